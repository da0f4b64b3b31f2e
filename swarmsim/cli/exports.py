"""The verb that gives recordings to other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def export(
    recording: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run, or its recording.")],
    map_: Annotated[
        Path, typer.Option("--map", metavar="OUT", help="Map to write: .yaml (map_server) or .json (OccupancyGrid).")
    ],
    robot: Annotated[
        int | None, typer.Option(metavar="I", help="The robot whose map it is; by default the union of all.")
    ] = None,
    at: Annotated[int | None, typer.Option(metavar="N", help="The iteration; by default the last.")] = None,
) -> None:
    """Write what robots have mapped for ROS: a cell is free, occupied, or unknown.

    Example: swarmsim export runs/basilica-1 --map basilica.yaml --robot 3 --at 100
    """
    from swarmsim.core.errors import InputError
    from swarmsim.operations.mapping.replay import MapReplay
    from swarmsim.recording.reader import Recording
    from swarmsim.world import rosmap

    opened = Recording(recording)
    if "changes" not in opened:
        raise InputError(f"{recording}: these robots kept no maps; expected the run of a swarm that maps")
    if not opened.iterations:
        raise InputError(f"{recording}: no whole iteration was recorded; expected at least one")
    count = opened.scenario.robots.count
    if robot is not None and not 0 <= robot < count:
        raise InputError(f"--robot {robot}: no such robot; expected 0 to {count - 1}")
    iteration = opened.iterations - 1 if at is None else at
    if not 0 <= iteration < opened.iterations:
        raise InputError(f"--at {iteration}: no such iteration; expected 0 to {opened.iterations - 1}")
    replay = MapReplay(opened)
    replay.advance(iteration)
    states = replay.collective() if robot is None else replay.maps[robot]
    for path in rosmap.write(map_, states, opened.lattice):
        print(path)
