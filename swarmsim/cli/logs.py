"""The verb that makes recordings of robots that exist."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def import_log(
    scenario: Annotated[Path, typer.Argument(help="Scenario file (TOML) with the world of these robots.")],
    files: Annotated[list[Path], typer.Argument(metavar="LOG...", help="CSV files, MCAP files or rosbag2 folders.")],
    out: Annotated[Path, typer.Option(help="Folder for the recording; it must not exist yet.")],
) -> None:
    """Record what robots that exist have done, from their logs, and fit their speed, acceleration and noise.

    CSV has the columns time, robot, x, y, yaw; or time, robot and distances; or time, sender, receiver, bytes.

    Example: swarmsim import-log scenarios/room.toml poses.csv --out runs/real
    """
    from swarmsim.api.logs import import_log as imported

    found = imported(scenario, files, out)
    fit = found.fit
    print(f"{out}: {found.run.iterations} iterations of {found.run.recording.scenario.robots.count} robots")
    for what, value, unit, count in (
        ("top speed", fit.speed, "m/s", f"{fit.windows} windows"),
        ("acceleration", fit.acceleration, "m/s2", f"{fit.starts} starts"),
        ("noise of x and y", fit.pose_noise, "m", "at rest"),
        ("noise of distances", fit.range_noise, "m", f"{fit.ranges} differences"),
    ):
        print(f"  {what}: {'the log does not tell' if value != value else f'{value:.3g} {unit} ({count})'}")
