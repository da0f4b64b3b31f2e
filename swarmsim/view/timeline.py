"""The events of a recorded run, as a picture shows them: faults, removed robots, boxes."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from typing import Literal

from swarmsim.core.events import Begins, Box, BoxGone, BoxStands, BoxWaits, Ended, Ends, Event, Lost, Regained, boxes_at
from swarmsim.core.parts import Fault
from swarmsim.core.scenario.file import Scenario
from swarmsim.core.scenario.part import Part
from swarmsim.recording.reader import Recording
from swarmsim.view.wording import cause_of, worded

Mark = Literal["", "fault", "removed", "late", "joined"]
NAMED = 8  # robots that a note names; for more it gives their number


@dataclass(frozen=True, slots=True)
class Note:
    """An event in words."""

    iteration: int
    kind: str
    cause: str
    robots: tuple[int, ...]  # empty for the building or the whole run
    is_box: bool  # whether pictures show where it happened
    ends: bool  # whether it ends something
    of_run: bool  # whether it is the run's own end

    @property
    def text(self) -> str:
        """The note on a line, as in `iteration 50: motor off: robots 3, 7, 9`."""
        if self.is_box:
            return f"iteration {self.iteration}: {self.kind}"
        if not self.robots:
            who = self.cause.removeprefix(f"{self.kind.removesuffix(' over')} ")  # of a fault it begins with its name
        elif len(self.robots) > NAMED:
            who = f"{len(self.robots)} robots"
        else:
            who = f"robot{'s' if len(self.robots) > 1 else ''} {', '.join(map(str, self.robots))}"
        return f"iteration {self.iteration}: {self.kind}: {who}"

    @property
    def words(self) -> str:
        """The event without its time."""
        return self.text.partition(": ")[2]


def noted(event: Event, scenario: Scenario) -> Note:
    """The event in words."""
    return Note(
        event.iteration,
        worded(event, scenario),
        cause_of(event, scenario),
        event.robots if isinstance(event, Begins | Ends | Lost | Regained) else (),
        isinstance(event, BoxStands | BoxGone | BoxWaits),
        isinstance(event, Ends | BoxGone | Ended | Regained),
        isinstance(event, Ended),
    )


class Occurrences:
    """The events of a recording, and the marks and boxes that result at any time."""

    def __init__(self, recording: Recording) -> None:
        events, scenario = recording.events(), recording.scenario
        robots = scenario.robots.count
        #: All events, in order.
        self.notes = [noted(event, scenario) for event in events]
        self._noted = [note.iteration for note in self.notes]
        self._changed: list[list[int]] = [[0] for _ in range(robots)]  # when each robot's mark changes ...
        self._marks: list[list[Mark]] = [[""] for _ in range(robots)]  # ... and to what
        has: list[set[int]] = [set() for _ in range(robots)]  # the faults that each has now
        late: set[int] = set()
        for event in events:
            if isinstance(event, Begins | Ends):
                for robot in event.robots:
                    (has[robot].add if isinstance(event, Begins) else has[robot].discard)(event.fault)
                    self._changed[robot].append(event.iteration)
                    mark = _mark([scenario.faults[fault] for fault in has[robot]])
                    if mark == "late":
                        late.add(robot)
                    self._marks[robot].append("joined" if mark == "" and robot in late else mark)
        built = {event.iteration for event in events if isinstance(event, BoxStands | BoxGone)}
        self._built = [0, *sorted(built)]  # when the building changes ...
        self._boxes = [tuple(boxes_at(events, iteration)) for iteration in self._built]  # ... and to what

    def mark(self, robot: int, iteration: int) -> Mark:
        """A robot's mark in an iteration."""
        return self._marks[robot][bisect_right(self._changed[robot], iteration) - 1]

    def boxes(self, iteration: int) -> tuple[Box, ...]:
        """The boxes in the building in an iteration."""
        return self._boxes[bisect_right(self._built, iteration) - 1]

    def latest(self, iteration: int, within: float, most: int) -> list[Note]:
        """The `most` newest notes less than `within` iterations old, the oldest first."""
        end = bisect_right(self._noted, iteration)
        return [note for note in self.notes[max(end - most, 0) : end] if iteration - note.iteration < within]


def _mark(faults: list[Part[Fault]]) -> Mark:
    marks = [fault.declares("mark", "fault") for fault in faults]
    return next((mark for mark in ("late", "removed", "fault") if mark in marks), "")
