"""Reproductions of papers."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from swarmsim.api.studies import Progress, run_jobs, untold
from swarmsim.core.scenario import registry
from swarmsim.studies import paper_report, reproduction
from swarmsim.studies.paper import find_paper, open_paper
from swarmsim.studies.reproduction import Reproduction
from swarmsim.studies.store import Store


def reproduce(
    paper: str | Path = "kit2018",
    *,
    seeds: int | None = None,
    readings: Sequence[str] = (),
    out: str | Path | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    allow_code: bool = False,
    progress: Progress = untold,
) -> list[Reproduction]:
    """Repeat a paper's experiments, its numbers beside ours, for each reading of it: `swarmsim reproduce`.

    `paper` is its folder, or the name of one that comes with swarmsim: kit2018 or shang2014. Each condition is run with
    the seeds 1 to `seeds`, by default those of its study. `readings` names ways to read the paper, by default all.
    Report, figures and results go into the folder `out`, by default runs/PAPER; existing runs are not repeated.
    `allow_code` lets its scenarios run their own code. Other parameters are those of `StudyRun.run`. Raises
    InputError for a folder that is no paper, for an unknown reading, and for failed runs.
    """
    with registry.own_code(allow_code):
        folder = find_paper(str(paper))
        opened, out = open_paper(folder), Path(out or Path("runs") / folder.resolve().name)
        names = [one.name for one in opened.read(readings)]
        with Store(out / "results.sqlite") as kept:
            run = partial(run_jobs, store=kept, workers=workers, scheduler=scheduler, progress=progress)
            found = reproduction.reproduce(opened, kept, run, seeds, names)
        paper_report.write(found, out)
    return found
