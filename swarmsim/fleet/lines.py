"""The world's lines to its robots: it tells each by itself, hears each on a channel of its own, and lets them join."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from typing import Final, final

from swarmsim.core.charge import Charge
from swarmsim.core.errors import InputError
from swarmsim.core.messages import FrameError
from swarmsim.fleet import wire
from swarmsim.fleet.terms import Terms, from_robot, from_world
from swarmsim.fleet.transport import LinkError, RobotLink
from swarmsim.fleet.wire import Telegram

_LOOK: Final = 0.005  # s between two looks at all channels


@final
class RobotLines:
    """Telegrams to and from the robots of a fleet."""

    def __init__(self, link: RobotLink, charges: Sequence[Charge], terms: Terms) -> None:
        """Each robot that joins is told its charge and the terms."""
        self.terms, self.charges, self._link = terms, charges, link
        self._from_robots = [link.channel(from_robot(robot)) for robot in range(len(charges))]
        self._to_robots = [link.channel(from_world(robot)) for robot in range(len(charges))]
        #: The process of each robot, as it told.
        self.pids: dict[int, int] = {}
        #: What was dropped, by reason.
        self.counts = Counter[str]()

    def present(self) -> set[int]:
        """The robots that are there, as far as the transport knows."""
        return self._link.present()

    def tell(self, telegram: Telegram) -> None:
        """Tell the robot that it is for. Raises LinkError if too much waits for it already, except at a free pace."""
        try:
            self._to_robots[telegram.robot].say(telegram.packed())
        except LinkError:
            if self.terms.lockstep:
                raise
            self.counts["unsent"] += 1

    def heard(self, seconds: float, first: int = 0) -> list[Telegram]:
        """What robots have told, after waiting at most so long for something, above all from the robot `first`.

        What is no telegram of the robot whose channel it came by is counted and dropped.
        """
        ends = time.monotonic() + seconds
        while True:
            found = [
                one
                for robot, channel in enumerate(self._from_robots)
                for data, _ in channel.heard()
                if (one := self._read(robot, data)) is not None
            ]
            left = ends - time.monotonic()
            if found or left <= 0.0:
                return found
            self._from_robots[first].wait(min(left, _LOOK))

    def _read(self, robot: int, data: bytes) -> Telegram | None:
        try:
            telegram = Telegram.read(data)
        except FrameError:
            self.counts["no telegram"] += 1
            return None
        if telegram.robot != robot:
            self.counts["of another robot"] += 1
            return None
        return telegram

    def admit(self, telegram: Telegram) -> None:
        """Let a robot join: tell it its charge and the terms. Raises InputError for a second robot of one number."""
        robot = telegram.robot
        if self.pids.setdefault(robot, telegram.iteration) != telegram.iteration:
            raise InputError(
                f"two robots have joined as number {robot}, processes {self.pids[robot]} and {telegram.iteration}; "
                "expected one of each number"
            )
        self.tell(Telegram(wire.CHARGE, robot, pieces=(self.charges[robot].packed(), self.terms.packed())))

    def forget(self, robot: int) -> int:
        """A robot has gone: another process may join under its number. Gives its own; 0 for none."""
        return self.pids.pop(robot, 0)

    def end(self) -> None:
        """Tell all robots that the run has ended."""
        for robot in range(len(self.charges)):
            self.tell(Telegram(wire.END, robot))
