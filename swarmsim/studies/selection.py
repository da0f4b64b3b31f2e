"""Finds the best condition: seeds are added until the intervals decide, and losers are dropped on the way."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from swarmsim.core.errors import InputError
from swarmsim.studies.engine import Job
from swarmsim.studies.plan import Plan, with_seeds
from swarmsim.studies.results import Result, gather, missing
from swarmsim.studies.statistics import bootstrap_mean
from swarmsim.studies.store import Store

FIRST = 10  # seeds of every condition in the first round
MORE = 10  # further seeds of every remaining condition in each later round


@dataclass(frozen=True, slots=True)
class Arm:
    """A condition at the end of the race."""

    name: str
    times: tuple[float, ...]  # iterations, by seed; an unfinished run has its iterations at the stop
    finished: int  # of these runs
    dropped: int | None  # the round in which it was shown to be slower, None if never


@dataclass(frozen=True, slots=True)
class Answer:
    """The condition that needs the fewest iterations, and how sure that is."""

    arms: tuple[Arm, ...]
    best: str
    decided: bool  # before the budget ended
    runs: int
    sentence: str


def best(
    plan: Plan,
    store: Store,
    run_jobs: Callable[[Sequence[Job]], None],
    confidence: float,
    budget: int,
    tolerance: float,
) -> Answer:
    """Race a study's conditions by successive elimination (Even-Dar, Mannor and Mansour 2006).

    A condition is dropped when it is slower than the leader with confidence; the race ends when none of the
    rest can be faster than the leader by more than `tolerance` (a share of the leader's mean). Differences are
    taken seed by seed, since equal seeds give equal starts; their Student intervals share 1 - `confidence`
    among all conditions and rounds. `perform` does the missing runs; at most `budget` are used.

    An unfinished run took longer than its limit, by an unknown amount. A condition that has one can be shown to be
    slower, but it never leads. Raises InputError if all remaining conditions, or an earlier leader, have one: then
    the best is unknown.
    """
    names = [condition.name for condition in plan.conditions]
    dropped: dict[str, int] = {}
    seeds, rounds, decided = FIRST, 0, False
    times: dict[str, NDArray[np.float64]] = {}
    found: dict[str, Result] = {}
    leader, led = names[0], set[str]()
    while True:
        racing = [name for name in names if name not in dropped]
        spent = sum(len(times[name]) for name in dropped)
        if rounds and (spent + len(racing) * seeds > budget or decided):
            break
        rounds += 1
        part = with_seeds(plan, seeds, racing)
        run_jobs(missing(part, store))
        found |= gather(part, store)
        times |= {name: found[name].times for name in racing}
        whole = _whole(plan, found, racing, led)
        leader = min(whole, key=lambda name: float(times[name].mean()))
        led.add(leader)
        alpha = (1.0 - confidence) * 6.0 / (math.pi * rounds) ** 2 / max(len(names) - 1, 1)
        highs = {name: _difference(times[leader], times[name], alpha) for name in racing if name != leader}
        dropped |= {name: rounds for name, high in highs.items() if high < 0.0}
        decided = not any(high > tolerance * times[leader].mean() for high in highs.values())
        seeds += MORE
    arms = tuple(
        Arm(name, tuple(times[name].tolist()), int(found[name].finished.sum()), dropped.get(name)) for name in names
    )
    return Answer(
        arms, leader, decided, sum(len(arm.times) for arm in arms), _said(arms, leader, decided, confidence, tolerance)
    )


def _whole(plan: Plan, found: dict[str, Result], racing: Sequence[str], led: set[str]) -> list[str]:
    """The remaining conditions whose runs have all finished. Raises InputError as `best`, or for failed runs."""
    for name in racing:
        if found[name].failed:
            row = found[name].failed[0]
            raise InputError(f"{plan.path}: {name}, seed {row.seed}: failed, and cannot be compared: {row.message}")
    whole = [name for name in racing if found[name].finished.all()]
    if not whole or not led.intersection(racing) <= set(whole):
        counts = ", ".join(
            f"{int(result.finished.sum())} of {len(result.rows)} {name}" for name, result in found.items()
        )
        raise InputError(
            f"{plan.path}: no condition can be called best, since too few runs finished: {counts}; an unfinished run "
            f"has no time; expected one condition at least whose runs all finish: raise stop.iterations, ask less of "
            f"the task, or compare what did finish with: swarmsim study table"
        )
    return whole


def _difference(first: NDArray[np.float64], second: NDArray[np.float64], alpha: float) -> float:
    """The upper end of Student's interval for the mean of first - second, paired by seed."""
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
    cut = any(arm.finished < len(arm.times) for arm in arms if arm.name in level)
    leads = "leads those whose runs all finished" if cut else "leads"
    return f"not decided within the budget ({runs} runs): {leader} {leads}, not told apart from {', '.join(level)}"


HEAD = ("condition", "runs", "finished", "mean", "95 % interval", "dropped in round")


def lines(answer: Answer) -> list[tuple[str, ...]]:
    """The table of the race, one line per condition, under HEAD."""
    rows: list[tuple[str, ...]] = []
    for arm in answer.arms:
        cut = arm.finished < len(arm.times)
        interval = None if cut else bootstrap_mean(arm.times)
        between = "-" if interval is None else f"{interval[0]:.1f} to {interval[1]:.1f}"
        mean = f"{'over ' if cut else ''}{np.mean(arm.times):.1f}"
        mark = " (best)" if arm.name == answer.best else ""
        round_ = "-" if arm.dropped is None else str(arm.dropped)
        rows.append((arm.name + mark, str(len(arm.times)), str(arm.finished), mean, between, round_))
    return rows
