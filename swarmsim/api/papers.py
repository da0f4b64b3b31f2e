"""Papers: their experiments done again."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from swarmsim.api.studies import Progress, run_jobs, untold
from swarmsim.core.errors import InputError
from swarmsim.studies import report, reproduction
from swarmsim.studies.reproduction import Reproduction
from swarmsim.studies.results import missing
from swarmsim.studies.store import Store


def reproduce(
    paper: str = "kit2018",
    *,
    seeds: int = 100,
    readings: Sequence[str] = (),
    out: str | Path = "runs/kit2018",
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Progress = untold,
) -> list[Reproduction]:
    """Do a paper's experiments again, its numbers beside ours, for each way to read it: `swarmsim reproduce`.

    There are so many `seeds` of each condition. `readings` are letter and arrival, by default both. Report, figures and
    results go into the folder `out`; runs that it has are not done again. Other parameters are those of
    `StudyRun.run`. Raises InputError for a paper or a reading that there is not, and for runs that failed.
    """
    if paper != "kit2018":
        raise InputError(f"reproduce {paper}: no such paper; known: kit2018")
    known = reproduction.READINGS
    for name in readings:
        if name not in known:
            raise InputError(f"--reading {name}: no such reading; known: {', '.join(known)}")
    read = [known[name] for name in dict.fromkeys(readings or known)]
    plans = [reproduction.plans(seeds, one) for one in read]
    with Store(Path(out) / "results.sqlite") as kept:
        # A run that two tables or readings share is done once.
        every = [plan for of_reading in plans for plan in of_reading.values()]
        jobs = {job.identity: job for plan in every for job in missing(plan, kept)}
        run_jobs(list(jobs.values()), kept, workers, scheduler, progress)
        found = [reproduction.evaluate(one, of, kept) for one, of in zip(read, plans, strict=True)]
    report.write(found, Path(out))
    return found
