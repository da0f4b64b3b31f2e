"""A robot's process: it joins a world, is told its charge, and then senses, says, hears and decides in step with it.

Nothing that it imports has a world, bodies, walls or recordings: see the contract "a robot knows no world".
"""

from __future__ import annotations

import argparse
import os
import sys
import threading
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from typing import Final

from swarmsim.core.charge import Charge
from swarmsim.core.errors import InputError
from swarmsim.core.messages import FrameError
from swarmsim.core.robot import Letter, Robot, warm
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.part import Part
from swarmsim.fleet import wire
from swarmsim.fleet.transport import LinkError, RobotLink, Transport
from swarmsim.fleet.wire import Ears, Telegram

FROM_ROBOTS: Final = "robots"  # the channel on which all robots tell the world
_PATIENCE: Final = 0.5  # s, after which a robot asks the world for a frame that the air has lost
_AGAIN: Final = 1.0  # s between two knocks at the world's door
_MOST: Final = 100_000  # frames that wait to be heard
BAD_INPUT, LOST = 2, 3  # exit codes


def from_world(robot: int) -> str:
    """The channel on which the world tells one robot."""
    return f"world/{robot}"


class RobotProcess:
    """A robot at its end of a link."""

    def __init__(self, link: RobotLink, number: int) -> None:
        self._link, self._number = link, number
        self._tells, self._told = link.channel(FROM_ROBOTS), link.channel(from_world(number))
        self._waiting: list[Telegram] = []
        self._heard: dict[tuple[int, int], Letter] = {}  # by sender and iteration sent
        #: What was dropped, by reason.
        self.counts = Counter[str]()

    def run(self) -> None:
        """Live until the world ends. Raises InputError for a charge that is none, LinkError if the world is lost."""
        charge = self._joined()
        warm(charge)  # before it counts as there: compiling takes longer than an iteration
        robot = Robot.of(charge)
        context = robot.context
        self._say(Telegram(wire.READY, self._number))
        while True:
            telegram = self._next()
            if telegram.kind == wire.END:
                return
            if telegram.kind != wire.SENSED:
                self.counts["out of turn"] += 1
                continue
            try:
                sensed = wire.sensed_of(telegram, context.channels, context.actuators)
            except FrameError:
                self.counts["no telegram"] += 1
                continue
            frames = robot.sense(sensed)
            for frame in frames if sensed.alive else ():
                self._link.say(frame)
            self._say(Telegram(wire.SAID, self._number, sensed.iteration, pieces=tuple(frames)))
            ears = self._ears(sensed.iteration)
            if ears is None:
                return
            deed = robot.hear(self._letters(robot, ears), ears.awake, ears.oldest)
            self._say(wire.deed_telegram(self._number, deed, context.actuators))

    def _joined(self) -> Charge:
        """The charge that the world tells, however late it comes there."""
        while True:
            self._say(Telegram(wire.JOIN, self._number, os.getpid()))
            telegram = self._within(_AGAIN)
            if telegram is not None and telegram.kind == wire.CHARGE and telegram.pieces:
                return Charge.read(telegram.pieces[0], f"the charge of robot {self._number}")

    def _ears(self, iteration: int) -> Ears | None:
        """Which letters reach it in this iteration; None at the end."""
        while True:
            telegram = self._next()
            if telegram.kind == wire.END:
                return None
            if telegram.kind == wire.EARS and telegram.iteration == iteration:
                with suppress(FrameError):
                    return Ears.of(telegram)
            self.counts["out of turn"] += 1

    def _letters(self, robot: Robot, ears: Ears) -> Sequence[Letter]:
        """The letters, from the air, or from the world where it changed them or the air lost them."""
        ends = time.monotonic() + _PATIENCE
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
                self._say(Telegram(wire.LACKS, self._number, ears.iteration))
                again = self._ears(ears.iteration)
                if again is None or not all(again.frames):
                    raise LinkError(f"robot {self._number}: the world does not tell what the air has lost")
                ears = again

    def _listen(self, robot: Robot, oldest: int) -> None:
        """Read the frames that have arrived; old ones are forgotten, and what no robot can have said is dropped."""
        for frame, _ in self._link.heard():
            try:
                letter = robot.read(frame)
            except FrameError:
                self.counts["no frame of this swarm"] += 1
                continue
            self._heard[letter.sender, letter.sent] = letter
        if len(self._heard) > _MOST or any(key[1] < oldest for key in self._heard):
            self._heard = {key: one for key, one in list(self._heard.items())[-_MOST:] if key[1] >= oldest}

    def _say(self, telegram: Telegram) -> None:
        self._tells.say(telegram.packed())

    def _next(self) -> Telegram:
        """The next telegram of the world."""
        while True:
            telegram = self._within(_AGAIN)
            if telegram is not None:
                return telegram

    def _within(self, seconds: float) -> Telegram | None:
        """The next telegram, if one comes in time."""
        if not self._waiting and self._told.wait(seconds):
            for data, _ in self._told.heard():
                try:
                    self._waiting.append(Telegram.read(data))
                except FrameError:
                    self.counts["no telegram"] += 1
        return self._waiting.pop(0) if self._waiting else None


def opened(transport: str, address: str, robot: int) -> RobotLink:
    """A link of a transport by name. Raises InputError."""
    part: Part[Transport] = Part("transport", {"use": transport})
    try:
        return part.build(None).open(address, robot)
    except InputError as problem:
        raise InputError(f"--transport {problem}" if "use:" in str(problem) else str(problem)) from problem


def _end_with_parent() -> None:
    """End this process once the process at the other end of its input has ended, for whatever reason."""

    def watch() -> None:
        while sys.stdin.buffer.read(1):
            pass
        os._exit(LOST)

    threading.Thread(target=watch, daemon=True).start()


def run(transport: str, address: str, number: int, allow_code: bool = False) -> int:
    """Be the robot of this number; the exit code."""
    try:
        link = opened(transport, address, number)
        try:
            with registry.own_code(allow_code):
                RobotProcess(link, number).run()
        finally:
            link.close()
    except (InputError, LinkError) as problem:
        sys.stderr.write(f"swarmsim: robot {number}: {problem}\n")
        return BAD_INPUT if isinstance(problem, InputError) else LOST
    return 0


def main(words: Sequence[str] | None = None) -> int:
    """One robot of a fleet on this machine, which ends with the process that started it."""
    parser = argparse.ArgumentParser(prog="swarmsim.fleet.robot_process")
    parser.add_argument("--transport", required=True)
    parser.add_argument("--join", required=True)
    parser.add_argument("--id", type=int, required=True)
    parser.add_argument("--allow-code", action="store_true")
    asked = parser.parse_args(words)
    _end_with_parent()
    return run(asked.transport, asked.join, asked.id, asked.allow_code)


if __name__ == "__main__":
    raise SystemExit(main())
