"""Checks that robot i does what it does by what robot i senses and hears, whatever its number and whoever is there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmsim.core import registry
from swarmsim.core.messages import Codec, Said
from swarmsim.core.parts import Computation, Parts, Strategy
from swarmsim.core.scenario import tables
from swarmsim.core.setting import Setting
from swarmsim.core.state import Beams, Intents, Knowledge, Observations, Readings, Tiles
from swarmsim.engine.build import Run
from swarmsim.engine.foreign import built
from swarmsim.faults.disguise import WrappedComputation
from swarmsim.testing.runs import ITERATIONS, limited, opened


@dataclass(frozen=True, slots=True, eq=False)
class Heard:
    """What a mind was given in one iteration, and what it did with that."""

    changes: Sequence[tuple[NDArray[np.int64], int | None]]  # before it: who forgot everything, or was given whose
    before: Observations  # when it spoke
    after: Observations  # with its inbox
    decides: Observations  # when it decided; what robots know is left out
    said: Said[Any]
    intents: Intents


class Witness(WrappedComputation):
    """Notes what a computation is given, and what the strategy beside it is."""

    def __init__(self, inner: Computation, strategy: Strategy) -> None:
        super().__init__(inner)
        #: Everything so far, in its order.
        self.heard: list[Heard] = []
        #: The strategy, followed as well.
        self.strategy = WitnessedStrategy(strategy, self)
        self._changes: list[tuple[NDArray[np.int64], int | None]] = []
        self._given: list[Observations] = []
        self._said: list[Said[Any]] = []

    def say(self, observations: Observations) -> Said[Any]:
        """What is said."""
        said = self._inner.say(observations)
        self._given, self._said = [_copied(observations)], [_kept(said)]
        return said

    def hear(self, observations: Observations) -> Knowledge:
        """What is known."""
        self._given.append(_copied(observations))
        return self._inner.hear(observations)

    def decided(self, observations: Observations, intents: Intents) -> None:
        """The end of an iteration."""
        before, after = self._given
        decides = replace(_copied(observations), knowledge=None)
        self.heard.append(Heard(self._changes, before, after, decides, self._said[0], intents))
        self._changes = []

    def forget(self, robots: NDArray[np.int64]) -> None:
        """Who forgets."""
        self._changes.append((robots.copy(), None))
        self._inner.forget(robots)

    def adopt(self, robots: NDArray[np.int64], source: int) -> None:
        """Who is given what another one knows."""
        self._changes.append((robots.copy(), source))
        self._inner.adopt(robots, source)


class WitnessedStrategy:
    """Notes what a strategy is given and decides."""

    def __init__(self, inner: Strategy, witness: Witness) -> None:
        self._inner, self._witness = inner, witness

    @property
    def reads(self) -> type[Knowledge]:
        """What the strategy inside reads."""
        return self._inner.reads

    def step(self, observations: Observations) -> Intents:
        """What it decides."""
        intents = self._inner.step(observations)
        self._witness.decided(observations, intents)
        return intents


@dataclass(frozen=True, slots=True, eq=False)
class Followed:
    """A run, and everything that its minds were given and gave before any fault changed that."""

    run: Run
    heard: Sequence[Heard]  # in each iteration
    codec: Codec[Any]


def _followed(scenario: Path | str, overrides: Sequence[str], iterations: int, allow_code: bool) -> Followed:
    witnesses: list[Witness] = []

    def watch(parts: Parts) -> Parts:
        witnesses.append(Witness(parts.computation, parts.strategy))
        return replace(parts, computation=witnesses[0], strategy=witnesses[0].strategy)

    run = opened(scenario, limited(overrides, iterations), False, allow_code, watch)
    run.simulation.run()
    return Followed(run, witnesses[0].heard, witnesses[0].codec)


def _kept(said: Said[Any]) -> Said[Any]:
    return replace(said, content=said.content.take(np.arange(len(said.content))))


def _copied(observations: Observations) -> Observations:
    return _chosen(observations, np.arange(len(observations.alive)))


def _chosen(observations: Observations, rows: NDArray[np.int64]) -> Observations:
    """The same with the rows of arrays in this order."""
    readings = observations.readings
    tiles, evidence = readings.tiles, None
    if tiles is not None:
        evidence = None if tiles.evidence is None else tiles.evidence[rows]
        tiles = Tiles(tiles.values[rows], tiles.origins[rows], evidence)
    beams = readings.beams and Beams(readings.beams.bearings, readings.beams.ranges[rows])
    field = None if readings.field is None else readings.field[rows]
    decided = observations.decided
    if decided is not None:
        columns = {one.name: getattr(decided, one.name) for one in fields(decided)}
        decided = replace(decided, **{name: column[rows] for name, column in columns.items() if column is not None})
    return replace(
        observations, pose=observations.pose[rows], velocity=observations.velocity[rows],
        alive=observations.alive[rows], readings=Readings(tiles, beams, field), decided=decided,
    )  # fmt: skip


def _mind(run: Run, setting: Setting) -> tuple[Computation, Strategy]:
    """A new mind, as built for a run."""
    parts = tables(run.scenario)
    return built("computation", parts["computation"], setting), built("strategy", parts["strategy"], setting)


def _repeated(
    mind: tuple[Computation, Strategy], before: Observations, after: Observations, decides: Observations
) -> tuple[Said[Any], Intents]:
    computation, strategy = mind
    said = computation.say(before)
    return said, strategy.step(replace(decides, knowledge=computation.hear(after)))


def check_one_robot(
    scenario: Path | str, overrides: Sequence[str] = (), iterations: int = ITERATIONS, allow_code: bool = False
) -> None:
    """A mind that is built for one robot alone says and does what this robot does in the swarm, to the last bit.

    The first robot, one in the middle and the last one are tried, each with its own row and inbox as they were in a
    run. All columns of messages are compared, their bytes and what is decided. A robot that a fault gives what
    another one knows is followed no further.
    """
    swarm = _followed(scenario, overrides, iterations, allow_code)
    count = swarm.run.setting.swarm
    for robot in sorted({0, count // 2, count - 1}):
        _check_rows(f"{scenario}", "when it is built alone", swarm, np.array([robot]), allow_code)


def check_permutation(
    scenario: Path | str, overrides: Sequence[str] = (), iterations: int = ITERATIONS, allow_code: bool = False
) -> None:
    """A mind whose rows are in another order says and does the same, to the last bit: each robot keeps its number."""
    swarm = _followed(scenario, overrides, iterations, allow_code)
    order = np.random.default_rng(swarm.run.scenario.seed).permutation(swarm.run.setting.swarm)
    rows = np.empty_like(order)
    rows[order] = np.roll(order, 1)  # one cycle through all robots: nobody keeps its row
    _check_rows(f"{scenario}", "when rows are in another order", swarm, rows, allow_code)


def _check_rows(scenario: str, when: str, swarm: Followed, ids: NDArray[np.int64], allow_code: bool) -> None:
    """Compare what a mind of the robots with these numbers (rows,) says and does with what they did in the swarm."""
    with registry.own_code(allow_code):
        mind = _mind(swarm.run, swarm.run.setting.serving(ids))
    followed = np.ones(len(ids), np.bool_)
    for heard in swarm.heard:
        for robots, source in heard.changes:
            mine = np.flatnonzero(np.isin(ids, robots))
            if source is None:
                mind[0].forget(mine)
            elif source in ids:
                mind[0].adopt(mine, int(np.flatnonzero(ids == source)[0]))
            else:  # what that one knows is not to be had here
                followed[mine] = False
        before, after, decides = (_served(one, ids) for one in (heard.before, heard.after, heard.decides))
        said, intents = _repeated(mind, before, after, decides)
        for row in np.flatnonzero(before.alive & followed).tolist():
            robot, now = int(ids[row]), before.iteration
            where = f"{scenario}, iteration {now}, robot {robot}"
            _check_said(said, row, heard.said, robot, f"{where}: {{}} {when}")
            if heard.said.sizes[robot] > 0:
                packed = mind[0].codec.pack(robot, now, said.of(row))
                first = swarm.codec.pack(robot, now, heard.said.of(robot))
                assert packed == first, f"{where}: sends other bytes {when}"
            if decides.alive[row]:
                assert _done(intents, row) == _done(heard.intents, robot), f"{where}: does something else {when}"


def _check_said(mine: Said[Any], row: int, first: Said[Any], robot: int, wrong: str) -> None:
    """Compare a row of what is said with what a robot said in the swarm; `wrong` has room for what differs."""
    here, there = (int(said.sizes[i]) for said, i in ((mine, row), (first, robot)))
    assert here == there, wrong.format(f"says {here} bytes, not {there},")
    content, whole = mine.of(row), first.of(robot)
    assert type(content).__match_args__ == type(whole).__match_args__, wrong.format("says other columns")
    for name, one, other in zip(type(whole).__match_args__, content.arrays(), whole.arrays(), strict=True):
        same = (one.dtype, one.shape, one.tobytes()) == (other.dtype, other.shape, other.tobytes())
        assert same, wrong.format(f"says other {name}")


def _served(observations: Observations, robots: NDArray[np.int64]) -> Observations:
    """What these robots (rows,) are given, as all the rows that there are, in this order."""
    inbox = observations.inbox
    if inbox is not None:
        row = np.full(len(observations.alive), -1, np.int32)
        row[robots] = np.arange(len(robots))
        inbox = replace(inbox, receivers=row[inbox.receivers])
        order = np.lexsort((inbox.sent, inbox.senders, inbox.receivers))
        inbox = inbox.take(order[inbox.receivers[order] >= 0])
    return replace(_chosen(observations, robots), inbox=inbox)


def check_locality(
    scenario: Path | str, overrides: Sequence[str] = (), iterations: int = ITERATIONS, allow_code: bool = False
) -> None:
    """What robot i neither sensed nor heard changes nothing that it says and does, to the last bit.

    A new mind is given all that the minds of a run were given, but for everybody except robot i something else: other
    poses and readings, and no messages.
    """
    swarm = _followed(scenario, overrides, iterations, allow_code)
    run, count = swarm.run, swarm.run.setting.swarm
    for robot in sorted({0, count // 2, count - 1}):
        with registry.own_code(allow_code):
            mind = _mind(run, run.setting)
        for heard in swarm.heard:
            other = [_scrambled(given, robot) for given in (heard.before, heard.after, heard.decides)]
            said, intents = _repeated(mind, *other)
            where = f"{scenario}, iteration {heard.before.iteration}, robot {robot}"
            if not heard.before.alive[robot]:
                continue
            for mine, first in zip(said.of(robot).arrays(), heard.said.of(robot).arrays(), strict=True):
                assert np.array_equal(mine, first, equal_nan=mine.dtype.kind == "f"), (
                    f"{where}: says something else when others sense and hear something else"
                )
            assert _done(intents, robot) == _done(heard.intents, robot), (
                f"{where}: does something else when others sense and hear something else"
            )


def _done(intents: Intents, robot: int) -> tuple[Any, ...]:
    """What one robot does, as something to compare."""
    way = intents.waypoints[robot, : intents.counts[robot]]
    twist = None if intents.twists is None else intents.twists[robot].tobytes()
    return tuple(intents.goals[robot].tolist()), way.tobytes(), bool(intents.planned[robot]), twist


def _scrambled(observations: Observations, robot: int) -> Observations:
    """The same for one robot alone: all others are where the next one was, facing about, and hear nothing."""
    count = len(observations.alive)
    rows = np.roll(np.arange(count), 1)
    rows[robot] = robot
    other = _chosen(observations, rows)
    turned = other.pose.copy()
    turned[np.arange(count) != robot, 2] += 1.0
    inbox = observations.inbox
    mine = None if inbox is None else inbox.take(np.flatnonzero(inbox.receivers == robot))
    return replace(other, pose=turned, inbox=mine)
