"""Venues in the Indoor Mapping Data Format: a folder or an archive with a GeoJSON file for each type of feature."""

from __future__ import annotations

import lzma
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import Final

from swarmsim.core.errors import InputError
from swarmsim.core.scenario.file import World
from swarmsim.core.scenario.files import LARGEST, content
from swarmsim.world import geojson
from swarmsim.world.indoor.drawings import drawn
from swarmsim.world.indoor.features import Feature
from swarmsim.world.shapes import Drawing

_FILES: Final = ("unit", "opening", "level", "fixture", "kiosk")  # files of a venue for a floor plan
_BROKEN: Final = (
    zipfile.BadZipFile, zlib.error, lzma.LZMAError, EOFError, ValueError, RuntimeError, NotImplementedError
)  # fmt: skip
_EXPECTED: Final = "a venue in IMDF, a folder or .zip with unit.geojson"


def read(path: Path, world: World) -> Drawing:
    """One level of a venue: units are floor with walls between them, openings are doors.

    `world.level` is a level's id, name, short name or ordinal, required if there are several. Raises InputError.
    """
    name = str(path)
    found: list[Feature] = []
    for member, text in _folder(path) if path.is_dir() else _archive(path):
        kind = PurePosixPath(member).name.partition(".")[0]
        for feature in geojson.features(geojson.parsed(text, f"{name}, {member}"), f"{name}, {member}"):
            properties = {"feature_type": kind, **feature.properties}
            found.append(Feature(properties, feature.shape, f"{member}, {feature.where}"))
    if not any(feature.properties["feature_type"] == "unit" for feature in found):
        raise InputError(f"{name}: no unit.geojson in it that holds units; expected {_EXPECTED}")
    return drawn(found, name, world, unit="degrees")


def _folder(path: Path) -> Iterator[tuple[str, str]]:
    """Name and text of the needed files, none from outside of the folder."""
    for kind in _FILES:
        file = path / f"{kind}.geojson"
        if file.is_file():
            if not file.resolve().is_relative_to(path.resolve()):
                raise InputError(f"{path}: {file.name} lies outside of it; expected {_EXPECTED}")
            yield file.name, _text(content(file, _EXPECTED), path, file.name)


def _archive(path: Path) -> Iterator[tuple[str, str]]:
    """The same for an archive; it unpacks at most the size limit of a file."""
    try:
        with path.open("rb") as file, zipfile.ZipFile(file) as archive:
            members = sorted(archive.infolist(), key=lambda member: (member.filename.count("/"), member.filename))
            left = LARGEST
            for kind in _FILES:
                member = next((one for one in members if _kind(one.filename) == kind), None)
                if member is None:
                    continue
                with archive.open(member) as packed:
                    plain = packed.read(left + 1)
                left -= len(plain)
                if left < 0:
                    raise InputError(f"{path}: unpacks to more than {LARGEST // 1_000_000} MB; expected {_EXPECTED}")
                yield member.filename, _text(plain, path, member.filename)
    except OSError as problem:
        raise InputError(f"{path}: cannot be read ({problem.strerror or problem}); expected {_EXPECTED}") from problem
    except (
        zipfile.BadZipFile,
        zlib.error,
        lzma.LZMAError,
        EOFError,
        ValueError,
        RuntimeError,
        NotImplementedError,
    ) as problem:
        raise InputError(f"{path}: a broken or locked archive; expected {_EXPECTED}") from problem


def _kind(member: str) -> str:
    """The type of feature in a file of an archive, or nothing for macOS's shadow files."""
    file = PurePosixPath(member)
    return file.stem if file.suffix == ".geojson" and "__MACOSX" not in file.parts else ""


def _text(raw: bytes, path: Path, member: str) -> str:
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as problem:
        raise InputError(
            f"{path}: {member} is not UTF-8 text (byte {problem.start}); expected {_EXPECTED}"
        ) from problem
