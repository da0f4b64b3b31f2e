"""The verb that exports recordings to other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from swarmsim.cli.options import AllowCode
from swarmsim.cli.progress import Counted, progress_bar


def export(
    recording: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run, or its recording.")],
    map_: Annotated[
        Path | None,
        typer.Option("--map", metavar="OUT", help="Map to write: .yaml (map_server) or .json (OccupancyGrid)."),
    ] = None,
    mcap: Annotated[Path | None, typer.Option(metavar="OUT.mcap", help="The run for Foxglove and Lichtblick.")] = None,
    rerun: Annotated[Path | None, typer.Option(metavar="OUT.rrd", help="The run for the Rerun viewer.")] = None,
    ros2: Annotated[Path | None, typer.Option(metavar="OUT", help="The run as a rosbag2: a new folder.")] = None,
    robot: Annotated[
        int | None, typer.Option(metavar="I", help="The map's robot; by default the union of all.")
    ] = None,
    at: Annotated[int | None, typer.Option(metavar="N", help="The map's iteration; by default the last.")] = None,
    allow_code: AllowCode = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print nothing but errors.")] = False,
) -> None:
    """Write a run for other programs: its map for ROS, or the whole run for a robotics viewer.

    Example: swarmsim export runs/basilica-1 --map basilica.yaml --robot 3 --at 100

    For Foxglove: swarmsim export runs/basilica-1 --mcap basilica.mcap

    For ros2 bag play and rviz: swarmsim export runs/basilica-1 --ros2 basilica-bag
    """
    from swarmsim.api.runs import open as open_run
    from swarmsim.view.layers.own import left_out

    run = open_run(recording)
    if (mcap or rerun) and not quiet and (notice := left_out(run.recording.scenario)):
        print(notice)
    with progress_bar(quiet or (mcap is None and rerun is None and ros2 is None)) as progress:
        told = Counted(progress, "writing")
        written = run.export(
            map_=map_, mcap=mcap, rerun=rerun, ros2=ros2, robot=robot, at=at, allow_code=allow_code, progress=told
        )
    for path in () if quiet else written:
        print(path)
