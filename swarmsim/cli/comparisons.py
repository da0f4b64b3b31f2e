"""The verb `compare`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from swarmsim.cli.printing import Form, for_print
from swarmsim.cli.tables import print_table


@for_print
def compare(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN...", help="Folders of runs, the reference first.")],
    plot: Annotated[Path | None, typer.Option(help="Figure to draw; without a suffix, PNG and SVG.")] = None,
    form: Form = None,
) -> None:
    """Print what faults cost: compare each run with the first, and plot the task's measure.

    Example: swarmsim compare runs/sound runs/faulty --plot runs/cost
    """
    from swarmsim.api.runs import compare as compare_runs
    from swarmsim.studies.comparison import head, lines

    found = compare_runs(runs, plot=plot)
    for notice in found.notices:
        typer.echo(f"notice: {notice}", err=form is not None)
    print_table(f"against {found.costs[0].name}", head(found.curve), lines(found.costs), form)
    for path in found.figures:
        print(path)
