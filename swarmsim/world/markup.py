"""XML files that are no drawings: maps and simulators' worlds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from lxml import etree

from swarmsim.core.errors import InputError
from swarmsim.core.files import content


def parsed(path: Path, root: str, expected: str) -> Any:
    """The element `root` of an XML file, without comments. Nothing outside of the file is read.

    Raises InputError, where it was `expected`, which repeats nothing of the file.
    """
    reader = etree.XMLParser(
        resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False, remove_comments=True, remove_pis=True
    )
    try:
        found = etree.fromstring(content(path, expected), reader)
    except etree.XMLSyntaxError as error:
        line, column = error.position
        kind = error.error_log.last_error.type_name if len(error.error_log) else ""
        reason = kind.removeprefix("ERR_").replace("_", " ").lower() or "no element in it"
        raise InputError(
            f"{path}: line {max(line, 1)}, column {max(column, 1)}: not XML ({reason}); expected {expected}"
        ) from None
    if found.tag != root:
        raise InputError(f"{path}: the root is no <{root}> element; expected {expected}")
    return found
