"""A robot's end of a link: it joins a world, is told its charge, and then senses, says, hears and decides.

Nothing that it imports has a world, bodies, walls or recordings: see the contract "a robot knows no world".
"""

from __future__ import annotations

import os
import time
from collections import Counter, deque
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final, final

import numpy as np

from swarmsim.core.charge import Charge
from swarmsim.core.messages import FrameError
from swarmsim.core.robot import Letter, Robot, Sensed, warm
from swarmsim.fleet import diaries, logbook, wire
from swarmsim.fleet.logbook import Logbook
from swarmsim.fleet.terms import AGAIN, FROM_ROBOTS, LATE, Terms, from_world
from swarmsim.fleet.transport import WORLD, LinkError, RobotLink
from swarmsim.fleet.wire import Ears, Telegram

_PATIENCE: Final = 0.5  # s, after which a robot asks the world for a frame that the air has lost
_GRACE: Final = 0.1  # of a period, that a robot at a free pace waits for a frame it should hear
_LISTENS: Final = 0.4  # of a period, that it listens to a real link
_MOST: Final = 100_000  # frames that wait to be heard


@final
class RobotEnd:
    """A robot at its end of a link."""

    def __init__(self, link: RobotLink, number: int, log: Path | None = None, recalls: bool = False) -> None:
        """One with a `log` that `recalls` begins with what it knew when that ended. Raises InputError."""
        self._link, self._number, self._recalls = link, number, recalls
        self._log = None if log is None else Logbook(log)
        self._path = log
        self._tells, self._told = link.channel(FROM_ROBOTS), link.channel(from_world(number))
        self._waiting = deque[Telegram]()
        self._heard: dict[tuple[int, int], Letter] = {}  # by sender and iteration sent
        self._terms = Terms()
        #: What was dropped, by reason.
        self.counts = Counter[str]()

    def run(self) -> None:
        """Live until the world ends. Raises InputError for a charge that is none, LinkError if the world is lost."""
        try:
            charge = self._joined()
            warm(charge)  # before it counts as there: compiling takes longer than an iteration
            robot = self._made(charge)
            self._say(Telegram(wire.READY, self._number))
            while (sensed := self._sensed(robot)) is not None:
                if not self._live(robot, sensed):
                    return
        finally:
            if self._log is not None:
                self._log.close()

    def _made(self, charge: Charge) -> Robot:
        """The robot, with an empty memory or what it knew."""
        recalled = None
        if self._recalls and self._path is not None:
            recalled = diaries.recalled(self._path, charge)
        self._note(wire.CHARGE, charge.packed())
        self._note(logbook.TERMS, self._terms.packed())
        if recalled is not None:
            self._note(logbook.RECALLED, b"")
        return recalled or Robot.of(charge)

    def _live(self, robot: Robot, sensed: Sensed) -> bool:
        """One iteration; whether the world goes on."""
        frames = robot.sense(sensed)
        said = Telegram(wire.SAID, self._number, sensed.iteration, pieces=tuple(frames))
        self._note(wire.SAID, said.packed())
        self._flush()
        for frame in frames if sensed.alive else ():
            self._link.say(frame)
        self._say(said)
        if self._terms.links == "real":
            letters, awake, oldest = self._arrived(robot, sensed.iteration), sensed.alive, sensed.iteration - LATE
        else:
            ears = self._ears(sensed.iteration)
            if ears is None:
                return False
            letters, awake, oldest = self._letters(robot, ears), ears.awake, ears.oldest
        deed = robot.hear(letters, awake, oldest)
        done = wire.deed_telegram(self._number, deed, robot.context.actuators)
        self._note(wire.DEED, done.packed())
        self._flush()
        self._say(done)
        return True

    def _joined(self) -> Charge:
        """The charge that the world tells, however late it comes there."""
        while True:
            self._say(Telegram(wire.JOIN, self._number, os.getpid()))
            telegram = self._within(AGAIN)
            if telegram is not None and telegram.kind == wire.CHARGE and len(telegram.pieces) == 2:
                self._terms = Terms.read(telegram.pieces[1])
                return Charge.read(telegram.pieces[0], f"the charge of robot {self._number}")

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
            self._note(wire.SENSED, telegram.packed())
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
                    self._note(wire.EARS, telegram.packed())
                    return ears
            self.counts["out of turn"] += 1

    def _letters(self, robot: Robot, ears: Ears) -> Sequence[Letter]:
        """The letters, from the air, or from the world where it changed them or the air lost them.

        At a free pace nobody asks the world for those.
        """
        patience = _PATIENCE if self._terms.lockstep else _GRACE * self._terms.period
        ends = time.monotonic() + patience
        while True:
            self._listen(robot, ears.oldest)
            keys = [(sender, sent) for sender, sent in ears.letters.tolist()]
            given = zip(keys, ears.frames, strict=True)
            found = [robot.read(frame) if frame else self._heard.get(key) for key, frame in given]
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

    def _arrived(self, robot: Robot, iteration: int) -> Sequence[Letter]:
        """All that arrives on the air in time for this iteration, or what the nearest say of it."""
        ends = time.monotonic() + _LISTENS * self._terms.period
        while (left := ends - time.monotonic()) > 0.0:
            self._link.wait(left)
            self._listen(robot, iteration - LATE)
        keys = [key for key in self._heard if key[1] <= iteration]
        letters = [self._heard.pop(key) for key in keys]
        return robot.nearest(letters, self._terms.nearest) if self._terms.nearest else letters

    def _listen(self, robot: Robot, oldest: int) -> None:
        """Read the frames that have arrived; old ones are forgotten, and what no robot can have said is dropped."""
        for frame, _ in self._link.heard():
            try:
                letter = robot.read(frame)
            except FrameError:
                self.counts["no frame of this swarm"] += 1
                continue
            self._note(logbook.HEARD, frame)
            self._heard[letter.sender, letter.sent] = letter
        if len(self._heard) > _MOST or any(key[1] < oldest for key in self._heard):
            self._heard = {key: one for key, one in list(self._heard.items())[-_MOST:] if key[1] >= oldest}

    def _say(self, telegram: Telegram) -> None:
        self._tells.say(telegram.packed())

    def _note(self, kind: int, data: bytes) -> None:
        if self._log is not None:
            self._log.note(kind, data)

    def _flush(self) -> None:
        if self._log is not None:
            self._log.flush()

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
