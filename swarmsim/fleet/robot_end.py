"""A robot's end of a link: it joins a world, is told its charge, and then senses, says, hears and decides.

Nothing that it imports has a world, bodies, walls or recordings: see the contract "a robot knows no world".
"""

from __future__ import annotations

import os
import time
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final, final

import numpy as np

from swarmsim.core.charge import Charge
from swarmsim.core.errors import InputError
from swarmsim.core.messages import FrameError
from swarmsim.core.robot import Letter, Robot, Sensed, warm
from swarmsim.fleet import diaries, logbook, wire
from swarmsim.fleet.listening import Listener
from swarmsim.fleet.logbook import Logbook, NoLogbook
from swarmsim.fleet.terms import AGAIN, LATE, Terms, from_robot, from_world
from swarmsim.fleet.transport import WORLD, LinkError, RobotLink
from swarmsim.fleet.wire import Ears, Telegram

_PATIENCE: Final = 0.5  # s, after which a robot asks the world for a frame that the air has lost
_GRACE: Final = 0.1  # of a period, that a robot at a free pace waits for a frame it should hear


def begun(charge: Charge, terms: Terms, log: Logbook | NoLogbook, recalled: Robot | None) -> Robot:
    """The robot of a charge, with an empty memory or as it is `recalled`; the log says which."""
    log.note(wire.CHARGE, charge.packed())
    log.note(logbook.TERMS, terms.packed())
    if recalled is not None:
        log.note(logbook.RECALLED, b"")
    return recalled or Robot.of(charge)


@final
class RobotEnd:
    """A robot at its end of a link."""

    def __init__(
        self,
        link: RobotLink,
        number: int,
        log: Path | None = None,
        recalls: bool = False,
        expected: Charge | None = None,
    ) -> None:
        """One with a `log` that `recalls` begins with what it knew when that ended.

        It joins only a world of the scenario of the `expected` charge. Raises InputError.
        """
        self._link, self._number, self._expected = link, number, expected
        self._log = NoLogbook() if log is None else Logbook(log)
        self._recalls = log if recalls else None
        self._tells, self._told = link.channel(from_robot(number)), link.channel(from_world(number))
        self._waiting = deque[Telegram]()
        self._air = Listener(link, self._log, lambda frame: False)
        self._terms = Terms()
        #: What was dropped, by reason.
        self.counts = self._air.counts

    def run(self) -> None:
        """Live until the world ends. Raises InputError for a charge that is none, LinkError if the world is lost."""
        try:
            charge = self._joined()
            warm(charge)  # before it counts as there: compiling takes longer than an iteration
            recalled = None if self._recalls is None else diaries.recalled(self._recalls, charge)
            robot = begun(charge, self._terms, self._log, recalled)
            self._say(Telegram(wire.READY, self._number))
            while (sensed := self._sensed(robot)) is not None:
                if not self._live(robot, sensed):
                    return
        finally:
            self._log.close()

    def _live(self, robot: Robot, sensed: Sensed) -> bool:
        """One iteration; whether the world goes on."""
        frames = robot.sense(sensed)
        said = Telegram(wire.SAID, self._number, sensed.iteration, pieces=tuple(frames))
        self._log.note(wire.SAID, said.packed())
        self._log.flush()
        for frame in frames if sensed.alive else ():
            self._link.say(frame)
        self._say(said)
        if self._terms.links == "real":
            letters = self._air.arrived(robot, sensed.iteration, self._terms)
            awake, oldest = sensed.alive, sensed.iteration - LATE
        else:
            ears = self._ears(sensed.iteration)
            if ears is None:
                return False
            letters, awake, oldest = self._letters(robot, ears), ears.awake, ears.oldest
        deed = robot.hear(letters, awake, oldest)
        done = wire.deed_telegram(self._number, deed, robot.context.actuators)
        self._log.note(wire.DEED, done.packed())
        self._log.flush()
        self._say(done)
        return True

    def _joined(self) -> Charge:
        """The charge that the world tells, however late it comes there."""
        while True:
            self._say(Telegram(wire.JOIN, self._number, os.getpid()))
            telegram = self._within(AGAIN)
            if telegram is not None and telegram.kind == wire.CHARGE and len(telegram.pieces) == 2:
                self._terms = Terms.read(telegram.pieces[1])
                charge = Charge.read(telegram.pieces[0], f"the charge of robot {self._number}")
                if self._expected is not None and self._expected.scenario != charge.scenario:
                    raise InputError(
                        f"--charge: is of the scenario {self._expected.title!r} with digest {self._expected.scenario}, "
                        f"and the world simulates {charge.title!r} with {charge.scenario}; expected the same, with "
                        "equal seed and settings"
                    )
                return charge

    def _sensed(self, robot: Robot) -> Sensed | None:
        """What it senses next: at a free pace the newest, for what has passed is past; None at the end."""
        while True:
            telegram = self._next()
            if telegram.kind == wire.END:
                return None
            later = [one for one in self._arriving() if one.kind == wire.SENSED]
            if telegram.kind != wire.SENSED or (later and not self._terms.lockstep):
                self.counts["skipped" if telegram.kind == wire.SENSED else "out of turn"] += 1
                continue
            try:
                sensed = wire.sensed_of(telegram, robot.context.channels, robot.context.actuators)
            except FrameError:
                self.counts["no telegram"] += 1
                continue
            self._log.note(wire.SENSED, telegram.packed())
            return sensed

    def _ears(self, iteration: int) -> Ears | None:
        """Which letters reach it in this iteration; None at the end."""
        while True:
            telegram = self._next()
            if telegram.kind == wire.END:
                return None
            if telegram.kind == wire.SENSED and telegram.iteration > iteration:  # what was told between got lost
                self._waiting.appendleft(telegram)
                return Ears(iteration, True, iteration, np.empty((0, 2), np.int32))
            if telegram.kind == wire.EARS and telegram.iteration == iteration:
                with suppress(FrameError):
                    ears = Ears.of(telegram)
                    self._log.note(wire.EARS, telegram.packed())
                    return ears
            self.counts["out of turn"] += 1

    def _letters(self, robot: Robot, ears: Ears) -> Sequence[Letter]:
        """The letters, from the air, or from the world where it changed them or the air lost them.

        At a free pace nobody asks the world for those.
        """
        patience = _PATIENCE if self._terms.lockstep else _GRACE * self._terms.period
        ends = time.monotonic() + patience
        while True:
            self._air.listen(robot, ears.oldest)
            keys = [(sender, sent) for sender, sent in ears.letters.tolist()]
            given = zip(keys, ears.frames, strict=True)
            found = [robot.read(frame) if frame else self._air.get(*key) for key, frame in given]
            letters = [one for one in found if one is not None]
            if len(letters) == len(keys):
                return letters
            if not self._link.wait(ends - time.monotonic()) or time.monotonic() > ends:
                self.counts["lost on the air"] += len(keys) - len(letters)
                if not self._terms.lockstep:
                    return letters
                self._say(Telegram(wire.LACKS, self._number, ears.iteration))
                again = self._ears(ears.iteration)
                if again is None or not all(again.frames):
                    raise LinkError(f"robot {self._number}: the world does not tell what the air has lost")
                ears = again

    def _say(self, telegram: Telegram) -> None:
        self._tells.say(telegram.packed())

    def _next(self) -> Telegram:
        """The next telegram of the world. Raises LinkError if there is no world any more."""
        while True:
            telegram = self._within(AGAIN)
            if telegram is not None:
                return telegram
            if WORLD not in self._link.present():
                raise LinkError("the world has gone; what was learned until then is in the log, if one was named")

    def _within(self, seconds: float) -> Telegram | None:
        """The next telegram, if one comes in time."""
        self._arriving(0.0 if self._waiting else seconds)
        return self._waiting.popleft() if self._waiting else None

    def _arriving(self, seconds: float = 0.0) -> Sequence[Telegram]:
        """The telegrams that wait, after waiting for one at most so long."""
        if self._told.wait(seconds):
            for data, _ in self._told.heard():
                try:
                    self._waiting.append(Telegram.read(data))
                except FrameError:
                    self.counts["no telegram"] += 1
        return self._waiting
