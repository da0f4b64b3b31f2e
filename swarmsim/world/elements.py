"""The elements of an SVG file, each with its place in the file, so that messages can name it."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from xml.parsers import expat

from swarmsim.core.errors import InputError

NUMBER = r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"  #: a number, as a regular expression
_SVG_NAMESPACE = "http://www.w3.org/2000/svg "


class ElementError(Exception):
    """What is wrong with one element; `Element.named` adds the file and the element."""


@dataclass(eq=False, slots=True)
class Element:
    """One XML element; names from other namespaces than SVG's are written `namespace name`."""

    tag: str
    attributes: dict[str, str]
    line: int
    number: int  # among the elements of its tag, from 1
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
    """The root of the SVG text `source`; expat itself reads it, because ElementTree forgets the lines."""
    parser = expat.ParserCreate("utf-8", " ")
    parser.buffer_text = True
    above = [Element("", {}, 0, 0)]
    counts: Counter[str] = Counter()

    def start(tag: str, attributes: dict[str, str]) -> None:
        tag = tag.removeprefix(_SVG_NAMESPACE)
        counts[tag] += 1
        element = Element(tag, attributes, parser.CurrentLineNumber, counts[tag])
        above[-1].children.append(element)
        above.append(element)

    def text(characters: str) -> None:
        above[-1].text += characters

    parser.StartElementHandler, parser.CharacterDataHandler = start, text
    parser.EndElementHandler = lambda _tag: above.pop()
    try:
        parser.Parse(source.encode(errors="surrogatepass"), True)  # expat refuses a surrogate, and says where
    except expat.ExpatError as error:
        raise InputError(
            f"{name}: line {error.lineno}, column {error.offset + 1}: not XML ({expat.ErrorString(error.code)}); "
            "save it as plain SVG"
        ) from None
    root = above[0].children[0]
    if root.tag != "svg":
        raise InputError(f"{name}: the root is <{root.tag}>, not <svg>; a world is drawn as SVG")
    return root


def numbers(text: str, what: str, counts: tuple[int, ...] = ()) -> list[float]:
    """The finite numbers in `text`, separated by blanks or commas, as many as one of `counts` says."""
    parts = text.replace(",", " ").split()
    if not all(re.fullmatch(NUMBER, part) and math.isfinite(float(part)) for part in parts):
        raise ElementError(f"{what} is {quoted(text)}; it should hold numbers alone, of finite size")
    if counts and len(parts) not in counts:
        raise ElementError(f"{what} has {len(parts)} numbers; it should have {' or '.join(map(str, counts))}")
    return [float(part) for part in parts]


def quoted(text: str) -> str:
    """`text` in quotes, cut to what a message bears."""
    return repr(text if len(text) <= 40 else f"{text[:37]}...")
