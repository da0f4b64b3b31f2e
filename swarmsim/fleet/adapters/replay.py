"""A body on a desk: it feels what a robot sensed in a recorded run, in real time, whatever it is told to do."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import Annotated, final

from msgspec import Meta, Struct

from swarmsim.core.errors import InputError
from swarmsim.core.messages import FrameError
from swarmsim.core.readings import Channels
from swarmsim.core.robot import Sensed
from swarmsim.fleet import diaries, wire
from swarmsim.fleet.adapter import Felt
from swarmsim.fleet.transport import LinkError


class ReplayedBody(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A robot's senses in a run, from its log or from one that `swarmsim robot replay --out` wrote; no body moves.

    It begins when it is opened, and cannot be reached any more once the run has ended.
    """

    file: str  # the log
    pace: Annotated[float, Meta(gt=0.0, le=1e6)] = 1.0  # times real time

    def open(self, robot: int) -> Desk:
        """Begin. Raises InputError for a file that is no log of this robot."""
        path = Path(self.file)
        charge = diaries.charge_of(path)
        if charge.robot != robot:
            raise InputError(f"adapter replay: {self.file} is of robot {charge.robot}; expected one of robot {robot}")
        channels, actuators = Channels(*charge.channels), Channels(*charge.actuators)
        try:
            senses = [wire.sensed_of(one.sensed.telegram(path), channels, actuators) for one in diaries.lives(path)]
        except FrameError as problem:
            raise InputError(f"adapter replay: {path}: {problem}; expected a log as written") from problem
        return Desk(senses, channels, charge.period / self.pace)


@final
class Desk:
    """What a robot sensed, one row after the other. `commands` are all that it was told since."""

    def __init__(self, senses: list[Sensed], channels: Channels, period: float) -> None:
        self._senses, self._channels, self._period = senses, channels, period
        self._began = time.monotonic()
        self.commands: list[tuple[float, float]] = []  # m/s, rad/s

    def sense(self) -> Felt:
        """What the robot sensed by now: `values` has the numbers of each of its sensors' channels, in a row."""
        row = int((time.monotonic() - self._began) / self._period)
        if row >= len(self._senses):
            raise LinkError(f"adapter replay: the run has ended, after {len(self._senses)} iterations")
        found = self._senses[row]
        x, y, yaw = found.pose.tolist()
        along_x, along_y, turn = found.velocity.tolist()
        values = {
            channel.name: tuple(float(one) for one in column.ravel().tolist())
            for channel, column in zip(self._channels, found.readings, strict=True)
        }
        ahead = along_x * math.cos(yaw) + along_y * math.sin(yaw)
        return Felt((x, y, yaw), (ahead, turn), values)

    def drive(self, ahead: float, turn: float) -> None:
        """Note it."""
        self.commands.append((ahead, turn))

    def stop(self) -> None:
        """Note that it stands."""
        self.drive(0.0, 0.0)

    def close(self) -> None:
        """Nothing is open."""
