"""The verb that puts runs side by side."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from swarmsim.cli.tables import print_table


def compare(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN...", help="Folders of runs, the reference first.")],
    plot: Annotated[Path | None, typer.Option(help="Figure to draw, as PNG and SVG, without ending.")] = None,
) -> None:
    """Print what faults cost: each run beside the first, and plot what their task is about.

    Example: swarmsim compare runs/sound runs/faulty --plot runs/cost
    """
    from swarmsim.core.errors import InputError
    from swarmsim.recording.reader import Recording
    from swarmsim.studies import comparison
    from swarmsim.studies.likeness import Side, notices

    if len(runs) < 2:
        raise InputError(f"compare: {len(runs)} run given; expected the reference and one more at least")
    opened = [Recording(run) for run in runs]
    for run, recording in zip(runs, opened, strict=True):
        if not recording.iterations:
            raise InputError(f"{run}: no whole iteration was recorded; there is nothing to compare")
    named, curve = dict(zip(_names(runs), opened, strict=True)), opened[0].curve
    costs = comparison.costs(named)
    for notice in notices([Side(name, run.scenario, run.world, run.code) for name, run in named.items()]):
        print(f"notice: {notice}")
    print_table(f"against {_names(runs)[0]}", comparison.head(curve), comparison.lines(costs))
    if plot is not None:
        for path in comparison.draw(costs, curve, plot):
            print(path)


def _names(runs: list[Path]) -> list[str]:
    """The last folders of each run's path, as many as tell all runs apart."""
    paths = [run.absolute().parent if run.suffix == ".h5" else run.absolute() for run in runs]
    for parts in range(1, max(len(path.parts) for path in paths) + 1):
        names = ["/".join(path.parts[-parts:]) for path in paths]
        if len(set(names)) == len(set(paths)):
            break
    return names if len(set(names)) == len(names) else [f"{name} ({place})" for place, name in enumerate(names, 1)]
