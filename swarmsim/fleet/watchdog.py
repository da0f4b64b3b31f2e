"""What bodies do whose robots answer late or not at all."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import final

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.charge import Charge
from swarmsim.core.reports import Report
from swarmsim.core.robot import Deed, idle
from swarmsim.core.state import Intents
from swarmsim.faults.mind import ahead, window
from swarmsim.fleet.terms import PATIENCE

#: One report for those of a robot that came in an iteration, given the one before them.
Combine = Callable[[int, Report, Sequence[Report]], Report]


@final
class Watchdog:
    """Keeps what each robot has decided last. A body goes on with that, and stands after PATIENCE periods."""

    def __init__(self, charges: Sequence[Charge], combine: Combine) -> None:
        """A robot that has decided nothing yet is as one that is dead at the start."""
        self._combine = combine
        self._idle = [replace(idle(charge), iteration=-1 - PATIENCE) for charge in charges]
        self._last = list(self._idle)
        self._within = PATIENCE * window(charges[0].context())  # waypoints that it may have passed

    def last(self, robot: int) -> int:
        """The iteration of its last decision; negative before the first."""
        return self._last[robot].iteration

    def forget(self, robot: int) -> None:
        """A robot begins anew."""
        self._last[robot] = self._idle[robot]

    def taken(self, now: int, poses: Sequence[NDArray[np.float64]], came: Sequence[Sequence[Deed]]) -> list[Deed]:
        """What each robot does in iteration `now` at these estimates of its pose, from the deeds that came in it."""
        return [self._of(robot, now, poses[robot], deeds) for robot, deeds in enumerate(came)]

    def _of(self, robot: int, now: int, pose: NDArray[np.float64], came: Sequence[Deed]) -> Deed:
        before = self._last[robot]
        newest = came[-1] if came else before
        report = self._combine(robot, before.report, [one.report for one in came])
        planned = np.array([any(bool(one.intents.planned[0]) for one in came)])
        intents = replace(newest.intents, planned=planned)
        if now - newest.iteration >= PATIENCE:
            intents = self._idle[robot].intents
        elif newest.iteration < now:
            intents = _shortened(intents, pose, self._within)
        deed = Deed(newest.iteration, intents, report, newest.heard)
        self._last[robot] = replace(deed, intents=newest.intents)
        return deed


def _shortened(intents: Intents, pose: NDArray[np.float64], within: int) -> Intents:
    """The intents of a robot that has gone on meanwhile: what is left of its way."""
    way = ahead(intents.waypoints[0, : intents.counts[0]], pose, within)
    waypoints = np.zeros_like(intents.waypoints)
    waypoints[0, : len(way)] = way
    return replace(intents, waypoints=waypoints, counts=np.array([len(way)], np.int32))
