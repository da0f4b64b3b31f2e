"""A benchmark that others can enter: entries, their verification, the page that compares them, and sets of one's own."""

from __future__ import annotations

import os
import secrets
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from swarmsim.api.studies import Progress, run_jobs, untold
from swarmsim.core.errors import InputError
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.identity import differences
from swarmsim.recording.digests import versions
from swarmsim.studies.benchmark import entries
from swarmsim.studies.benchmark.entries import Entry
from swarmsim.studies.benchmark.scores import Standings, standings
from swarmsim.studies.benchmark.sets import TaskSet, open_set, shipped_set
from swarmsim.studies.engine import execute
from swarmsim.studies.plan import libraries
from swarmsim.studies.results import gather, missing
from swarmsim.studies.store import Store


@dataclass(frozen=True, slots=True)
class MadeEntry:
    """An entry that was made, and its files."""

    entry: Entry
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
    of a set, by default the newest that is shipped, and `secret` the file that opens its held-out part. Runs are kept in
    `store`, by default runs/benchmark/SET/NAME.sqlite, and not repeated. `workers`, `scheduler`, `progress` and
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
    which. Other parameters are those of `benchmark_explore`. Raises InputError for a damaged entry, or one of another set.
    """
    if not 0.0 < share <= 1.0:
        raise InputError(f"--share {share:g}: expected a share of the runs, above 0 and at most 1")
    found = open_set(_folder(tasks), _path(secret))
    read = entries.read_entry(Path(entry), found)
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


def _opened(paths: Sequence[str | Path], tasks: TaskSet) -> list[Entry]:
    return [entries.read_entry(Path(path), tasks) for path in paths]
