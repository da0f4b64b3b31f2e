"""Finds the smallest swarm that does its task within a time with a given probability, with as few runs as it takes.

Counts of robots, or values of any key, stand on a ladder. The last one is asked first, the rest by bisection. Runs with
seeds 1, 2, 3 and so on are spent on one value until its chance P is settled by the tests of `sequential`:

- it *suffices* once P > sure - slack is shown;
- it *does not* once P < sure + slack is shown, and the evidence is also ODDS to 1 that P < sure. Within the slack both
  P > sure - slack and P < sure + slack will be shown; whichever came first would decide by chance, so a value that
  is exactly as sure as asked is given up in at most one of ODDS cases;
- it *may* suffice if the budget ends before.

Half of 1 - confidence goes to each statement of the answer: that one value suffices, and that the next one does not.
Whichever values are asked may come to be these two, so each of them has a part of that; see `smallest`. What is said of
a value depends on its outcomes in the order of seeds alone, so it stays the same however often one looks, and whether
the runs were made at once or not.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from swarmsim.studies import sequential
from swarmsim.studies.sequential import JudgedChance
from swarmsim.studies.survival import Interval

Verdict = Literal["suffices", "does not", "may"]
Times = NDArray[np.float64]  # (n,): s until done, by seed; inf where it was not done within the time
Ask = Callable[[int, int], Times]  # of a place on the ladder and a number of runs: the times of its first runs

FIRST: Final = 8  # runs of a value before the first look
ODDS: Final = 10.0  # against a value that is given up
MORE_PLACES: Final = 6  # further places asked for a lower price


def grown(runs: int) -> int:
    """The runs at the next look: a quarter more."""
    return max(FIRST, runs + max(4, runs // 4))


@dataclass(frozen=True, slots=True)
class Question:
    """The question that a search answers."""

    within: float  # s
    sure: float = 0.95
    slack: float = 0.02
    confidence: float = 0.95  # of both statements of the answer together
    budget: int = 4000  # runs; no value gets more than half of them
    part: float = 1.0  # of alpha, for that a value suffices

    @property
    def alpha(self) -> float:
        """The largest chance that one statement is wrong."""
        return (1.0 - self.confidence) / 2.0

    def shown(self, done: NDArray[np.bool_], since: int = 0) -> NDArray[np.bool_]:
        """What outcomes (n,) by seed show, (3, n - since), after each run but the first `since`.

        The rows are P > sure - slack, P < sure + slack, and P < sure, the last with less evidence.
        """
        low, high = sequential.bounds(self.sure, self.slack)
        good, runs = np.cumsum(done)[since:], np.arange(since + 1, len(done) + 1)
        above = sequential.evidence(good, runs - good, low) >= -np.log(self.alpha * self.part)
        below = sequential.evidence(runs - good, good, 1.0 - high) >= -np.log(self.alpha)
        less = sequential.evidence(runs - good, good, 1.0 - self.sure) >= np.log(ODDS)
        return np.stack([above, below, less])


def settled(shown: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """After each run, by what was shown (3, n), whether a value is settled: it suffices (n,), it does not (n,)."""
    above, below, less = np.logical_or.accumulate(shown, axis=1)
    return above, below & less


@dataclass(frozen=True)
class Asked:
    """A value of the ladder, and the runs that its verdict is made of."""

    place: int
    times: Times
    question: Question

    @property
    def done(self) -> NDArray[np.bool_]:
        """Whether each run (n,) was done within the time."""
        return self.times <= self.question.within

    @cached_property
    def judged(self) -> JudgedChance:
        """What the runs show of P."""
        asked = self.question
        return sequential.judge(self.done, asked.sure, asked.slack, asked.alpha * asked.part)

    @cached_property
    def verdict(self) -> Verdict:
        """Whether it suffices; where both are shown, within the slack, it does."""
        suffices, does_not = settled(self.question.shown(self.done))
        if suffices[-1:].any():
            return "suffices"
        return "does not" if does_not[-1:].any() else "may"

    def quantile(self, share: float) -> tuple[float, Interval]:
        """The time by which this share of all runs is done, s, and its interval; inf where it is not known.

        A time t is in the interval unless the runs done by then refute that P(done by t) is `share`, which keeps it
        valid whenever the runs stop, as the interval of P.
        """
        ordered, runs = np.sort(self.times), len(self.times)
        done = np.arange(runs + 1)
        needed = -np.log(self.question.alpha)
        may = np.flatnonzero(sequential.evidence(runs - done, done, 1.0 - share) < needed)  # P(done by t) >= share
        are = np.flatnonzero((sequential.evidence(done, runs - done, share) >= needed) & (done > share * runs))
        ends = int(may[0]), int(are[0]) if len(are) else runs + 1
        point, low, high = (_nth(ordered, count) for count in (int(np.ceil(share * runs - 1e-9)), *ends))
        return point, (low, high)

    def mean(self) -> tuple[float, Interval]:
        """The mean of min(time, within), s, and its interval, valid whenever the runs stop.

        The evidence for a chance serves as that for the mean of any variable between 0 and 1: the likelihood ratio is
        convex in it, so it is raised on average no more than by a run that ends well or not (Hoeffding 1963).
        """
        within = self.question.within
        share = float(np.minimum(self.times, within).sum()) / within
        low, high = sequential.interval(share, len(self.times), 2.0 * self.question.alpha)
        return within * share / len(self.times), (within * low, within * high)


@dataclass(frozen=True, slots=True)
class LadderAnswer:
    """The answer, and everything that was asked for it."""

    question: Question
    asked: tuple[Asked, ...]  # in the order of the ladder
    more_is_better: bool | None  # None where both ends of the ladder suffice, or neither, and nobody said
    best: int | None  # the place of the smallest value that suffices, or the largest where less is better
    decided: bool  # whether the place next to the best is shown not to suffice, or all are
    falls: tuple[tuple[int, int], ...]  # places whose chance is shown to be lower at the second, which should be better
    cheapest: int | None = None  # the place with the lowest price of those that suffice, if prices were asked for

    def at(self, place: int) -> Asked:
        """What was asked of a place. Raises KeyError if nothing was."""
        return {one.place: one for one in self.asked}[place]

    @property
    def used(self) -> int:
        """The runs that the verdicts are made of."""
        return sum(len(one.times) for one in self.asked)


@dataclass
class LadderSearch:
    """A search on a ladder of places 0 to `places` - 1."""

    question: Question
    places: int
    ask: Ask
    tell: Callable[[Asked], None] = lambda asked: None
    step: Callable[[int], int] = grown  # the runs at the next look
    priced: bool = False  # whether `cheaper` will be asked too
    found: dict[int, Asked] = field(default_factory=dict)
    best: int | None = None
    cheapest: int | None = None
    better: bool | None = None

    def smallest(self, more_is_better: bool | None = True, first: Sequence[int] = ()) -> None:
        """Look for the first place that suffices; None finds out at which end of the ladder it is easier.

        The easier end is asked first, or the places in `first` in their order, until one suffices. If none does, places
        between are tried, halving the gaps, since the chance may rise and fall again.

        Each value that is asked first, by bisection or for its price has an equal part of the error, and those tried
        between share one: 1/2 + 1/6 + 1/12 + ... = 1.
        """
        order = range(self.places)
        parts = len(first or (0,)) + (more_is_better is None) + (self.places - 1).bit_length() + (self.places > 1)
        parts += min(MORE_PLACES, self.places - 1) * self.priced
        self.question = replace(self.question, confidence=1.0 - (1.0 - self.question.confidence) / parts)
        self.better = more_is_better
        if more_is_better is None:
            bottom, top = self._suffices(0), self._suffices(order[-1])
            self.better = None if bottom == top else top
            if bottom and top:
                self.best = 0
                return
        if self.better is False:
            order = order[::-1]
        right = next(
            (rank for rank in first or (len(order) - 1,) if self._left() and self._suffices(order[rank])), None
        )
        if right is None:
            right = self._anywhere(order)
        if right is not None:
            self.best = order[self._bisected(order, right)]

    def cheaper(self, price: Callable[[Asked], float], least: Callable[[int], float]) -> None:
        """Look for the place with the lowest price that suffices, given the least that a place can cost.

        At most MORE_PLACES of those that may cost less are asked beside what was asked before.
        """
        enough = [one for one in self.found.values() if one.verdict == "suffices"]
        for _ in range(MORE_PLACES):
            if not enough:
                return
            lowest = min(map(price, enough))
            may = [place for place in halved(0, self.places) if place not in self.found and least(place) < lowest]
            may = [place for place in may if self._beyond(place)]
            if not may or not self._left():
                break
            if self._suffices(may[0]):
                enough.append(self.found[may[0]])
        self.cheapest = min(enough, key=lambda one: (price(one), one.place)).place if enough else None

    def answer(self) -> LadderAnswer:
        """What was found."""
        asked = tuple(self.found[place] for place in sorted(self.found))
        order = asked[::-1] if self.better is False else asked
        falls = tuple(
            (one.place, other.place)
            for number, one in enumerate(order)
            for other in order[number + 1 :]
            if self.better is not None and _falls(one, other)
        )
        if self.best is None:
            decided = len(asked) == self.places and all(one.verdict == "does not" for one in asked)
        else:
            beside = self.best + (1 if self.better is False else -1)
            there = 0 <= beside < self.places
            decided = not there or (beside in self.found and self.found[beside].verdict == "does not")
        return LadderAnswer(self.question, asked, self.better, self.best, decided, falls, self.cheapest)

    def _beyond(self, place: int) -> bool:
        """Whether a place is on the easier side of the best."""
        best = self.places if self.best is None else self.best
        return place < best if self.better is False else place > best

    def _left(self) -> int:
        return self.question.budget - sum(len(one.times) for one in self.found.values())

    def _suffices(self, place: int, part: float = 1.0) -> bool:
        """Whether a place suffices; it is asked if it was not yet."""
        if place not in self.found:
            question = replace(self.question, part=part)
            self.found[place] = self._asked(place, question, max(0, min(self._left(), question.budget // 2)))
            self.tell(self.found[place])
        return self.found[place].verdict == "suffices"

    def _asked(self, place: int, question: Question, most: int) -> Asked:
        stop, times, shown = None, np.empty(0), np.empty((3, 0), np.bool_)
        while stop is None and len(times) < most:
            times = self.ask(place, min(most, max(self.step(len(times)), len(times) + 1)))
            new = question.shown(times <= question.within, shown.shape[1])
            shown = np.concatenate([shown, new], axis=1)
            hits = np.flatnonzero(np.logical_or(*settled(shown)))
            stop = int(hits[0]) + 1 if len(hits) else None
        return Asked(place, times[:stop], question)

    def _anywhere(self, order: Sequence[int]) -> int | None:
        """A rank at which the task is done, by halving the gaps; None if there is none, or the budget ends."""
        for tried, rank in enumerate(halved(0, len(order) - 1), 1):
            if not self._left():
                return None
            if self._suffices(order[rank], 1.0 / (tried * (tried + 1))):
                return rank
        return None

    def _bisected(self, order: Sequence[int], right: int) -> int:
        """The first rank that suffices, between one that does and the nearest below it that was asked and does not."""
        below = [rank for rank in range(right) if order[rank] in self.found]
        left = max((rank for rank in below if self.found[order[rank]].verdict != "suffices"), default=-1)
        while right - left > 1 and self._left():
            middle = (left + right) // 2
            if self._suffices(order[middle]):
                right = middle
            else:
                left = middle
        return right


def _falls(first: Asked, second: Asked) -> bool:
    """Whether the second is shown to have the lower chance."""
    apart = second.judged.interval[1] < first.judged.interval[0]
    return apart or (first.verdict, second.verdict) == ("suffices", "does not")


def _nth(ordered: Times, count: int) -> float:
    """The time by which so many runs were done: 0 for none, inf for more than there are."""
    return 0.0 if count < 1 else float(ordered[count - 1]) if count <= len(ordered) else np.inf


def halved(first: int, end: int) -> Iterator[int]:
    """The numbers from `first` to before `end`, each next one in the middle of a gap, wide gaps first."""
    gaps = deque([(first, end)])
    while gaps:
        low, high = gaps.popleft()
        if low < high:
            middle = (low + high) // 2
            yield middle
            gaps += [(low, middle), (middle + 1, high)]
