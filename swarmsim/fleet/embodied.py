"""A robot with a body of its own and no world: its mind at its own pace, on its own clock."""

from __future__ import annotations

import math
import time
from collections import Counter
from typing import Final, final

import numpy as np

from swarmsim.core.charge import Charge
from swarmsim.core.errors import InputError
from swarmsim.core.robot import Robot, Sensed
from swarmsim.core.state import Intents
from swarmsim.fleet import wire
from swarmsim.fleet.adapter import Felt, Pose
from swarmsim.fleet.body_senses import BodySenses
from swarmsim.fleet.emergency import Halt
from swarmsim.fleet.guard import GuardedBody
from swarmsim.fleet.listening import Listener
from swarmsim.fleet.logbook import Logbook, NoLogbook
from swarmsim.fleet.robot_end import begun
from swarmsim.fleet.terms import LATE, Terms
from swarmsim.fleet.transport import LinkError, RobotLink
from swarmsim.fleet.wire import Telegram

_PATIENCE: Final = 10.0  # s, in which a body has to tell where it is, and what the mind senses
_LONGEST: Final = 500  # waypoints that a guard is told: it is told anew in each iteration
_AHEAD: Final = 100_000  # iterations that a frame may be ahead of all before


@final
class EmbodiedRobot:
    """A robot that senses by its body, hears what arrives, and lets its guard drive.

    Iterations are numbered from 0. A robot that hears of a later one goes on with that number: swarms agree on time
    without clocks that do.
    """

    def __init__(
        self, link: RobotLink, charge: Charge, body: GuardedBody, nearest: int, log: Logbook | NoLogbook
    ) -> None:
        """One that listens to the `nearest` of those that it hears; 0: to all."""
        self._link, self._charge, self._body, self._log = link, charge, body, log
        self._air = Listener(link, log, self._obeys)
        self._terms = Terms(period=charge.period, links="real", nearest=nearest)
        self._ordered = -1  # when the newest order that it obeyed was given
        #: Iterations that began more than a tenth of a period late.
        self.late = 0

    @property
    def counts(self) -> Counter[str]:
        """What was dropped, by reason."""
        return self._air.counts

    def run(self, recalled: Robot | None = None, iterations: int | None = None) -> None:
        """Live for so many iterations, or until the body is lost, which raises LinkError.

        Raises InputError for a body that does not tell what the mind senses.
        """
        robot = begun(self._charge, self._terms, self._log, recalled)
        senses = BodySenses(robot.context.channels, robot.context.lattice)
        senses.check(self._placed()[0])
        now, lived, due = 0, 0, time.monotonic()
        while iterations is None or lived < iterations:
            self._live(robot, senses, now)
            lived, due = lived + 1, due + self._charge.period
            if (over := time.monotonic() - due) > 0.0:
                self.late += over > 0.1 * self._charge.period
                due += over
            self._air.until(robot, due, now - LATE)
            latest = self._air.latest
            now = latest if now < latest <= now + _AHEAD else now + 1

    def _live(self, robot: Robot, senses: BodySenses, now: int) -> None:
        felt, pose = self._placed()
        x, y, yaw = pose
        ahead, turn = felt.velocity or (0.0, 0.0)
        velocity = np.array([ahead * math.cos(yaw), ahead * math.sin(yaw), turn])
        sensed = Sensed(now, True, np.array([x, y, yaw]), velocity, senses.readings(felt, pose))
        self._log.note(wire.SENSED, wire.sensed_telegram(robot.number, sensed, robot.context.actuators).packed())
        frames = robot.sense(sensed)
        self._log.note(wire.SAID, Telegram(wire.SAID, robot.number, now, pieces=tuple(frames)).packed())
        self._log.flush()
        for frame in frames:
            self._link.say(frame)
        deed = robot.hear(self._air.arrived(robot, now, self._terms), True, now - LATE)
        self._log.note(wire.DEED, wire.deed_telegram(robot.number, deed, robot.context.actuators).packed())
        self._log.flush()
        self._do(deed.intents)

    def _placed(self) -> tuple[Felt, Pose]:
        """What the body feels, and where it is. Raises LinkError if that stays unknown."""
        ends = time.monotonic() + _PATIENCE
        while True:
            felt = self._body.sense()
            if self._body.pose is not None:
                return felt, self._body.pose
            if time.monotonic() > ends:
                raise LinkError(f"the body does not tell where it is within {_PATIENCE:g} s; it stands")
            time.sleep(0.02)

    def _do(self, intents: Intents) -> None:
        """Tell the guard. Raises InputError for a move to the side."""
        twist = None if intents.twists is None else intents.twists[0].tolist()
        if twist is None or math.isnan(sum(twist)):
            way = intents.waypoints[0, : min(int(intents.counts[0]), _LONGEST)]
            self._body.follow([(x, y) for x, y in way.tolist()])
            return
        if any(twist[2:]):
            raise InputError("--adapter: this mind moves to the side, which bodies on two wheels cannot")
        self._body.drive(twist[0], twist[1])

    def _obeys(self, frame: bytes) -> bool:
        """Obey an order on the air; whether it is one."""
        order = Halt.read(frame)
        if order is None:
            return False
        if order.is_for(self._charge.robot) and (order.when, order.halts) > (self._ordered, False):
            self._ordered = order.when
            self._body.halt() if order.halts else self._body.release()
        return True
