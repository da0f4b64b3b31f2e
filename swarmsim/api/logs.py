"""Logs of robots that exist, as recordings beside simulated ones."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, cast

import msgspec
import numpy as np
from numpy.typing import NDArray

from swarmsim.api.recorded import Run
from swarmsim.api.runs import new_folder
from swarmsim.core.errors import InputError
from swarmsim.core.events import Ended
from swarmsim.core.messages import Delivery
from swarmsim.core.scenario.file import load
from swarmsim.core.state import Done, Intents, Knowledge, Moment, State
from swarmsim.engine.build import BuiltRun, build
from swarmsim.recording.logs import RobotLog, read_logs
from swarmsim.recording.reader import Recording
from swarmsim.studies.motion_fit import MotionFit, fitted_motion

_GAP: Final = 5.0  # periods without a pose, after which a robot counts as absent
_MOST: Final = 1_000_000  # iterations
#: What a log does not tell, and so is not in its recording.
_BARE: Final = (
    'sensor={use="none"}', 'mind={computation={use="reactive"}, strategy={use="stand"}}', "faults=[]",
    'network={topology={use="none"}}', 'localisation={use="perfect"}', 'task={use="travelled", distance=1e6}',
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class ImportedLog:
    """A log as a recording, and what it tells of its robots."""

    run: Run
    fit: MotionFit


def import_log(scenario: str | Path, files: Sequence[str | Path], out: str | Path) -> ImportedLog:
    """Record what robots that exist have done into the new folder `out`: `swarmsim import-log`.

    `scenario` has their world, period and radius; `files` are logs in CSV, MCAP or rosbag2. Robots are numbered as in
    the log, from 0. Raises InputError.
    """
    log = read_logs([Path(file) for file in files])
    made = _built(Path(scenario), log)
    moments = _moments(made, log)
    folder = new_folder(Path(out))
    with made.recorder(folder / "recording.h5") as recorder:
        for moment in moments:
            recorder.sample(moment)
    return ImportedLog(Run(Recording(folder), folder), fitted_motion(log))


def _built(scenario: Path, log: RobotLog) -> BuiltRun:
    """A run of the log's robots in the scenario's world, which is never simulated."""
    numbers = sorted(log.poses)
    if numbers[0] < 0 or numbers[-1] > 9999:
        raise InputError(f"robot {numbers[0] if numbers[0] < 0 else numbers[-1]} in the log; expected 0 to 9999")
    strange = (log.messages[:, 1:3] < 0) | (log.messages[:, 1:3] > numbers[-1])
    if strange.any():
        robot = int(log.messages[:, 1:3][strange][0])
        raise InputError(f"robot {robot} sends or hears a message, and has no pose; expected 0 to {numbers[-1]}")
    found = load(scenario, [*_BARE, f"robots.count={numbers[-1] + 1}"])
    steps = int((log.ends - log.begins) / found.period + 0.5) + 1
    if steps > _MOST:
        raise InputError(f"the log has {steps} periods of {found.period:g} s; expected {_MOST} at most")
    stop = msgspec.structs.replace(found.stop, iterations=steps)
    found = msgspec.structs.replace(found, title=f"Log: {found.title}", stop=stop)
    return build(found, str(scenario))


def _moments(made: BuiltRun, log: RobotLog) -> Iterator[Moment[Knowledge]]:
    """The log, iteration by iteration. Raises InputError for robots off the page."""
    period, building = made.scenario.period, made.simulation.parts.building
    count = int((log.ends - log.begins) / period + 0.5) + 1
    times: NDArray[np.float64] = log.begins + period * np.arange(count, dtype=np.float64)
    poses, alive = _resampled(made, log, times)
    left, lower, right, upper = building.bounds
    outside = alive & ((poses[..., :2] < (left, lower)) | (poses[..., :2] > (right, upper))).any(axis=-1)
    if outside.any():
        row, robot = (int(one) for one in np.argwhere(outside)[0])
        x, y = poses[row, robot, :2]
        raise InputError(
            f"robot {robot} is at ({x:g}, {y:g}) m after {times[row] - log.begins:g} s, off the page of "
            f"{made.scenario.world.file}; expected poses in the frame of that world"
        )
    return _told(made, log, times, poses, alive)


def _told(
    made: BuiltRun, log: RobotLog, times: NDArray[np.float64], poses: NDArray[np.float64], alive: NDArray[np.bool_]
) -> Iterator[Moment[Knowledge]]:
    """The moments of these poses (t, n, 3) and robots that are there (t, n)."""
    count, period, task = poses.shape[1], made.scenario.period, made.simulation.parts.task
    aims, none = np.full((count, 2), np.nan), np.zeros(count, np.int32)
    nowhere = Intents(aims, np.zeros((count, 1, 2)), none, none > 0)
    silent = build(made.scenario, "the log", made.world).simulation.tick([])  # an iteration of robots that say nothing
    for row in range(len(times)):
        velocity = (poses[row] - poses[max(row - 1, 0)]) / period
        letters = _letters(log, times[row], period, row)
        moment = replace(
            silent, state=State(row, poses[row], velocity, np.zeros((count, 2)), alive[row]), intents=nowhere,
            links=np.unique(letters[:, :2], axis=0), delivery=Delivery(letters, (), row),
            events=(Ended(row, finished=False),) if row == len(times) - 1 else (),
        )  # fmt: skip
        yield replace(moment, measured=task.measure(cast("Done[Knowledge]", moment)))


def _resampled(
    made: BuiltRun, log: RobotLog, times: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Poses (t, n, 3) at these times, between those logged, and who was there (t, n)."""
    count = made.context.swarm
    poses, alive = np.zeros((len(times), count, 3)), np.zeros((len(times), count), np.bool_)
    for robot, rows in log.poses.items():
        for column in range(3):
            numbers = np.unwrap(rows[:, 3]) if column == 2 else rows[:, 1 + column]
            poses[:, robot, column] = np.interp(times, rows[:, 0], numbers)
        after = np.searchsorted(rows[:, 0], times)
        gaps = [np.abs(rows[np.clip(after + one, 0, len(rows) - 1), 0] - times) for one in (-1, 0)]
        alive[:, robot] = np.minimum(*gaps) <= _GAP * made.scenario.period
    return poses, alive


def _letters(log: RobotLog, time: float, period: float, row: int) -> NDArray[np.int32]:
    """The messages of an iteration: receiver, sender, iteration sent, bytes."""
    when = log.messages[:, 0]
    found = log.messages[(when >= time) & (when < time + period)]
    letters = np.column_stack([found[:, 2], found[:, 1], np.full(len(found), row), found[:, 3]]).astype(np.int32)
    return letters[np.lexsort(letters[:, [2, 1, 0]].T)]
