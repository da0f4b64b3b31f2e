"""What happens in a recorded run, as a picture shows it: who has a fault, who is gone, which boxes stand."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from typing import Literal

from swarmsim.changes import boxes_at
from swarmsim.core.parts import Box
from swarmsim.core.state import Event
from swarmsim.recording import Recording, grouped

Mark = Literal["", "fault", "removed", "late"]
#: What ends what, where the end is not called as its beginning with " over".
ENDS = {"returned": "removed", "repaired": "crashed", "joined": "late"}
BODIES = ("removed", "crashed", "late")  # what befalls bodies, which pictures show by itself
BOX = "box "  # how the cause of what happens to a building begins
NAMED = 8  # robots that a note names; of more it gives the number


@dataclass(frozen=True, slots=True)
class Note:
    """What happened to one or several robots at once."""

    iteration: int
    kind: str
    cause: str
    robots: tuple[int, ...]  # none for the building or the whole run

    @property
    def text(self) -> str:
        """The note in a line, as in `iteration 50: motor off: robots 3, 7, 9`."""
        if self.cause.startswith(BOX):
            return f"iteration {self.iteration}: {self.kind}"  # pictures show where
        if not self.robots:
            who = self.cause
        elif len(self.robots) > NAMED:
            who = f"{len(self.robots)} robots"
        else:
            who = f"robot{'s' if len(self.robots) > 1 else ''} {', '.join(map(str, self.robots))}"
        return f"iteration {self.iteration}: {self.kind}: {who}"

    @property
    def ends(self) -> bool:
        """Whether something is over with it."""
        gone = self.cause.startswith(BOX) and self.cause.endswith(" gone")
        return gone or _ended(self.kind) is not None or self.kind in ("finished", "not finished")


class Happenings:
    """The events of a recording, and what follows from them at any time."""

    def __init__(self, recording: Recording) -> None:
        events, robots = recording.events(), recording.scenario.robots.count
        #: All that happened, in its order.
        self.notes = [Note(at, kind, cause, robots) for (at, kind, cause), robots in grouped(events).items()]
        self._noted = [note.iteration for note in self.notes]
        self._changed: list[list[int]] = [[0] for _ in range(robots)]  # when each robot's mark changes ...
        self._marks: list[list[Mark]] = [[""] for _ in range(robots)]  # ... and to what
        has: list[list[tuple[str, str]]] = [[] for _ in range(robots)]  # kind and cause of what each has now
        for event in events:
            if event.robot >= 0:
                _turn(has[event.robot], event)
                self._changed[event.robot].append(event.iteration)
                self._marks[event.robot].append(_mark(has[event.robot]))
        building = [event for event in events if event.robot < 0 and event.cause.startswith(BOX)]
        self._built = [0, *sorted({event.iteration for event in building})]  # when the building changes ...
        self._boxes = [tuple(boxes_at(building, iteration)) for iteration in self._built]  # ... and to what

    def mark(self, robot: int, iteration: int) -> Mark:
        """How a robot is marked in an iteration."""
        return self._marks[robot][bisect_right(self._changed[robot], iteration) - 1]

    def boxes(self, iteration: int) -> tuple[Box, ...]:
        """What stands in the building besides its plan in an iteration."""
        return self._boxes[bisect_right(self._built, iteration) - 1]

    def latest(self, iteration: int, within: float, most: int) -> list[Note]:
        """The newest notes, `most` of them, that are less than `within` iterations old; the oldest first."""
        end = bisect_right(self._noted, iteration)
        return [note for note in self.notes[max(end - most, 0) : end] if iteration - note.iteration < within]


def _ended(kind: str) -> str | None:
    """The kind that is over with an event of this `kind`; none if it is no end."""
    return kind.removesuffix(" over") if kind.endswith(" over") else ENDS.get(kind)


def _turn(has: list[tuple[str, str]], event: Event) -> None:
    """Bring what a robot `has` up to an event of its own."""
    over = _ended(event.kind)
    if over is None:
        has.append((event.kind, event.cause))
    elif (over, event.cause) in has:
        has.remove((over, event.cause))


def _mark(has: list[tuple[str, str]]) -> Mark:
    kinds = [kind for kind, _ in has]
    if "late" in kinds:
        return "late"
    if "removed" in kinds or any(kind == "battery empty" and "empty=remove" in cause for kind, cause in has):
        return "removed"
    return "fault" if any(kind not in BODIES for kind in kinds) else ""
