"""Finds the best condition: seeds are added until the intervals decide, and losers are dropped on the way."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from swarmsim.core.durations import told
from swarmsim.core.errors import InputError
from swarmsim.studies.engine import Job
from swarmsim.studies.plan import Plan, one_period, with_seeds
from swarmsim.studies.results import Result, gather, missing
from swarmsim.studies.sequential import interval
from swarmsim.studies.statistics import bootstrap_mean
from swarmsim.studies.store import Store
from swarmsim.studies.survival import ROUNDING, Endings

FIRST = 10  # seeds of every condition in the first round
MORE = 10  # further seeds of every remaining condition in each later round
ENOUGH = 0.5  # share of the leader's runs that must finish: else restricted means tell little but the limit


@dataclass(frozen=True, slots=True)
class Goal:
    """What is compared: the mean of min(time, horizon) or, if `chance`, the chance of being done by the horizon.

    Both are known of every run, finished or not, as the horizon is no later than any condition's limit.
    """

    horizon: float
    period: float | None  # s, of one iteration; None: conditions have several, and times are in seconds
    chance: bool

    def endings(self, result: Result) -> Endings:
        """How a condition's runs ended, up to the horizon."""
        return (result.seconds if self.period is None else result.endings).within(self.horizon)

    def values(self, endings: Endings) -> NDArray[np.float64]:
        """What is averaged over runs (n,), less being better: the time up to the horizon, or 1 for a run not done."""
        return (~endings.finished).astype(np.float64) if self.chance else endings.times

    def upper(self, change: NDArray[np.float64], alpha: float, rounds: int) -> float:
        """The upper end, in this round, of an interval for the mean difference (n,) of two conditions' values.

        Means have Student's interval with a part of alpha for every round. Chances have the difference of the chances
        that either alone is done, each within its confidence sequence, which is valid in all rounds at once.
        """
        n = len(change)
        if self.chance:
            worse, better = (interval(int((sign * change > 0.0).sum()), n, alpha / 2.0) for sign in (1.0, -1.0))
            return worse[1] - better[0]
        spent = alpha * 6.0 / (math.pi * rounds) ** 2
        return float(change.mean() + stats.t.ppf(1.0 - spent / 2.0, n - 1) * change.std(ddof=1) / math.sqrt(n))

    def may_lead(self, endings: Endings, alpha: float) -> bool:
        """Whether a condition may be called best: too many unfinished runs are not shown."""
        return endings.done > 0 if self.chance else interval(endings.done, len(endings.times), alpha)[1] >= ENOUGH

    def leads(self, endings: Endings) -> bool:
        """Whether enough of its runs finished to call it best."""
        return endings.done >= (1 if self.chance else ENOUGH * len(endings.times))

    @property
    def words(self) -> str:
        """The horizon."""
        return told(self.horizon * (self.period or 1.0)) if self.chance or self.period is None else f"{self.horizon:g}"


@dataclass(frozen=True, slots=True)
class Arm:
    """A condition at the end of the race."""

    name: str
    endings: Endings  # of its runs by seed, up to the horizon
    dropped: int | None  # the round in which it was shown to be worse, None if never

    @property
    def runs(self) -> int:
        """The number of its runs."""
        return len(self.endings.times)


@dataclass(frozen=True, slots=True)
class Answer:
    """The best condition by a goal, and how sure that is."""

    goal: Goal
    arms: tuple[Arm, ...]
    best: str
    decided: bool  # before the budget ended
    runs: int
    sentence: str


class TooFewError(InputError):
    """Too few runs finished to call any condition the best."""

    def __init__(self, goal: Goal, ends: Mapping[str, Endings]) -> None:
        counts = ", ".join(f"{one.done} of {len(one.times)} {name}" for name, one in ends.items())
        if goal.chance:
            by, how = f"by {goal.words}", "some: give a later time or an easier task"
        else:
            by = f"within {goal.words}{' iterations' if goal.period else ''}"
            how = "at least half of the best's: give a later limit, an easier task, or a time: --within TIME"
        super().__init__(f"no condition can be called best, since too few runs finished {by}: {counts}; expected {how}")


def best(
    plan: Plan,
    store: Store,
    run_jobs: Callable[[Sequence[Job]], None],
    confidence: float,
    budget: int,
    tolerance: float,
    within: float | None = None,
) -> Answer:
    """Race a study's conditions by successive elimination (Even-Dar, Mannor and Mansour 2006).

    The best has the lowest mean of min(time, horizon), the horizon being the shortest limit of all conditions: that
    is its mean time if all its runs finish. Or, with a time `within` in s, the highest chance of being done by it.

    A condition is dropped when it is worse than the leader with confidence; the race ends when none of the rest can be
    better than the leader by more than `tolerance`, a share of the leader's mean or a difference of chances.
    Differences are taken seed by seed, since equal seeds give equal starts; their intervals share 1 - `confidence`
    among all conditions and rounds. `run_jobs` does the missing runs; at most `budget` are used.

    Raises InputError if too few runs finish to call any condition the best, and for a time beyond a limit.
    """
    goal = goal_of(plan, within)

    def run(names: Sequence[str], seeds: int) -> dict[str, Endings]:
        part = with_seeds(plan, seeds, names)
        run_jobs(missing(part, store))
        return _ended(plan, gather(part, store), goal)

    try:
        return race([condition.name for condition in plan.conditions], goal, run, confidence, budget, tolerance)
    except TooFewError as problem:
        raise InputError(f"{plan.path}: {problem}") from problem


def race(
    names: Sequence[str],
    goal: Goal,
    run: Callable[[Sequence[str], int], Mapping[str, Endings]],
    confidence: float,
    budget: int,
    tolerance: float,
) -> Answer:
    """The race of `best`; `run` gives how the runs of these conditions with so many seeds ended. Raises TooFewError."""
    dropped: dict[str, int] = {}
    seeds, rounds, decided, leader = FIRST, 0, False, names[0]
    ends: dict[str, Endings] = {}
    alpha = (1.0 - confidence) / max(len(names) - 1, 1)
    while True:
        racing = [name for name in names if name not in dropped]
        spent = sum(len(ends[name].times) for name in dropped)
        if rounds and (spent + len(racing) * seeds > budget or decided):
            break
        rounds += 1
        ends |= run(racing, seeds)
        if not any(goal.may_lead(ends[name], 1.0 - confidence) for name in racing):
            raise TooFewError(goal, ends)
        values = {name: goal.values(ends[name]) for name in racing}
        leader = min(racing, key=lambda name: float(values[name].mean()))
        highs = {name: goal.upper(values[leader] - values[name], alpha, rounds) for name in racing if name != leader}
        dropped |= {name: rounds for name, high in highs.items() if high < 0.0}
        margin = tolerance if goal.chance else tolerance * float(values[leader].mean())
        decided = goal.leads(ends[leader]) and not any(high > margin for high in highs.values())
        seeds += MORE
    if not goal.leads(ends[leader]):
        raise TooFewError(goal, ends)
    arms = tuple(Arm(name, ends[name], dropped.get(name)) for name in names)
    said = _said(goal, arms, leader, decided, confidence, tolerance)
    return Answer(goal, arms, leader, decided, sum(arm.runs for arm in arms), said)


def goal_of(plan: Plan, within: float | None) -> Goal:
    """What is compared. Raises InputError for a time beyond a condition's limit."""
    period = one_period(plan.conditions)
    scenarios = {condition.name: condition.scenario for condition in plan.conditions}
    if within is None:
        limits = [one.limit * (one.period if period is None else 1.0) for one in scenarios.values()]
        return Goal(min(limits), period, False)
    for name, one in scenarios.items():
        if one.limit * one.period < within * (1.0 - ROUNDING):
            raise InputError(
                f"{plan.path}: --within {told(within)}: beyond the limit of {name}, {told(one.limit * one.period)}; "
                f"expected at most that, or a later stop.seconds or stop.iterations"
            )
    return Goal(within, None, True)


def _ended(plan: Plan, found: Mapping[str, Result], goal: Goal) -> dict[str, Endings]:
    """How the runs of all conditions ended. Raises InputError for failed runs."""
    for name, result in found.items():
        if result.failed:
            row = result.failed[0]
            raise InputError(f"{plan.path}: {name}, seed {row.seed}: failed, and cannot be compared: {row.message}")
    return {name: goal.endings(result) for name, result in found.items()}


def _said(goal: Goal, arms: Sequence[Arm], leader: str, decided: bool, confidence: float, tolerance: float) -> str:
    runs = sum(arm.runs for arm in arms)
    level = [arm.name for arm in arms if arm.dropped is None and arm.name != leader]
    cut = not all(arm.endings.whole for arm in arms)
    if goal.chance:
        claim = f"has a chance of being done by {goal.words} that is higher by more than {100 * tolerance:g} points"
        what = f" by the chance of being done by {goal.words}"
    elif goal.period is None:
        claim = f"needs less time{f', of the first {goal.words},' * cut} by more than {tolerance:.0%}"
        what = f" by the first {goal.words}" * cut
    else:
        claim = f"needs fewer iterations{f', of the first {goal.words},' * cut} by more than {tolerance:.0%}"
        what = f" by the first {goal.words} iterations" * cut
    if decided:
        beside = f"; not shown to be worse: {', '.join(level)}" if level else ""
        return f"{leader} is best: with {confidence:.0%} confidence no other {claim}{beside} ({runs} runs)"
    return f"not decided within the budget ({runs} runs): {leader} leads{what}, not told apart from {', '.join(level)}"


def head(answer: Answer) -> tuple[str, ...]:
    """The columns of the table of a race."""
    goal, cut = answer.goal, not all(arm.endings.whole for arm in answer.arms)
    if goal.chance:
        return ("condition", "runs", "finished", f"done by {goal.words}", "interval, any time", "dropped in round")
    unit = "iterations" if goal.period else "seconds"
    mean = f"mean of min({unit}, {goal.horizon:g})" if cut else f"mean {unit}"
    return ("condition", "runs", "finished", mean, "95 % interval", "mean in time", "dropped in round")


def lines(answer: Answer) -> list[tuple[str, ...]]:
    """The table of the race, one line per condition, under `head`."""
    return [
        (
            arm.name + " (best)" * (arm.name == answer.best and answer.decided),
            str(arm.runs),
            str(arm.endings.done),
            *_averages(answer.goal, arm),
            "-" if arm.dropped is None else str(arm.dropped),
        )
        for arm in answer.arms
    ]


def _averages(goal: Goal, arm: Arm) -> tuple[str, ...]:
    """The cells of what is compared."""
    if goal.chance:
        low, high = interval(arm.endings.done, arm.runs, 0.05)
        return f"{100 * arm.endings.done / arm.runs:.0f} %", f"{100 * low:.0f} to {100 * high:.0f} %"
    mean, found = float(arm.endings.times.mean()), bootstrap_mean(arm.endings.times)
    between = "-" if found is None else f"{found[0]:.1f} to {found[1]:.1f}"
    return f"{mean:.1f}", between, told(mean * (goal.period or 1.0))
