"""The verb `size`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Literal

import typer

from swarmsim.cli.interruption import end_if_asked, told_if_interrupted
from swarmsim.cli.options import AllowCode, Faults, Overrides, Quiet
from swarmsim.cli.progress import Counted, progress_bar
from swarmsim.cli.studies import Scheduler, Workers
from swarmsim.cli.tables import print_table

NOT_ANSWERED = 1  # exit code


def size(
    scenario: Annotated[Path, typer.Argument(help="Scenario file (TOML).")],
    within: Annotated[str, typer.Option(help="Time that the task may take, such as 8min, 90s or 1.5h.")],
    sure: Annotated[float, typer.Option(help="Chance of being done within it.")] = 0.95,
    slack: Annotated[float, typer.Option(help="How much less is enough: a smaller one takes more runs.")] = 0.02,
    confidence: Annotated[float, typer.Option(help="Confidence in all statements together.")] = 0.95,
    over: Annotated[str, typer.Option(metavar="KEY", help="Key to find the value of.")] = "robots.count",
    low: Annotated[float | None, typer.Option(help="Lowest value; of counts by default 1.")] = None,
    high: Annotated[
        float | None, typer.Option(help="Highest value; of counts by default twice the scenario's, then 4 and 8 times.")
    ] = None,
    values: Annotated[str | None, typer.Option(metavar="V1,V2,...", help="Values, instead of low to high.")] = None,
    better: Annotated[
        Literal["more", "less"] | None, typer.Option(help="What makes the task easier; otherwise found out.")
    ] = None,
    faults: Faults = None,
    set_: Overrides = None,
    price: Annotated[str | None, typer.Option(metavar="robot=A,minute=B", help="Find the cheapest too.")] = None,
    vary: Annotated[
        list[str] | None, typer.Option(metavar="KEY=V1,V2,...", help="Do it for each of these; repeatable.")
    ] = None,
    budget: Annotated[int, typer.Option(help="Runs to spend at most.")] = 4000,
    store: Annotated[Path | None, typer.Option(help="Runs; default: runs/sizes/SCENARIO.sqlite.")] = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    plot: Annotated[Path | None, typer.Option(help="Figure to draw, as PNG and SVG, without suffix.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")] = False,
    allow_code: AllowCode = False,
    quiet: Quiet = False,
) -> None:
    """Find the smallest swarm that does its task in time with a given probability.

    Runs are spent where the answer is open, and kept: the same command goes on from there.

    Exit code 0: answered; 1: not decided within the budget, or nothing suffices; 2: bad input.

    Example: swarmsim size scenarios/basilica.toml --within 8min --sure 0.95

    With a quarter of the robots dying: --fault "crash at=60 fraction=0.25"; by price: --price robot=120,minute=0.5
    """
    from swarmsim.api.sizes import size as size_of

    with progress_bar(quiet or as_json) as progress:
        told = Counted(progress, "simulating", "{} of at most {} runs")

        def tell(words: str) -> None:
            progress.console.print(words, markup=False, highlight=False)

        def move(runs: int) -> None:
            end_if_asked()
            told(runs, budget)

        with told_if_interrupted(lambda: f"{told.done} runs are kept; the same command goes on from there"):
            found = size_of(
                scenario, within, sure=sure, slack=slack, confidence=confidence, over=over, low=low, high=high,
                values=values, better=better, faults=faults or (), overrides=set_, price=price, vary=vary or (),
                budget=budget, store=store, workers=workers, scheduler=scheduler, plot=plot, allow_code=allow_code,
                progress=move, tell=tell,
            )  # fmt: skip
    if as_json:
        print(json.dumps(found.record(), indent=2))
    elif not quiet:
        print_table(f"{scenario}: done within {within}?", found.head, found.rows)
        for sentence in (*found.sentences, *map(str, found.figures)):
            print(sentence)
    raise typer.Exit(0 if found.answered else NOT_ANSWERED)
