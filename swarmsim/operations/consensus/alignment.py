"""The task of heading consensus: how well robots are aligned, and how they follow those who turn."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Final

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from swarmsim.core.parts import Curve, Setting, Summary
from swarmsim.core.state import Knowledge, Measured, Moment
from swarmsim.operations.consensus.heading import Headings

CURVE: Final = Curve("order", "order parameter", low=0.0, high=1.0, format=".3f")


class Alignment(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Live robots head the same way: their order parameter reaches a threshold."""

    order: Annotated[float, Meta(gt=0.0, le=1.0)] = 0.99  # the order parameter that finishes the run

    def build(self, setting: Setting) -> AlignmentTask:
        """The task."""
        return AlignmentTask(self.order)


class AlignmentTask:
    """Measures the order parameter of what robots have decided."""

    reads: type[Knowledge] = Headings
    curve = CURVE

    def __init__(self, wanted: float) -> None:
        self._wanted = wanted

    def measure(self, moment: Moment) -> Measured:
        """The order of the live, and how closely those who do not lead follow those who do."""
        heading, alive = moment.knowledge.heading, moment.state.alive
        leads = moment.knowledge.leads & alive
        reached = order(heading[alive])
        values = {"order": reached}
        if leads.any():
            values["following"] = following(heading[alive & ~leads], heading[leads])
        return Measured(values, {}, min(1.0, reached / self._wanted), reached >= self._wanted)

    def summaries(self) -> Sequence[Summary]:
        """Order over the run, and how far correlations reach at its end."""
        return (AlignmentMeasures(),)


class AlignmentMeasures:
    """A probe that sums alignment up."""

    def __init__(self) -> None:
        self._orders: list[float] = []
        self._following: list[float] = []
        self._last: Moment | None = None

    def sample(self, moment: Moment) -> None:
        """Take note of one iteration."""
        self._orders.append(moment.measured.values["order"])
        if "following" in moment.measured.values:
            self._following.append(moment.measured.values["following"])
        self._last = moment

    def summary(self) -> dict[str, float | int | None]:
        """The order at the end and its mean over the second half, how leaders were followed, and correlation length."""
        orders, last = np.array(self._orders), self._last
        half = len(orders) // 2
        length = None
        if last is not None:
            alive = last.state.alive
            length = correlation_length(last.state.pose[alive, :2], last.knowledge.heading[alive])
        return {
            "order_end": float(orders[-1]) if len(orders) else None,
            "order_late": float(orders[half:].mean()) if len(orders) else None,
            "following_late": float(np.mean(self._following[len(self._following) // 2 :])) if self._following else None,
            "correlation_length": length,
        }


def order(heading: NDArray[np.float64]) -> float:
    """|sum_j exp(i theta_j)| / n (Vicsek et al. 1995): 1 if all headings (n,) are equal, about 0 if they are random.

    NaN for nobody.
    """
    return float(np.abs(np.exp(1j * heading).mean())) if len(heading) else float("nan")


def following(followers: NDArray[np.float64], leaders: NDArray[np.float64]) -> float:
    """The mean cosine of the angle between followers' headings (f,) and the leaders' mean direction (l,): 1 is exactly.

    NaN without followers.
    """
    if len(followers) == 0:
        return float("nan")
    course = np.angle(np.exp(1j * leaders).sum())
    return float(np.cos(followers - course).mean())


def correlation_length(place: NDArray[np.float64], heading: NDArray[np.float64], bins: int = 20) -> float | None:
    """The distance in m at which the correlation of heading fluctuations first falls to zero (Cavagna et al. 2010).

    Fluctuations are the unit vectors of headings (n,) less their mean; pairs of robots at places (n, 2) are binned by
    distance. None where fewer than three robots are, none fluctuates, or it stays positive.
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
