"""A crew within this process, from which nothing but bytes comes or goes, and what it was told and did."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from swarmsim.core.charge import Charge
from swarmsim.core.robot import Deed, Robot, Sensed
from swarmsim.core.scenario.file import load
from swarmsim.fleet import running, wire
from swarmsim.fleet.running import Fleet
from swarmsim.fleet.wire import Ears, Telegram


@dataclass
class Diary:
    """What one robot was told, and what it said and did: all as bytes."""

    charge: bytes
    sensed: list[bytes] = field(default_factory=list)
    said: list[list[bytes]] = field(default_factory=list)
    ears: list[bytes] = field(default_factory=list)
    heard: list[list[bytes]] = field(default_factory=list)
    deeds: list[bytes] = field(default_factory=list)


class BytesCrew:
    """Robots built from the bytes of charges, told by telegrams and by frames."""

    def __init__(self, fleet: Fleet) -> None:
        self._minds = fleet.minds
        self.diaries = [Diary(one.packed()) for one in fleet.charges()]
        self.robots = [Robot.of(Charge.read(one.charge, "charge")) for one in self.diaries]
        fleet.minds.crew = self

    def sense(self, sensed: Sequence[Sensed]) -> list[bytes]:
        frames = []
        for robot, diary, one in zip(self.robots, self.diaries, sensed, strict=True):
            actuators = robot.context.actuators
            diary.sensed.append(wire.sensed_telegram(robot.number, one, actuators).packed())
            told = wire.sensed_of(Telegram.read(diary.sensed[-1]), robot.context.channels, actuators)
            diary.said.append(robot.sense(told))
            frames.append(diary.said[-1][0] if diary.said[-1] else b"")
        return frames

    def hear(self, ears: Sequence[Ears]) -> list[Deed]:
        deeds = []
        for robot, diary, one in zip(self.robots, self.diaries, ears, strict=True):
            diary.ears.append(one.telegram(robot.number).packed())
            told = Ears.of(Telegram.read(diary.ears[-1]))
            letters = zip(told.letters.tolist(), told.frames, strict=True)
            diary.heard.append([frame or self._minds.frame(sender, sent) for (sender, sent), frame in letters])
            deed = robot.hear([robot.read(frame) for frame in diary.heard[-1]], told.awake, told.oldest)
            diary.deeds.append(wire.deed_telegram(robot.number, deed, robot.context.actuators).packed())
            deeds.append(wire.deed_of(Telegram.read(diary.deeds[-1]), robot.context.actuators))
        return deeds


def fleet_of(path: Path, *overrides: str, iterations: int | None = None) -> Fleet:
    """A scenario's fleet, at most so long."""
    limit = () if iterations is None else (f'stop={{iterations={iterations}, when_done="continue"}}',)
    return running.assembled(load(path, [*overrides, *limit]), str(path))
