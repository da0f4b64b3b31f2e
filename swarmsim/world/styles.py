"""The paint of SVG elements, as attributes, style attributes and style sheets say it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from swarmsim.world.elements import Element, ElementError, quoted

Style = Mapping[str, str]  # value by property, for each property in INITIAL

#: What applies when nothing is said; all of it is inherited here, also where a mask or clip is only once.
INITIAL: Style = {
    "fill": "black", "fill-rule": "nonzero", "stroke": "none", "stroke-width": "1", "stroke-linecap": "butt",
    "stroke-linejoin": "miter", "stroke-miterlimit": "4", "display": "inline", "visibility": "visible",
    "clip-path": "none", "mask": "none", "stroke-dasharray": "none", "vector-effect": "none",
}  # fmt: skip
_RULE = re.compile(r"([^{}]*)\{([^{}]*)\}")
_SELECTOR = re.compile(r"\*|[\w-]+|[\w-]*\.[\w-]+|#[\w-]+")


@dataclass(frozen=True, slots=True)
class StyleSheet:
    """The rules that say anything about what is solid, by selector, those that override others last."""

    rules: list[tuple[str, Style]]

    @classmethod
    def of(cls, text: str) -> StyleSheet:
        """The rules of the text of <style> elements."""
        rules = []
        for selectors, body in _RULE.findall(re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)):
            declarations = _declarations(body)
            if not declarations.keys() & {*INITIAL, "transform"}:
                continue
            for selector in map(str.strip, selectors.split(",")):
                if not _SELECTOR.fullmatch(selector):
                    raise ElementError(f"the style sheet selects {quoted(selector)}; use a plain tag, .class or #id")
                rules.append((selector, declarations))
        return cls(sorted(rules, key=lambda rule: ("#" in rule[0], "." in rule[0], rule[0] != "*")))

    def styled(self, element: Element, inherited: Style) -> Style:
        """What `element` inherits, overridden by its attributes, this sheet and its style attribute, in this order."""
        own = {key: value.strip() for key, value in element.attributes.items() if key in INITIAL}
        marks = {"*", element.tag, f"#{element.attributes.get('id', '')}"}
        for name in element.attributes.get("class", "").split():
            marks |= {f".{name}", f"{element.tag}.{name}"}
        for selector, declarations in self.rules:
            own |= declarations if selector in marks else {}
        own |= _declarations(element.attributes.get("style", ""))
        if "transform" in own:
            raise ElementError("its style has a transform; write it as the attribute `transform`")
        return {**inherited, **{key: own[key] for key in own.keys() & INITIAL.keys() if own[key] != "inherit"}}


def _declarations(text: str) -> dict[str, str]:
    """The properties in a style attribute or between the braces of a rule."""
    pairs = (part.partition(":") for part in text.split(";"))
    return {key.strip(): value.replace("!important", "").strip() for key, _, value in pairs if value.strip()}
