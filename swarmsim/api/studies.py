"""Studies: many runs, and their statistics."""

from __future__ import annotations

import html
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from swarmsim.api.frames import framed
from swarmsim.api.overrides import seconds_in
from swarmsim.core.errors import InputError, unwritten
from swarmsim.core.scenario import registry
from swarmsim.core.tables import WRITERS, Form
from swarmsim.studies import chances, methods, pairing, peak, selection
from swarmsim.studies import plan as plans
from swarmsim.studies import report as reports
from swarmsim.studies import results as found
from swarmsim.studies.engine import Job, execute
from swarmsim.studies.likeness import Side, notices
from swarmsim.studies.plan import Plan
from swarmsim.studies.results import Result
from swarmsim.studies.statistics import Description
from swarmsim.studies.store import Store

if TYPE_CHECKING:
    import pandas as pd

Progress = Callable[[int, int, int], None]  # called with runs done, all runs, and failed runs


def untold(done: int, of: int, failed: int) -> None:
    """Ignore progress."""


def study(
    path: str | Path,
    *,
    seeds: int | None = None,
    store: str | Path | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    keep_old: bool = False,
    allow_code: bool = False,
) -> StudyRun:
    """Do the missing runs of a study and return all: `open_study`, then `StudyRun.run`.

    Parameters and errors are those of both. In a script, call it under `if __name__ == "__main__":`, since it starts
    processes.
    """
    opened = open_study(path, seeds=seeds, store=store, keep_old=keep_old, allow_code=allow_code)
    return opened.run(workers=workers, scheduler=scheduler)


def open_study(
    path: str | Path,
    *,
    seeds: int | None = None,
    store: str | Path | None = None,
    keep_old: bool = False,
    allow_code: bool = False,
) -> StudyRun:
    """Read the study file `path` with its finished runs, and do none.

    `seeds` replaces their number. Results are kept in `store`, by default runs/studies/STUDY.sqlite; those made by
    other code than the present count only with `keep_old`. `allow_code` lets its scenarios run their own code.
    Raises InputError that names the file, the condition and the key.
    """
    kept = Path(store) if store else Path("runs") / "studies" / f"{Path(path).stem}.sqlite"
    with registry.own_code(allow_code):
        return StudyRun(plans.open_study(Path(path), seeds, keep_old=keep_old), kept, allow_code)


@dataclass(frozen=True, slots=True)
class Estimate:
    """The amount of work."""

    runs: int  # in all
    missing: int  # still to do
    seconds: float  # of one core for each, about


@dataclass(frozen=True, slots=True)
class Count:
    """A condition's progress, in runs."""

    condition: str
    finished: int
    not_finished: int
    failed: int
    missing: int


@dataclass(frozen=True, slots=True)
class StudyTable:
    """A table of texts, which notebooks display."""

    title: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]

    def written(self, form: Form) -> str:
        """The table as "markdown", "latex" (with booktabs) or "csv"."""
        return WRITERS[form](self.head, self.rows)

    def _repr_html_(self) -> str:
        def row(cells: Sequence[str], tag: str) -> str:
            return f"<tr>{''.join(f'<{tag}>{html.escape(cell)}</{tag}>' for cell in cells)}</tr>"

        body = "".join(row(line, "td") for line in self.rows)
        return f"<div><b>{html.escape(self.title)}</b><table>{row(self.head, 'th')}{body}</table></div>"


class StudyRun:
    """A study and its finished runs."""

    def __init__(self, plan: Plan, store: Path, allow_code: bool = False) -> None:
        #: The plan of the study.
        self.plan = plan
        #: The file of the results (SQLite).
        self.store = store
        self._allow_code = allow_code
        #: The runs of each condition, by its name.
        self.results: dict[str, Result] = self._gathered()

    def _gathered(self) -> dict[str, Result]:
        with Store(self.store) as kept:
            return found.gather(self.plan, kept)

    def of_other_code(self) -> list[str]:
        """A sentence about runs made by other code than the present, if any."""
        return found.of_other_code(self.plan, self.results)

    def unlike(self) -> list[str]:
        """Differences of conditions that make their numbers hard to compare, a sentence each."""
        return notices([Side(one.name, one.scenario, self.plan.world_of(one)) for one in self.plan.conditions])

    def estimate(self) -> Estimate:
        """The number of runs and of missing ones, and the time of each: `swarmsim study plan`.

        The time is the mean of the finished runs or, without any, from simulating each condition briefly.
        """
        seconds = [row.seconds for result in self.results.values() for row in result.rows]
        missing = sum(result.missing for result in self.results.values())
        with registry.own_code(self._allow_code):
            each = sum(seconds) / len(seconds) if seconds else plans.trial(self.plan)
        return Estimate(len(self.plan.runs), missing, each)

    def run(
        self,
        *,
        workers: int | None = None,
        scheduler: str | None = None,
        retry: bool = False,
        progress: Progress = untold,
    ) -> StudyRun:
        """Do the missing runs, keep each as it ends, and return the study: `swarmsim study run`.

        `workers` processes do them, by default one per core, or those of a Dask `scheduler` (tcp://host:port).
        `retry` repeats failed runs. `progress` is called with runs done, all runs, and failed runs.
        Raises InputError for a scheduler that does not answer, StorageError for a full disk.
        """
        with registry.own_code(self._allow_code), Store(self.store) as kept:
            run_jobs(found.missing(self.plan, kept, retry), kept, workers, scheduler, progress)
        self.results = self._gathered()
        return self

    def status(self) -> list[Count]:
        """The progress of each condition: `swarmsim study status`."""
        return [
            Count(name, int(one.finished.sum()), int((~one.finished).sum()), len(one.failed), one.missing)
            for name, one in self.results.items()
        ]

    def table(self, measure: str | None = None) -> StudyTable:
        """The statistics of each condition's iterations, or of a measure, in words: `swarmsim study table`.

        `describe` gives them as numbers. Raises InputError for an unknown measure.
        """
        if measure is None:
            return StudyTable(
                f"{self.plan.study.title}: iterations", *found.filled(found.HEAD, found.lines(self.results))
            )
        return StudyTable(f"{self.plan.study.title}: {measure}", found.MEASURED, found.measured(self.results, measure))

    def chances(self, *by: str | float) -> StudyTable:
        """Chances of being done by these times, such as "8min" or seconds: `swarmsim study table --by`.

        Raises InputError for what is no time.
        """
        times = [seconds_in("--by", one) for one in by]
        return StudyTable(f"{self.plan.study.title}: chance of being done", *chances.chances(self.results, times))

    def quantiles(self, *quantile: float) -> StudyTable:
        """Times by which these shares of the runs, between 0 and 1, are done: `swarmsim study table --quantile`.

        Raises InputError for other shares.
        """
        for share in quantile:
            if not 0.0 < share < 1.0:
                raise InputError(f"--quantile {share:g}: expected a share between 0 and 1, such as 0.95")
        return StudyTable(
            f"{self.plan.study.title}: time until a share is done", *chances.quantiles(self.results, quantile)
        )

    def compare(self, against: str) -> StudyTable:
        """Every other condition tested against one, in seconds: `swarmsim study table --compare`.

        The test is by seed if equal seeds are shown to make times alike, by rank otherwise. Raises InputError for an
        unknown condition.
        """
        if against not in self.results:
            raise InputError(f"--compare {against}: no such condition; known: {', '.join(self.results)}")
        return StudyTable(f"against {against}", pairing.COMPARED, pairing.compared(self.results, against))

    def peaks(self, measure: str, which: peak.Extreme = "highest") -> list[peak.Peak]:
        """The best value on the study's axis by a measure's mean, in each series: `swarmsim study table --peak`.

        `which` mean of the `measure` is best; with the interval of the best value and the values not shown to be
        worse. Raises InputError for a study without an axis and for an unknown measure.
        """
        return peak.peaks(self.results, measure, which)

    def digest(self) -> str:
        """One digest over all runs, independent of their order and machine."""
        return found.digest(list(self.results.values()))

    def describe(self, measure: str | None = None) -> dict[str, Description]:
        """The statistics of each condition's iterations, or of a measure. Raises InputError for an unknown one."""
        return {
            name: result.describe() if measure is None else result.describe_measure(measure)
            for name, result in self.results.items()
        }

    def curves(self, condition: str) -> list[NDArray[np.float64]]:
        """The task's main measure in each run of a condition (t,), if the study keeps curves."""
        return self.results[condition].curves

    def records(self) -> list[dict[str, object]]:
        """One record for each run: condition, its changes, seed, outcome and all measures."""
        return found.records(self.plan, self.results)

    def frame(self) -> pd.DataFrame:
        """One row for each run. Needs pandas."""
        return framed(self.records())

    def plot(self, folder: str | Path, *measures: str) -> list[Path]:
        """Draw the study's figures, and measures along its axis, into a folder: `swarmsim study plot`.

        Returns the files, PNG and SVG. Raises InputError if there is nothing to draw or no place for it.
        """
        return reports.study_figures(self.plan.study, self.results, Path(folder), measures)

    def export(self, *, csv: str | Path | None = None, parquet: str | Path | None = None) -> list[Path]:
        """Write every run with all its measures, and return the files: `swarmsim study export`.

        `csv` and `parquet` are the files to write, at least one. Raises InputError if none is given or it cannot be
        written, StorageError for a full disk.
        """
        if csv is None and parquet is None:
            raise InputError("study export: nothing to write; name a file with --csv or --parquet")
        written = []
        for path, write in ((csv, found.write_csv), (parquet, found.write_parquet)):
            if path is not None:
                try:
                    write(Path(path), self.records())
                except OSError as problem:
                    raise unwritten(path, problem) from problem
                written.append(Path(path))
        return written

    def rank(
        self, *, method: str = "method", within: str | None = None, out: str | Path | None = None
    ) -> methods.Compared:
        """Compare methods over many worlds: `swarmsim study rank`.

        `method` is the `together` of the methods' axes, `within` the key of an axis whose values are kept apart, `out`
        a folder for figures. Returns ratios to the first method with intervals, the probability of improvement and
        profiles. Raises InputError for an unknown axis or missing runs.
        """
        compared = methods.compare(self.plan, self.results, method, within)
        if out is None:
            return compared
        drawn = reports.method_figures(compared, self.plan.study.title, Path(out))
        return replace(compared, figures=tuple(drawn))

    def best(
        self,
        *,
        confidence: float = 0.95,
        budget: int = 2000,
        tolerance: float = 0.03,
        within: str | float | None = None,
        workers: int | None = None,
        scheduler: str | None = None,
        progress: Progress = untold,
    ) -> selection.Answer:
        """Find the condition with the fewest iterations, with as few runs as possible: `swarmsim study best`.

        Seeds are added until, with this confidence, no other value needs fewer iterations by more than `tolerance`, a
        share, or `budget` runs are spent. Runs are compared up to the shortest limit of the conditions; seconds are,
        if periods differ. With a time `within`, such as "8min" or seconds, the best has the highest chance of being
        done by then, and `tolerance` is a difference of chances. Other parameters are those of `run`. Raises InputError
        if too few runs finish to find the best.
        """
        seconds = None if within is None else seconds_in("--within", within)
        with registry.own_code(self._allow_code), Store(self.store) as kept:
            more = partial(run_jobs, store=kept, workers=workers, scheduler=scheduler, progress=progress)
            answer = selection.best(self.plan, kept, more, confidence, budget, tolerance, seconds)
        self.results = self._gathered()
        return answer

    def report(self, out: str | Path, *, replays: bool = True) -> list[Path]:
        """Write the study's page `out`, and return all pages: `swarmsim report`.

        With `replays` each condition's median run is repeated, as its own page. Raises InputError for a name that does
        not end in .html, and if no run is finished.
        """
        from swarmsim.api.pages import study_page

        with registry.own_code(self._allow_code):
            return study_page(self.plan, self.results, Path(out), replays)

    def __repr__(self) -> str:
        runs = sum(len(result.rows) for result in self.results.values())
        return f"<StudyRun {self.plan.study.title!r}: {runs} runs of {len(self.results)} conditions>"

    def _repr_html_(self) -> str:
        return StudyTable(self.plan.study.title, found.HEAD, found.lines(self.results))._repr_html_()


def run_jobs(jobs: Sequence[Job], store: Store, workers: int | None, scheduler: str | None, progress: Progress) -> None:
    """Do all jobs and keep each row as it comes; `progress` is called before the first and after each."""
    if not jobs:
        return
    failed = 0
    progress(0, len(jobs), failed)
    for count, row in enumerate(execute(jobs, workers or os.cpu_count() or 1, scheduler), 1):
        store.add(row)
        failed += row.status == "failed"
        progress(count, len(jobs), failed)
