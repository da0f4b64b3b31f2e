"""A paper as a folder: what it published and claims, how it is read, and the studies that do its experiments again."""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final, Literal

from msgspec import Meta, Struct

from swarmsim.core.errors import InputError, nearest
from swarmsim.core.scenario import shipped
from swarmsim.core.scenario.decoding import read_struct
from swarmsim.core.scenario.files import text_lines
from swarmsim.studies.claims import Check
from swarmsim.studies.plan import Plan, changes_of, open_study, read_study

ABOUT: Final = "paper.toml"
READINGS: Final = "readings.toml"
Name = Annotated[str, Meta(pattern=r"^[\w-]+$")]  # files are called by it


class Figure(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A picture of one study, for each reading."""

    name: Name
    kind: Literal["curves", "distributions", "scaling", "sweep"]
    study: str
    title: str
    caption: str
    measure: str = ""  # of a sweep; default: iterations
    marks: dict[str, tuple[int, ...]] = {}  # of curves: iterations at which something befell a condition


class Listing(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A table of one measure: mean, interval and number of runs of each condition of a study."""

    title: str
    study: str
    measure: str = "iterations"  # also "speed", one over them, or a measure of the runs


class About(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What `paper.toml` says."""

    cite: str  # authors and year
    title: str
    doi: str = ""
    studies: Annotated[dict[str, str], Meta(min_length=1)]  # study files, from the folder, by the paper's names
    published: str = "iterations"  # the measure of published numbers, which is their column too
    figure: tuple[Figure, ...] = ()
    table: tuple[Listing, ...] = ()


class Reading(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One way to read what a paper says and what it leaves open."""

    name: Name = "reading"
    title: str = "as published"
    given: tuple[tuple[str, str], ...] = ()  # what the paper says, and how it is read
    changes: dict[str, object] = {}  # of the studies' scenarios, by dotted key
    conditions: dict[str, str] = {}  # the paper's names of conditions that are other ones of its study
    calibrated: tuple[str, ...] = ()  # the published numbers by which open choices were made, or "all"
    calibration: str | None = None  # the study in which they were made, from the folder


class Readings(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What `readings.toml` says."""

    reading: Annotated[tuple[Reading, ...], Meta(min_length=1)] = (Reading(),)
    rows: tuple[str, ...] = ()  # keys of a scenario that say which published number a calibration's run is held to


class Claim(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What the paper says, in words that tests can decide on."""

    text: str
    source: str  # where the paper says so
    margin: str = ""  # where the limits of its tests come from
    test: Annotated[tuple[Check, ...], Meta(min_length=1)]


class Claims(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What `claims.toml` says."""

    claim: Annotated[tuple[Claim, ...], Meta(min_length=1)]


@dataclass(frozen=True, slots=True)
class Published:
    """A number that the paper printed of one condition."""

    study: str
    condition: str
    value: float
    row: str  # what a calibration's tables call it


@dataclass(frozen=True, slots=True)
class Paper:
    """A folder whose files have been read and fit one another."""

    folder: Path
    about: About
    readings: Readings
    claims: tuple[Claim, ...]
    published: tuple[Published, ...]

    def plans(self, reading: Reading, seeds: int | None = None) -> dict[str, Plan]:
        """Its studies in a reading, by name; `seeds` replaces their numbers of seeds. Raises InputError."""
        files = self.about.studies.items()
        return {name: open_study(self.folder / file, seeds, reading.changes) for name, file in files}

    def read(self, names: Sequence[str] = ()) -> list[Reading]:
        """The readings of these names, by default all. Raises InputError for a name that there is not."""
        known = {reading.name: reading for reading in self.readings.reading}
        for name in names:
            if name not in known:
                raise InputError(f"{name}: no such reading; known: {', '.join(known)}")
        return [known[name] for name in dict.fromkeys(names or known)]


def find_paper(given: str) -> Path:
    """The folder of a paper: one on the disk, or a shipped one by its name. Raises InputError, which lists those."""
    home = shipped.root() / "papers"
    for folder in (Path(given), home / given, home.parent / given):
        if os.path.isfile(folder / ABOUT):  # noqa: PTH113 - whatever is typed, and be it no path at all
            return folder
    known = ", ".join(path.parent.name for path in sorted(home.glob(f"*/{ABOUT}")))
    raise InputError(f"{given}: no such paper; expected a folder with a file {ABOUT}, or one of those known: {known}")


def open_paper(folder: Path) -> Paper:
    """Read a paper's folder: `paper.toml`, `claims.toml` and, if they are there, `readings.toml` and `published.csv`.

    Raises InputError that names the file, and in it the key or the line at fault.
    """
    about = read_struct(folder / ABOUT, "what is said of a paper", About)
    path = folder / READINGS
    readings = read_struct(path, "readings of a paper", Readings) if path.exists() else Readings()
    known = _Known({name: _conditions(folder, name, file) for name, file in about.studies.items()}, readings.reading)
    for i, figure in enumerate(about.figure):
        known.check(f"{folder / ABOUT}: figure[{i}]", figure.study, figure.marks)
    for i, listing in enumerate(about.table):
        known.check(f"{folder / ABOUT}: table[{i}]", listing.study, ())
    claims = read_struct(folder / "claims.toml", "claims of a paper", Claims).claim
    checks = {f"claim[{i}].test[{j}]": one for i, claim in enumerate(claims) for j, one in enumerate(claim.test)}
    for place, check in checks.items():
        known.check(f"{folder / 'claims.toml'}: {place}", check.study, check.conditions)
        for name in check.but:
            if name not in check.conditions:
                raise InputError(f"{folder / 'claims.toml'}: {place}.but: {name!r} is none of its conditions")
    numbers = folder / "published.csv"
    published = _published(numbers, about.published, known) if numbers.exists() else ()
    named = [name for check in checks.values() for name in check.conditions]
    _check_readings(folder, readings.reading, [number.condition for number in published], named)
    return Paper(folder, about, readings, claims, published)


@dataclass(frozen=True, slots=True)
class _Known:
    """The studies of a paper with their conditions, to which all else in its folder refers."""

    studies: Mapping[str, Mapping[str, object]]
    readings: tuple[Reading, ...]

    def check(self, place: str, study: str, conditions: Iterable[str]) -> None:
        """Raise InputError, which starts with `place`, unless in every reading there are these, each once."""
        if study not in self.studies:
            raise InputError(f"{place}: study: {study!r} is no study of the paper; {nearest(study, self.studies)}")
        known = self.studies[study]
        for reading in self.readings:
            names = [reading.conditions.get(name, name) for name in conditions]
            for name in names:
                if name not in known or names.count(name) > 1:
                    wrong = "twice" if name in known else f"not in the study {study!r}; {nearest(name, known)}"
                    raise InputError(f"{place}: conditions: {name!r} is {wrong}")


def _conditions(folder: Path, name: str, file: str) -> Mapping[str, object]:
    path = folder / file
    if not path.is_file():
        raise InputError(f"{folder / ABOUT}: studies.{name}: there is no file {path}; expected a study's, from here")
    return changes_of(path, read_study(path))


def _published(path: Path, measure: str, known: _Known) -> tuple[Published, ...]:
    """The rows of the file. Raises InputError that names the file, the line and the column."""
    reader = csv.DictReader(text_lines(path, "a CSV file of published numbers"), restval="")
    there, found = dict.fromkeys(reader.fieldnames or ()), []
    for column in ("study", "condition", measure):
        if column not in there:
            raise InputError(f"{path}: the column {column!r} is missing; {nearest(column, there)}")
    for cells in reader:
        place, condition, text = f"{path}, line {reader.line_num}", cells["condition"], cells[measure]
        known.check(place, cells["study"], [condition])
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not 0.0 < value < math.inf:
            raise InputError(f"{place}: {measure}: {text!r} is no number above 0; expected one, as in 583")
        found.append(Published(cells["study"], condition, value, cells.get("row", condition)))
    return tuple(found)


def _check_readings(folder: Path, readings: Sequence[Reading], numbers: Sequence[str], named: Sequence[str]) -> None:
    """Raise InputError for what readings name and nothing else in the folder has."""
    published, names = dict.fromkeys(["all", *numbers]), [reading.name for reading in readings]
    either = {**published, **dict.fromkeys(named)}
    for i, reading in enumerate(readings):
        place = f"{folder / READINGS}: reading[{i}]"
        if names.count(reading.name) > 1:
            raise InputError(f"{place}.name: {reading.name!r} stands twice; expected each once")
        for key, given, known in (
            ("conditions", reading.conditions, either),
            ("calibrated", reading.calibrated, published),
        ):
            for name in given:
                if name not in known:
                    raise InputError(f"{place}.{key}: nothing is said of {name!r}; {nearest(name, known)}")
        if reading.calibration is not None and not (folder / reading.calibration).is_file():
            raise InputError(f"{place}.calibration: there is no file {folder / reading.calibration}")
