"""Tours driven by the simulator: the test of a tour, since one that is only computed can be wrong unseen."""

from __future__ import annotations

import re
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from swarmsim.core.errors import InputError
from swarmsim.core.messages import Inbox, MessageBatch
from swarmsim.core.parts import Parts
from swarmsim.core.scenario.file import Mind, Network, Scenario, Stop
from swarmsim.core.scenario.part import Part
from swarmsim.core.state import Intents, Knowledge, Moment, Senses
from swarmsim.engine.build import BuiltRun, build
from swarmsim.kernels import occupancy
from swarmsim.recording.digests import Digests
from swarmsim.studies.benchmark.views import Stands

AHEAD: Final = 10  # points of its way that a robot is given in an iteration
WINDOW: Final = 4  # points that it may pass in one
STILL: Final = 0.1  # of what it can drive: a robot that moves less has stopped
PATIENCE: Final = 5  # iterations until one that has stopped counts as blocked
SLACK: Final = 1.3  # of the longest way's time at top speed, before a replay ends ...
MORE: Final = 40  # ... and iterations besides
COMPASS: Final = {
    "n": (1, 0), "nne": (2, 1), "ne": (1, 1), "ene": (1, 2), "e": (0, 1), "ese": (-1, 2), "se": (-1, 1), "sse": (-2, 1),
    "s": (-1, 0), "ssw": (-2, -1), "sw": (-1, -1), "wsw": (-1, -2), "w": (0, -1), "wnw": (1, -2), "nw": (1, -1),
    "nnw": (2, -1),
}  # fmt: skip


def way_of(cells: NDArray[np.int64]) -> str:
    """A way as a text: row and column of its first cell (of `cells` (k, 2)), then its steps, as in `12,34 5n3ne`."""
    names = {step: name for name, step in COMPASS.items()}
    steps = [names[down, across] for down, across in np.diff(cells, axis=0).tolist()]
    runs = list[list[object]]()
    for step in steps:
        if runs and runs[-1][1] == step:
            runs[-1][0] = int(str(runs[-1][0])) + 1
        else:
            runs.append([1, step])
    return f"{cells[0, 0]},{cells[0, 1]} {''.join(f'{count}{step}' for count, step in runs)}"


def cells_of(way: str) -> NDArray[np.int64]:
    """The cells (k, 2) of a way, row and column, from its text. Raises InputError for another text."""
    found = re.fullmatch(r"(\d+),(\d+) ((?:\d+[nsew]{1,3})*)", way)
    steps = [] if found is None else re.findall(r"(\d+)([nsew]{1,3})", found[3])
    if found is None or any(step not in COMPASS for _, step in steps):
        raise InputError(f"way {way[:40]!r}: expected a first cell and steps, as in '12,34 5n3ne'")
    moves = [COMPASS[step] for count, step in steps for _ in range(int(count))]
    return np.cumsum([(int(found[1]), int(found[2])), *moves], axis=0)


@dataclass(eq=False)
class KnownWays:
    """A strategy: robots follow ways known beforehand, and avoid nobody.

    Where two block each other, they take over each other's rest of the way: together they see the same.
    """

    ways: list[NDArray[np.float64]]  # by robot: (k, 2), x and y in m
    pace: float  # m in an iteration, at top speed
    near: float  # m between the middles of robots that may block each other
    requires_knowledge: type[Knowledge] = Knowledge  # type: ignore[type-abstract]  # any kind will do

    def __post_init__(self) -> None:
        self._arcs = [np.concatenate([[0.0], np.hypot(*np.diff(way, axis=0).T).cumsum()]) for way in self.ways]
        self._at = [0] * len(self.ways)  # by way
        self._mine = list(range(len(self.ways)))  # the way of each robot
        self._waited = np.zeros(len(self.ways), np.int64)  # iterations
        self._before: NDArray[np.float64] | None = None

    def step(self, senses: Senses, inbox: Inbox[MessageBatch], knowledge: Knowledge) -> Intents:
        """The next points of each robot's way."""
        here = senses.pose[:, :2]
        moved = np.zeros(len(here)) if self._before is None else np.hypot(*(here - self._before).T)
        self._before = here.copy()
        for robot in range(len(here)):
            self._advance(robot, here[robot], moved[robot])
        self._give_way(here, moved)
        ahead = {robot: self._ahead(robot) for robot in range(len(here))}
        return Intents.along(ahead, len(here), np.zeros(len(here), np.bool_))

    def _ahead(self, robot: int) -> NDArray[np.float64]:
        """The next points of its way; a robot that has run against a wall first goes back to where it should be."""
        way, at = self.ways[self._mine[robot]], self._at[self._mine[robot]]
        return way[min(at + (self._waited[robot] == 0), len(way) - 1) : at + 1 + AHEAD]

    def _advance(self, robot: int, here: NDArray[np.float64], moved: float) -> None:
        """Note which points of its way a robot has passed."""
        number = self._mine[robot]
        at = self._at[number]
        near, arcs = self.ways[number][at : at + WINDOW], self._arcs[number]
        # A way can touch itself: of points equally near, the one is meant that lies as far along as the robot drove.
        along = np.abs(arcs[at : at + WINDOW] - arcs[at] - moved)
        self._at[number] = at + int((np.hypot(*(near - here).T) + 0.3 * along).argmin())

    def _give_way(self, here: NDArray[np.float64], moved: NDArray[np.float64]) -> None:
        """Swap the ways of robots that stand before their end with those of the robots that block them."""
        under_way = np.array([self._at[number] < len(self.ways[number]) - 1 for number in self._mine])
        self._waited = np.where(under_way & (moved < STILL * self.pace), self._waited + 1, 0)
        for robot in np.flatnonzero(self._waited >= PATIENCE).tolist():
            apart = np.hypot(*(here - here[robot]).T)
            apart[robot] = np.inf
            other = int(apart.argmin())
            if self._waited[robot] and apart[other] <= self.near:
                self._mine[robot], self._mine[other] = self._mine[other], self._mine[robot]
                self._waited[[robot, other]] = 0


@dataclass(eq=False)
class Watched:
    """An observer: coverage after each iteration, what has been seen, and how far each robot has driven."""

    seen: NDArray[np.bool_]  # (rows, columns): at first all false
    coverage: list[float] = field(default_factory=list)
    poses: list[NDArray[np.float64]] = field(default_factory=list)

    def sample(self, moment: Moment[Knowledge]) -> None:
        self.coverage.append(moment.measured.values["coverage"])
        self.poses.append(moment.state.pose[:, :2].copy())
        tiles = moment.readings.tiled
        occupancy.note_observed(tiles.values, tiles.origins, self.seen)

    def first(self, share: float) -> int | None:
        """The iterations after which a share is covered first."""
        reached = np.flatnonzero(np.array(self.coverage) >= share)
        return int(reached[0]) + 1 if len(reached) else None

    @property
    def driven(self) -> NDArray[np.float64]:
        """How far in m each robot has driven (k, n) until it senses in each iteration, by straight steps."""
        steps = np.hypot(*np.moveaxis(np.diff(np.stack(self.poses), axis=0), -1, 0))
        return np.vstack([np.zeros_like(steps[:1]), steps.cumsum(axis=0)])


def bare(scenario: Scenario, iterations: int) -> Scenario:
    """The same building and bodies with no network, faults or mind: what a tour is replayed in."""
    robots = scenario.robots
    groups = tuple(msgspec.structs.replace(group, mind=msgspec.UNSET) for group in robots.groups)
    return msgspec.structs.replace(
        scenario,
        robots=msgspec.structs.replace(robots, groups=groups),
        localisation=Part("localisation").decoded(),
        network=Network(topology=Part("topology", {"use": "none"}).decoded(), channel=Part("channel").decoded()),
        mind=Mind(computation=Part("computation").decoded(), strategy=Part("strategy", {"use": "stand"}).decoded()),
        task=Part("task", {"use": "coverage"}).decoded(),
        faults=(),
        probes=(),
        layers=(),
        stop=Stop(iterations=iterations),
    )


@dataclass(frozen=True, slots=True, eq=False)
class Driven:
    """A replay."""

    watched: Watched
    planned: tuple[float, ...]  # the length in m of each robot's way
    missed: NDArray[np.int64]  # which cells of the ground's domain nobody has seen at the end
    digest: str
    pace: float  # how far the fastest robot had driven at any time, as a share of what top speed allows until then


def drive(built: BuiltRun, ground: Stands, ways: tuple[str, ...], record: Path | None = None) -> Driven:
    """Drive a tour in the building and with the bodies of a run, and `record` it into a new file.

    Raises InputError for ways that do not fit them.
    """
    points = [_points(ground, robot, way) for robot, way in enumerate(ways)]
    if len(points) != len(ground.starts):
        raise InputError(f"{len(points)} ways for {len(ground.starts)} robots; expected a way for each")
    planned = tuple(float(np.hypot(*np.diff(way, axis=0).T).sum()) for way in points)
    limit = int(SLACK * max(planned) / ground.pace) + MORE

    near = 3.0 * built.scenario.robots.radius

    def following(parts: Parts) -> Parts:
        return replace(parts, strategy=KnownWays(points, ground.pace, near))

    run = build(bare(built.scenario, limit), built.simulation.name, built.world, watch=following)
    watched, digests = Watched(np.zeros(ground.lattice.shape, np.bool_)), Digests()
    with nullcontext() if record is None else run.recorder(record) as recorder:
        run.simulate([watched, digests, *([] if recorder is None else [recorder])])
    missed = np.flatnonzero(~watched.seen.reshape(-1)[ground.domain])
    allowed = ground.pace * np.arange(1, len(watched.poses))[:, None]
    return Driven(watched, planned, missed, digests.total(), float((watched.driven[1:] / allowed).max(initial=0.0)))


def _points(ground: Stands, robot: int, way: str) -> NDArray[np.float64]:
    """The points (k, 2) in m of a robot's way. Raises InputError for one that starts elsewhere or leaves the ground."""
    cells = cells_of(way)
    inside = ((cells >= 0) & (cells < ground.lattice.shape)).all()
    places = ground.index[tuple(cells.T)] if inside else np.array([-1])
    if (places < 0).any() or places[0] != ground.starts[robot]:
        raise InputError(f"way of robot {robot}: starts elsewhere, or leaves the cells that robots can reach")
    return np.asarray(ground.points[places])
