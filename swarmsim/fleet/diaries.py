"""A robot's life again, from its log: what it sensed and heard goes in, and what comes out can be compared."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import final

from swarmsim.core.charge import Charge
from swarmsim.core.errors import InputError
from swarmsim.core.messages import FrameError
from swarmsim.core.robot import Letter, Robot, warm
from swarmsim.fleet import logbook, wire
from swarmsim.fleet.logbook import LogEntry
from swarmsim.fleet.terms import LATE, Links, Terms
from swarmsim.fleet.wire import Ears, Telegram


@dataclass(frozen=True, slots=True)
class Lived:
    """One iteration of a robot's log."""

    iteration: int
    sensed: LogEntry
    said: bytes  # the telegram
    arrived: tuple[LogEntry, ...]  # frames on the air since the iteration before
    deed: bytes  # the telegram; empty if it ended before
    charge: bytes = b""  # of a mind that begins here, anew ...
    recalls: bool = False  # ... or with what it knew
    links: Links = "simulated"
    ears: bytes = b""  # the telegram; empty with real links


def lives(path: Path) -> Iterator[Lived]:
    """The iterations in a log, in order. Raises InputError for a file that is no robot's log."""
    parts: dict[int, bytes] = {}
    arrived, sensed, terms, recalls = list[LogEntry](), None, Terms(), False

    def whole() -> Lived | None:
        if sensed is None:
            return None
        given = (parts.pop(kind, b"") for kind in (wire.SAID, wire.DEED, wire.CHARGE))
        said, deed, charge = given
        ears = parts.pop(wire.EARS, b"")
        iteration = sensed.telegram(path).iteration
        return Lived(iteration, sensed, said, tuple(arrived), deed, charge, recalls, terms.links, ears)

    for entry in logbook.entries(path):
        begins = entry.kind in (wire.SENSED, wire.CHARGE)
        if begins and (found := whole()) is not None:
            yield found
            arrived, sensed, recalls = [], None, False
        if entry.kind == wire.SENSED:
            sensed = entry
        elif entry.kind == logbook.HEARD:
            arrived.append(entry)
        elif entry.kind == logbook.TERMS:
            terms = Terms.read(entry.data)
        elif entry.kind == logbook.RECALLED:
            recalls = True
        else:
            parts[entry.kind] = entry.data
    if (found := whole()) is not None:
        yield found


@dataclass(frozen=True, slots=True)
class Relived:
    """What a robot did in an iteration that it has lived through again."""

    said: bytes  # the telegram
    deed: bytes = b""  # the telegram; empty if the log has none
    on_air: dict[tuple[int, int], bytes] = field(default_factory=dict)  # frames taken in, by sender and iteration sent
    heard: int = 0  # letters taken in, with those that the world had changed


@final
class Again:
    """A robot that lives through a log again."""

    def __init__(self, path: Path) -> None:
        """The log is named in messages."""
        self._path = path
        self._robot: Robot | None = None
        self._heard: dict[tuple[int, int], tuple[Letter, bytes]] = {}

    @property
    def robot(self) -> Robot:
        """The robot as it is now. Raises InputError for a log without a charge."""
        if self._robot is None:
            raise InputError(f"{self._path}: begins without a charge; expected the log of a robot")
        return self._robot

    def lived(self, one: Lived) -> Relived:
        """What it says and decides in an iteration, as telegrams; no decision where the log has none.

        Raises InputError for a log that cannot be one, FrameError for frames that cannot have been said.
        """
        if one.charge and not (one.recalls and self._robot is not None):
            self._robot, self._heard = Robot.of(Charge.read(one.charge, str(self._path))), {}
        robot, context = self.robot, self.robot.context
        sensed = wire.sensed_of(Telegram.read(one.sensed.data), context.channels, context.actuators)
        said = Telegram(wire.SAID, robot.number, one.iteration, pieces=tuple(robot.sense(sensed))).packed()
        for entry in one.arrived:
            letter = robot.read(entry.data)
            self._heard[letter.sender, letter.sent] = letter, entry.data
        if not one.deed:
            return Relived(said)
        taken = [(sender, sent) for sender, sent in Telegram.read(one.deed).arrays[0].tolist()]
        awake, oldest, changed = sensed.alive, one.iteration - LATE, dict[tuple[int, int], Letter]()
        if one.ears:
            ears = Ears.of(Telegram.read(one.ears))
            awake, oldest = ears.awake, ears.oldest
            changed = {(letter.sender, letter.sent): letter for letter in map(robot.read, filter(None, ears.frames))}
        elif one.links == "simulated":
            awake, oldest = True, one.iteration
        on_air = {key: self._heard[key] for key in taken if key not in changed and key in self._heard}
        for sender, sent in taken:
            if (sender, sent) not in changed and (sender, sent) not in on_air:
                raise FrameError(f"it heard what has not arrived from robot {sender}, said in iteration {sent}")
        self._heard = {key: letter for key, letter in self._heard.items() if key[1] >= oldest}
        deed = robot.hear([changed[key] if key in changed else on_air[key][0] for key in taken], awake, oldest)
        done = wire.deed_telegram(robot.number, deed, context.actuators).packed()
        return Relived(said, done, {key: frame for key, (_, frame) in on_air.items()}, len(taken))


@dataclass(frozen=True, slots=True)
class LogReplay:
    """How a log went when a robot lived through it again."""

    robot: int
    iterations: int
    difference: str  # the first one, in words; empty: all that it said and did is equal
    mean: float  # s of processor time, for one iteration
    longest: float  # s

    @property
    def equal(self) -> bool:
        """Whether the robot said and did the same, to the last bit."""
        return not self.difference

    def __str__(self) -> str:
        took = f"{1e3 * self.mean:.2f} ms of processor time an iteration, at most {1e3 * self.longest:.1f} ms"
        if self.equal:
            return f"robot {self.robot}: equal in all {self.iterations} iterations; {took}"
        return f"robot {self.robot}: different: {self.difference}"


def replayed(path: Path) -> LogReplay:
    """Let a robot live through a log up to the first difference. Raises InputError for a file that cannot be one."""
    warm(charge_of(path))
    again, spent, difference = Again(path), list[float](), ""
    for one in lives(path):
        begins = time.process_time()
        try:
            lived = again.lived(one)
        except FrameError as problem:
            raise InputError(f"{path}: iteration {one.iteration}: {problem}; expected a log as written") from problem
        spent.append(time.process_time() - begins)
        if difference := unfounded(one, lived):
            difference = f"iteration {one.iteration}, {difference}"
            break
    mean, longest = sum(spent) / max(len(spent), 1), max(spent, default=0.0)
    return LogReplay(again.robot.number, len(spent), difference, mean, longest)


def unfounded(one: Lived, lived: Relived) -> str:
    """What in an iteration does not follow from what the robot sensed and heard; empty if all does."""
    if one.said and lived.said != one.said:
        return "it said what does not follow from what it sensed"
    if one.deed and lived.deed != one.deed:
        return "it decided what does not follow from what it sensed and heard"
    return ""


def charge_of(path: Path) -> Charge:
    """The charge that a robot's log begins with. Raises InputError."""
    for entry in logbook.entries(path):
        if entry.kind == wire.CHARGE:
            return Charge.read(entry.data, str(path))
    raise InputError(f"{path}: has no charge; expected the log of a robot")


def recalled(path: Path, charge: Charge) -> Robot | None:
    """The robot as it was when its log ended; None if there is none of this charge. Raises InputError."""
    if not path.exists():
        return None
    again, its = Again(path), False
    for one in lives(path):
        if one.charge:
            told = Charge.read(one.charge, str(path))
            its = (told.robot, told.scenario) == (charge.robot, charge.scenario)
        again.lived(one)
    return again.robot if its else None
