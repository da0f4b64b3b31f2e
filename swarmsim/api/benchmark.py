"""A benchmark that others can enter: entries, their verification, the page that compares them, and further sets."""

from __future__ import annotations

import math
import os
import random
import secrets
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from swarmsim.api.studies import Progress, run_jobs, untold
from swarmsim.core.errors import InputError
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.identity import differences
from swarmsim.recording.digests import versions
from swarmsim.studies.benchmark import entries
from swarmsim.studies.benchmark.entries import MethodEntry, entries_to_compare, read_entry
from swarmsim.studies.benchmark.imported import ImportedSet, Pictures, imported
from swarmsim.studies.benchmark.leaderboard import write_board
from swarmsim.studies.benchmark.referenced import kept_tours, refer, unconfirmed
from swarmsim.studies.benchmark.scores import Standings, joules_of, standings
from swarmsim.studies.benchmark.sets import open_set, shipped_set
from swarmsim.studies.engine import execute
from swarmsim.studies.requests import libraries
from swarmsim.studies.results import gather, missing
from swarmsim.studies.store import Store


@dataclass(frozen=True, slots=True)
class MadeEntry:
    """An entry that was made, and its files."""

    entry: MethodEntry
    files: tuple[Path, ...]
    scores: Standings  # of this entry alone


@dataclass(frozen=True, slots=True)
class Verified:
    """The result of repeating some of an entry's runs."""

    repeated: int  # runs ...
    of: int  # ... of so many
    disagreements: tuple[str, ...]  # numbers that the repetition does not confirm
    unlike: str  # other code or libraries than the entry's, in words; they can explain disagreements

    @property
    def equal(self) -> bool:
        """Whether every repeated run gave the entry's numbers."""
        return not self.disagreements


def benchmark_explore(
    method: str | Path,
    *,
    out: str | Path,
    tasks: str | Path | None = None,
    secret: str | Path | None = None,
    store: str | Path | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    allow_code: bool = False,
    progress: Progress = untold,
) -> MadeEntry:
    """Run a method on all tasks of a set and write its entry: `swarmsim benchmark explore`.

    `method` is a TOML file with `name` and `mind`. `out` is the entry: a folder, or a .json file. `tasks` is the folder
    of a set, by default the newest that is shipped, and `secret` the file that opens its held-out part. Runs are kept
    in `store`, by default runs/benchmark/SET/NAME.sqlite, and not repeated. `workers`, `scheduler`, `progress` and
    `allow_code` are as in `study`. Raises InputError for a bad method or set, another secret, and failed runs.
    """
    path, found = Path(method), open_set(_folder(tasks), _path(secret))
    asked = entries.read_method(path)
    kept = Path(store) if store else Path("runs") / "benchmark" / found.name / f"{asked.name}.sqlite"
    with registry.own_code(allow_code), Store(kept) as rows:
        plan = entries.open_method(found, asked, path, found.made)
        run_jobs(missing(plan, rows, retry=True), rows, workers, scheduler, progress)
        entry = entries.entry_of(found, asked, plan, gather(plan, rows))
    files = entries.write_entry(entry, Path(out), plan.conditions[0].code, path.absolute().parent)
    return MadeEntry(entry, tuple(files), standings(found, [entry]))


def benchmark_verify(
    entry: str | Path,
    *,
    share: float = 0.05,
    tasks: str | Path | None = None,
    secret: str | Path | None = None,
    seed: int | None = None,
    workers: int | None = None,
    allow_code: bool = False,
    progress: Progress = untold,
) -> Verified:
    """Repeat a share of an entry's runs in other processes and compare every number: `swarmsim benchmark verify`.

    The `share` (0 to 1) of its tasks is drawn anew each time, unless `seed` says how: who made the entry cannot know
    which. Others are those of `benchmark_explore`. Raises InputError for a damaged entry, or one of another set.
    """
    if not 0.0 < share <= 1.0:
        raise InputError(f"--share {share:g}: expected a share of the runs, above 0 and at most 1")
    found = open_set(_folder(tasks), _path(secret))
    read = read_entry(Path(entry), found)
    drawn = secrets.randbits(64) if seed is None else seed
    names = set(entries.sampled(read, share, [task.name for task in found.made], drawn))
    chosen = [task for task in found.made if task.name in names]
    with registry.own_code(allow_code):
        plan = entries.open_method(found, read.method, entries.place_of(Path(entry)), chosen)
        with TemporaryDirectory() as folder, Store(Path(folder) / "none.sqlite") as none:
            jobs = missing(plan, none)
        rows = []
        progress(0, len(jobs), 0)
        for row in execute(jobs, workers or os.cpu_count() or 1):
            if row.status == "failed":
                raise InputError(f"{entry}: {row.condition}, seed {row.seed} fails: {row.message}")
            rows.append(row)
            progress(len(rows), len(jobs), 0)
    now = plan.conditions[0].code.hashes
    told = [differences(read.code, now), differences(read.libraries, libraries(versions()))]
    runs = sorted((entries.run_of(row) for row in rows), key=lambda run: run.task)
    return Verified(
        len(runs), len(read.runs), tuple(entries.disagreements(read, runs)), ", ".join(one for one in told if one)
    )


def _folder(tasks: str | Path | None) -> Path:
    return shipped_set() if tasks is None else Path(tasks)


def _path(given: str | Path | None) -> Path | None:
    return None if given is None else Path(given)


@dataclass(frozen=True, slots=True)
class Board:
    """Entries side by side."""

    standings: dict[str, Standings]  # of the part `public` and, if all entries have it, `held-out`
    files: tuple[Path, ...]  # the page and its figures


def benchmark_board(
    entries: Sequence[str | Path] = (),
    *,
    out: str | Path,
    tasks: str | Path | None = None,
    energy: Mapping[str, float] | str | None = None,
    alone: bool = False,
) -> Board:
    """Compare entries on a page with profiles, ratios and tests, and draw its figures: `swarmsim benchmark board`.

    `entries` are files or folders of one set, `tasks` as in `benchmark_explore`; `out` is the page, a name in .html.
    Those that come with the set are compared too, except one of the same name, and unless yours are to stay `alone`.
    `energy`, such as {"metre": 2, "second": 0.5, "kilobyte": 0.01}, says what costs a robot how many joules. Raises
    InputError for a damaged entry, one of another set, two of yours with one name, and if there are none.
    """
    page = Path(out)
    if page.suffix != ".html":
        raise InputError(f"--out {page}: expected a name that ends in .html")
    joules = None if energy is None else joules_of(energy)
    found = open_set(_folder(tasks))
    compared = entries_to_compare(found, [Path(path) for path in entries], alone)
    parts, files = write_board(found, compared, page, joules)
    return Board(parts, tuple(files))


def benchmark_import(
    source: str | Path,
    *,
    out: str | Path,
    width: float | None = None,
    resolution: float | None = None,
    floor: int | None = None,
    robots: Sequence[int] = (),
    limit: int | None = None,
    tasks: str | Path | None = None,
) -> ImportedSet:
    """Make a set of tasks from the maps in the folder `source`: `swarmsim benchmark import`.

    Maps are map_server's YAML files and pictures; `width` is that of every map in metres, `resolution` that of a pixel
    of pictures without a YAML file, and `floor` their darkest grey (0 to 255) that is floor. Robots start in a roomy
    place. The set is written into the folder `out`, with the regimes of the set `tasks`, by default the newest that is
    shipped; `robots` and `limit` replace its numbers of robots and of iterations. Raises InputError for a folder
    without a map that can be used.
    """
    for name, given in (("width", width), ("resolution", resolution)):
        if given is not None and not 0.0 < given <= 1e4:
            raise InputError(f"--{name} {given:g}: expected metres, above 0 and at most 10000")
    if width is not None and resolution is not None:
        raise InputError("--width and --resolution say the same in two ways; expected one of them")
    if any(count < 1 for count in robots):
        raise InputError(f"--robots {min(robots)}: expected at least 1")
    return imported(Path(source), Path(out), _folder(tasks), Pictures(width, resolution, floor), limit, robots)


@dataclass(frozen=True, slots=True)
class Referred:
    """The references of a set."""

    found: int  # that were missing, and are there now
    of: int  # in all
    disagreements: tuple[str, ...]  # numbers that a replay does not confirm, if that was asked


def benchmark_references(
    tasks: str | Path, *, secret: str | Path | None = None, check: float = 0.0, progress: Progress = untold
) -> Referred:
    """Find what a set's tasks lack: proved bounds, and tours with the map known: `swarmsim benchmark references`.

    `tasks` is the set's folder, `secret` opens its held-out part, and `progress` is as in `study`. Each reference is
    kept in the set as it is found. With `check` that share of the tours kept before is replayed and compared instead.
    Raises InputError without OR-tools, and for a damaged set.
    """
    if not 0.0 <= check <= 1.0:
        raise InputError(f"--check {check:g}: expected a share of the tours, from 0 to 1")
    found = open_set(Path(tasks), _path(secret))
    if not check:
        return Referred(refer(found, progress), len(found.made) * len(found.about.seeds), ())
    known = kept_tours(found)
    names = random.Random(secrets.randbits(64)).sample(known, min(len(known), math.ceil(check * len(known))))
    return Referred(0, len(names), tuple(unconfirmed(found, set(names), progress)))
