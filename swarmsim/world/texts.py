"""Files of buildings as text, in any encoding, compressed or not."""

from __future__ import annotations

import re
import zlib
from pathlib import Path
from typing import Final

from swarmsim.core.errors import InputError
from swarmsim.core.scenario.files import LARGEST, check_plain, content

_DECLARED: Final = re.compile(rb"<\?xml[^>]*?encoding\s*=\s*[\"']([A-Za-z0-9._-]+)[\"']")
_MARKS: Final = {b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16", b"\xef\xbb\xbf": "utf-8-sig"}
_GZIP: Final = b"\x1f\x8b"


def check_file(path: Path, expected: str, most: int = LARGEST) -> None:
    """Raise InputError unless there is a plain file of at most `most` bytes."""
    if not path.exists():
        raise InputError(f"world: {path} cannot be read (no such file); expected {expected}")
    if path.is_dir():
        raise InputError(f"world: {path} is a folder, no plain file; expected {expected}")
    try:
        check_plain(path, expected, most)
    except InputError as problem:
        raise InputError(f"world: {problem}") from problem


def text_of(path: Path) -> str:
    """The text of a file, in the encoding given by its first bytes or its XML declaration, or else UTF-8."""
    try:
        packed = content(path, "a drawing")
    except InputError as problem:
        raise InputError(f"world: {problem}") from problem
    plain = _unpacked(packed, path) if packed.startswith(_GZIP) else packed
    declared = _DECLARED.search(plain[:200])
    marked = next((encoding for mark, encoding in _MARKS.items() if plain.startswith(mark)), None)
    encoding = marked or (declared[1].decode("ascii") if declared else "utf-8")
    try:
        return plain.decode(encoding)
    except LookupError:
        raise InputError(
            f"world: {path} declares the encoding {encoding!r}, which does not exist; save it as UTF-8"
        ) from None
    except UnicodeDecodeError as problem:
        raise InputError(
            f"world: {path} is not {encoding.upper()} text (byte {problem.start}); expected a drawing in the encoding "
            "that it declares"
        ) from None


def _unpacked(content: bytes, path: Path) -> bytes:
    """The contents of a compressed drawing (SVGZ). Raises InputError if they are broken or far too large."""
    reader = zlib.decompressobj(wbits=31)
    try:
        plain = reader.decompress(content, LARGEST + 1)
    except zlib.error:
        raise InputError(f"world: {path} is a broken gzip file; expected a whole SVGZ") from None
    if len(plain) > LARGEST:
        raise InputError(f"world: {path} unpacks to more than {LARGEST // 1_000_000} MB; expected a drawing")
    if not reader.eof:
        raise InputError(f"world: {path} is a broken gzip file; expected a whole SVGZ")
    return plain
