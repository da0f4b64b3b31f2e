"""A swarm as its robots' logs have it, where no world's log is: with the poses that they believed."""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final, final

import msgspec
import numpy as np
from numpy.typing import NDArray

from swarmsim.core.charge import Charge, digest_of
from swarmsim.core.errors import InputError
from swarmsim.core.messages import HEADER
from swarmsim.core.parts import Motion, Parts
from swarmsim.core.readings import Channels, Readings
from swarmsim.core.robot import Sensed
from swarmsim.core.scenario.file import Scenario
from swarmsim.core.state import State
from swarmsim.engine.build import build
from swarmsim.fleet import diaries, logbook, wire
from swarmsim.fleet.logbook import Came
from swarmsim.fleet.logged import Kept, LoggedEnd
from swarmsim.fleet.merging import FromLogs, robots_in
from swarmsim.fleet.real_links import RealLinks
from swarmsim.fleet.remote import RemoteMinds
from swarmsim.fleet.running import Fleet
from swarmsim.fleet.terms import Terms
from swarmsim.fleet.watchdog import Watchdog
from swarmsim.fleet.wire import Telegram
from swarmsim.robots.localisation import PerfectLocalisation

#: What such a recording lacks: `pose` are the estimates of the robots themselves.
ABSENT: Final = ("true poses", "velocities of wheels", "what was lost on the air", "faults")

Row = Mapping[int, Sensed]  # what robots sensed in an iteration, by number


@final
class RememberedBodies:
    """Bodies that are where their robots believed to be; one without an entry is where it was, and dead."""

    def __init__(self, start: State, rows: Sequence[Row]) -> None:
        self._rows, self._state = rows, start
        self._state = self._at(0)

    @property
    def solid(self) -> NDArray[np.bool_]:
        """Those that are alive."""
        return self._state.alive

    def state(self) -> State:
        """Now."""
        return self._state

    def drive(self, motion: Motion, period: float) -> State:
        """One iteration later."""
        self._state = self._at(self._state.iteration + 1)
        return self._state

    def _at(self, iteration: int) -> State:
        row = self._rows[min(iteration, len(self._rows) - 1)]
        pose, velocity = self._state.pose.copy(), np.zeros_like(self._state.velocity)
        alive = np.zeros_like(self._state.alive)
        for robot, sensed in row.items():
            pose[robot], velocity[robot], alive[robot] = sensed.pose, sensed.velocity, sensed.alive
        return State(iteration, pose, velocity, np.zeros_like(self._state.wheels), alive, self._state.actuators)

    def remove(self, robots: NDArray[np.int64]) -> None:
        """Nothing: logs do not change."""

    def crash(self, robots: NDArray[np.int64]) -> None:
        """Nothing."""

    def place(self, robots: NDArray[np.int64], pose: NDArray[np.float64]) -> None:
        """Nothing."""

    def push(self, robots: NDArray[np.int64], velocity: tuple[float, float]) -> None:
        """Nothing."""

    def retire(self, robots: NDArray[np.int64]) -> None:
        """Nothing."""


@final
class RememberedSensor:
    """Readings as the robots had them."""

    def __init__(self, channels: Channels, rows: Sequence[Row]) -> None:
        self.channels, self._rows = channels, rows

    def sense(self, state: State) -> Readings:
        """Those of this iteration; unknown where a log has none."""
        columns = [channel.blanks(len(state.alive)) for channel in self.channels]
        for robot, sensed in self._rows[state.iteration].items():
            for column, mine in zip(columns, sensed.readings, strict=True):
                column[robot] = mine
        return Readings(self.channels, tuple(columns))


def remembered(folder: Path, scenario: Scenario, name: str) -> FromLogs:
    """The fleet whose robots have logged into a folder. Raises InputError, also for logs of another scenario."""
    logs, made = robots_in(folder), list[RemoteMinds]()
    heard = list[RealLinks]()

    def watch(parts: Parts) -> Parts:
        made.append(RemoteMinds(parts))
        heard.append(RealLinks(made[0]))
        return replace(parts, computation=made[0], strategy=made[0].strategy, topology=heard[0], channel=heard[0])

    run = build(msgspec.structs.replace(scenario, faults=()), name, watch=watch)  # which no robot's log tells of
    context = run.context
    rows = _rows(logs, scenario, context.channels, context.actuators)
    parts = run.simulation.parts
    bodies = RememberedBodies(parts.bodies.state(), rows)
    run.simulation.parts = replace(
        parts, bodies=bodies, sensor=RememberedSensor(context.channels, rows), localisation=PerfectLocalisation()
    )
    run.simulation.state = bodies.state()
    fleet = Fleet(run, made[0], Terms(period=scenario.period, links="real"), None, heard[0])
    kept = [Kept.of(logs[robot]) if robot in logs else None for robot in range(context.swarm)]
    dog = Watchdog(fleet.charges(), made[0].combined)
    end = LoggedEnd(kept, context.actuators, _came(kept, len(rows)), iter(()), dog)
    fleet.minds.crew = heard[0].crew = end
    return FromLogs(fleet, logs)


def _rows(logs: Mapping[int, Path], scenario: Scenario, channels: Channels, actuators: Channels) -> list[Row]:
    """What robots sensed, iteration by iteration. Raises InputError for another scenario's logs."""
    found: defaultdict[int, dict[int, Sensed]] = defaultdict(dict)
    for robot, path in logs.items():
        for one in diaries.lives(path):
            if one.charge:
                charge = Charge.read(one.charge, str(path))
                if (charge.robot, charge.scenario) != (robot, digest_of(scenario)):
                    raise InputError(
                        f"{path}: is of robot {charge.robot} of {charge.title!r}, in another scenario or under another "
                        "number; expected the scenario, seed and settings that its world had"
                    )
            found[one.iteration][robot] = wire.sensed_of(Telegram.read(one.sensed.data), channels, actuators)
    if not found:
        raise InputError("the robots' logs hold no iteration; expected logs of a run that has begun")
    return [found[iteration] for iteration in range(max(found) + 1)]


def _came(kept: Sequence[Kept | None], iterations: int) -> Iterator[Came]:
    """What would have come to a world: all that was said and decided, in time."""
    for now in range(iterations):
        said = tuple(robot for robot, one in enumerate(kept) if one is not None and now in one.said)
        deeds = tuple((robot, now) for robot, one in enumerate(kept) if one is not None and now in one.deeds)
        yield Came(now, said, (), deeds)
        yield Came(now)


def offsets(logs: Mapping[int, Path]) -> dict[int, float]:
    """By how much (s) each robot's clock is ahead of that of the first, as far as they have heard one another.

    Half the difference of the least times that frames took there and back by both clocks (Cristian 1989): right if the
    fastest take equally long both ways.
    """
    said, least = dict[tuple[int, int], int](), dict[tuple[int, int], int]()
    for robot, path in logs.items():
        for entry in logbook.entries(path):
            if entry.kind == wire.SAID:
                said[robot, Telegram.read(entry.data).iteration] = entry.when
    for robot, path in logs.items():
        for entry in logbook.entries(path):
            if entry.kind == logbook.HEARD and (when := said.get(HEADER.unpack_from(entry.data))) is not None:
                pair = int(HEADER.unpack_from(entry.data)[0]), robot
                least[pair] = min(least.get(pair, entry.when - when), entry.when - when)
    first = min(logs)
    found, waiting = {first: 0.0}, deque([first])
    while waiting:
        one = waiting.popleft()
        for other in sorted(logs):
            if other not in found and (one, other) in least and (other, one) in least:
                found[other] = found[one] + 0.5e-9 * (least[one, other] - least[other, one])
                waiting.append(other)
    return found
