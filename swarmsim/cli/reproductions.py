"""The verb that repeats a paper's experiments."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from swarmsim.cli.options import AllowCode, Quiet
from swarmsim.cli.progress import perform_all, study_bar
from swarmsim.cli.studies import FAILED, Scheduler, Workers, opened_store
from swarmsim.cli.tables import print_table
from swarmsim.core.errors import InputError

if TYPE_CHECKING:
    from swarmsim.studies.paper import Paper, Reading
    from swarmsim.studies.reproduction import Reproduction


def reproduce(
    paper: Annotated[str, typer.Argument(metavar="PAPER", help="Folder of a paper, or kit2018 or shang2014.")],
    seeds: Annotated[int | None, typer.Option(help="Seeds 1 to N, instead of the studies'.", min=2)] = None,
    reading: Annotated[
        list[str] | None, typer.Option(help="A reading of the paper, such as letter; repeatable; default: all.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for the report; default: runs/PAPER.")] = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    allow_code: AllowCode = False,
    quiet: Quiet = False,
    calibrate: Annotated[
        bool, typer.Option("--calibrate", help="Instead, rank all candidates of the readings' calibrations.")
    ] = False,
) -> None:
    """Repeat a paper's experiments and print its numbers beside ours, for each reading.

    Exit code 0: every claim holds in every reading; 1: some claim does not; 2: bad input.

    Example: swarmsim reproduce kit2018 --seeds 30 --reading letter
    """
    from swarmsim.api import papers
    from swarmsim.studies import paper_report
    from swarmsim.studies.paper import find_paper, open_paper

    folder = find_paper(paper)
    opened, out = open_paper(folder), out or Path("runs") / folder.resolve().name
    try:
        read = opened.read(reading or ())
    except InputError as problem:
        raise InputError(f"--reading {problem}") from problem
    if calibrate:
        for one in read:
            _calibrate(opened, one, out, workers, scheduler, quiet)
        return
    begun = time.perf_counter()
    with study_bar(quiet) as bar:
        found = papers.reproduce(
            folder, seeds=seeds, readings=[one.name for one in read], out=out, workers=workers, scheduler=scheduler,
            allow_code=allow_code, progress=bar,
        )  # fmt: skip
    if not quiet:
        for of_reading in found:
            _print(of_reading)
        print(f"{bar.jobs} runs in {time.perf_counter() - begun:.1f} s")
        for name in paper_report.FILES:
            print(out / name)
    raise typer.Exit(0 if all(claim.verdict == "holds" for one in found for claim in one.claims) else FAILED)


def _print(found: Reproduction) -> None:
    """The tables of one reading."""
    from swarmsim.studies import fit, reproduction

    about, title = found.paper.about, found.reading.title
    if found.numbers:
        print_table(f"{about.cite}, {title}, {found.seed_count} seeds", reproduction.HEAD, reproduction.lines(found))
        fitted = found.fit
        print(found.error_sentences(fitted))
        if fitted is not None:
            print_table(f"{fit.TITLE}, {title}", fit.HEAD, fit.lines(fitted))
    for listing in about.table:
        shown = f"{about.cite}, {title}, {found.seed_count} seeds: {listing.title}"
        print_table(shown, reproduction.LISTED, reproduction.listed(found, listing))
    print_table(
        f"claims, {title}", reproduction.CLAIMED, [(claim.text, verdict, test) for claim, verdict, test in found.claims]
    )
    print(f"digest of the runs: {found.digest}")


def _calibrate(
    paper: Paper, reading: Reading, out: Path, workers: int | None, scheduler: str | None, quiet: bool
) -> None:
    from swarmsim.studies import calibration
    from swarmsim.studies.results import missing

    opened = calibration.opened(paper, reading)
    numbers = calibration.held(paper, reading, opened)
    with opened_store(out / f"calibration-{reading.name}.sqlite", out) as results:
        perform_all(missing(opened, results), results, workers, scheduler, quiet)
        found = calibration.candidates(opened, results, numbers)
    print_table(f"{opened.study.title}, {len(opened.seeds)} seeds", calibration.head(found), calibration.lines(found))
    if len(found[0].means) > 2:
        left_out = calibration.left_out(found)
        print_table("each number predicted by the others", calibration.LEFT_OUT, calibration.left_out_lines(left_out))
        print(f"root-mean-square log-ratio of these predictions: {calibration.prediction_error(left_out):.3f}")
