"""The quality of a run's maps, and each robot's contribution, in numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarmsim.core import memory
from swarmsim.core.lattice import Lattice
from swarmsim.core.state import FREE, OCCUPIED, UNKNOWN, Moment
from swarmsim.operations.mapping.maps import Maps
from swarmsim.operations.mapping.measures.sightings import Sightings
from swarmsim.recording.measures import jain, mean_value, share_of


@dataclass(frozen=True, slots=True)
class Quality:
    """How a map's occupied cells compare with the truth; undefined shares are None."""

    precision: float | None  # TP / (TP + FP)
    recall: float | None  # TP / (TP + FN)
    f1: float | None  # 2 TP / (2 TP + FP + FN)
    iou: float | None  # TP / (TP + FP + FN)
    false_occupied: int  # FP, cells


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
    precision, recall = share_of(tp, tp + fp), share_of(tp, tp + fn)
    return Quality(precision, recall, share_of(2 * tp, 2 * tp + fp + fn), share_of(tp, tp + fp + fn), fp)


def probability(log_odds: NDArray[np.float32]) -> NDArray[np.float64]:
    """The probability of being occupied, 1 / (1 + exp(-l)) (Elfes 1989)."""
    return np.asarray(1.0 / (1.0 + np.exp(-log_odds.astype(np.float64))))


class Pool:
    """All robots' maps together, added one after another, so that no more than one is copied."""

    def __init__(self, cells: int) -> None:
        """`cells` of each map that count."""
        #: How many maps hold each cell (cells,).
        self.holders = np.zeros(cells, np.int64)
        self._total = np.zeros(cells)
        #: Where any robot's map calls the cell occupied (cells,): the collective map of the films.
        self.occupied = np.zeros(cells, np.bool_)
        self._full: list[NDArray[np.int64]] = []  # each robot's occupied cells ...
        self._empty: list[NDArray[np.int64]] = []  # ... and its free ones

    def add(self, observed: NDArray[np.bool_], log_odds: NDArray[np.float32]) -> None:
        """Take in one robot's map (cells,)."""
        occupied = observed & (log_odds > 0.0)
        self.holders += observed
        self._total += probability(log_odds) * observed
        self.occupied |= occupied
        self._full.append(np.flatnonzero(occupied))
        self._empty.append(np.flatnonzero(observed & ~occupied))

    @property
    def observed(self) -> NDArray[np.bool_]:
        """Which cells any map holds (cells,)."""
        return self.holders > 0

    @property
    def probability(self) -> NDArray[np.float64]:
        """The mean probability over the robots that observed each cell (cells,), 0.5 where none has.

        This is the linear opinion pool (Stone 1961). Adding log-odds would count each shared tile as often as
        it was heard.
        """
        return np.where(self.observed, self._total / np.maximum(self.holders, 1), 0.5)

    @property
    def disagreement(self) -> float | None:
        """How much robots' maps contradict each other, from 0 to 1.

        The share of cells known to both robots that are occupied on one map and free on the other (Hamming
        1950), as the mean over all pairs that know a cell in common; None if there is no such pair.
        """
        from scipy import sparse  # takes a while to import

        def marked(cells: list[NDArray[np.int64]]) -> sparse.csr_array:
            """Each robot's marked cells as a matrix (n, cells) of 1 and 0."""
            ends = np.cumsum([0, *map(len, cells)])
            ones = np.ones(ends[-1], np.int32)
            return sparse.csr_array((ones, np.concatenate(cells), ends), shape=(len(cells), len(self.holders)))

        full, empty = marked(self._full), marked(self._empty)
        differ = full @ empty.T
        differing = (differ + differ.T).toarray()
        joint = sparse.triu(full @ full.T + empty @ empty.T + differ + differ.T, 1, "coo")
        if joint.nnz == 0:
            return None
        shares = differing[joint.row, joint.col] / joint.data.astype(np.float32)
        return float(shares.mean(dtype=np.float64))


def entropy(belief: NDArray[np.float64]) -> float:
    """The sum over cells of -p log2 p - (1 - p) log2(1 - p), in bits (Shannon 1948); p = 0.5 is 1 bit."""
    terms = [p * np.log2(np.where(p > 0.0, p, 1.0)) for p in (belief, 1.0 - belief)]
    return float(-(terms[0] + terms[1]).sum())


def brier(belief: NDArray[np.float64], truth: NDArray[np.bool_], where: NDArray[np.bool_]) -> float | None:
    """The mean of (p - truth)^2 over the cells `where` True (Brier 1950): 0 is perfect, 0.25 is p = 0.5."""
    return float(((belief - truth)[where] ** 2).mean()) if where.any() else None


def overlap(holders: NDArray[np.int64]) -> float | None:
    """The redundancy of maps, given how many hold each cell: sum_i |M_i| / |union M_i| - 1 (Xu et al. 2022)."""
    ratio = share_of(int(holders.sum()), int(np.count_nonzero(holders)))
    return None if ratio is None else ratio - 1.0


def _inside(origins: NDArray[np.int32], tiles: tuple[int, ...], grid: tuple[int, ...]) -> NDArray[np.bool_]:
    """Which cells of `tiles` (k, rows, columns) at `origins` (k, 2) lie on the grid (rows, columns)."""
    row, column = origins[:, :1] + np.arange(tiles[1]), origins[:, 1:] + np.arange(tiles[2])
    fits = ((row >= 0) & (row < grid[0]))[:, :, None] & ((column >= 0) & (column < grid[1]))[:, None, :]
    return np.asarray(fits)


def _mean(values: Sequence[float | None]) -> float | None:
    """The mean of the defined values."""
    defined = [value for value in values if value is not None]
    return float(np.mean(defined)) if defined else None


class MapMeasures:
    """An observer that keeps the data to judge a run's maps, so that studies need no recording.

    Cells count only in the coverage domain, except those that messages carry. A robot *sensed* the cells of its own
    tiles; its map also holds those it heard of. Dead robots keep their rows.
    """

    def __init__(self, robots: int, domain: NDArray[np.bool_], lattice: Lattice) -> None:
        """The coverage domain (rows, columns) at the start counts for sensing, the last one for maps."""
        self._domain, self._sightings = domain, Sightings(lattice)
        self._sensed = memory.zeros((robots * domain.size,), np.bool_)
        self._known = memory.zeros((robots * domain.size,), np.bool_)  # sensed or heard
        self._robots = np.arange(robots)
        self._offsets = np.zeros((0, 0), np.int64)  # of a tile's cells from its first, in the grid's row-major order
        self._union: list[float] = []
        self._last: Moment[Maps] | None = None
        self._readings = self._carried = self._fresh = self._heard = self._age = 0

    def sample(self, moment: Moment[Maps]) -> None:
        """Take note of one iteration."""
        self._union.append(moment.measured.values["coverage"])
        self._last = moment
        self._sightings.add(moment)
        self._read(moment)

    def _read(self, moment: Moment[Maps]) -> None:
        """Count the cells sensed, then those heard of."""
        robots, tiles, inbox = len(self._robots), moment.readings.tiled, moment.knowledge.accepted
        values = np.concatenate([tiles.values * moment.state.alive[:, None, None], inbox.content.values])
        origins = np.concatenate([tiles.origins, inbox.content.origins])
        owners = np.concatenate([self._robots, inbox.receivers])
        seen: NDArray[np.bool_] = values != UNKNOWN
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
        self._readings += int(np.count_nonzero(self._domain.reshape(-1)[sensed % self._domain.size]))
        self._heard += len(inbox.receivers)
        self._age += len(inbox.receivers) * moment.state.iteration - int(inbox.content.sensed.sum(dtype=np.int64))
        self._carried += len(heard)
        self._fresh += len(set(fresh.tolist()))  # a cell in two messages is new once

    def summary(self) -> dict[str, float | int | None]:
        """The maps in numbers; docs/measures.md defines each. None where undefined."""
        union = np.array(self._union)
        times: dict[str, float | int | None] = {
            "coverage": float(union[-1]) if len(union) else 0.0,
            "mean_coverage": mean_value(union),
            "discovery_time": discovery_time(union),
        }
        return {**times, **self._maps(), **self._work()}

    def _maps(self) -> dict[str, float | int | None]:
        if self._last is None:
            return {}
        building, maps = self._last.building, self._last.knowledge
        domain = building.explorable
        truth, pool, robots = building.occupied[domain], Pool(int(np.count_nonzero(domain))), []
        union_cells, free, full = np.zeros(domain.shape, np.uint8), np.uint8(FREE), np.uint8(OCCUPIED)
        observed: NDArray[np.bool_]
        log_odds: NDArray[np.float32]
        for observed, log_odds in zip(maps.observed, maps.log_odds, strict=True):
            np.maximum(union_cells, np.where(log_odds > 0.0, full, free) * observed, out=union_cells)
            held, odds = observed[domain], log_odds[domain]
            pool.add(held, odds)
            robots.append(_judge(truth, held & (odds > 0.0), np.where(held, probability(odds), 0.5), held))
        union = _judge(truth, pool.occupied, pool.probability, pool.observed)
        return {
            "sensed": share_of(int(np.count_nonzero(self._sightings.seen & domain)), int(np.count_nonzero(domain))),
            "correct": self._sightings.share(union_cells),
            **{f"union_{name}": value for name, value in union.items()},
            **{f"robot_{name}": _mean([robot[name] for robot in robots]) for name in union},
            "disagreement": pool.disagreement,
            "overlap_maps": overlap(pool.holders),
        }

    def _work(self) -> dict[str, float | int | None]:
        cells, robots = self._domain.reshape(-1), len(self._robots)
        known = sum(int(np.count_nonzero(one[cells])) for one in self._known.reshape(robots, -1))
        own, holders = np.zeros(robots), np.zeros(np.count_nonzero(cells), np.int64)
        for robot, one in enumerate(self._sensed.reshape(robots, -1)):
            sensed = one[cells]
            own[robot] = np.count_nonzero(sensed)
            holders += sensed
        return {
            "overlap_sensed": overlap(holders),
            "heard_share": share_of(known - int(own.sum()), known),
            "redundancy": share_of(self._readings, int(np.count_nonzero(holders))),
            "jain_sensed": jain(own),
            "age": share_of(self._age, self._heard),
            "fresh_share": share_of(self._fresh, self._carried),
        }


def _judge(
    truth: NDArray[np.bool_], occupied: NDArray[np.bool_], belief: NDArray[np.float64], observed: NDArray[np.bool_]
) -> dict[str, float | int | None]:
    """How one map, given cell by cell of the domain, compares with the truth."""
    found = quality(occupied, truth, observed)
    return {
        "precision": found.precision,
        "recall": found.recall,
        "f1": found.f1,
        "iou": found.iou,
        "false_occupied": found.false_occupied,
        "false_called": None if found.precision is None else 1.0 - found.precision,
        "false_known": share_of(found.false_occupied, int(np.count_nonzero(observed))),
        "entropy": entropy(belief),
        "brier": brier(belief, truth, observed),
    }
