"""The task of heading consensus: how well robots are aligned, and how they follow turning leaders."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Final

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from swarmsim.core.context import BuildContext
from swarmsim.core.parts import Curve, Summary
from swarmsim.core.state import Done, Knowledge, Measured, Moment
from swarmsim.operations.consensus.heading import Headings
from swarmsim.operations.steering import wrapped

CLOSE: Final = np.pi / 8.0  # rad: a robot this close to its leaders' course follows them
CURVE: Final = Curve("order", "order parameter", low=0.0, high=1.0, format=".3f")


class Alignment(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Live robots head the same way: their order parameter reaches a threshold.

    With the `frequency` at which leaders turn to and fro, a run also measures the others' response.
    """

    order: Annotated[float, Meta(gt=0.0, le=1.0)] = 0.99  # the order parameter that finishes the run
    frequency: Annotated[float, Meta(gt=0.0)] | None = None  # Hz

    def build(self, context: BuildContext) -> AlignmentTask:
        return AlignmentTask(self, context.period)


class AlignmentTask:
    """Measures the order parameter of the robots' decisions."""

    requires_knowledge: type[Knowledge] = Headings
    curve = CURVE

    def __init__(self, parameters: Alignment, period: float) -> None:
        self._wanted, self._frequency, self._period = parameters.order, parameters.frequency, period

    def measure(self, done: Done[Headings]) -> Measured:
        """The order of the live, and how closely followers follow the leaders; NaN while no robot leads."""
        heading, alive = done.knowledge.heading, done.state.alive
        leads = done.knowledge.leads & alive
        reached = order(heading[alive])
        values = {"order": reached, "following": following(heading[alive & ~leads], heading[leads])}
        return Measured(values, {}, min(1.0, reached / self._wanted), reached >= self._wanted)

    def summaries(self) -> Sequence[Summary[Headings]]:
        """Order over the run, and the correlation length at its end."""
        every = None if self._frequency is None else 1.0 / (self._frequency * self._period)
        return (AlignmentMeasures(every),)


class AlignmentMeasures:
    """An observer that sums alignment up."""

    def __init__(self, every: float | None = None) -> None:
        """`every`: iterations in which leaders turn to and fro once."""
        self._every = every
        self._headings: list[NDArray[np.float64]] = []
        self._orders: list[float] = []
        self._following: list[float] = []
        self._last: Moment[Headings] | None = None

    def sample(self, moment: Moment[Headings]) -> None:
        """Take note of one iteration."""
        self._orders.append(moment.measured.values["order"])
        if np.isfinite(moment.measured.values["following"]):
            self._following.append(moment.measured.values["following"])
        if self._every is not None:
            self._headings.append(moment.knowledge.heading)
        self._last = moment

    def summary(self) -> dict[str, float | int | None]:
        """Order, how far, how fast and how faithfully leaders were followed, and correlation length.

        `_late` is the mean over the second half of the run, or of the time with leaders. `reach` is the share of
        followers within CLOSE of their leaders' course at the end, `followed_after` the iterations until followers were
        that close on average.
        """
        orders, last = np.array(self._orders), self._last
        half = len(orders) // 2
        length = None
        if last is not None:
            alive = last.state.alive
            length = correlation_length(last.state.pose[alive, :2], last.knowledge.heading[alive])
        return {
            "order_end": float(orders[-1]) if len(orders) else None,
            "order_late": float(orders[half:].mean()) if len(orders) else None,
            "reach": self._reach(),
            "followed_after": next((at for at, f in enumerate(self._following, 1) if f >= np.cos(CLOSE)), None),
            "following_late": float(np.mean(self._following[len(self._following) // 2 :])) if self._following else None,
            "correlation_length": length,
            **({} if self._every is None else {"response": self._response(self._every)}),
        }

    def _reach(self) -> float | None:
        if self._last is None or not self._following:
            return None
        heading, alive = self._last.knowledge.heading, self._last.state.alive
        leads = self._last.knowledge.leads & alive
        course = np.angle(np.exp(1j * heading[leads]).sum())
        close = np.abs(wrapped(heading[alive & ~leads] - course)) <= CLOSE
        return float(close.mean()) if len(close) else None

    def _response(self, every: float) -> float | None:
        """The response over all whole turns that fit into the second half of the run; None if none does."""
        turns = int(len(self._headings) / 2 / every)
        if turns == 0 or self._last is None:
            return None
        window = np.array(self._headings[-round(turns * every) :])
        leads, alive = self._last.knowledge.leads, self._last.state.alive
        return response(window[:, alive & ~leads], window[:, leads & alive], turns)


def order(heading: NDArray[np.float64]) -> float:
    """|sum_j exp(i theta_j)| / n (Vicsek et al. 1995): 1 if all headings (n,) are equal, about 0 if they are random.

    NaN without robots.
    """
    return float(np.abs(np.exp(1j * heading).mean())) if len(heading) else float("nan")


def following(followers: NDArray[np.float64], leaders: NDArray[np.float64]) -> float:
    """The mean cosine of the angle between followers' headings (f,) and the leaders' mean direction (l,): 1 is exact.

    NaN without followers or leaders.
    """
    if len(followers) == 0 or len(leaders) == 0:
        return float("nan")
    course = np.angle(np.exp(1j * leaders).sum())
    return float(np.cos(followers - course).mean())


def response(followers: NDArray[np.float64], leaders: NDArray[np.float64], turns: int) -> float | None:
    """H^2 = sum_i |h_i|^2 over followers (Mateo et al. 2019): their total response to the leaders' turning to and fro.

    h_i is the Fourier component of follower i's heading (t, f) at the frequency of `turns` whole turns in these t
    iterations, over that of the leaders' mean heading (t, l). Headings must stay within half a circle of the first
    leader's first. None without leaders.
    """
    if leaders.shape[1] == 0:
        return None
    wave = np.exp(-2j * np.pi * turns * np.arange(len(followers)) / len(followers))
    course = leaders[0, 0]
    driven, drive = (wave @ wrapped(heading - course) for heading in (followers, leaders))
    return float((np.abs(driven) ** 2).sum() / np.abs(drive.mean()) ** 2)


def correlation_length(place: NDArray[np.float64], heading: NDArray[np.float64], bins: int = 20) -> float | None:
    """The distance in m at which the correlation of heading fluctuations first falls to zero (Cavagna et al. 2010).

    Fluctuations are the unit vectors of headings (n,) less their mean; pairs of robots at places (n, 2) are binned by
    distance. None for fewer than three robots, without fluctuations, or if it stays positive.
    """
    if len(heading) < 3:
        return None
    unit = np.stack([np.cos(heading), np.sin(heading)], axis=1)
    rest = unit - unit.mean(axis=0)
    if not (np.abs(rest) > 1e-9).any():
        return None
    first, second = np.triu_indices(len(heading), 1)
    apart = np.hypot(*(place[first] - place[second]).T)
    product = (rest[first] * rest[second]).sum(axis=1)
    edges = np.linspace(0.0, float(apart.max()) or 1.0, bins + 1)
    row = np.clip(np.digitize(apart, edges) - 1, 0, bins - 1)
    pairs = np.bincount(row, minlength=bins)
    mean = np.bincount(row, product, minlength=bins) / np.maximum(pairs, 1)
    below = np.flatnonzero((pairs > 0) & (mean <= 0.0))
    return float(0.5 * (edges[below[0]] + edges[below[0] + 1])) if len(below) else None
