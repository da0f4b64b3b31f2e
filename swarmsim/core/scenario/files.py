"""Files: tables of numbers, pictures and code beside a scenario, and texts written whole or not at all."""

from __future__ import annotations

import io
import os
import stat
import tempfile
from pathlib import Path
from typing import Final

import msgspec

from swarmsim.core.errors import InputError, StorageError, is_of_the_machine, unwritten

LARGEST: Final = 64_000_000  # bytes of a file read whole
Table = dict[str, object]  # `use` and the keys of the part it names, or a whole scenario


def with_files(table: Table, folder: Path, place: str = "") -> Table:
    """The table with paths in it, or in tables inside it, resolved from `folder`.

    A value {file = "x.csv"} becomes the rows of that file; the path in `use = "./file.py:Name"` is written out. Raises
    InputError, which starts with the key (after `place`).
    """
    filled = dict(table)
    for key, value in table.items():
        if key == "use" and isinstance(value, str) and value.rpartition(":")[0].endswith(".py"):
            file, _, own = value.rpartition(":")
            filled[key] = f"{os.path.normpath(folder / file)}:{own}"
        elif isinstance(value, dict) and value.keys() == {"file"} and isinstance(value["file"], str):
            try:
                filled[key] = read_rows(folder / value["file"])
            except InputError as problem:
                raise InputError(f"{place}{key}: {problem}") from problem
        elif isinstance(value, dict):
            filled[key] = with_files(value, folder, f"{place}{key}.")
    return filled


def outside(table: Table, folder: Path, ours: Path | None = None) -> list[str]:
    """A notice for each file that a scenario's table reads from outside its `folder` and `ours`."""
    found: list[Path] = []

    def look(value: object) -> None:
        if isinstance(value, dict):
            found.extend(folder / one for key, one in value.items() if key == "file" and isinstance(one, str) and one)
            for inner in value.values():
                look(inner)
        elif isinstance(value, list):
            for inner in value:
                look(inner)

    look(table)
    homes = [home.resolve() for home in (folder, ours) if home is not None]
    away = [path for path in found if not any(path.resolve().is_relative_to(home) for home in homes)]
    return [f"reads {os.path.normpath(path)}, which lies outside of the scenario's folder" for path in away]


def content(path: Path, expected: str) -> bytes:
    """The bytes of a plain file of at most LARGEST bytes. Raises InputError, which names what was `expected`.

    Raises StorageError for a disk that cannot be read.
    """
    try:
        check_plain(path, expected)
        return path.read_bytes()
    except (OSError, ValueError) as problem:  # a path with a null character in it is a ValueError
        told = problem.strerror if isinstance(problem, OSError) else problem
        if is_of_the_machine(problem):
            raise StorageError(f"{path}: cannot be read ({told})") from problem
        raise InputError(f"{path}: cannot be read ({told}); expected {expected}") from problem


def check_plain(path: Path, expected: str, most: int | None = LARGEST) -> None:
    """Raise InputError unless this is a folder or a plain file of 1 to `most` bytes: other files may never end.

    System files, as in /proc, have length 0, and reading some blocks for ever. Raises OSError.
    """
    status = path.stat()
    if stat.S_ISDIR(status.st_mode):
        return
    if not stat.S_ISREG(status.st_mode):
        raise InputError(f"{path}: is no plain file; expected {expected}")
    if not status.st_size:
        raise InputError(f"{path}: is empty, or no plain file; expected {expected}")
    if most is not None and status.st_size > most:
        raise InputError(f"{path}: is larger than {most // 1_000_000} MB; expected {expected}")


def text_lines(path: Path, expected: str) -> list[str]:
    """The lines of a text file. Raises InputError, which names what was `expected`."""
    try:
        return content(path, expected).decode("utf-8-sig").splitlines()  # spreadsheets mark UTF-8
    except UnicodeDecodeError as problem:
        raise InputError(f"{path}: not UTF-8 text (byte {problem.start}); expected {expected}") from problem


def read_rows(path: Path) -> list[list[int | float]]:
    """The rows of a CSV file: numbers separated by commas, empty lines left out; for a PNG, its grey levels.

    Levels are 0 for black to 1 for white.

    Raises InputError, which names the file and the line.
    """
    if path.suffix.lower() == ".png":
        return _grey_levels(path)
    lines = text_lines(path, "a CSV file of numbers")
    rows = []
    for number, line in enumerate(lines, start=1):
        if line.strip():
            try:
                rows.append(msgspec.json.decode(f"[{line}]", type=list[int | float]))
            except msgspec.DecodeError as problem:
                raise InputError(
                    f"{path}, line {number}: not a row of numbers; expected numbers with commas between them, as in 0,1"
                ) from problem
    return rows


def write_whole(path: Path, text: str) -> None:
    """Write a text file whole, replacing an older one, or not at all.

    Raises InputError, and StorageError for a full disk.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(
            "w", dir=path.parent, prefix=f".{path.name}.", encoding="utf-8", delete=False
        ) as file:
            part = Path(file.name)
            try:
                file.write(text)
                file.close()
                part.chmod(0o644)
                part.replace(path)
            finally:
                part.unlink(missing_ok=True)
    except OSError as problem:
        raise unwritten(path, problem) from problem


def _grey_levels(path: Path) -> list[list[int | float]]:
    from PIL import Image  # slow to import, and rarely needed

    try:
        with Image.open(io.BytesIO(content(path, "a PNG picture"))) as picture:
            grey = picture.convert("L")
            levels, width = list(grey.tobytes()), grey.width
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as problem:
        raise InputError(f"{path}: cannot be read ({problem}); expected a PNG picture") from problem
    return [[level / 255.0 for level in levels[at : at + width]] for at in range(0, len(levels), width)]
