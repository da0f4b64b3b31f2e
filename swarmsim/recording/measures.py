"""The measures of every run: time, distance and communication."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.crew import Crew
from swarmsim.core.events import Ended
from swarmsim.core.parts import Curve
from swarmsim.core.scenario.robots import Robots
from swarmsim.core.state import Knowledge, Moment, State

EDITION: Final = 2  # of the measures' meaning; raised on changes, so that studies do not mix old and new rows
SHARES: Final = (50, 75, 90, 95, 99, 100)  # per cent of a curve's top; the time to each is measured


def reached(curve: NDArray[np.float64], share: float) -> int | None:
    """The number of iterations after which `curve` (t,), from 0 to 1, first reached `share`, or None."""
    hits = np.flatnonzero(curve >= share)
    return int(hits[0]) + 1 if len(hits) else None


def times_of(values: NDArray[np.float64], curve: Curve) -> dict[int, int | None]:
    """The number of iterations after which the `values` (t,) of a task's curve first reached each of SHARES, or None.

    They are shares of the top of the curve's axis, such as the whole domain for coverage, not of the task's goal.
    A curve without a top, such as an error, has no shares: the answer is empty.
    """
    if not curve.rises or curve.low != 0.0 or curve.high is None:
        return {}
    return {share: reached(values * (curve.scale / curve.high), share / 100) for share in SHARES}


def jain(shares: NDArray[np.float64]) -> float | None:
    """Fairness (sum x)^2 / (n sum x^2) of robots' shares (n,) (Jain et al. 1984): 1 is equal, 1/n one robot alone."""
    squares = float(len(shares) * (shares**2).sum())
    return float(shares.sum() ** 2) / squares if squares > 0.0 else None


def share_of(part: float, whole: float) -> float | None:
    """The part over the whole; None if the whole is 0."""
    return part / whole if whole else None


class RunMeasures:
    """Keeps the measures of every run, so that studies need no recording."""

    def __init__(self, robots: Robots | Crew, period: float, curve: Curve) -> None:
        """`period` in s; `curve` is the task's."""
        self._period, self._curve = period, curve
        self._leap = 2.0 * robots.speed * period  # m; a longer move in one iteration means the robot was carried
        self._path = np.zeros(len(robots.each("speed")))
        self._last: State | None = None
        self._values: list[float] = []  # of the curve
        self._finished = False
        self._links = self._messages = self._bytes = self._lost = 0
        self._sent: int | None = None  # bytes; told for runs with jobs

    def sample(self, moment: Moment[Knowledge]) -> None:
        """Note one iteration."""
        state, last = moment.state, self._last
        if last is not None:
            step = np.hypot(*(state.pose - last.pose)[:, :2].T)
            self._path += np.where(last.alive & (step < self._leap), step, 0.0)
        self._last = state
        self._values.append(moment.measured.values[self._curve.name])
        self._finished = any(isinstance(event, Ended) and event.finished for event in moment.events)
        self._links += len(moment.links) if moment.traffic is None else moment.traffic.offered
        if moment.jobs and moment.traffic is not None:
            self._sent = (self._sent or 0) + moment.traffic.sent
        self._messages += len(moment.delivery.heard)
        self._bytes += int(moment.delivery.heard[:, 3].sum())
        self._lost += sum(len(letters) for _, letters in moment.delivery.lost)

    def summary(self) -> dict[str, float | int | None]:
        """The run in numbers, defined in docs/measures.md. None where a number is undefined."""
        ran = len(self._values)
        found = times_of(np.array(self._values), self._curve)
        times = {share: found.get(share) for share in SHARES}
        return {
            "finished": int(self._finished),
            "iterations": ran if self._finished else None,
            "iterations_run": ran,
            "seconds": ran * self._period if self._finished else None,
            **{f"t{share}": time for share, time in times.items()},
            "tail_ratio": times[100] / times[95] if times[95] and times[100] else None,
            "path_sum": float(self._path.sum()),
            "path_longest": float(self._path.max(initial=0.0)),
            "path_mean": float(self._path.mean()),
            "jain_path": jain(self._path),
            "messages": self._messages,
            "bytes": self._bytes,
            **({} if self._sent is None else {"bytes_sent": self._sent}),
            "delivered_share": share_of(self._messages, self._links),
            "lost": self._lost,
        }


def mean_value(curve: NDArray[np.float64], horizon: int | None = None) -> float | None:
    """The area under a curve (t,), divided by its length: the mean of its values.

    With a `horizon` (iterations) it is the mean up to there, and a shorter curve keeps its last value, so that runs
    of different lengths can be compared. None without iterations.
    """
    length = len(curve) if horizon is None else horizon
    if length < 1 or len(curve) == 0:
        return None
    return float((curve[:length].sum() + curve[-1] * max(0, length - len(curve))) / length)
