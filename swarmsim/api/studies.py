"""Studies from Python: many runs, and what they say."""

from __future__ import annotations

import html
import os
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.scenario import registry
from swarmsim.studies import results as found
from swarmsim.studies.engine import execute
from swarmsim.studies.plan import Plan, open_study
from swarmsim.studies.report import study_figures
from swarmsim.studies.results import Result
from swarmsim.studies.statistics import Description
from swarmsim.studies.store import Store

if TYPE_CHECKING:
    import pandas as pd


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
    """Do the runs of a study that are still missing, and give all of them.

    `seeds` replaces their number; results are kept in `store`, by default runs/studies/STUDY.sqlite, and runs that it
    has are not done again, unless other code made them; with `keep_old` those count too. `workers` processes, by
    default one for each core, or a Dask `scheduler`'s. In a script this has to be called under
    `if __name__ == "__main__":`, since processes are started. Raises InputError.
    """
    with registry.own_code(allow_code):
        plan = open_study(Path(path), seeds, keep_old=keep_old)
        with Store(Path(store) if store else Path("runs") / "studies" / f"{Path(path).stem}.sqlite") as kept:
            tasks = found.missing(plan, kept)
            for row in execute(tasks, workers or os.cpu_count() or 1, scheduler) if tasks else ():
                kept.add(row)
            return StudyRun(plan, found.gather(plan, kept))


class StudyRun:
    """A study whose runs are done."""

    def __init__(self, plan: Plan, results: dict[str, Result]) -> None:
        #: What was asked.
        self.plan = plan
        #: The runs of each condition, by its name.
        self.results = results

    def describe(self, measure: str | None = None) -> dict[str, Description]:
        """The statistics of each condition's iterations, or of a measure. Raises InputError for an unknown one."""
        return {
            name: result.describe() if measure is None else result.describe_measure(measure)
            for name, result in self.results.items()
        }

    def curves(self, condition: str) -> list[NDArray[np.float64]]:
        """What the task is about in each run of a condition (t,), where the study keeps curves."""
        return self.results[condition].curves

    def records(self) -> list[dict[str, object]]:
        """One record for each run: condition, what it changes, seed, outcome and all measures."""
        return found.records(self.plan, self.results)

    def frame(self) -> pd.DataFrame:
        """One row for each run. Needs pandas."""
        try:
            import pandas as pd
        except ImportError as problem:
            raise ImportError("frame() needs pandas; install it with: pip install pandas") from problem
        return pd.DataFrame(self.records())

    def plot(self, folder: str | Path, *measures: str) -> list[Path]:
        """Draw the study's figures into a folder, and measures along its axis; gives the files. Raises InputError."""
        return study_figures(self.plan.study, self.results, Path(folder), measures)

    def __repr__(self) -> str:
        runs = sum(len(result.rows) for result in self.results.values())
        return f"<StudyRun {self.plan.study.title!r}: {runs} runs of {len(self.results)} conditions>"

    def _repr_html_(self) -> str:
        def row(cells: tuple[str, ...], tag: str) -> str:
            return f"<tr>{''.join(f'<{tag}>{html.escape(cell)}</{tag}>' for cell in cells)}</tr>"

        body = "".join(row(line, "td") for line in found.lines(self.results))
        return f"<div><b>{html.escape(self.plan.study.title)}</b><table>{row(found.HEAD, 'th')}{body}</table></div>"
