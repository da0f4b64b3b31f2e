"""Values that a run takes on the way: a measure at some time or at its extremes, and robots that were stuck or died."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.state import Knowledge, Moment


@dataclass(frozen=True, slots=True)
class Watch:
    """One value to keep of a run."""

    #: `at`: a measure after this many iterations, or at the end of a run that ended before; `least`, `most`: its
    #: extremes up to then, leaving out where it is undefined. `stuck`: the number of robots that were stuck for this
    #: long; `dead`: at the end.
    how: Literal["at", "least", "most", "stuck", "dead"]
    measure: str = ""  # of the task
    iterations: int | None = None  # None: to the end

    @property
    def key(self) -> str:
        """Its name among a run's measures."""
        until = "the end" if self.iterations is None else f"{self.iterations}"
        return f"{self.measure} {self.how} {until}".strip()


class Watcher:
    """An observer that keeps watched values."""

    def __init__(self, watches: Sequence[Watch], radius: float) -> None:
        """`radius` in m is that of a robot: one that wants to move and stays within it is stuck."""
        self._watches, self._radius, self._time = watches, radius, 0
        self._values: dict[str, float] = {}
        self._standing = any(one.how == "stuck" for one in watches)
        self._anchor: NDArray[np.float64] | None = None
        self._still = self._longest = np.zeros(0, np.int64)  # iterations, of each robot
        self._dead = 0

    def sample(self, moment: Moment[Knowledge]) -> None:
        """Note one iteration."""
        self._time += 1
        self._dead = int(np.count_nonzero(~moment.state.alive))
        if self._standing:
            self._note_standing(moment)
        for watch in self._watches:
            if watch.measure and (watch.iterations is None or self._time <= watch.iterations):
                value, before = float(moment.measured.values[watch.measure]), self._values.get(watch.key)
                if watch.how == "at" or before is None:
                    self._values[watch.key] = value
                else:
                    self._values[watch.key] = float((np.fmin if watch.how == "least" else np.fmax)(before, value))

    def _note_standing(self, moment: Moment[Knowledge]) -> None:
        place = moment.state.pose[:, :2]
        if self._anchor is None:
            self._anchor = place.copy()
            self._still = self._longest = np.zeros(len(place), np.int64)
        free = ~wanting(moment, self._radius) | (np.hypot(*(place - self._anchor).T) > self._radius)
        self._anchor = np.where(free[:, None], place, self._anchor)
        self._still = np.where(free, 0, self._still + 1)
        self._longest = np.maximum(self._longest, self._still)

    def summary(self) -> dict[str, float | int | None]:
        """The watched values, by key."""
        found: dict[str, float | int | None] = dict(self._values)
        for watch in self._watches:
            if watch.how == "stuck":
                found[watch.key] = int(np.count_nonzero(self._longest >= (watch.iterations or 1)))
            elif watch.how == "dead":
                found[watch.key] = self._dead
        return found


def wanting(moment: Moment[Knowledge], reach: float) -> NDArray[np.bool_]:
    """The live robots (n,) that want to be elsewhere: their way leads beyond `reach` m, or they drive."""
    intents, alive = moment.intents, moment.state.alive
    last = np.maximum(intents.counts - 1, 0)
    ends = intents.waypoints[np.arange(len(last)), last] if intents.waypoints.shape[1] else np.zeros((len(last), 2))
    here = moment.state.pose if moment.believed is None else moment.believed
    away: NDArray[np.bool_] = (intents.counts > 0) & (np.hypot(*(ends - here[:, :2]).T) > reach)
    if intents.twists is not None:
        speeds = np.delete(intents.twists, 1, axis=1)  # ahead, and to the left where there is one
        away = np.where(np.isnan(intents.twists[:, 0]), away, (speeds != 0.0).any(axis=1))
    return away & alive
