"""The elements of an SVG file, each with its place in the file, for messages."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import cssselect2
from lxml import etree

from swarmsim.core.errors import InputError

NUMBER = r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"  #: a number, as a regular expression
_SVG_NAMESPACE = "{http://www.w3.org/2000/svg}"
_UNDECLARED = "NS_ERR_UNDEFINED_NAMESPACE"
_PREFIX = re.compile(r"Namespace prefix (\S+)")
_START = re.compile(r"<(?:[\w.-]+:)?svg(?=[\s>/])")
#: Prefixes that programs write and that get lost when a drawing is embedded in a page.
_NAMESPACES = {
    "xlink": "http://www.w3.org/1999/xlink",
    "inkscape": "http://www.inkscape.org/namespaces/inkscape",
    "sodipodi": "http://sodipodi.sourceforge.net/DTD/sodipodi-0.dtd",
    "svg": "http://www.w3.org/2000/svg",
    "serif": "http://www.serif.com/",
    "sketch": "http://www.bohemiancoding.com/sketch/ns",
    "rdf": "http://www.w3.org/1999/02/22-rdf-syntax-ns#",
    "cc": "http://creativecommons.org/ns#",
    "dc": "http://purl.org/dc/elements/1.1/",
}
_REASONS = {
    "ERR_TAG_NAME_MISMATCH": "mismatched tag",
    "ERR_UNDECLARED_ENTITY": "undefined entity",
    "ERR_RESOURCE_LIMIT": (
        "its entities or elements multiply without end or are nested without end, or a text in it is longer than 10 MB"
    ),
    "ERR_DOCUMENT_EMPTY": "no element in it",
}


class ElementError(Exception):
    """An error in one element; `Element.named` adds the file and the element."""


@dataclass(eq=False, slots=True)
class Element:
    """One XML element; names from other namespaces than SVG's are written `{namespace}name`."""

    tag: str
    attributes: dict[str, str]
    line: int
    number: int  # among the elements of its tag, from 1
    node: cssselect2.ElementWrapper  # the same for style sheets
    children: list[Element] = field(default_factory=list)
    text: str = ""

    def __str__(self) -> str:
        mark = f' id="{self.attributes["id"]}">' if "id" in self.attributes else f"> number {self.number}"
        return f"<{self.tag}{mark} (line {self.line})"

    def tree(self) -> Iterator[Element]:
        """The element itself and all below it, in the order of the file."""
        waiting = [self]
        while waiting:
            element = waiting.pop()
            yield element
            waiting.extend(reversed(element.children))

    @contextmanager
    def named(self, name: str) -> Iterator[None]:
        """Turns an ElementError in its block into an InputError about this element of the file `name`."""
        try:
            yield
        except ElementError as wrong:
            raise InputError(f"{name}: {self}: {wrong}") from None


def parse(source: str, name: str) -> Element:
    """The root of the SVG text `source`; the encoding that it declares is ignored.

    Nothing outside of the text is read. Its own entities are replaced, within libxml2's limits. Messages repeat nothing
    of a text that is not SVG. Raises InputError.
    """
    try:
        root = _root(source)
    except etree.XMLSyntaxError as error:
        kind = error.error_log.last_error.type_name if len(error.error_log) else ""
        reason = _REASONS.get(kind, kind.removeprefix("ERR_").replace("_", " ").lower() or "no element in it")
        if kind == _UNDECLARED and (match := _PREFIX.search(error.error_log.last_error.message)):
            reason = f"nothing declares the prefix {quoted(match[1])}"
        line, column = error.position
        raise InputError(
            f"{name}: line {max(line, 1)}, column {max(column, 1)}: not XML ({reason}); save it as plain SVG"
        ) from None
    if _tag(root) != "svg":
        raise InputError(f"{name}: the root is not an <svg> element; a world is drawn as SVG")
    return _tree(root)


def _root(source: str) -> etree._Element:
    """The root of a text; the usual prefixes need no declaration, and elements may be nested deeply.

    Raises XMLSyntaxError.
    """
    try:
        return _parsed(source, deep=False)
    except etree.XMLSyntaxError as error:
        kind = error.error_log.last_error.type_name if len(error.error_log) else ""  # before it: those of other texts
        if kind == "ERR_RESOURCE_LIMIT" and "<!ENTITY" not in source:
            return _parsed(source, deep=True)
        if kind != _UNDECLARED:
            raise
    missing = [prefix for prefix in _NAMESPACES if f"xmlns:{prefix}=" not in source]
    declared = "".join(f' xmlns:{prefix}="{_NAMESPACES[prefix]}"' for prefix in missing)
    return _parsed(_START.sub(lambda match: match[0] + declared, source, count=1), deep=False)


def _parsed(source: str, *, deep: bool) -> etree._Element:
    reader = etree.XMLParser(
        encoding="utf-8", resolve_entities="internal", no_network=True, load_dtd=False, huge_tree=deep,
        remove_comments=True, remove_pis=True,
    )  # fmt: skip
    return etree.fromstring(source.encode(errors="surrogatepass"), reader)  # libxml2 refuses a surrogate


def _tree(root: etree._Element) -> Element:
    """Our elements made from lxml's."""
    counts: Counter[str] = Counter()
    made: dict[etree._Element, Element] = {}
    for node in cssselect2.ElementWrapper.from_xml_root(root).iter_subtree():
        found = node.etree_element
        tag = _tag(found)
        counts[tag] += 1
        element = Element(
            tag, dict(found.attrib), found.sourceline or 0, counts[tag], node, text="".join(found.itertext())
        )
        made[found] = element
        if (above := found.getparent()) is not None:
            made[above].children.append(element)
    return made[root]


def _tag(element: etree._Element) -> str:
    return str(element.tag).removeprefix(_SVG_NAMESPACE)


def numbers(text: str, what: str, counts: tuple[int, ...] = ()) -> list[float]:
    """The finite numbers in `text`, separated by blanks or commas; `counts` are the possible numbers of them."""
    parts = text.replace(",", " ").split()
    if not all(re.fullmatch(NUMBER, part) and math.isfinite(float(part)) for part in parts):
        raise ElementError(f"{what} is {quoted(text)}; it should hold numbers alone, of finite size")
    if counts and len(parts) not in counts:
        raise ElementError(f"{what} has {len(parts)} numbers; it should have {' or '.join(map(str, counts))}")
    return [float(part) for part in parts]


def quoted(text: str) -> str:
    """`text` in quotes, cut to fit a message."""
    return repr(text if len(text) <= 40 else f"{text[:37]}...")
