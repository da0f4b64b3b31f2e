"""Installed distributions with parts: their entry points, and their files by content."""

from __future__ import annotations

import hashlib
import os
import sysconfig
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from importlib.machinery import ModuleSpec
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Final

_PACKAGE: Final = Path(__file__).parents[2]
_PYTHON: Final = tuple(sysconfig.get_path(name) + os.sep for name in ("stdlib", "platstdlib"))
_INSTALLED: Final = {"site-packages", "dist-packages"}
Stamps = dict[str, tuple[int, int]]
CHANGED: Final = "+"  # after the hash of files changed since this process loaded them


@lru_cache(maxsize=1)
def parts() -> dict[str, dict[str, EntryPoint]]:
    """The entry points of all installed parts, by seam and name."""
    found: dict[str, dict[str, EntryPoint]] = {}
    every = entry_points()  # reads files of all installed packages
    for group in sorted(every.groups):
        if group.startswith("swarmsim."):
            named = found.setdefault(group.removeprefix("swarmsim."), {})
            for entry in sorted(every.select(group=group), key=lambda entry: entry.name):
                named.setdefault(entry.name, entry)
    return found


@lru_cache(maxsize=1)
def plugins() -> frozenset[str]:
    """The top-level packages of all installed parts."""
    return frozenset(entry.module.partition(".")[0] for named in parts().values() for entry in named.values())


def ours() -> str:
    """A hash of the code of this package."""
    return _content(frozenset([_PACKAGE]))


def plugin(entry: EntryPoint) -> tuple[str, str]:
    """The name of a part's distribution, and a hash of its files."""
    top = entry.module.partition(".")[0]
    if entry.dist is None:
        return top, module(top)
    listed = [Path(str(entry.dist.locate_file(file))) for file in entry.dist.files or () if _counts(file.parts)]
    return entry.dist.name, _content(frozenset(listed) | _homes(top))


def module(name: str) -> str:
    """A hash of an installed module's package; empty without files."""
    homes = _homes(name.partition(".")[0])
    return _content(homes) if homes else ""


@dataclass(frozen=True, slots=True)
class Home:
    """Where a module is."""

    installed: bool  # with Python, with a distribution, or in no file
    folder: Path | None  # that it is imported from; None if it is not found


def home_of(top: str) -> Home:
    """Where Python finds the module of this name."""
    spec = _spec(top)
    if spec is None:
        return Home(top in plugins(), None)
    place = next(iter(spec.submodule_search_locations or ()), spec.origin if spec.has_location else None)
    if (
        place is None
        or top in plugins() | {"__main__"}
        or place.startswith(_PYTHON)
        or _INSTALLED.intersection(Path(place).parts)
    ):
        return Home(True, None)
    is_source = bool(spec.submodule_search_locations) or place.endswith(".py")
    return Home(not is_source, Path(os.path.normpath(Path.cwd() / place)).parent if is_source else None)


def _spec(top: str) -> ModuleSpec | None:
    try:
        return find_spec(top)
    except (ImportError, ValueError):  # as of __main__, and of modules that a session made itself
        return None


def _counts(parts: tuple[str, ...]) -> bool:
    """Whether a file that a distribution lists affects what it does."""
    top = parts[0]
    if top.endswith(".dist-info") or top.startswith("__editable__") or ".." in parts:
        return False
    return not parts[-1].endswith((".pyc", ".pth"))


@lru_cache(maxsize=256)
def _homes(top: str) -> frozenset[Path]:
    """The folders of a package, or the file of a module."""
    spec = _spec(top)
    if spec is None:
        return frozenset()
    inner = list(spec.submodule_search_locations or ())
    return frozenset(map(Path, inner or ([spec.origin] if spec.has_location and spec.origin else [])))


def _content(places: frozenset[Path]) -> str:
    """A hash of these files, and of the code in these folders, as this process first found them.

    It ends with CHANGED if they differ by now: then it is unknown which version this process has loaded.
    """
    files, folders, found = _first(places)
    same = (_are_as(files) and _are_as(folders)) or _stamps(places)[
        0
    ] == files  # folders change by what is no code, too
    return found if same else found + CHANGED


@lru_cache(maxsize=64)
def _first(places: frozenset[Path]) -> tuple[Stamps, Stamps, str]:
    stamps, folders = _stamps(places)
    made = hashlib.blake2b(digest_size=8)
    files = sorted(map(Path, stamps))
    above = os.path.commonpath([place.parent for place in places]) if places else ""
    for file in files:
        text = file.read_bytes()
        made.update(f"{os.path.relpath(file, above)}\0{len(text)}\0".encode())
        made.update(text)
    return stamps, folders, made.hexdigest()


def _stamps(places: Iterable[Path]) -> tuple[Stamps, Stamps]:
    """When each of these files, and of the files of code in these folders, was last changed, and its size.

    Beside them those of the folders, which change when a file comes or goes.
    """
    found: Stamps = {}
    folders: Stamps = {}
    for place in places:
        if not place.is_dir():
            found |= {str(place): _stamp(place.stat())} if place.is_file() else {}
        for folder, _, names in os.walk(place):
            folders[folder] = _stamp(os.stat(folder))  # noqa: PTH116 - for each run, and Path is slow
            code = [f"{folder}{os.sep}{name}" for name in names if name.endswith(".py")]
            found |= {file: _stamp(os.stat(file)) for file in code}  # noqa: PTH116
    return found, folders


def _are_as(stamps: Stamps) -> bool:
    """Whether these files or folders are as they were: faster than to look for them."""
    try:
        return all(_stamp(os.stat(path)) == stamp for path, stamp in stamps.items())  # noqa: PTH116
    except OSError:
        return False


def _stamp(status: os.stat_result) -> tuple[int, int]:
    return status.st_mtime_ns, status.st_size
