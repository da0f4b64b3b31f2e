"""Faults of the building: doors, furniture and rubble, which are boxes that come and go."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Protocol

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.events import Box, BoxGone, BoxStands, BoxWaits, Event
from swarmsim.core.parts import Parts, Tick
from swarmsim.faults.timeline import Duration, Iteration, Share

_TRIES = 100  # places drawn for a piece of rubble before it stays where it was
_STRIDE = 2.9  # cells: a diagonal leg of a walker's way, and the diagonal of a cell that the box may just touch


class Scheduled(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The keys that every change of the building has. One of `at` and `progress` says when."""

    at: Iteration | None = None  # the first iteration with the change
    progress: Share | None = None  # it comes once this share of the task is done
    every: Duration | None = None  # iterations from one change to the next of its kind; default: never again
    duration: Duration | None = None  # iterations with the change; default: for good


class Door(Scheduled, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A box closes a doorway, which opens again when the change ends."""

    box: Box  # m: left, lower, right, upper

    def build(self, context: BuildContext) -> ChangingBuilding:
        """The fault. Raises InputError for keys that contradict each other."""
        layout = Fixed((), (("box", self.box),))
        return ChangingBuilding(Strikes(self, again=False), layout, context)


class Furniture(Scheduled, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A box is put into the building or, there from the start, moved `to` another place."""

    box: Box  # m: left, lower, right, upper
    to: Box | None = None  # m: where it is moved, and from where it returns when the change ends

    def build(self, context: BuildContext) -> ChangingBuilding:
        """The fault. Raises InputError for keys that contradict each other."""
        before = (("box", self.box),) if self.to else ()
        after = (("to", self.to),) if self.to else (("box", self.box),)
        layout = Fixed(before, after)
        return ChangingBuilding(Strikes(self, again=False), layout, context)


class Rubble(Scheduled, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Boxes of random size fall at random places of a region, never on robots or people; they may cut rooms off."""

    region: Box  # m: left, lower, right, upper
    count: Annotated[int, Meta(ge=1, le=1000)] = 1  # boxes at a time
    size: tuple[Annotated[float, Meta(gt=0.0)], Annotated[float, Meta(gt=0.0)]] = (0.15, 0.5)  # m: least, largest side

    def build(self, context: BuildContext) -> ChangingBuilding:
        """The fault. Raises InputError for boxes that do not fit into the region."""
        left, low, right, high = self.region
        least, most = self.size
        if not least <= most <= min(right - left, high - low):
            raise InputError(
                f"size: {least:g} to {most:g} m in a region of {right - left:g} m x {high - low:g} m; expected the "
                "least side first, and no more than the region's sides"
            )
        return ChangingBuilding(Strikes(self, again=True), Falling(self, context), context)


class Strikes:
    """When a change is there: strikes, counted from 0; each lasts for a while or for good."""

    def __init__(self, change: Scheduled, *, again: bool) -> None:
        """`again` allows strikes while another lasts. Raises InputError for keys that contradict each other."""
        if (change.at is None) == (change.progress is None):
            raise InputError("at: expected either at or progress to say when")
        if change.every is not None and not again and (change.duration is None or change.duration >= change.every):
            raise InputError(
                f"every: {change.every} iterations, but it does not end before; expected a shorter duration"
            )
        self._change = change
        self._since: int | None = None  # the iteration of the first strike

    def strikes(self, now: int, progress: float) -> range:
        """The numbers of the strikes that last in iteration `now`, with this share (0 to 1) of the task done."""
        change = self._change
        due = now >= change.at if change.at is not None else progress >= (change.progress or 0.0)
        if self._since is None and due:
            self._since = now
        if self._since is None:
            return range(0)
        elapsed = now - self._since
        every = change.every or elapsed + 1
        over = 0 if change.duration is None or elapsed < change.duration else (elapsed - change.duration) // every + 1
        return range(over, elapsed // every + 1)


class Layout(Protocol):
    """Where a change wants its boxes."""

    @property
    def places(self) -> tuple[tuple[str, Box], ...]:
        """Where it can put boxes, each with the key that says so."""
        ...

    def wanted(self, strikes: range, clear: Callable[[Box], bool]) -> tuple[Box, ...]:
        """The boxes of these strikes, none over before; `clear` tells whether a place is free of robots and people."""
        ...


@dataclass(frozen=True, slots=True)
class Fixed:
    """The boxes before and during a strike."""

    before: tuple[tuple[str, Box], ...]
    during: tuple[tuple[str, Box], ...]

    @property
    def places(self) -> tuple[tuple[str, Box], ...]:
        return self.before + self.during

    def wanted(self, strikes: range, clear: Callable[[Box], bool]) -> tuple[Box, ...]:
        """One of the two."""
        return tuple(box for _, box in (self.during if strikes else self.before))


class Falling:
    """Boxes drawn anew for each strike, from its own stream."""

    def __init__(self, rubble: Rubble, context: BuildContext) -> None:
        self._rubble, self._streams, self._purpose = rubble, context.streams, f"fault {context.number} rubble"
        self._fallen: dict[int, tuple[Box, ...]] = {}

    @property
    def places(self) -> tuple[tuple[str, Box], ...]:
        return (("region", self._rubble.region),)

    def wanted(self, strikes: range, clear: Callable[[Box], bool]) -> tuple[Box, ...]:
        """The rubble not yet cleared away."""
        for strike in strikes:
            if strike not in self._fallen:
                self._fallen[strike] = self._fall(strike, clear)
        return tuple(box for strike in strikes for box in self._fallen[strike])

    def _fall(self, strike: int, clear: Callable[[Box], bool]) -> tuple[Box, ...]:
        """The boxes of one strike, in whole millimetres; a box that finds no place clear of bodies does not fall."""
        rubble = self._rubble
        boxes: list[Box] = []
        left, low, right, high = rubble.region
        for number in range(rubble.count):
            stream = self._streams.open(f"{self._purpose} {strike}", number)
            for _ in range(_TRIES):
                width, height = stream.uniform(*rubble.size, size=2).tolist()
                x, y = stream.uniform((left, low), (right - width, high - height)).tolist()
                box = (
                    max(round(x, 3), left), max(round(y, 3), low),
                    min(round(x + width, 3), right), min(round(y + height, 3), high),
                )  # fmt: skip
                if clear(box):
                    boxes.append(box)
                    break
        return tuple(boxes)


@dataclass(frozen=True, slots=True)
class ChangingBuilding:
    """A layout's boxes, which come and go on a schedule."""

    schedule: Strikes
    layout: Layout
    context: BuildContext

    def install(self, parts: Parts) -> Parts:
        """The same parts, with the changes in their calendar. Raises InputError for boxes that cannot stand here."""
        for key, box in self.layout.places:
            parts.building.check(box, key)
        parts.schedule.enter(Builder(parts, self))
        return parts


class Builder:
    """Changes the building between two iterations, where no robot or person is in the way."""

    def __init__(self, parts: Parts, change: ChangingBuilding) -> None:
        self._parts, self._change = parts, change
        self._standing: tuple[Box, ...] = ()
        self._waits = False

    def advance(self, now: Tick) -> Sequence[Event]:
        """Make the change that is due, as a whole, once all its places are clear."""
        building, change, number = self._parts.building, self._change, self._change.context.number
        strikes = change.schedule.strikes(now.iteration, now.progress)
        wanted = change.layout.wanted(strikes, self._is_clear)
        if wanted == self._standing:
            self._waits = False
            return ()
        gone = [box for box in self._standing if box not in wanted]
        come = [box for box in wanted if box not in self._standing]
        blocked = [box for box in come if not self._is_clear(box)]
        if blocked:
            waited, self._waits = self._waits, True
            return () if waited else (BoxWaits(now.iteration, number, blocked[0]),)
        boxes = list(building.boxes)
        for box in gone:
            boxes.remove(box)
        building.rebuild((*boxes, *come))
        self._standing, self._waits = wanted, False
        return [
            *(BoxGone(now.iteration, number, box) for box in gone),
            *(BoxStands(now.iteration, number, box) for box in come),
        ]

    def _is_clear(self, box: Box) -> bool:
        """Whether no body is in a box, or would meet it on its present step."""
        building, context = self._parts.building, self._change.context
        pose = self._parts.bodies.state().pose[self._parts.bodies.solid]
        walkers = building.walkers()
        room = walkers[:, 2] + _STRIDE * context.lattice.cell
        robots = (_distance(box, pose) >= context.robots.radius).all()
        return bool(robots and (_distance(box, walkers) >= room).all())


def _distance(box: Box, places: NDArray[np.float64]) -> NDArray[np.float64]:
    """The distance (k,) in m of a box from each of `places` (k, 2 or more: x, y); 0 inside."""
    left, low, right, high = box
    x, y = places[:, 0], places[:, 1]
    aside = np.maximum(np.maximum(left - x, x - right), 0.0)
    above = np.maximum(np.maximum(low - y, y - high), 0.0)
    return np.asarray(np.hypot(aside, above))
