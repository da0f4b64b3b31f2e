"""XML files other than drawings: maps and simulators' worlds."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Protocol, overload

from lxml import etree

from swarmsim.core.errors import InputError
from swarmsim.core.scenario.files import content


class Node(Protocol):
    """An element of an XML file, as lxml gives it."""

    tag: str
    text: str | None
    sourceline: int

    def __iter__(self) -> Iterator[Node]: ...

    @overload
    def get(self, key: str) -> str | None: ...

    @overload
    def get(self, key: str, default: str) -> str: ...

    def find(self, path: str) -> Node | None:
        """The first element there."""

    def findtext(self, path: str) -> str | None:
        """Its text."""

    def iterfind(self, path: str) -> Iterator[Node]:
        """All elements there."""

    def iterchildren(self, *tags: str) -> Iterator[Node]:
        """The children of these kinds."""


def parsed(path: Path, root: str, expected: str) -> Node:
    """The element `root` of an XML file, without comments. Nothing outside of the file is read.

    Raises InputError, which says what was `expected` and repeats nothing of the file.
    """
    reader = etree.XMLParser(
        resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False, remove_comments=True, remove_pis=True
    )
    try:
        found: Node = etree.fromstring(content(path, expected), reader)
    except etree.XMLSyntaxError as error:
        line, column = error.position
        kind = error.error_log.last_error.type_name if len(error.error_log) else ""
        reason = kind.removeprefix("ERR_").replace("_", " ").lower() or "no element in it"
        raise InputError(
            f"{path}: line {max(line, 1)}, column {max(column, 1)}: not XML ({reason}); expected {expected}"
        ) from None
    if found.tag != root:
        raise InputError(f"{path}: the root is not <{root}>; expected {expected}")
    return found
