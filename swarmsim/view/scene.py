"""What a picture of a run shows at any moment: shapes in metres and numbers, from its recording."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import PurePath
from typing import Final, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from swarmsim.core.errors import InputError
from swarmsim.core.events import Box
from swarmsim.core.scenario.part import Part
from swarmsim.core.state import UNKNOWN
from swarmsim.network.analysis import groups
from swarmsim.operations.fields.replay import FieldReplay, holds_estimates
from swarmsim.operations.mapping.replay import MapReplay
from swarmsim.recording.reader import Recording
from swarmsim.view.beams import BeamReplay
from swarmsim.view.timeline import Mark, Note, Occurrences
from swarmsim.world.areas import joined
from swarmsim.world.plan import UNKNOWN_LAYER
from swarmsim.world.source import floor_plan

Points = NDArray[np.float64]  # (p, 2): x, y in m
Bounds = tuple[float, float, float, float]  # m: left, right, lower, upper
Pairs = NDArray[np.int32]  # (m, 2): receiver, sender
MARGIN = 2  # cells of surroundings shown around the walls
HELD = 60.0  # s of simulated time that a caption stays: three seconds of a film at the default speed
CAPTIONS = 3  # at a time, at most


QUARTERED: Final = (1.0, 1.2, 1.6, 2.0, 2.4, 3.2, 4.0, 6.0, 8.0, 10.0)  # a quarter of each is round


@dataclass(frozen=True, slots=True)
class Frame:
    """All that changes during a run, at one moment; row i is robot i."""

    iteration: int  # completed iterations
    time: float  # s, simulated
    row: int  # of the recording, for tables that change from one iteration to the next
    pose: NDArray[np.float64]  # (n, 3): x, y in m, yaw in rad, between two iterations
    alive: NDArray[np.bool_]  # (n,)
    marks: list[Mark]  # each robot's fault or absence
    boxes: tuple[Box, ...]  # m: obstacles besides the floor plan
    captions: list[str]  # recent events, the oldest first
    origins: Points  # (n, 2): the lower left corner of each tile, in m; (0, 2) if robots have none
    mutual: Pairs  # robots that hear each other, the lower id first
    one_way: Pairs  # receivers that the sender does not hear
    lost: Pairs  # links with a lost message
    waiting: Pairs  # links with a message under way
    goals: Points  # (n, 2): m, NaN for none
    ways: list[Points]  # for each robot the rest of its path, from its own place; empty for none
    value: float  # of the task's measure
    headings: NDArray[np.float64] | None  # (n,): rad, each robot's estimate of the way to go, if any
    groups: int  # of live robots that hear each other, directly or through others
    heard: int  # messages heard in this iteration
    messages: int  # heard so far
    believed: Points | None  # (n, 2): m, estimated positions, if they may differ
    people: NDArray[np.float64]  # (p, 3): x, y, radius in m
    lights: NDArray[np.uint8] | None  # (n, 3): the colour of each robot's light, black for none
    radii: NDArray[np.float64]  # (n,): m
    focus: int | None  # the focused robot
    chosen: tuple[int, ...]  # robots with tiles, ways and beams drawn; empty: all robots, but no beams
    recording: Recording

    def holds(self, name: str) -> bool:
        """Whether the recording has a table of this name."""
        return name in self.recording

    def recorded(self, name: str, back: int = 0) -> NDArray[np.generic]:
        """A table's row of this moment, or `back` iterations earlier, but not before the first.

        Raises InputError if there is no such table, or if it has no row for each iteration.
        """
        return self.recording.row(name, max(self.row - back, 0))


class Told(NamedTuple):
    """The outcome of an iteration's messages, as a shot shows it."""

    mutual: Pairs
    one_way: Pairs
    lost: Pairs
    waiting: Pairs
    groups: int
    heard: int


@dataclass(frozen=True, slots=True)
class Curves:
    """The task's measure by iteration, each of shape (iterations,)."""

    union: NDArray[np.float64]  # of the swarm
    mean: NDArray[np.float64] | None  # of live robots, if it is measured for each robot
    worst: NDArray[np.float64] | None  # the live robot that is farthest from done


class Scene:
    """A recorded run to be drawn; moments may be asked for in any order, fastest in time order."""

    def __init__(self, recording: Recording) -> None:
        """Raises InputError if the recording holds no whole iteration."""
        if not recording.iterations:
            raise InputError(f"{recording.path}: no whole iteration was recorded; there is nothing to show")
        self.recording = self._recording = recording
        self.scenario = scenario = recording.scenario
        self._plan = plan = floor_plan(recording.world, scenario.world)
        beyond = [plan.border, *([plan.unknown] if scenario.world.unknown == "wall" else [])]
        #: Solid areas by layer, with unknown areas and those that close an open building.
        self.layers = {**plan.layers, UNKNOWN_LAYER: joined(beyond)}
        #: The building's ground: the solid areas without their holes.
        self.footprint = [shapely.Polygon(part.exterior) for part in joined([plan.walls, plan.border]).geoms]
        self.lattice = recording.lattice
        margin = MARGIN * self.lattice.cell
        solid = [layer for layer in self.layers.values() if not layer.is_empty] or [plan.walls]
        left, low, right, high = shapely.total_bounds(solid)
        self.bounds: Bounds = (left - margin, right + margin, low - margin, high + margin)
        self.robots = scenario.robots.count
        self.radius = scenario.robots.radius  # m, of the largest
        self.radii = scenario.robots.each("radius")  # m, (n,)
        #: Rows and columns of a tile; 0, 0 if robots have none.
        self.tile: tuple[int, int] = recording["tiles"].shape[2:] if "tiles" in recording else (0, 0)
        self.has_maps = "changes" in recording
        #: The robots' estimates of a field, if they make any.
        self._field = FieldReplay(recording, plan.page) if holds_estimates(recording) else None
        self.has_field = self._field is not None
        #: m, of a page whose opposite edges are joined: robots that leave on the right return on the left.
        around = bool(scenario.physics.declares("periodic", False))
        self._around = np.array([plan.width, plan.height] if around else [np.inf, np.inf])
        self.has_headings = "heading" in recording
        self.has_beliefs = "believed" in recording
        self.has_people = "people" in recording
        self.curve = recording.curve
        self.title = scenario.title
        self.seed = scenario.seed
        self.topology = _described(scenario.network.topology)
        self.channel = _described(scenario.network.channel)
        self.world = PurePath(scenario.world.title).stem
        self.period = scenario.period  # s, one iteration
        self._replay = MapReplay(recording)
        self.refresh()

    def refresh(self) -> None:
        """Read what a run that still goes on has recorded since."""
        recording = self._recording
        self.iterations = recording.iterations
        #: Whether there are ways and goals to show.
        self.walks = len(recording["paths"]) > 0 or not np.isnan(recording["goals"]).all()
        self.curves = _curves(recording)
        self.limits = _limits(self.curves, recording)
        self._occurrences = Occurrences(recording)
        self.notes = notes = self._occurrences.notes
        self.marks = sorted({note.iteration for note in notes if not note.of_run})
        self.names = _names(notes)
        self.signs = _signs(self._occurrences, recording)
        self._bends: dict[tuple[int, int], list[list[float]]] = {}  # corners of paths that have been drawn
        self._last: tuple[int, Told] | None = None
        self._messages = np.cumsum(recording["messages"], dtype=np.int64)
        self._starts: list[list[int]] = [[] for _ in range(self.robots)]
        self._paths: list[list[NDArray[np.float32]]] = [[] for _ in range(self.robots)]
        for iteration, robot, waypoints in recording.paths():
            self._starts[robot].append(iteration)
            self._paths[robot].append(waypoints)

    @cached_property
    def _beams(self) -> BeamReplay:
        return BeamReplay(self._recording, self._plan)

    def beams(self, robot: int, shot: Frame) -> NDArray[np.float64]:
        """Lengths (b,) in m of a robot's beams at a shot's pose; empty without a ring."""
        return self._beams.lengths(robot, shot.pose[robot], shot.boxes, shot.people)

    def reach(self, robot: int) -> float:
        """The greatest length of a robot's beams in m; 0 without a ring."""
        return self._beams.reach(robot)

    @cached_property
    def bearings(self) -> list[list[float]]:
        """The bearings of each robot's beams in rad, counter-clockwise from straight ahead; none without a ring."""
        return [self._beams.bearings(robot) for robot in range(self.robots)]

    def marks_at(self, row: int) -> list[Mark]:
        """Each robot's mark in an iteration."""
        return [self._occurrences.mark(robot, row) for robot in range(self.robots)]

    def messages(self, row: int) -> tuple[int, int]:
        """How many messages were heard, and how many lost, in an iteration."""
        fates = self._recording.letters(row)[:, 4]
        heard = int(np.count_nonzero(fates == 0))
        return heard, len(fates) - heard

    def groups(self, row: int) -> int:
        """The number of groups of live robots that hear each other in an iteration, directly or through others."""
        letters = self._recording.letters(row)
        return groups(letters[letters[:, 4] == 0, :2], self._recording["alive"][row])

    def robot_curve(self, robot: int) -> NDArray[np.float64] | None:
        """The task's curve for one robot (iterations,), if it is measured for each robot."""
        name = self.curve.robots
        return None if name is None else np.asarray(self._recording.rows(name, self.robots)[:, robot], np.float64)

    def row(self, iteration: float) -> int:
        """The recording's row for a moment from 0, the start, to `iterations`, the end of the last one."""
        return min(int(iteration), self.iterations - 1)

    def at(self, iteration: float, focus: int | None = None, chosen: tuple[int, ...] = ()) -> Frame:
        """The moment after this many iterations, 0 to `iterations`; poses are interpolated, all else is as sensed.

        `focus` is the focused robot; tiles, ways and beams are drawn for those in `chosen`.
        """
        recording, row = self._recording, self.row(iteration)
        ends = recording["pose"][row], recording["pose"][self.row(row + 1)]
        pose = _between(*ends, min(iteration - row, 1.0), self._around)
        alive = recording["alive"][row]
        told = self._told(row)
        aims = np.where(alive[:, None], recording["goals"][row], np.nan)
        return Frame(
            iteration=int(iteration),
            time=iteration * self.period,
            row=row,
            pose=pose,
            alive=alive,
            marks=self.marks_at(row),
            boxes=self._occurrences.boxes(row),
            captions=[note.text for note in self._occurrences.latest(row, HELD / self.period, CAPTIONS)],
            origins=self._origins(row),
            mutual=self._short(told.mutual, pose),
            one_way=self._short(told.one_way, pose),
            lost=self._short(told.lost, pose),
            waiting=self._short(told.waiting, pose),
            goals=aims,
            ways=[self._way(robot, row, pose[robot, :2], aims[robot]) for robot in range(self.robots)],
            value=float(self.curves.union[row]),
            headings=recording.rows("heading", self.robots)[row] if self.has_headings else None,
            groups=told.groups,
            heard=told.heard,
            messages=int(self._messages[row]),
            believed=recording["believed"][row][:, :2] if self.has_beliefs else None,
            people=self._people(row, min(iteration - row, 1.0)),
            radii=self.radii,
            focus=focus,
            chosen=chosen,
            recording=recording,
            lights=None if (shining := lights(recording)) is None else shining[row],
        )

    def _told(self, row: int) -> Told:
        """The outcome of an iteration's messages, cached for the frames that show it."""
        if self._last is None or self._last[0] != row:
            letters, links, robots = self._recording.letters(row), self._recording.links(row), self.robots
            heard, lost = letters[letters[:, 4] == 0, :2], letters[letters[:, 4] > 0, :2]
            waiting = links[~np.isin(_numbered(links, robots), _numbered(letters[:, :2], robots))]
            pairs = _paired(np.unique(heard, axis=0), robots)
            self._last = row, Told(*pairs, lost, waiting, self.groups(row), len(heard))
        return self._last[1]

    def _people(self, row: int, part: float) -> NDArray[np.float64]:
        if not self.has_people:
            return np.empty((0, 3))
        people = self._recording["people"]
        before, after = people[row], people[self.row(row + 1)]
        return np.asarray(before + part * (after - before))

    def estimate(self, row: int) -> NDArray[np.float64] | None:
        """The robots' mean estimate of the field (rows, columns), scaled to 0 to 1 over the floor at the run's end.

        NaN where there is no floor; None where they estimate nothing.
        """
        if self._field is None:
            return None
        floor = self._recording["domain"]
        last = self._field.mean(self.iterations - 1)[floor]
        low, high = float(last.min()), float(last.max())
        shares = np.clip((self._field.mean(row) - low) / ((high - low) or 1.0), 0.0, 1.0)
        return np.where(floor, shares, np.nan)

    def height(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """The curve's values scaled to its axis, 0 to 1."""
        low, high = (end / self.curve.scale for end in self.limits)
        return np.nan_to_num(np.clip((values - low) / (high - low), 0.0, 1.0))

    def _short(self, links: Pairs, pose: NDArray[np.float64]) -> Pairs:
        """The links (m, 2) that do not cross the page's edges."""
        gap = np.abs(pose[links[:, 0], :2] - pose[links[:, 1], :2])
        return links[(gap <= 0.5 * self._around).all(axis=1)]

    def _origins(self, row: int) -> Points:
        if "origins" not in self._recording:
            return np.empty((0, 2))
        corner = np.array([self.lattice.x0, self.lattice.y0])
        origins: Points = self._recording["origins"][row][:, ::-1] * self.lattice.cell + corner
        return origins

    def cells(self, row: int) -> NDArray[np.uint8]:
        """The collective map (rows, columns) of the recording's row: UNKNOWN, FREE or OCCUPIED."""
        return self._maps(row).collective() if self.has_maps else np.full(self.lattice.shape, UNKNOWN, np.uint8)

    def own_cells(self, robot: int, row: int) -> NDArray[np.uint8]:
        """The map (rows, columns) of one robot: UNKNOWN, FREE or OCCUPIED; a view."""
        own: NDArray[np.uint8] = self._maps(row).maps[robot]
        return own

    def known(self, row: int) -> NDArray[np.int32]:
        """How many robots, dead ones too, know each cell (rows, columns); a view."""
        return self._maps(row).known

    def _maps(self, row: int) -> MapReplay:
        if row < self._replay.iteration:
            self._replay = MapReplay(self._recording)
        self._replay.advance(row)
        return self._replay

    def _way(self, robot: int, row: int, here: Points, aim: Points) -> Points:
        """The rest of the newest path, from the robot on; none without a goal."""
        newest = bisect_right(self._starts[robot], row) - 1
        if newest < 0 or np.isnan(aim[0]) or not len(self._paths[robot][newest]):
            return np.empty((0, 2))
        if (robot, newest) not in self._bends:
            self._bends[robot, newest] = _corners(self._paths[robot][newest].astype(np.float64)).tolist()
        bends, place = self._bends[robot, newest], here.tolist()
        apart = [_apart(place, *leg) for leg in pairwise(bends)]
        passed = apart.index(min(apart)) + 1 if apart else 0
        return np.array([place, *bends[passed:]])


def lights(recording: Recording) -> NDArray[np.uint8] | None:
    """The recorded colours (t, n, 3) of the first actuator with lights; None without one."""
    tables = [one.recorded_as for one in recording.actuators if one.is_colour and one.recorded_as]
    return recording[tables[0]] if tables else None


def _names(notes: list[Note]) -> dict[int, str]:
    """Names of what begins, by iteration."""
    kinds: dict[int, list[str]] = {}
    for note in notes:
        if not note.ends:
            kinds.setdefault(note.iteration, []).append(note.kind)
    return {iteration: ", ".join(dict.fromkeys(found)) for iteration, found in kinds.items()}


def _signs(occurrences: Occurrences, recording: Recording) -> set[str]:
    """The optional signs that are ever drawn: links, dead, removed, fault, joined, box, lost, waiting."""
    signs: set[str] = {"mutual", "one way"} if recording["messages"].any() else set()
    for iteration in {0, *(note.iteration for note in occurrences.notes)}:
        row = min(iteration, recording.iterations - 1)
        marks = [occurrences.mark(robot, row) for robot in range(recording.scenario.robots.count)]
        for alive, mark in zip(recording["alive"][row].tolist(), marks, strict=True):
            signs.add(mark if not alive and mark in ("removed", "late") else "dead" if not alive else mark)
        if occurrences.boxes(row):
            signs.add("box")
    if len(recording.fates) > 1:
        signs.add("lost")
    if recording.scenario.network.channel.declares("delays", True):
        signs.add("waiting")
    return signs


def _described(part: Part[object]) -> str:
    table = part.table
    long = (bool, list, dict)  # named by their key alone, if at all
    parameters = [f"{key} = {value}" for key, value in table.items() if key != "use" and not isinstance(value, long)]
    parameters += [key for key, value in table.items() if value is True]
    return ", ".join([part.use.rpartition(":")[2], *parameters])


def _curves(recording: Recording) -> Curves:
    curve = recording.curve
    if curve.robots is None:
        return Curves(recording[curve.name], None, None)
    alive = recording["alive"] | ~recording["alive"].any(axis=1, keepdims=True)  # once all are dead, the dead
    of_each = recording.rows(curve.robots, recording.scenario.robots.count)
    worst = (
        np.where(alive, of_each, np.inf).min(axis=1) if curve.rises else np.where(alive, of_each, -np.inf).max(axis=1)
    )
    return Curves(recording[curve.name], np.average(of_each, axis=1, weights=alive), worst)


def _limits(curves: Curves, recording: Recording) -> tuple[float, float]:
    """The ends of the curve's axis, in its unit."""
    curve = recording.curve
    drawn = [values for values in (curves.union, curves.mean, curves.worst) if values is not None]
    values = curve.scale * np.concatenate([values[np.isfinite(values)] for values in drawn])
    low = curve.low if curve.low is not None else float(values.min(initial=0.0))
    high = curve.high if curve.high is not None else _round_above(float(values.max(initial=low)), low)
    return low, high if high > low else low + 1.0


def _round_above(value: float, low: float) -> float:
    """A number of at least `value`; a quarter of its distance from `low` is round."""
    if value <= low:
        return low
    ten = 10.0 ** np.floor(np.log10(value - low))
    return float(low + ten * next(step for step in QUARTERED if value - low <= step * ten * (1.0 + 1e-9)))


def _corners(path: Points) -> Points:
    """The path without waypoints on straight pieces."""
    if len(path) < 3:
        return path
    steps = np.diff(path, axis=0)
    turn = steps[:-1, 0] * steps[1:, 1] - steps[:-1, 1] * steps[1:, 0]
    corners: Points = path[np.concatenate([[True], np.abs(turn) > 1e-6, [True]])]
    return corners


def _apart(point: list[float], start: list[float], end: list[float]) -> float:
    """The squared distance of a point from a piece of a path."""
    dx, dy = end[0] - start[0], end[1] - start[1]
    x, y = point[0] - start[0], point[1] - start[1]
    share = min(max((x * dx + y * dy) / (dx * dx + dy * dy or 1.0), 0.0), 1.0)
    return (x - share * dx) ** 2 + (y - share * dy) ** 2


def _between(
    before: NDArray[np.float64], after: NDArray[np.float64], part: float, around: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Poses (n, 3) between two iterations; yaw, and places on a page of this size, go the short way."""
    step = after - before
    far = np.abs(step[:, :2]) > 0.5 * around
    step[:, :2] -= np.where(far, np.sign(step[:, :2]) * np.where(np.isfinite(around), around, 0.0), 0.0)
    step[:, 2] = (step[:, 2] + np.pi) % (2.0 * np.pi) - np.pi
    between: NDArray[np.float64] = before + part * step
    return between


def _numbered(links: Pairs, robots: int) -> NDArray[np.int64]:
    """A number for each link, equal for equal ones."""
    return np.asarray(links[:, 0].astype(np.int64) * robots + links[:, 1])


def _paired(links: Pairs, robots: int) -> tuple[Pairs, Pairs]:
    """Links (m, 2) split into mutual ones, one row for each two, and the others."""
    answered = np.isin(_numbered(links, robots), _numbered(links[:, ::-1], robots))
    return links[answered & (links[:, 0] < links[:, 1])], links[~answered]
