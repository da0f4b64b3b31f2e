"""The verb that does a paper's experiments again."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from swarmsim.cli.options import Quiet
from swarmsim.cli.progress import perform_all
from swarmsim.cli.studies import FAILED, Scheduler, Workers, opened_store
from swarmsim.cli.tables import print_table
from swarmsim.core.errors import InputError

if TYPE_CHECKING:
    from swarmsim.studies.reproduction import Reading


def reproduce(
    paper: Annotated[str, typer.Argument(metavar="kit2018", help="The paper: kit2018.")],
    seeds: Annotated[int, typer.Option(help="Seeds of each condition.", min=2)] = 100,
    reading: Annotated[
        list[str] | None, typer.Option(help="How the paper is read: letter or arrival; repeatable; default: both.")
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for the report and its figures.")] = Path("runs/kit2018"),
    workers: Workers = None,
    scheduler: Scheduler = None,
    quiet: Quiet = False,
    calibrate: Annotated[
        bool, typer.Option("--calibrate", help="Instead, rank all candidates of the readings' calibrations.")
    ] = False,
) -> None:
    """Do the experiments of the reference paper and print its numbers beside ours, for each way to read it.

    Exit code 0: every claim holds in every reading; 1: some claim does not; 2: bad input.

    Example: swarmsim reproduce kit2018 --seeds 30 --reading letter
    """
    from swarmsim.studies import report, reproduction
    from swarmsim.studies.results import missing

    if paper != "kit2018":
        raise InputError(f"reproduce {paper}: no such paper; known: kit2018")
    known = reproduction.READINGS
    for name in reading or ():
        if name not in known:
            raise InputError(f"--reading {name}: no such reading; known: {', '.join(known)}")
    readings = [known[name] for name in dict.fromkeys(reading or known)]
    if calibrate:
        for one in readings:
            _calibrate(one, out, workers, scheduler, quiet)
        return
    plans = [reproduction.plans(seeds, one) for one in readings]
    begun = time.perf_counter()
    with opened_store(out / "results.sqlite", out) as results:
        # A run that two tables or readings share is done once.
        opened = [plan for of_reading in plans for plan in of_reading.values()]
        tasks = {task.identity: task for plan in opened for task in missing(plan, results)}
        perform_all(list(tasks.values()), results, workers, scheduler, quiet)
        found = [reproduction.evaluate(one, of, results) for one, of in zip(readings, plans, strict=True)]
    seconds = time.perf_counter() - begun
    if not quiet:
        for read in found:
            title = f"Kit, Mateo and Bouffanais (2018), {read.reading.title}, {seeds} seeds"
            print_table(title, reproduction.HEAD, reproduction.lines(read))
            print(read.error_sentence)
            print_table(f"claims, {read.reading.title}", reproduction.CLAIMED, [claim.line for claim in read.claims])
            print(f"digest of the runs: {read.digest}")
        print(f"{len(tasks)} runs in {seconds:.1f} s")
    for path in report.write(found, out):
        if not quiet:
            print(path)
    raise typer.Exit(0 if all(claim.verdict == "holds" for read in found for claim in read.claims) else FAILED)


def _calibrate(reading: Reading, out: Path, workers: int | None, scheduler: str | None, quiet: bool) -> None:
    from swarmsim.studies import calibration, reproduction
    from swarmsim.studies.results import missing

    opened = reproduction.calibration_plan(reading)
    with opened_store(out / f"calibration-{reading.name}.sqlite", out) as results:
        perform_all(missing(opened, results), results, workers, scheduler, quiet)
        found = calibration.candidates(opened, results, reproduction.published_numbers())
    print_table(f"{opened.study.title}, {len(opened.seeds)} seeds", calibration.head(found), calibration.lines(found))
    if len(found[0].means) > 2:
        left_out = calibration.left_out(found)
        print_table("each number predicted by the others", calibration.LEFT_OUT, calibration.left_out_lines(left_out))
        print(f"root-mean-square log-ratio of these predictions: {calibration.prediction_error(left_out):.3f}")
