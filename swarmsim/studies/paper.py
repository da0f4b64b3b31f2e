"""A paper as a folder: its numbers and claims, its readings, and the studies that repeat its experiments."""

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
from swarmsim.studies.claims import ClaimTest
from swarmsim.studies.plan import Plan, changes_of, open_study, read_study

ABOUT: Final = "paper.toml"
READINGS: Final = "readings.toml"
Name = Annotated[str, Meta(pattern=r"^[\w-]+$")]  # files are named after it


class Figure(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A figure of one study, for each reading."""

    name: Name
    kind: Literal["curves", "distributions", "scaling", "sweep"]
    study: str
    title: str
    caption: str
    measure: str = ""  # of a sweep; default: iterations
    marks: dict[str, tuple[int, ...]] = {}  # of curves: iterations of faults by condition


class Listing(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A table of one measure: mean, interval and number of runs for each condition of a study."""

    title: str
    study: str
    measure: str = "iterations"  # or "speed" (1 / iterations), or a measure of the runs


class About(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The contents of `paper.toml`."""

    cite: str  # authors and year
    title: str
    doi: str = ""
    studies: Annotated[dict[str, str], Meta(min_length=1)]  # study files, relative to the folder, by the paper's names
    published: str = "iterations"  # the measure of published numbers, and their column
    figure: tuple[Figure, ...] = ()
    table: tuple[Listing, ...] = ()


class Reading(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One interpretation of a paper and of what it leaves open."""

    name: Name = "reading"
    title: str = "as published"
    given: tuple[tuple[str, str], ...] = ()  # the paper's words, and their interpretation
    changes: dict[str, object] = {}  # to the studies' scenarios, by dotted key
    conditions: dict[str, str] = {}  # the paper's names of conditions with other names in its study
    calibrated: tuple[str, ...] = ()  # the published numbers that open choices were fitted to, or "all"
    calibration: str | None = None  # the study that made them, relative to the folder


class PaperReadings(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The contents of `readings.toml`."""

    reading: Annotated[tuple[Reading, ...], Meta(min_length=1)] = (Reading(),)
    rows: tuple[str, ...] = ()  # keys of a scenario that identify the published number for a calibration's run


class Claim(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A claim of the paper, worded so that tests can decide it."""

    text: str
    source: str  # its place in the paper
    margin: str = ""  # the origin of its tests' limits
    margin_chosen: str = ""  # when, if only after results had been seen: "after ..."
    test: Annotated[tuple[ClaimTest, ...], Meta(min_length=1)]

    def __post_init__(self) -> None:
        if self.margin_chosen and not self.margin:
            raise ValueError("'margin_chosen' says when a 'margin' was chosen; expected both")


class Claims(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The contents of `claims.toml`."""

    claim: Annotated[tuple[Claim, ...], Meta(min_length=1)]


@dataclass(frozen=True, slots=True)
class Published:
    """A number that the paper printed for one condition."""

    study: str
    condition: str
    value: float
    row: str  # its name in a calibration's tables


@dataclass(frozen=True, slots=True)
class Paper:
    """A paper's folder, read and checked for consistency."""

    folder: Path
    about: About
    readings: PaperReadings
    claims: tuple[Claim, ...]
    published: tuple[Published, ...]

    def plans(self, reading: Reading, seeds: int | None = None) -> dict[str, Plan]:
        """The studies of a reading, by name; `seeds` replaces their numbers of seeds. Raises InputError."""
        files = self.about.studies.items()
        return {name: open_study(self.folder / file, seeds, reading.changes) for name, file in files}

    def read(self, names: Sequence[str] = ()) -> list[Reading]:
        """The readings of these names, by default all. Raises InputError for an unknown name."""
        known = {reading.name: reading for reading in self.readings.reading}
        for name in names:
            if name not in known:
                raise InputError(f"{name}: no such reading; known: {', '.join(known)}")
        return [known[name] for name in dict.fromkeys(names or known)]


def find_paper(given: str) -> Path:
    """A paper's folder: a path, or the name of a shipped paper. Raises InputError, which lists the shipped ones."""
    home = shipped.root() / "papers"
    for folder in (Path(given), home / given, home.parent / given):
        if os.path.isfile(folder / ABOUT):  # noqa: PTH113 - the input may be no path at all
            return folder
    known = ", ".join(path.parent.name for path in sorted(home.glob(f"*/{ABOUT}")))
    raise InputError(f"{given}: no such paper; expected a folder with a file {ABOUT}, or one of those known: {known}")


def open_paper(folder: Path) -> Paper:
    """Read a paper's folder: `paper.toml`, `claims.toml` and, if present, `readings.toml` and `published.csv`.

    Raises InputError that names the file and the key or line at fault.
    """
    about = read_struct(folder / ABOUT, "a paper's description", About)
    path = folder / READINGS
    readings = read_struct(path, "readings of a paper", PaperReadings) if path.exists() else PaperReadings()
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
                raise InputError(f"{folder / 'claims.toml'}: {place}.but: {name!r} is not one of its conditions")
    numbers = folder / "published.csv"
    published = _published(numbers, about.published, known) if numbers.exists() else ()
    named = [name for check in checks.values() for name in check.conditions]
    _check_readings(folder, readings.reading, [number.condition for number in published], named)
    return Paper(folder, about, readings, claims, published)


@dataclass(frozen=True, slots=True)
class _Known:
    """A paper's studies and conditions, for checking references to them."""

    studies: Mapping[str, Mapping[str, object]]
    readings: tuple[Reading, ...]

    def check(self, place: str, study: str, conditions: Iterable[str]) -> None:
        """Raise InputError, starting with `place`, unless every reading has these, each once."""
        if study not in self.studies:
            raise InputError(f"{place}: study: {study!r} is not a study of the paper; {nearest(study, self.studies)}")
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
    """The rows of the file. Raises InputError that names file, line and column."""
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
            raise InputError(f"{place}: {measure}: {text!r} is not a number above 0; expected for example 583")
        found.append(Published(cells["study"], condition, value, cells.get("row", condition)))
    return tuple(found)


def _check_readings(folder: Path, readings: Sequence[Reading], numbers: Sequence[str], named: Sequence[str]) -> None:
    """Raise InputError for names in readings that are unknown to the folder."""
    published, names = dict.fromkeys(["all", *numbers]), [reading.name for reading in readings]
    either = {**published, **dict.fromkeys(named)}
    for i, reading in enumerate(readings):
        place = f"{folder / READINGS}: reading[{i}]"
        if names.count(reading.name) > 1:
            raise InputError(f"{place}.name: {reading.name!r} is listed twice; expected each once")
        for key, given, known in (
            ("conditions", reading.conditions, either),
            ("calibrated", reading.calibrated, published),
        ):
            for name in given:
                if name not in known:
                    raise InputError(f"{place}.{key}: {name!r} is unknown; {nearest(name, known)}")
        if reading.calibration is not None and not (folder / reading.calibration).is_file():
            raise InputError(f"{place}.calibration: there is no file {folder / reading.calibration}")
