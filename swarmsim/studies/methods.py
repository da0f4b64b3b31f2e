"""Methods compared over many tasks: ratios, performance profiles and probabilities of improvement.

A study's axes that step together under one name are its methods; all other axes make its tasks, such as a world or a
world and network. Runs of different methods in one task are independent; tasks have equal weight.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.errors import InputError
from swarmsim.studies.labels import label, shown
from swarmsim.studies.plan import Plan
from swarmsim.studies.results import Result
from swarmsim.studies.survival import ROUNDING, Endings, Interval, common_horizon

RESAMPLES: Final = 2000  # of the stratified bootstrap
TAUS: Final = np.geomspace(0.25, 4.0, 97)  # ratios at which profiles are taken


@dataclass(frozen=True, slots=True)
class Standing:
    """One method against the first, over all tasks of a group."""

    method: str
    runs: int
    finished: int  # of these runs, up to the horizons
    restricted: bool  # whether unfinished runs, its own or the first method's, count up to the horizons alone
    ratio: float  # geometric mean over tasks of its mean time relative to the first method's; NaN if unknown
    interval: Interval  # 95 %, from runs resampled in every task
    across: Interval | None  # 95 %, from tasks resampled as well: for other tasks of the kind; None for one task
    better: float  # probability that a run in a random task improves on the first method
    better_interval: Interval
    profile: NDArray[
        np.float64
    ]  # (len(TAUS),): share of runs within tau times the first's mean in their task; NaN if unknown


@dataclass(frozen=True, slots=True)
class Compared:
    """All methods against the first, for each group."""

    methods: tuple[str, ...]
    groups: dict[str, tuple[Standing, ...]]
    tasks: int  # in each group
    figures: tuple[Path, ...] = ()  # files drawn, if requested


def compare(plan: Plan, results: Mapping[str, Result], method: str = "method", within: str | None = None) -> Compared:
    """Compare a study's methods, the axes with this `together`, separately for each value of a key.

    Times are seconds, since periods may differ, and means are of min(time, horizon), the horizon of a task being the
    shortest limit of its methods: all of that is known of unfinished runs too. A ratio is unknown if in some task
    neither method finishes a run. Raises InputError if there is no such axis, or runs are missing.
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
    groups = {group: _standings(of) for group, of in times.items()}
    return Compared(methods, groups, len(next(iter(times.values()))[methods[0]]))


def _standings(of: Mapping[str, Mapping[str, Result]]) -> tuple[Standing, ...]:
    """The standings of all methods, from their results by task."""
    first, *_ = of.values()
    ends: dict[str, list[Endings]] = {name: [] for name in of}
    for task in first:
        several = {name: tasks[task].seconds for name, tasks in of.items()}
        horizon = common_horizon(several.values())
        for name, one in several.items():
            ends[name].append(one.within(horizon))
    base, *_ = ends.values()
    return tuple(_standing(name, mine, base) for name, mine in ends.items())


def _standing(name: str, ours: Sequence[Endings], theirs: Sequence[Endings]) -> Standing:
    pairs, is_base = list(zip(ours, theirs, strict=True)), ours is theirs
    generator = np.random.default_rng(0)
    logs, wins = [], []
    for mine, base in pairs:
        x, y = (_counts(generator, len(ends.times)) for ends in (mine, base))
        logs.append(np.log(((x @ mine.times) / len(mine.times)) / ((y @ base.times) / len(base.times))))
        won = _wins(mine, base)
        wins.append(np.einsum("ri,ij,rj->r", x, won, y) / won.size)
    draws = np.array(logs)  # (tasks, RESAMPLES)
    chosen = generator.integers(0, len(pairs), (len(pairs), RESAMPLES))
    across = draws[chosen, generator.integers(0, RESAMPLES, chosen.shape)]
    if any(mine.done == base.done == 0 for mine, base in pairs):
        draws, across = np.full_like(draws, np.nan), np.full_like(across, np.nan)
    ratio = float(np.exp(np.mean([np.log(mine.times.mean() / base.times.mean()) for mine, base in pairs])))
    return Standing(
        method=name,
        runs=sum(len(mine.times) for mine in ours),
        finished=sum(mine.done for mine in ours),
        restricted=not is_base and not all(mine.whole and base.whole for mine, base in pairs),
        ratio=1.0 if is_base else ratio if np.isfinite(draws).all() else math.nan,
        interval=(1.0, 1.0) if is_base else _percentiles(np.exp(draws.mean(axis=0))),
        across=None if len(pairs) < 3 or is_base else _percentiles(np.exp(across.mean(axis=0))),
        better=float(np.mean([_wins(mine, base).mean() for mine, base in pairs])),
        better_interval=(0.5, 0.5) if is_base else _percentiles(np.mean(wins, axis=0)),
        profile=_profile(pairs),
    )


def _profile(pairs: Sequence[tuple[Endings, Endings]]) -> NDArray[np.float64]:
    """The share of runs within each of TAUS; NaN where, in some task, that is beyond the horizon of unfinished runs."""
    profile = np.zeros(len(TAUS))
    for mine, base in pairs:
        times = TAUS * base.times.mean()
        profile += (mine.ranks[:, None] <= times).sum(axis=0)
        if not mine.whole:
            profile[times > mine.limit * (1.0 + ROUNDING)] = np.nan
    return profile / sum(len(mine.times) for mine, _ in pairs)


def _wins(mine: Endings, base: Endings) -> NDArray[np.float64]:
    """Compares each run of one (n,) with each of the other (m,): 1 if faster, 1/2 if as fast, 0 if slower.

    Its mean is the probability of improvement of Agarwal et al., "Deep Reinforcement Learning at the Edge of the
    Statistical Precipice", NeurIPS (2021), in one task. Runs that are unfinished at the horizon count as equals.
    """
    x, y = mine.ranks, base.ranks
    return np.asarray((x[:, None] < y) + 0.5 * (x[:, None] == y), np.float64)


def _counts(generator: np.random.Generator, runs: int) -> NDArray[np.float64]:
    """How often each run is drawn in each resample (RESAMPLES, runs)."""
    return generator.multinomial(runs, np.full(runs, 1.0 / runs), RESAMPLES).astype(np.float64)


def _percentiles(drawn: NDArray[np.float64]) -> Interval:
    low, high = np.quantile(drawn, [0.025, 0.975])
    return float(low), float(high)


TO_THE_LIMIT: Final = "to the limit"
HEAD = (
    "method", "finished", "ratio", "95 % interval", "over other tasks", "better than the first", "95 % interval",
)  # fmt: skip


def lines(standings: tuple[Standing, ...]) -> list[tuple[str, ...]]:
    """One line per method, under HEAD; ratios that count unfinished runs up to the limit say so."""
    return [
        (
            one.method,
            f"{one.finished} of {one.runs}",
            "unknown" if math.isnan(one.ratio) else f"{one.ratio:.3f}" + f" {TO_THE_LIMIT}" * one.restricted,
            _between(one.interval),
            _between(one.across),
            f"{100 * one.better:.0f} %",
            f"{100 * one.better_interval[0]:.0f} to {100 * one.better_interval[1]:.0f} %",
        )
        for one in standings
    ]


def notes(standings: tuple[Standing, ...]) -> list[str]:
    """What the table's marks mean, as far as it has them."""
    marked = any(one.restricted and not math.isnan(one.ratio) for one in standings)
    unknown = any(math.isnan(one.ratio) for one in standings)
    return [
        *[f"{TO_THE_LIMIT}: of the means of min(time, limit), since not all runs finished"] * marked,
        *["unknown: in some task neither this method nor the first finished a run"] * unknown,
    ]


def _between(ends: Interval | None) -> str:
    return "-" if ends is None or math.isnan(ends[0]) else f"{ends[0]:.2f} to {ends[1]:.2f}"
