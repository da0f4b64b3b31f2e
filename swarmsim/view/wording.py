"""Describes a run's events in words, for tables and pictures."""

from __future__ import annotations

import math
from typing import Final

from swarmsim.core.events import Begins, BoxStands, BoxWaits, Ended, Ends, Event, Lost, PieceLost, PieceTaken, Regained
from swarmsim.core.parts import Curve, Fault
from swarmsim.core.scenario.file import Scenario
from swarmsim.core.scenario.part import Part
from swarmsim.faults.in_words import described

#: Names of faults that differ from their `use` in the scenario.
WORDS: Final = {
    "remove": ("removed", "returned"),
    "crash": ("crashed", "repaired"),
    "join": ("late", "joined"),
    "push": ("pushed", "steady again"),
    "battery": ("battery empty", "battery full"),
    "door": ("door closed", "door opened"),
    "furniture": ("furniture placed", "furniture taken"),
    "rubble": ("rubble fell", "rubble cleared"),
}


def worded_value(curve: Curve, value: float) -> str:
    """A task's measure in the unit of its axis; per cent are rounded down, so that 100 % is all of it."""
    unit = curve.label.partition(", ")[2]
    scaled = math.floor(10.0 * curve.scale * value + 1e-9) / 10.0 if unit == "%" else curve.scale * value
    return f"{scaled:{curve.format}} {unit}".rstrip()


def _name(part: Part[object]) -> str:
    """A part's name; for third-party code without its module."""
    return part.use.rpartition(":")[2]


def worded(event: Event, scenario: Scenario) -> str:
    """An event in a word or two, as in `motor off over`."""
    if isinstance(event, Ended):
        return "finished" if event.finished else "not finished"
    if isinstance(event, PieceTaken | PieceLost):
        return f"{event.job}: piece {event.piece} {'lost' if isinstance(event, PieceLost) else 'taken over'}"
    if isinstance(event, Lost | Regained):
        return "lost" if isinstance(event, Lost) else "back"
    fault = scenario.faults[event.fault]
    name = _name(fault)
    plain = f"{name} {fault.declares('failure', '')}".rstrip()
    begins, ends = WORDS.get(fault.use, (plain, f"{plain} over"))
    if isinstance(event, BoxWaits):
        return f"{name} waits"
    return begins if isinstance(event, Begins | BoxStands) else ends


def cause_of(event: Event, scenario: Scenario) -> str:
    """The event's cause or place."""
    if isinstance(event, Ended):
        if not event.finished:
            return f"limit of {scenario.limit} iterations"
        name, share = _name(scenario.task), scenario.task.declares("share", None)
        return f"{100.0 * share:g} % {name} reached" if isinstance(share, float) else f"{name} done"
    if isinstance(event, PieceLost):
        return "no living robot has it"
    if isinstance(event, PieceTaken):
        return f"by robot {event.robots[0]} from robot {event.robots[-1]}" if event.robots else "by a robot"
    if isinstance(event, Lost | Regained):
        return "its process has ended" if isinstance(event, Lost) else "with an empty memory"
    if isinstance(event, Begins | Ends):
        return described(scenario.faults[event.fault])
    left, low, right, high = event.box
    return f"{left:.10g} to {right:.10g} m across, {low:.10g} to {high:.10g} m up"


def fault_line(fault: Part[Fault]) -> str:
    """A scenario's fault on a line, as in `motor off, at 50, count 2`."""
    words = described(fault).split()
    name = [word for word in words if "=" not in word]
    keys = [" ".join(word.split("=", 1)) for word in words if "=" in word]
    return ", ".join([" ".join(name), *keys])
