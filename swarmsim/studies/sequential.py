"""Tests of a chance that may be looked at after every run: each run ends well or not, and looking costs nothing.

The evidence that P > b is the likelihood ratio of the runs so far for a uniform mixture of all p above b against b
itself (Robbins 1970: a Beta prior cut off at the bound):

    M = integral over b < p < 1 of p^s (1 - p)^f dp / (1 - b) / (b^s (1 - b)^f),   s good and f other runs.

As long as P <= b, no run raises it on average, so it ever reaches 1 / alpha with probability alpha at most (Ville
1939), however often one looks and whatever decides when to stop. The mixture is continuous: any P above b is shown in
the end. Evidence that P < b is the same for the other runs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from swarmsim.studies.survival import Interval

HALVINGS: Final = 50  # of the range that holds an end of an interval


@dataclass(frozen=True, slots=True)
class JudgedChance:
    """What the runs so far show of the chance P. Inside the slack both may be shown, and both are right."""

    runs: int
    successes: int
    above: bool  # P > bounds[0] is shown
    below: bool  # P < bounds[1] is shown
    interval: Interval  # of P: misses at most alpha on each side, at any time; after the last run, and within bounds


def bounds(chance: float, slack: float) -> Interval:
    """The bounds for a chance: chance - slack, and chance + slack but at most halfway from the chance to 1.

    That P < 1 says nothing, so near 1 the slack above is smaller. Raises ValueError.
    """
    if not 0.0 < slack < chance < 1.0:
        raise ValueError(f"expected 0 < slack < chance < 1, got slack {slack:g} and chance {chance:g}")
    return round(chance - slack, 12), round(chance + min(slack, (1.0 - chance) / 2.0), 12)  # 0.93, not 0.9299999


def evidence(successes: ArrayLike, failures: ArrayLike, bound: ArrayLike) -> NDArray[np.float64]:
    """The logarithm of M: evidence that P > bound, elementwise. For P < bound swap the counts and give 1 - bound."""
    s, f, b = (np.asarray(values, np.float64) for values in (successes, failures, bound))
    with np.errstate(divide="ignore"):  # no evidence at all: the logarithm of 0
        above = np.log(special.betaincc(s + 1.0, f + 1.0, b))
    mixed = special.betaln(s + 1.0, f + 1.0) + above - np.log1p(-b)
    return np.asarray(mixed - special.xlogy(s, b) - special.xlog1py(f, -b))


def judge(outcomes: ArrayLike, chance: float, slack: float, alpha: float) -> JudgedChance:
    """What runs with these outcomes (n,), in the order of their seeds, show of P; see `bounds`.

    P > bounds[0] is shown if its evidence reaches 1 / alpha after any of the runs, and likewise P < bounds[1]: each is
    wrong with probability alpha at most, for all n at once. Raises ValueError for bad bounds.
    """
    low, high = bounds(chance, slack)
    ended = np.asarray(outcomes, np.bool_)
    good = np.cumsum(ended)
    other = np.arange(1, len(ended) + 1) - good
    needed = -math.log(alpha)
    above = bool((evidence(good, other, low) >= needed).any())
    below = bool((evidence(other, good, 1.0 - high) >= needed).any())
    successes = int(good[-1]) if len(good) else 0
    ends = interval(successes, len(ended), 2.0 * alpha)
    within = (max(ends[0], low) if above else ends[0], min(ends[1], high) if below else ends[1])
    return JudgedChance(
        runs=len(ended),
        successes=successes,
        above=above,
        below=below,
        interval=within if within[0] <= within[1] else ends,
    )


def interval(successes: float, runs: int, alpha: float) -> Interval:
    """All P that `evidence` of these runs does not refute at alpha / 2 on each side: a confidence sequence.

    It is computed from the last run alone, and holds P with probability 1 - alpha for all numbers of runs at once, so
    it stays valid whatever made the runs stop. Without runs it is (0, 1).
    """
    low, high = intervals([successes], runs, alpha)[0].tolist()
    return low, high


def intervals(successes: ArrayLike, runs: int, alpha: float) -> NDArray[np.float64]:
    """The interval (m, 2) for each of these numbers of successes (m,), as `interval` gives it."""
    good = np.asarray(successes, np.float64)
    return np.stack([_lower(good, runs - good, alpha / 2.0), 1.0 - _lower(runs - good, good, alpha / 2.0)], axis=1)


def _lower(good: NDArray[np.float64], other: NDArray[np.float64], alpha: float) -> NDArray[np.float64]:
    """The largest b for which the runs show P > b. Bisection finds it: below s / n, evidence falls as b rises."""
    low, high = np.zeros_like(good), good / np.maximum(good + other, 1.0)
    for _ in range(HALVINGS):
        middle = (low + high) / 2.0
        shown = evidence(good, other, middle) >= -math.log(alpha)
        low, high = np.where(shown, middle, low), np.where(shown, high, middle)
    return np.where(good > 0.0, low, 0.0)
