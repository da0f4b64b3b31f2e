"""Checks that robots which are told nothing but bytes do what they do in a swarm."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

from swarmsim.core.charge import Charge
from swarmsim.core.robot import Deed, Robot, Sensed
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.file import load
from swarmsim.fleet import logbook, running, wire
from swarmsim.fleet.logbook import Logbook
from swarmsim.fleet.running import Fleet
from swarmsim.fleet.terms import Terms
from swarmsim.fleet.wire import Ears, Telegram
from swarmsim.recording.digests import ACTUATED, DIGESTED, Digests
from swarmsim.testing.broken import BrokenError
from swarmsim.testing.runs import ITERATIONS, limited, opened


@dataclass(slots=True)
class Diary:
    """What one robot was told, said and did: one entry an iteration in each list."""

    charge: bytes
    sensed: list[bytes] = field(default_factory=list)  # telegrams
    said: list[list[bytes]] = field(default_factory=list)  # frames
    ears: list[bytes] = field(default_factory=list)  # telegrams
    heard: list[list[bytes]] = field(default_factory=list)  # frames
    deeds: list[bytes] = field(default_factory=list)  # telegrams

    def write(self, path: Path) -> None:
        """Keep it as the log that the robot would have written. Raises InputError."""
        path.unlink(missing_ok=True)
        with closing(Logbook(path)) as log:
            log.note(wire.CHARGE, self.charge)
            log.note(logbook.TERMS, Terms().packed())
            for sensed, said, ears, heard, deed in zip(
                self.sensed, self.said, self.ears, self.heard, self.deeds, strict=True
            ):
                told = Telegram.read(sensed)
                log.note(wire.SENSED, sensed)
                log.note(wire.SAID, Telegram(wire.SAID, told.robot, told.iteration, pieces=tuple(said)).packed())
                for frame in heard:
                    log.note(logbook.HEARD, frame)
                log.note(wire.EARS, ears)
                log.note(wire.DEED, deed)


class BytesCrew:
    """The robots of a fleet, in this process, to and from which go telegrams and frames alone."""

    def __init__(self, fleet: Fleet) -> None:
        """They are the fleet's from now on."""
        self._minds = fleet.minds
        #: Of each robot.
        self.diaries = [Diary(one.packed()) for one in fleet.charges()]
        self._robots = [Robot.of(Charge.read(one.charge, "the charge")) for one in self.diaries]
        fleet.minds.crew = self

    def sense(self, sensed: Sequence[Sensed]) -> list[bytes]:
        frames = []
        for robot, diary, one in zip(self._robots, self.diaries, sensed, strict=True):
            actuators = robot.context.actuators
            diary.sensed.append(wire.sensed_telegram(robot.number, one, actuators).packed())
            told = wire.sensed_of(Telegram.read(diary.sensed[-1]), robot.context.channels, actuators)
            diary.said.append(robot.sense(told))
            frames.append(diary.said[-1][0] if diary.said[-1] else b"")
        return frames

    def hear(self, ears: Sequence[Ears]) -> list[Deed]:
        deeds = []
        for robot, diary, one in zip(self._robots, self.diaries, ears, strict=True):
            actuators = robot.context.actuators
            diary.ears.append(one.telegram(robot.number).packed())
            told = Ears.of(Telegram.read(diary.ears[-1]))
            letters = zip(told.letters.tolist(), told.frames, strict=True)
            diary.heard.append([frame or self._minds.frame(sender, sent) for (sender, sent), frame in letters])
            deed = robot.hear([robot.read(frame) for frame in diary.heard[-1]], told.awake, told.oldest)
            diary.deeds.append(wire.deed_telegram(robot.number, deed, actuators).packed())
            deeds.append(wire.deed_of(Telegram.read(diary.deeds[-1]), actuators))
        return deeds


def check_apart(
    scenario: Path | str, overrides: Sequence[str] = (), iterations: int = ITERATIONS, allow_code: bool = False
) -> None:
    """Robots built one by one from their charges, and told nothing but bytes, make the run of one process.

    Every field of every iteration is compared, to the last bit. Raises InputError for a swarm whose robots cannot be
    processes of their own, such as one with jobs.
    """
    path, keys = Path(scenario), limited(overrides, iterations)
    whole, apart = Digests(), Digests()
    opened(path, keys, False, allow_code).simulation.run([whole])
    with registry.own_code(allow_code):
        fleet = running.assembled(load(path, keys), str(path))
        BytesCrew(fleet)
        fleet.run.simulation.run([apart])
    for iteration, (one, other) in enumerate(zip(whole.rows, apart.rows, strict=True)):
        if one != other:
            names = [*DIGESTED, ACTUATED][: len(one) // 8]
            at = next(name for n, name in enumerate(names) if one[8 * n :][:8] != other[8 * n :][:8])
            raise BrokenError(f"{scenario}, iteration {iteration}: other {at} when robots are told nothing but bytes")
