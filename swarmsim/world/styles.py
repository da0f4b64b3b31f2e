"""The paint of SVG elements, by attributes, style attributes and style sheets."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Final, Protocol

import cssselect2
import tinycss2
from tinycss2 import color4

from swarmsim.world.elements import NUMBER, Element, quoted

Style = Mapping[str, str]  # value by property, for each property in INITIAL

#: The properties of an element that says nothing itself.
_OWN: Final = {
    "display": "inline", "opacity": "1", "clip-path": "none", "mask": "none", "overflow": "hidden", "transform": "",
    "transform-origin": "", "transform-box": "view-box", "vector-effect": "none",
}  # fmt: skip
#: The properties of an element if neither it nor those around it say anything.
INITIAL: Final[Style] = {
    "fill": "black", "fill-opacity": "1", "fill-rule": "nonzero", "clip-rule": "nonzero", "stroke": "none",
    "stroke-opacity": "1", "stroke-width": "1", "stroke-linecap": "butt", "stroke-linejoin": "miter",
    "stroke-miterlimit": "4", "visibility": "visible", "color": "black", **_OWN,
}  # fmt: skip
_AS_WRITTEN: Final = frozenset({"fill", "stroke", "clip-path", "mask", "transform", "color"})  # ids have their case
_SEEN_BY: Final = frozenset({"", "all", "screen"})  # media of a drawing on a screen
_QUERY: Final = re.compile(r"(?:(only|not)\s+)?([a-z-]*)\s*(.*)", re.DOTALL)
_REFERENCE: Final = re.compile(r"url\(\s*[\"']?(.*?)[\"']?\s*\)\s*(.*)", re.DOTALL | re.IGNORECASE)

_SHADED: Final = 0.75  # the luminance of gradients and patterns

_Declarations = list[tuple[str, str, bool]]  # property, value, whether it is important


class _Token(Protocol):
    """A rule, a declaration or a token of tinycss2; its type says which of the others it has."""

    type: str
    lower_at_keyword: str
    lower_name: str
    prelude: Sequence[_Token]
    content: Sequence[_Token] | None
    value: Sequence[_Token]
    important: bool


@dataclass(slots=True)
class StyleSheet:
    """The rules that matter for solids."""

    _matcher: cssselect2.Matcher = field(default_factory=cssselect2.Matcher)
    _rules: int = 0
    notices: list[str] = field(default_factory=list)  # on unknown contents

    @classmethod
    def of(cls, styles: Iterable[Element]) -> StyleSheet:
        """The rules in <style> elements, in their order."""
        sheet = cls()
        for element in styles:
            kind = element.attributes.get("type", "text/css").strip().lower()
            if kind in {"", "text/css"} and sheet._applies(element.attributes.get("media", "")):
                sheet._add(tinycss2.parse_stylesheet(element.text, skip_comments=True, skip_whitespace=True))
        return sheet

    def _add(self, rules: Iterable[_Token]) -> None:
        for rule in rules:
            if rule.type == "qualified-rule":
                self._add_rule(rule)
            elif rule.type == "at-rule" and rule.lower_at_keyword == "media" and rule.content is not None:
                if self._applies(tinycss2.serialize(rule.prelude)):
                    self._add(tinycss2.parse_rule_list(rule.content, skip_comments=True, skip_whitespace=True))
            elif rule.type == "at-rule" and rule.lower_at_keyword == "import":
                self.notices.append("its style sheet imports another one, which is not read")

    def _add_rule(self, rule: _Token) -> None:
        declarations = _declarations(rule.content)
        if not declarations:
            return
        try:
            selectors = cssselect2.compile_selector_list(rule.prelude)
        except cssselect2.SelectorError:
            selector = quoted(tinycss2.serialize(rule.prelude).strip())
            self.notices.append(f"its style sheet selects {selector}, which is not understood and selects nothing")
            return
        for selector in selectors:
            if selector.pseudo_element is None:
                self._rules += 1
                self._matcher.add_selector(selector, declarations)

    def _applies(self, media: str) -> bool:
        """Whether a list of media queries holds for a screen; queries for its size count as false."""
        applies = not media.strip()
        for query in media.lower().split(","):
            negated, kind, features = _QUERY.findall(query.strip())[0]  # it matches anything
            if features:
                self.notices.append(f"its style sheet has rules for {quoted(query.strip())}, which are passed over")
            else:
                applies |= bool(query.strip()) and (kind in _SEEN_BY) != (negated == "not")
        return applies

    def styled(self, element: Element, inherited: Style) -> Style:
        """The inherited properties of `element`, overridden in the order of CSS.

        That is by its attributes, this sheet, its style attribute, and the important declarations in the sheet and in
        the attribute.
        """
        attributes = element.attributes
        own = [(key, value.strip()) for key, value in attributes.items() if key in INITIAL]
        important: list[tuple[str, str]] = []
        said = [match[3] for match in self._matcher.match(element.node)] if self._rules else []
        if "style" in attributes:
            said.append(_declarations(attributes["style"]))
        for declarations in said:
            for key, value, outranks in declarations:
                (important if outranks else own).append((key, value))
        found = {**inherited, **_OWN}
        for key, value in own + important:
            word = value.lower()
            if word in {"inherit", "unset"}:
                found[key] = inherited[key] if key not in _OWN or word == "inherit" else _OWN[key]
            elif word == "initial":
                found[key] = INITIAL[key]
            elif value:
                found[key] = value if key in _AS_WRITTEN else word
        return found


def _declarations(source: str | Sequence[_Token] | None) -> _Declarations:
    """The properties in a style attribute or between the braces of a rule, without those irrelevant for solids."""
    found = tinycss2.parse_blocks_contents(source, skip_comments=True, skip_whitespace=True)
    return [
        (one.lower_name, _serialized(one.value), one.important)
        for one in found
        if one.type == "declaration" and one.lower_name in INITIAL
    ]


def _serialized(tokens: Iterable[_Token]) -> str:
    return str(tinycss2.serialize([token for token in tokens if token.type != "comment"])).strip()


def reference(value: str) -> tuple[str, str] | None:
    """The id in `url(#id)` and the text after it; None for any other value."""
    match = _REFERENCE.fullmatch(value)
    return (match[1].removeprefix("#"), match[2].strip()) if match else None


@dataclass(frozen=True, slots=True)
class Paint:
    """The paint of a fill or a stroke."""

    alpha: float  # 0 to 1: opaque
    luminance: float  # 0 to 1: white

    @property
    def darkness(self) -> float:
        """How much it darkens a white page, 0 to 1."""
        return self.alpha * (1.0 - self.luminance)


def paint(style: Style, kind: str, ids: Mapping[str, object]) -> Paint | None:
    """The paint of a style's "fill" or "stroke"; None for nothing.

    Gradients and patterns, and colours other than sRGB, count as light grey.
    """
    value = style[kind]
    found = reference(value)
    if found is not None:
        if found[0] in ids:
            return _visible(fraction(style[f"{kind}-opacity"]), _SHADED)
        value = found[1] or "none"
    if value.lower() == "none":
        return None
    if value.lower() == "currentcolor":
        value = style["color"]
    alpha, light = _colour(value)
    return _visible(fraction(style[f"{kind}-opacity"]) * alpha, light)


@lru_cache(maxsize=1024)
def _colour(value: str) -> tuple[float, float]:
    """The alpha and the luminance of a colour."""
    try:
        colour = color4.parse_color(value)
    except ValueError:
        colour = None
    if colour is None or colour == "currentcolor":
        return 1.0, _SHADED
    alpha = float(colour.alpha if colour.alpha is not None else 1.0)
    try:
        red, green, blue = colour.to("srgb").coordinates
    except NotImplementedError:
        return alpha, _SHADED
    light = 0.2126 * float(red or 0.0) + 0.7152 * float(green or 0.0) + 0.0722 * float(blue or 0.0)
    return alpha, min(max(light, 0.0), 1.0)


def _visible(alpha: float, light: float) -> Paint | None:
    return Paint(alpha, light) if alpha > 0.0 else None


def luminance(style: Style, kind: str, ids: Mapping[str, object]) -> float | None:
    """The brightness of a paint in a mask, 0 to 1 times its opacity; None for no paint.

    Anything but a plain colour counts as bright.
    """
    found = paint(style, kind, ids)
    if found is None:
        return None
    return found.alpha * (1.0 if found.luminance == _SHADED else found.luminance)


def fraction(text: str) -> float:
    """A number from 0 to 1 or a percentage; 1 for anything else, as in CSS."""
    match = re.fullmatch(rf"\s*({NUMBER})\s*(%?)\s*", text)
    return min(max(float(match[1]) / (100.0 if match[2] else 1.0), 0.0), 1.0) if match else 1.0
