"""Which condition is best: seeds are added until the intervals decide, and losers are dropped on the way."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from swarmsim.studies.engine import Task
from swarmsim.studies.plan import Plan, with_seeds
from swarmsim.studies.results import gather, missing
from swarmsim.studies.statistics import bootstrap_mean
from swarmsim.studies.store import Store

FIRST = 10  # seeds of every condition in the first round
MORE = 10  # seeds of every condition still in the race in each later one


@dataclass(frozen=True, slots=True)
class Arm:
    """A condition at the end of the race."""

    name: str
    times: tuple[float, ...]  # iterations, by seed; an unfinished run counts its limit
    dropped: int | None  # the round in which it was shown to be worse, None if never


@dataclass(frozen=True, slots=True)
class Answer:
    """Which condition needs the fewest iterations, and how sure that is."""

    arms: tuple[Arm, ...]
    best: str
    decided: bool  # before the budget ended
    runs: int
    sentence: str


def best(
    plan: Plan,
    store: Store,
    perform: Callable[[Sequence[Task]], None],
    confidence: float,
    budget: int,
    tolerance: float,
) -> Answer:
    """Race a study's conditions by successive elimination (Even-Dar, Mannor and Mansour 2006).

    A condition is dropped when it is slower than the leader with confidence; the race ends when none of the
    rest can be faster than the leader by more than `tolerance` (a share of the leader's mean). Differences are
    taken seed by seed, since equal seeds give equal starts; their Student intervals share 1 - `confidence`
    among all conditions and rounds. `perform` does the missing runs; at most `budget` are used.
    """
    names = [condition.name for condition in plan.conditions]
    dropped: dict[str, int] = {}
    seeds, rounds, decided = FIRST, 0, False
    times: dict[str, NDArray[np.float64]] = {}
    leader = names[0]
    while True:
        racing = [name for name in names if name not in dropped]
        spent = sum(len(times[name]) for name in dropped)
        if rounds and (spent + len(racing) * seeds > budget or decided):
            break
        rounds += 1
        part = with_seeds(plan, seeds, racing)
        perform(missing(part, store))
        times |= {name: result.times for name, result in gather(part, store).items()}
        leader = min(racing, key=lambda name: float(times[name].mean()))
        alpha = (1.0 - confidence) * 6.0 / (math.pi * rounds) ** 2 / max(len(names) - 1, 1)
        decided = True
        for name in racing:
            if name == leader:
                continue
            high = _difference(times[leader], times[name], alpha)
            if high < 0.0:
                dropped[name] = rounds
            elif high > tolerance * times[leader].mean():
                decided = False
        seeds += MORE
    arms = tuple(Arm(name, tuple(times[name].tolist()), dropped.get(name)) for name in names)
    return Answer(
        arms, leader, decided, sum(len(arm.times) for arm in arms), _said(arms, leader, decided, confidence, tolerance)
    )


def _difference(first: NDArray[np.float64], second: NDArray[np.float64], alpha: float) -> float:
    """The upper end of Student's interval of the mean of first - second, paired by seed."""
    change = first - second
    reach = float(stats.t.ppf(1.0 - alpha / 2.0, len(change) - 1)) * float(change.std(ddof=1)) / math.sqrt(len(change))
    return float(change.mean()) + reach


def _said(arms: Sequence[Arm], leader: str, decided: bool, confidence: float, tolerance: float) -> str:
    runs = sum(len(arm.times) for arm in arms)
    level = [arm.name for arm in arms if arm.dropped is None and arm.name != leader]
    if decided:
        beside = f"; not shown to be slower: {', '.join(level)}" if level else ""
        return (
            f"{leader} is best: with {confidence:.0%} confidence no other needs fewer iterations by more than "
            f"{tolerance:.0%}{beside} ({runs} runs)"
        )
    return f"not decided within the budget ({runs} runs): {leader} leads, not told apart from {', '.join(level)}"


HEAD = ("condition", "runs", "mean", "95 % interval", "dropped in round")


def lines(answer: Answer) -> list[tuple[str, ...]]:
    """The table of the race, one line for each condition, under HEAD."""
    rows: list[tuple[str, ...]] = []
    for arm in answer.arms:
        interval = bootstrap_mean(arm.times)
        between = "-" if interval is None else f"{interval[0]:.1f} to {interval[1]:.1f}"
        mark = " (best)" if arm.name == answer.best else ""
        round_ = "-" if arm.dropped is None else str(arm.dropped)
        rows.append((arm.name + mark, str(len(arm.times)), f"{np.mean(arm.times):.1f}", between, round_))
    return rows
