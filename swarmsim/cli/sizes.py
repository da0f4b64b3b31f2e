"""The verb `size`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Literal

import typer

from swarmsim.cli.interruption import end_if_asked, told_if_interrupted
from swarmsim.cli.options import AllowCode, Faults, Overrides, Quiet
from swarmsim.cli.printing import for_print
from swarmsim.cli.progress import Counted, progress_bar
from swarmsim.cli.studies import Scheduler, Workers
from swarmsim.cli.tables import print_table
from swarmsim.core.durations import told

NOT_ANSWERED = 1  # exit code


@for_print
def size(
    scenario: Annotated[Path, typer.Argument(help="Scenario file (TOML).")],
    within: Annotated[str, typer.Option(help="Time for the task: 8min, 90s, 1.5h, or seconds.")],
    sure: Annotated[float, typer.Option(help="Chance of being done by then.")] = 0.95,
    slack: Annotated[float, typer.Option(help="How much less is enough; a smaller slack takes more runs.")] = 0.02,
    confidence: Annotated[float, typer.Option(help="Confidence in all statements together.")] = 0.95,
    over: Annotated[str, typer.Option(metavar="KEY", help="Key whose value to find.")] = "robots.count",
    low: Annotated[float | None, typer.Option(help="Lowest value; for counts by default the fewest that work.")] = None,
    high: Annotated[
        float | None,
        typer.Option(help="Highest value; for counts by default 2, 4 or 8 times the scenario's own."),
    ] = None,
    values: Annotated[
        str | None, typer.Option(metavar="V1,V2,...", help="Values, instead of --low and --high.")
    ] = None,
    better: Annotated[
        Literal["more", "less"] | None,
        typer.Option(help="What makes the task easier; default: it finds out."),
    ] = None,
    faults: Faults = None,
    set_: Overrides = None,
    price: Annotated[str | None, typer.Option(metavar="robot=A,minute=B", help="Find the cheapest swarm too.")] = None,
    vary: Annotated[
        list[str] | None, typer.Option(metavar="KEY=V1,V2,...", help="Search once for each value; repeatable.")
    ] = None,
    budget: Annotated[int, typer.Option(help="Most runs to spend.")] = 4000,
    store: Annotated[
        Path | None, typer.Option(help="Where runs are kept; default: runs/sizes/SCENARIO.sqlite.")
    ] = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    plot: Annotated[Path | None, typer.Option(help="Figure to draw; without a suffix, PNG and SVG.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")] = False,
    allow_code: AllowCode = False,
    quiet: Quiet = False,
) -> None:
    """Find the smallest swarm that does its task in time with a given probability.

    Runs are spent where the answer is open, and kept: the same command goes on from there.

    Exit code 0: answered; 1: not decided within the budget, or nothing suffices; 2: bad input.

    Example: swarmsim size basilica --within 8min --sure 0.95

    With a quarter of the robots dying: --fault "crash at=60 fraction=0.25"; by price: --price robot=120,minute=0.5
    """
    from swarmsim.api.sizes import size as size_of

    with progress_bar(quiet or as_json) as progress:
        counted = Counted(progress, "simulating", "{} of at most {} runs")

        def tell(words: str) -> None:
            progress.console.print(words, markup=False, highlight=False)

        def move(runs: int) -> None:
            end_if_asked()
            counted(runs, budget)

        with told_if_interrupted(lambda: f"{counted.done} runs are kept; the same command goes on from there"):
            found = size_of(
                scenario, within, sure=sure, slack=slack, confidence=confidence, over=over, low=low, high=high,
                values=values, better=better, faults=faults or (), overrides=set_, price=price, vary=vary or (),
                budget=budget, store=store, workers=workers, scheduler=scheduler, plot=plot, allow_code=allow_code,
                progress=move, tell=tell,
            )  # fmt: skip
    if as_json:
        print(json.dumps(found.record(), indent=2))
    elif not quiet:
        print_table(f"{scenario}: done within {told(found.answers[0].answer.question.within)}?", found.head, found.rows)
        for sentence in (*found.sentences, *map(str, found.figures)):
            print(sentence)
    raise typer.Exit(0 if found.answered else NOT_ANSWERED)
