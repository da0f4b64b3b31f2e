"""The verb that gives recordings to other programs."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from swarmsim.cli.options import AllowCode
from swarmsim.cli.progress import progress_bar

if TYPE_CHECKING:
    from swarmsim.recording.reader import Recording

Write = Callable[["Recording", Path, Callable[[int, int], None]], None]


def export(
    recording: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run, or its recording.")],
    map_: Annotated[
        Path | None,
        typer.Option("--map", metavar="OUT", help="Map to write: .yaml (map_server) or .json (OccupancyGrid)."),
    ] = None,
    mcap: Annotated[Path | None, typer.Option(metavar="OUT.mcap", help="The run for Foxglove and Lichtblick.")] = None,
    rerun: Annotated[Path | None, typer.Option(metavar="OUT.rrd", help="The run for the Rerun viewer.")] = None,
    robot: Annotated[
        int | None, typer.Option(metavar="I", help="The robot whose map it is; by default the union of all.")
    ] = None,
    at: Annotated[int | None, typer.Option(metavar="N", help="The map's iteration; by default the last.")] = None,
    allow_code: AllowCode = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print nothing but errors.")] = False,
) -> None:
    """Write a run for other programs: what was mapped for ROS, or all of it for a robotics viewer.

    Example: swarmsim export runs/basilica-1 --map basilica.yaml --robot 3 --at 100

    For Foxglove: swarmsim export runs/basilica-1 --mcap basilica.mcap
    """
    from swarmsim.core.errors import InputError
    from swarmsim.recording.reader import Recording
    from swarmsim.view.layers.own import left_out

    if map_ is None and mcap is None and rerun is None:
        raise InputError("export: nothing to write; name a file with --map, --mcap or --rerun")
    for option, path, suffix in (("--mcap", mcap, ".mcap"), ("--rerun", rerun, ".rrd")):
        if path is not None and path.suffix.lower() != suffix:
            raise InputError(f"{option} {path}: expected a name that ends in {suffix}")
    opened = Recording(recording)
    if not opened.iterations:
        raise InputError(f"{recording}: no whole iteration was recorded; expected at least one")
    written = [] if map_ is None else _map(opened, recording, map_, robot, at)
    if (mcap is not None or rerun is not None) and (told := left_out(opened.scenario)) and not quiet:
        print(told)
    if mcap is not None:
        from swarmsim.view.viewers.foxglove import write_mcap

        written.append(_whole(opened, mcap, write_mcap, quiet))
    if rerun is not None:
        from swarmsim.view.viewers.rerun import write_rrd

        written.append(_whole(opened, rerun, write_rrd, quiet))
    for path in () if quiet else written:
        print(path)


def _map(opened: Recording, name: Path, out: Path, robot: int | None, at: int | None) -> list[Path]:
    from shapely import box

    from swarmsim.core.errors import InputError
    from swarmsim.operations.mapping.replay import MapReplay
    from swarmsim.world import rosmap
    from swarmsim.world.rasters import cropped
    from swarmsim.world.source import floor_plan

    if "changes" not in opened:
        raise InputError(f"{name}: these robots kept no maps; expected the run of a swarm that maps")
    count = opened.scenario.robots.count
    if robot is not None and not 0 <= robot < count:
        raise InputError(f"--robot {robot}: no such robot; expected 0 to {count - 1}")
    iteration = opened.iterations - 1 if at is None else at
    if not 0 <= iteration < opened.iterations:
        raise InputError(f"--at {iteration}: no such iteration; expected 0 to {opened.iterations - 1}")
    replay = MapReplay(opened)
    replay.advance(iteration)
    states = replay.collective() if robot is None else replay.maps[robot]
    plan = floor_plan(opened.world, opened.scenario.world)
    areas = [box(*plan.page), *plan.layers.values(), plan.border]
    return list(rosmap.write(out, *cropped(states, opened.lattice, areas)))


def _whole(opened: Recording, out: Path, write: Write, quiet: bool) -> Path:
    """Write a file with a progress bar; it appears whole or not at all."""
    from swarmsim.core.errors import StorageError, unwritten

    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        with progress_bar(quiet) as progress, tempfile.TemporaryDirectory(dir=out.parent, prefix=".export-") as folder:
            task = progress.add_task("writing", total=opened.iterations, text="")
            part = Path(folder) / out.name
            write(opened, part, lambda done, _: progress.update(task, completed=done))
            part.replace(out)
    except OSError as problem:
        raise unwritten(out, problem) from problem
    except RuntimeError as problem:  # as the SDK for MCAP says it, with no number of the system's
        if "I/O error" not in str(problem):
            raise
        raise StorageError(f"{out}: cannot be written ({problem})") from problem
    return out
