"""What one run says in numbers: how fast, how far, how much talk, and how good the maps are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.parts import Behaviour, Building
from swarmsim.core.scenario import Robots
from swarmsim.core.state import UNKNOWN, Moment, State

SHARES: Final = (50, 75, 90, 95, 99, 100)  # per cent of the domain whose times are measured


@dataclass(frozen=True, slots=True)
class Quality:
    """How the cells that a map calls occupied compare with the truth; None where nothing defines a share."""

    precision: float | None  # TP / (TP + FP)
    recall: float | None  # TP / (TP + FN)
    f1: float | None  # 2 TP / (2 TP + FP + FN)
    iou: float | None  # TP / (TP + FP + FN)
    false_occupied: int  # FP, cells


def reached(curve: NDArray[np.float64], share: float) -> int | None:
    """The number of iterations after which `curve` (t,), a coverage from 0 to 1, was first at `share`, or None."""
    hits = np.flatnonzero(curve >= share)
    return int(hits[0]) + 1 if len(hits) else None


def mean_coverage(curve: NDArray[np.float64], horizon: int | None = None) -> float | None:
    """The area under a coverage curve (t,), divided by its length: the mean of C(t), 0 to 1.

    With a `horizon` (iterations) it is the mean up to there, and a map that is older than its run keeps its
    last value; only so can runs of different lengths be compared. None for no iterations.
    """
    length = len(curve) if horizon is None else horizon
    if length < 1 or len(curve) == 0:
        return None
    return float((curve[:length].sum() + curve[-1] * max(0, length - len(curve))) / length)


def discovery_time(curve: NDArray[np.float64]) -> float | None:
    """The mean over the domain's cells of the number of iterations after which each was covered.

    That is the area above the curve (t,), 1 + sum of 1 - C over all iterations but the last: a mean is
    the sum of the survival function (of cells yet uncovered). Cells never covered count as covered last.
    """
    return float(1.0 + (1.0 - curve[:-1]).sum()) if len(curve) else None


def quality(occupied: NDArray[np.bool_], truth: NDArray[np.bool_], where: NDArray[np.bool_]) -> Quality:
    """Precision, recall, F1 (van Rijsbergen 1979) and IoU (Jaccard 1912) of occupied cells against the truth.

    All three are boolean arrays of one shape; only cells `where` True count.
    """
    tp = int(np.count_nonzero(occupied & truth & where))
    fp = int(np.count_nonzero(occupied & ~truth & where))
    fn = int(np.count_nonzero(~occupied & truth & where))
    precision, recall = _share(tp, tp + fp), _share(tp, tp + fn)
    return Quality(precision, recall, _share(2 * tp, 2 * tp + fp + fn), _share(tp, tp + fp + fn), fp)


def probability(log_odds: NDArray[np.float32]) -> NDArray[np.float64]:
    """The probability of being occupied, 1 / (1 + exp(-l)) (Elfes 1989)."""
    return np.asarray(1.0 / (1.0 + np.exp(-log_odds.astype(np.float64))))


def union_occupied(observed: NDArray[np.bool_], log_odds: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Where any robot (axis 0) that observed the cell believes it occupied: the collective map of the films."""
    return np.asarray((observed & (log_odds > 0.0)).any(axis=0))


def union_probability(observed: NDArray[np.bool_], log_odds: NDArray[np.float32]) -> NDArray[np.float64]:
    """The mean probability over the robots (axis 0) that observed each cell, 0.5 where none has.

    This is the linear opinion pool (Stone 1961). Adding log-odds would count each shared tile as often as
    it was heard.
    """
    seen = observed.sum(axis=0)
    total = (probability(log_odds) * observed).sum(axis=0)
    return np.where(seen > 0, total / np.maximum(seen, 1), 0.5)


def entropy(belief: NDArray[np.float64]) -> float:
    """The sum over cells of -p log2 p - (1 - p) log2(1 - p), in bits (Shannon 1948); p = 0.5 is 1 bit."""
    terms = [p * np.log2(np.where(p > 0.0, p, 1.0)) for p in (belief, 1.0 - belief)]
    return float(-(terms[0] + terms[1]).sum())


def brier(belief: NDArray[np.float64], truth: NDArray[np.bool_], where: NDArray[np.bool_]) -> float | None:
    """The mean of (p - truth)^2 over the cells `where` True (Brier 1950): 0 is perfect, 0.25 is p = 0.5."""
    return float(((belief - truth)[where] ** 2).mean()) if where.any() else None


def disagreement(observed: NDArray[np.bool_], occupied: NDArray[np.bool_]) -> float | None:
    """How much robots' maps contradict each other, from 0 to 1: row i of both (n, cells) is robot i.

    The share of cells known to both robots that one holds for occupied and the other for free (Hamming
    1950), as the mean over all pairs that know a cell in common; None if there is no such pair.
    """
    full = (observed & occupied).astype(np.float32)
    empty = (observed & ~occupied).astype(np.float32)
    first, second = np.triu_indices(len(full), 1)
    differ = full @ empty.T
    differing = (differ + differ.T)[first, second]
    joint = differing + (full @ full.T + empty @ empty.T)[first, second]
    known = joint > 0
    return float((differing[known] / joint[known]).mean(dtype=np.float64)) if known.any() else None


def overlap(held: NDArray[np.bool_]) -> float | None:
    """How often the cells held (n, cells) are held once more: sum_i |M_i| / |union M_i| - 1 (Xu et al. 2022)."""
    ratio = _share(int(np.count_nonzero(held)), int(np.count_nonzero(held.any(axis=0))))
    return None if ratio is None else ratio - 1.0


def jain(shares: NDArray[np.float64]) -> float | None:
    """Fairness (sum x)^2 / (n sum x^2) of what each robot (n,) did (Jain et al. 1984): 1 is equal, 1/n is one alone."""
    squares = float(len(shares) * (shares**2).sum())
    return float(shares.sum() ** 2) / squares if squares > 0.0 else None


def _inside(origins: NDArray[np.int32], tiles: tuple[int, ...], grid: tuple[int, ...]) -> NDArray[np.bool_]:
    """Which cells of `tiles` (k, rows, columns) at `origins` (k, 2) lie on the grid (rows, columns)."""
    row, column = origins[:, :1] + np.arange(tiles[1]), origins[:, 1:] + np.arange(tiles[2])
    fits = ((row >= 0) & (row < grid[0]))[:, :, None] & ((column >= 0) & (column < grid[1]))[:, None, :]
    return np.asarray(fits)


def _share(part: float, whole: float) -> float | None:
    return part / whole if whole else None


def _mean(values: Sequence[float | None]) -> float | None:
    """The mean of what is defined."""
    defined = [value for value in values if value is not None]
    return float(np.mean(defined)) if defined else None


class Measures:
    """A probe that keeps what `summary` needs while a run goes, so that studies need no recording.

    Cells count in the coverage domain alone, except those that messages carry. What a robot *sensed* came
    from its own tiles; its map also holds what it heard. Robots that died keep their rows.
    """

    def __init__(self, building: Building, robots: Robots, period: float, behaviour: Behaviour) -> None:
        """`period` in s. Maps are judged by the `building` of the end; what was sensed, by its domain now."""
        domain, count = building.domain, robots.count
        self._building, self._domain, self._period, self._behaviour = building, domain, period, behaviour
        self._leap = 2.0 * robots.speed * period  # m; whoever is that far in one iteration was carried there
        self._counted = np.tile(domain.reshape(-1), count)
        self._sensed = np.zeros(count * domain.size, np.bool_)
        self._known = np.zeros(count * domain.size, np.bool_)  # sensed or heard
        self._robots = np.arange(count)
        self._offsets = np.zeros((0, 0), np.int64)  # of a tile's cells from its first, in the grid's row-major order
        self._path = np.zeros(count)
        self._last: State | None = None
        self._union: list[int] = []
        self._cells: list[int] = []  # of the domain, which changes with the building
        self._each: list[NDArray[np.int32]] = []  # -1 for the dead
        self._finished = False
        self._readings = self._carried = self._fresh = self._heard = self._age = 0
        self._links = self._messages = self._bytes = self._lost = 0

    def sample(self, moment: Moment) -> None:
        """Take note of one iteration."""
        state, coverage, last = moment.state, moment.coverage, self._last
        self._union.append(coverage.union)
        self._cells.append(coverage.domain)
        self._each.append(np.where(state.alive, coverage.each, -1).astype(np.int32))
        if last is not None:
            step = np.hypot(*(state.pose - last.pose)[:, :2].T)
            self._path += np.where(last.alive & (step < self._leap), step, 0.0)
        self._last = state
        self._finished = any(event.robot < 0 and event.kind == "finished" for event in moment.events)
        self._read(moment)

    def _read(self, moment: Moment) -> None:
        """Count what was sensed, then what was heard."""
        robots, tiles, inbox = len(self._robots), moment.tiles, moment.inbox
        values = np.concatenate([tiles.values * moment.state.alive[:, None, None], inbox.values])
        origins = np.concatenate([tiles.origins, inbox.origins])
        owners = np.concatenate([self._robots, inbox.receivers])
        seen = values != UNKNOWN
        rows, columns = (room - size for room, size in zip(self._domain.shape, values.shape[1:], strict=True))
        if origins.min() < 0 or origins[:, 0].max() > rows or origins[:, 1].max() > columns:
            seen &= _inside(origins, seen.shape, self._domain.shape)
        first = (owners * self._domain.shape[0] + origins[:, 0]) * self._domain.shape[1] + origins[:, 1]
        if self._offsets.shape != values.shape[1:]:
            self._offsets = np.add.outer(np.arange(values.shape[1]) * self._domain.shape[1], np.arange(values.shape[2]))
        cells = first[:, None, None] + self._offsets
        sensed, heard = cells[:robots][seen[:robots]], cells[robots:][seen[robots:]]
        self._sensed[sensed] = True
        self._known[sensed] = True
        fresh = heard[~self._known[heard]]
        self._known[fresh] = True
        self._readings += int(np.count_nonzero(self._counted[sensed]))
        self._links += len(moment.links)
        self._messages += len(moment.delivery.heard)
        self._bytes += int(moment.delivery.heard[:, 3].sum())
        self._lost += sum(len(letters) for _, letters in moment.delivery.lost)
        self._heard += len(inbox.receivers)
        self._age += len(inbox.receivers) * moment.state.iteration - int(inbox.sensed.sum(dtype=np.int64))
        self._carried += len(heard)
        self._fresh += len(set(fresh.tolist()))  # a cell in two messages is new once

    def curve(self) -> NDArray[np.float64]:
        """Coverage after each iteration (t, 4): the union's, then the least, mean and most of robots alive, or nan."""
        union = np.array(self._union, np.float64)
        each = np.array(self._each, np.float64).reshape(-1, len(self._robots))
        living = each >= 0.0
        count = living.sum(axis=1)
        least = np.where(living, each, np.inf).min(axis=1, initial=np.inf)
        mean = np.where(living, each, 0.0).sum(axis=1) / np.maximum(count, 1)
        own = np.stack([least, mean, each.max(axis=1, initial=-1.0)], axis=1)
        own[count == 0] = np.nan
        return np.column_stack([union, own]) / np.array(self._cells, np.float64).reshape(-1, 1)

    def summary(self) -> dict[str, float | int | None]:
        """The run in numbers; docs/measures.md defines each. None where a number is not defined."""
        return {**self._times(), **self._maps(), **self._work(), **self._talk()}

    def _times(self) -> dict[str, float | int | None]:
        union = np.array(self._union, np.float64) / np.array(self._cells, np.float64)
        ran = len(union)
        times = {f"t{share}": reached(union, share / 100) for share in SHARES}
        t95, t100 = times["t95"], times["t100"]
        return {
            "finished": int(self._finished),
            "iterations": ran if self._finished else None,
            "iterations_run": ran,
            "seconds": ran * self._period if self._finished else None,
            "coverage": float(union[-1]) if ran else 0.0,
            **times,
            "tail_ratio": t100 / t95 if t95 and t100 else None,
            "mean_coverage": mean_coverage(union),
            "discovery_time": discovery_time(union),
        }

    def _maps(self) -> dict[str, float | int | None]:
        domain = self._building.domain
        observed, log_odds = self._behaviour.observed[:, domain], self._behaviour.log_odds[:, domain]
        occupied = observed & (log_odds > 0.0)
        belief = np.where(observed, probability(log_odds), 0.5)
        robots = [self._judge(*row) for row in zip(occupied, belief, observed, strict=True)]
        union = self._judge(
            union_occupied(observed, log_odds),
            union_probability(observed, log_odds),
            np.asarray(observed.any(axis=0)),
        )
        return {
            **{f"union_{name}": value for name, value in union.items()},
            **{f"robot_{name}": _mean([robot[name] for robot in robots]) for name in union},
            "disagreement": disagreement(observed, occupied),
            "overlap_maps": overlap(observed),
        }

    def _judge(
        self, occupied: NDArray[np.bool_], belief: NDArray[np.float64], observed: NDArray[np.bool_]
    ) -> dict[str, float | int | None]:
        truth = self._building.occupied[self._building.domain]
        found = quality(occupied, truth, observed)
        return {
            "precision": found.precision,
            "recall": found.recall,
            "f1": found.f1,
            "iou": found.iou,
            "false_occupied": found.false_occupied,
            "entropy": entropy(belief),
            "brier": brier(belief, truth, observed),
        }

    def _work(self) -> dict[str, float | int | None]:
        cells = self._domain.reshape(-1)
        sensed = self._sensed.reshape(len(self._robots), -1)[:, cells]
        known = int(np.count_nonzero(self._known.reshape(sensed.shape[0], -1)[:, cells]))
        own = sensed.sum(axis=1)
        return {
            "overlap_sensed": overlap(sensed),
            "heard_share": _share(known - int(own.sum()), known),
            "redundancy": _share(self._readings, int(np.count_nonzero(sensed.any(axis=0)))),
            "path_sum": float(self._path.sum()),
            "path_longest": float(self._path.max(initial=0.0)),
            "path_mean": float(self._path.mean()),
            "jain_path": jain(self._path),
            "jain_sensed": jain(own.astype(np.float64)),
        }

    def _talk(self) -> dict[str, float | int | None]:
        return {
            "messages": self._messages,
            "bytes": self._bytes,
            "delivered_share": _share(self._messages, self._links),
            "lost": self._lost,
            "age": _share(self._age, self._heard),
            "fresh_share": _share(self._fresh, self._carried),
        }
