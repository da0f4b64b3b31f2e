"""One recording from the logs of a fleet's processes."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from swarmsim.core.errors import InputError
from swarmsim.core.messages import FrameError
from swarmsim.core.parts import Observer
from swarmsim.core.scenario.file import shape
from swarmsim.core.scenario.toml import parsed
from swarmsim.fleet import diaries, running
from swarmsim.fleet.diaries import Relived
from swarmsim.fleet.logged import Kept, LoggedEnd, MissingError, WorldLog
from swarmsim.fleet.real_faults import RealFaults
from swarmsim.fleet.running import WORLD_LOG, Fleet
from swarmsim.fleet.watchdog import Watchdog
from swarmsim.fleet.wire import Telegram


@dataclass(frozen=True, slots=True)
class FromLogs:
    """A fleet whose robots answer from logs."""

    fleet: Fleet
    logs: dict[int, Path]  # of the robots

    def simulate(self, observers: Sequence[Observer]) -> str:
        """Go through the run again; what the logs lack, if they do not hold the whole run, in words."""
        simulation = self.fleet.run.simulation
        try:
            while not simulation.over:
                simulation.tick(observers)
        except (MissingError, FrameError) as lacking:
            return str(lacking)
        return ""


def replayed(folder: Path) -> FromLogs:
    """The fleet whose processes have logged into a folder. Raises InputError."""
    world = WorldLog(folder / WORLD_LOG)
    told, logs = world.told, robots_in(folder)
    pace = None
    scenario = shape(parsed(told.scenario), told.name)
    if not told.terms.lockstep:
        pace = scenario.period / told.terms.period
    fleet = running.assembled(scenario, told.name, pace, told.terms.links, told.local, told.world)
    count = fleet.run.context.swarm
    kept = [Kept.of(logs[robot]) if robot in logs else None for robot in range(count)]
    dog = None if pace is None else Watchdog(fleet.charges(), fleet.minds.combined)
    end = LoggedEnd(kept, fleet.run.context.actuators, world.came(), world.seen(), dog)
    if pace is None:
        fleet.minds.crew = end
    else:
        running.started(fleet, end, fleet.faults or RealFaults(), end.look)
    return FromLogs(fleet, logs)


def robots_in(folder: Path) -> dict[int, Path]:
    """The robots' logs in a folder, by number. Raises InputError if there is none."""
    named = ((re.fullmatch(r"robot-(\d{1,5})\.log", path.name), path) for path in sorted(folder.glob("robot-*.log")))
    found = {int(matched[1]): path for matched, path in named if matched is not None}
    if not found:
        raise InputError(
            f"{folder}: holds no logs of robots; expected robot-0.log and so on, as `fleet up` writes them"
        )
    return found


@dataclass(frozen=True, slots=True)
class Checked:
    """What the logs of a fleet say about its robots."""

    iterations: int  # of all robots together
    heard: int  # letters taken in
    problems: tuple[str, ...]  # what is not as it should be, in words


def checked(folder: Path, progress: Callable[[int, int], None] = lambda done, of: None) -> Checked:
    """Check each robot's log by itself, and what was heard against what was said. Raises InputError.

    Every robot's frames and decisions have to follow, to the bit, from what it sensed and heard; what it heard was said
    by the robot that it names, in that iteration, or was told by the world in the place of what was said.
    """
    logs, problems = robots_in(folder), list[str]()
    said = {robot: Kept.of(path).said for robot, path in logs.items()}
    iterations = heard = 0
    for done, (robot, path) in enumerate(sorted(logs.items())):
        progress(done, len(logs))
        again = diaries.Again(path)
        for one in diaries.lives(path):
            iterations += 1
            try:
                lived = again.lived(one)
            except FrameError as problem:
                problems.append(f"robot {robot}, iteration {one.iteration}: {problem}")
                break
            heard += lived.heard
            found = [*filter(None, [diaries.unfounded(one, lived)]), *_unsaid(lived, said)]
            problems += [f"robot {robot}, iteration {one.iteration}: {told}" for told in found]
            if found:
                break
    progress(len(logs), len(logs))
    return Checked(iterations, heard, tuple(problems))


def _unsaid(lived: Relived, said: dict[int, dict[int, bytes]]) -> list[str]:
    """What the robot took in from the air that nobody said, as far as the senders' logs are there."""
    return [
        f"it heard what robot {sender} has not said in iteration {sent}"
        for (sender, sent), frame in lived.on_air.items()
        if sender in said and frame not in _frames(said[sender].get(sent))
    ]


def _frames(telegram: bytes | None) -> Sequence[bytes]:
    return () if telegram is None else Telegram.read(telegram).pieces
