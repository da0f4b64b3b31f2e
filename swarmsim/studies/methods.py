"""Methods compared over many tasks: ratios, performance profiles and probabilities of improvement.

A study's axes that step together under one name are its methods; all other axes make its tasks, such as a world or a
world and network. Runs of different methods in one task are independent; tasks have equal weight.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.errors import InputError
from swarmsim.studies.plan import Plan, label, shown
from swarmsim.studies.results import Result
from swarmsim.studies.statistics import ranked
from swarmsim.studies.survival import Interval

RESAMPLES: Final = 2000  # of the stratified bootstrap
TAUS: Final = np.geomspace(0.25, 4.0, 97)  # ratios at which profiles are taken


@dataclass(frozen=True, slots=True)
class Standing:
    """One method against the first, over all tasks of a group."""

    method: str
    runs: int
    finished: int
    ratio: float  # geometric mean over tasks of its mean iterations relative to the first method's
    interval: Interval  # 95 %, from runs resampled in every task
    across: Interval | None  # 95 %, from tasks resampled as well: for other tasks of the kind; None for one task
    better: float  # probability that a run in a random task improves on the first method
    better_interval: Interval
    profile: NDArray[np.float64]  # (len(TAUS),): share of runs within tau times the first method's mean in their task


@dataclass(frozen=True, slots=True)
class Compared:
    """All methods against the first, for each group."""

    methods: tuple[str, ...]
    groups: dict[str, tuple[Standing, ...]]
    tasks: int  # in each group
    figures: tuple[Path, ...] = ()  # files drawn, if requested


def compare(plan: Plan, results: Mapping[str, Result], method: str = "method", within: str | None = None) -> Compared:
    """Compare a study's methods, the axes with this `together`, separately for each value of a key.

    An unfinished run counts with the iterations at its stop, which flatters its method: `lines` marks such ratios as
    bounds. Raises InputError if there is no such axis, or runs are missing.
    """
    keys = [axis.key for axis in plan.study.vary if axis.together == method]
    if not keys:
        raise InputError(
            f"{plan.path}: vary: no axis has together = {method!r}; expected one, whose values are compared"
        )
    if within is not None and within not in (axis.key for axis in plan.study.vary if axis.together != method):
        raise InputError(f"{plan.path}: --within {within}: expected the key of another axis of the study")
    times: dict[str, dict[str, dict[str, Result]]] = {}
    for result in results.values():
        changes = result.condition.changes
        if any(key not in changes for key in keys):
            continue
        if result.missing or result.failed:
            raise InputError(f"{plan.path}: {result.condition.name}: {result.missing} runs are missing; run it first")
        group = label({within: changes[within]}) if within is not None else ""
        task = json.dumps([value for key, value in changes.items() if key not in keys])
        name = ", ".join(str(shown(changes[key])) for key in keys)
        times.setdefault(group, {}).setdefault(name, {})[task] = result
    methods = tuple(next(iter(times.values())))
    groups = {
        group: tuple(_standing(name, of[name], of[methods[0]]) for name in methods) for group, of in times.items()
    }
    return Compared(methods, groups, len(next(iter(times.values()))[methods[0]]))


def _standing(name: str, ours: Mapping[str, Result], theirs: Mapping[str, Result]) -> Standing:
    pairs = [(ours[task], theirs[task]) for task in ours]
    generator = np.random.default_rng(0)
    logs, wins = [], []
    for mine, base in pairs:
        x, y = (_counts(generator, len(result.times)) for result in (mine, base))
        logs.append(np.log(((x @ mine.times) / len(mine.times)) / ((y @ base.times) / len(base.times))))
        won = _wins(mine, base)
        wins.append(np.einsum("ri,ij,rj->r", x, won, y) / won.size)
    draws = np.array(logs)  # (tasks, RESAMPLES)
    chosen = generator.integers(0, len(pairs), (len(pairs), RESAMPLES))
    across = draws[chosen, generator.integers(0, RESAMPLES, chosen.shape)]
    is_base = ours is theirs
    relative = [np.where(mine.finished, mine.times / base.times.mean(), np.inf) for mine, base in pairs]
    return Standing(
        method=name,
        runs=sum(len(mine.times) for mine, _ in pairs),
        finished=int(sum(mine.finished.sum() for mine, _ in pairs)),
        ratio=float(np.exp(np.mean([np.log(mine.times.mean() / base.times.mean()) for mine, base in pairs]))),
        interval=(1.0, 1.0) if is_base else _percentiles(np.exp(draws.mean(axis=0))),
        across=None if len(pairs) < 3 or is_base else _percentiles(np.exp(across.mean(axis=0))),
        better=float(np.mean([_wins(mine, base).mean() for mine, base in pairs])),
        better_interval=(0.5, 0.5) if is_base else _percentiles(np.mean(wins, axis=0)),
        profile=np.array([(np.concatenate(relative) <= tau).mean() for tau in TAUS]),
    )


def _wins(mine: Result, base: Result) -> NDArray[np.float64]:
    """Compares each run of one (n,) with each of the other (m,): 1 if faster, 1/2 if as fast, 0 if slower.

    Its mean is the probability of improvement of Agarwal et al., "Deep Reinforcement Learning at the Edge of the
    Statistical Precipice", NeurIPS (2021), in one task.
    """
    x, y = (ranked(result.times, result.finished) for result in (mine, base))
    return np.asarray((x[:, None] < y) + 0.5 * (x[:, None] == y), np.float64)


def _counts(generator: np.random.Generator, runs: int) -> NDArray[np.float64]:
    """How often each run is drawn in each resample (RESAMPLES, runs)."""
    return generator.multinomial(runs, np.full(runs, 1.0 / runs), RESAMPLES).astype(np.float64)


def _percentiles(drawn: NDArray[np.float64]) -> Interval:
    low, high = np.quantile(drawn, [0.025, 0.975])
    return float(low), float(high)


HEAD = (
    "method", "finished", "ratio", "95 % interval", "over other tasks", "better than the first", "95 % interval",
)  # fmt: skip


def lines(standings: tuple[Standing, ...]) -> list[tuple[str, ...]]:
    """One line per method, under HEAD; ratios with unfinished runs are marked as bounds or left out."""
    return [
        (
            one.method,
            f"{one.finished} of {one.runs}",
            *_ratios(one, standings[0]),
            f"{100 * one.better:.0f} %",
            f"{100 * one.better_interval[0]:.0f} to {100 * one.better_interval[1]:.0f} %",
        )
        for one in standings
    ]


def _ratios(one: Standing, first: Standing) -> tuple[str, str, str]:
    """The ratio to the first method, and its two intervals."""
    longer, shorter = one.finished < one.runs, first.finished < first.runs
    if one is not first and longer and shorter:
        return "-", "-", "-"
    bound = "" if one is first or longer == shorter else "over " if longer else "under "
    across = "-" if one.across is None else f"{bound}{one.across[0]:.2f} to {one.across[1]:.2f}"
    return f"{bound}{one.ratio:.3f}", f"{bound}{one.interval[0]:.2f} to {one.interval[1]:.2f}", across
