"""Recorded runs as files for other programs."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

from shapely import box

from swarmsim.api.figures import check_maps
from swarmsim.core.errors import InputError, StorageError, unwritten
from swarmsim.operations.mapping.replay import MapReplay
from swarmsim.recording.reader import Recording
from swarmsim.world import rosmap
from swarmsim.world.rasters import cropped
from swarmsim.world.source import floor_plan

Progress = Callable[[int, int], None]  # called with iterations done and all iterations


def exported(
    recording: Recording,
    name: str,
    map_: Path | None,
    mcap: Path | None,
    rerun: Path | None,
    ros2: Path | None,
    robot: int | None,
    at: int | None,
    progress: Progress,
) -> list[Path]:
    """Write a run for other programs and return the files. `name` is the run's in messages. Raises InputError."""
    if map_ is None and mcap is None and rerun is None and ros2 is None:
        raise InputError("export: nothing to write; name a file with --map, --mcap, --rerun or --ros2")
    if ros2 is not None and (ros2.exists() or ros2.suffix == ".bag"):
        why = "exists already" if ros2.exists() else "is a name for ROS 1"
        raise InputError(f"--ros2 {ros2}: {why}; expected a new folder, such as {ros2.stem}-bag")
    for option, path, suffix in (("--mcap", mcap, ".mcap"), ("--rerun", rerun, ".rrd")):
        if path is not None and path.suffix.lower() != suffix:
            raise InputError(f"{option} {path}: expected a name that ends in {suffix}")
    if not recording.iterations:
        raise InputError(f"{name}: no whole iteration was recorded; expected at least one")
    written = [] if map_ is None else _map(recording, name, map_, robot, at)
    if mcap is not None:
        from swarmsim.view.viewers.foxglove import write_mcap

        written.append(_whole(recording, mcap, write_mcap, progress))
    if rerun is not None:
        from swarmsim.view.viewers.rerun import write_rrd

        written.append(_whole(recording, rerun, write_rrd, progress))
    if ros2 is not None:
        from swarmsim.view.viewers.ros2 import write_bag

        written.append(_whole(recording, ros2, write_bag, progress))
    return written


def _map(recording: Recording, name: str, out: Path, robot: int | None, at: int | None) -> list[Path]:
    check_maps(recording, name)
    count = recording.scenario.robots.count
    if robot is not None and not 0 <= robot < count:
        raise InputError(f"--robot {robot}: no such robot; expected 0 to {count - 1}")
    iteration = recording.iterations - 1 if at is None else at
    if not 0 <= iteration < recording.iterations:
        raise InputError(f"--at {iteration}: no such iteration; expected 0 to {recording.iterations - 1}")
    replay = MapReplay(recording)
    replay.advance(iteration)
    states = replay.collective() if robot is None else replay.maps[robot]
    plan = floor_plan(recording.world, recording.scenario.world)
    areas = [box(*plan.page), *plan.layers.values(), plan.border]
    return list(rosmap.write(out, *cropped(states, recording.lattice, areas)))


def _whole(
    recording: Recording, out: Path, write: Callable[[Recording, Path, Progress], None], progress: Progress
) -> Path:
    """Write a file, or a folder, that appears whole or not at all."""
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=out.parent, prefix=".export-") as folder:
            part = Path(folder) / out.name
            progress(0, recording.iterations)
            write(recording, part, progress)
            part.replace(out)
    except OSError as problem:
        raise unwritten(out, problem) from problem
    except RuntimeError as problem:  # from the MCAP SDK, without a system error number
        if "I/O error" not in str(problem):
            raise
        raise StorageError(f"{out}: cannot be written ({problem})") from problem
    return out
