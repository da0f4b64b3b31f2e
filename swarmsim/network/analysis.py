"""A network over time in numbers: degrees, components, contacts, and how far robots have heard each other.

A graph is given as links (m, 2), receiver and sender, one array for each iteration of a window, and the robots alive
(iterations, n) in it. Links may be those of the topology or of messages heard. A[i, j] = 1: robot i hears robot j.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

Links = NDArray[np.int32]  # (m, 2): receiver, sender; repeated pairs count once
Alive = NDArray[np.bool_]  # (n,) or (iterations, n)
Ints = NDArray[np.int64]
Reals = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class LinkGraph:
    """The graph of one iteration; undefined numbers are NaN."""

    degrees: Ints  # (live robots,), by id: how many others each hears (in-degree), including senders that died since
    listeners: Ints  # (live robots,), by id: how many others hear each (out-degree)
    reciprocity: float  # share of the links with a link back; NaN without links
    clustering: float  # mean over live robots, 0 to 1; NaN without any
    weak_components: int  # pieces in which every robot reaches every other if links led both ways
    strong_components: int  # pieces in which every robot reaches every other along the links
    weak_share: float  # of the live robots, in the largest weak component; NaN without any
    strong_share: float  # the same for the largest strong component
    turnover: float  # 1 - mean Jaccard index of neighbour sets with the iteration before; NaN in the first

    @property
    def mean_degree(self) -> float:
        """The mean number of others that a live robot hears; NaN if none is alive."""
        return float(self.degrees.mean()) if len(self.degrees) else np.nan

    @property
    def least_degree(self) -> float:
        """The least number of others that a live robot hears; NaN if none is alive."""
        return float(self.degrees.min()) if len(self.degrees) else np.nan

    @property
    def most_degree(self) -> float:
        """The largest number of others that a live robot hears; NaN if none is alive."""
        return float(self.degrees.max()) if len(self.degrees) else np.nan

    @property
    def least_listeners(self) -> float:
        """The least number of robots that hear a live robot; NaN if none is alive."""
        return float(self.listeners.min()) if len(self.listeners) else np.nan

    @property
    def most_listeners(self) -> float:
        """The largest number of robots that hear a live robot; NaN if none is alive."""
        return float(self.listeners.max()) if len(self.listeners) else np.nan


@dataclass(frozen=True, slots=True, eq=False)
class Spells:
    """How long something lasted between two robots, again and again; sorted by pair, then by time."""

    pairs: Ints  # (s, 2)
    start: Ints  # (s,): the first iteration of each spell
    length: Ints  # (s,): iterations, at least 1
    begun: NDArray[np.bool_]  # (s,): whether its beginning was seen; if not, it may have begun before the window
    ended: NDArray[np.bool_]  # (s,): whether its end was seen; if not, it lasted at least this long

    def survival(self) -> tuple[Reals, Reals]:
        """Lengths (k,), ascending, and the share of spells (k,) that last longer (Kaplan and Meier 1958).

        Spells whose end was not seen are censored. Those whose beginning was not seen are left out, because long
        spells are likelier to be under way when a window opens. Empty if no spell is left.
        """
        if not self.begun.any():
            return np.empty(0), np.empty(0)
        lengths, ended = self.length[self.begun], self.ended[self.begun]
        estimate = stats.ecdf(stats.CensoredData(uncensored=lengths[ended], right=lengths[~ended])).sf
        return estimate.quantiles, estimate.probabilities

    def median(self) -> float | None:
        """The shortest length outlasted by at most half of the spells, or None if fewer than half were seen to end."""
        lengths, outlasting = self.survival()
        reached = np.flatnonzero(outlasting <= 0.5 + 1e-12)  # a product of quotients, which rounds
        return float(lengths[reached[0]]) if len(reached) else None


@dataclass(frozen=True, slots=True, eq=False)
class Reach:
    """The graphs of a window together, direct links only: nothing is passed on.

    Robots count if they were alive in some iteration of the window; iterations are numbered as in the run.
    """

    first_heard: Ints  # (n, n): the first iteration in which robot i (row) heard robot j (column); -1 for never
    present: NDArray[np.bool_]  # (n,): which robots count
    share: Reals  # (iterations, n): share of the others that count heard by each robot by then; NaN without any
    all_heard: int | None  # the first iteration by which every robot had heard every other, or None
    all_met: int | None  # the first iteration by which in every pair one robot had heard the other, or None
    strongly_connected: bool  # whether every robot reaches every other along the links of all graphs together

    @property
    def union(self) -> NDArray[np.bool_]:
        """The union of the graphs (n, n): whether robot i ever heard robot j."""
        return np.asarray(self.first_heard >= 0)


def snapshots(links: Sequence[Links], alive: Alive) -> list[LinkGraph]:
    """The graph of each iteration in numbers.

    Let B be A between live robots and S = B + B^T. Reciprocity is sum(B o B^T) / sum(B) (Newman 2010). A robot's
    clustering is (S^3)_ii / (2 (d (d - 1) - 2 e)), where d is its number of links in and out and e that of neighbours
    linked both ways (Fagiolo 2007), and 0 where that is 0 / 0. Turnover is the mean of 1 - |P & Q| / |P | Q|
    (Jaccard 1912) over robots alive in both iterations, for the sets P and Q of those that each heard; two empty sets
    are equal. Raises ValueError unless `links` and `alive` are of equal length, at least 1.
    """
    _check(links, alive)
    found: list[LinkGraph] = []
    before = None
    for row, pairs in enumerate(links):
        heard = _adjacency(pairs, alive.shape[1])
        turnover = np.nan if before is None else _turnover(before, heard, alive[row - 1] & alive[row])
        found.append(_snapshot(heard, alive[row], turnover))
        before = heard
    return found


def groups(links: Links, alive: NDArray[np.bool_]) -> int:
    """How many groups of live robots hear each other, directly or through others: weakly connected components."""
    robots = len(alive)
    among = links[alive[links].all(axis=1)]
    ones = np.ones(len(among), np.int8)
    count, _ = connected_components(csr_array((ones, (among[:, 0], among[:, 1])), (robots, robots)), connection="weak")
    return int(count - np.count_nonzero(~alive))


def meetings(links: Links) -> Links:
    """The same links without a direction (m, 2): the lower id first, each pair once."""
    return np.unique(np.sort(links, axis=1), axis=0)


def contacts(links: Sequence[Links], alive: Alive, first: int = 0) -> tuple[Spells, Spells]:
    """Contact times and inter-contact times of all pairs that were in contact (Chaintreau et al. 2007).

    A contact is a maximal run of iterations with the link; the time between contacts runs from one contact's last
    iteration to the next one's first, both excluded. Pairs are ordered, receiver first, or not, as `links` are (see
    `meetings`). `first` is the window's first iteration in the run: a window that opens with the run, at 0, sees all
    beginnings. A contact still there in the last iteration is censored; so is the time after a pair's last contact, at
    the end of the window or, if earlier, of one robot's life. The time before a pair's first contact does not count as
    time between contacts. Raises ValueError as `snapshots` does.
    """
    _check(links, alive)
    span, robots = alive.shape
    rows = np.repeat(np.arange(span), [len(pairs) for pairs in links])
    ids = np.concatenate(links).astype(np.int64)
    stride = span + 1  # one more than rows, so that two pairs never have neighbouring keys
    keys = np.unique((ids[:, 0] * robots + ids[:, 1]) * stride + rows)
    breaks = np.flatnonzero(np.diff(keys) != 1)
    begins, ends = (keys[at] for at in (np.r_[0, breaks + 1], np.r_[breaks, -1])) if len(keys) else (keys, keys)
    pairs = np.column_stack(np.divmod(begins // stride, robots))
    start, last = begins % stride, ends % stride
    together = Spells(pairs, first + start, last - start + 1, (start > 0) | (first == 0), last < span - 1)

    again = np.zeros(len(pairs), np.bool_)  # whether the pair's next contact follows
    again[:-1] = (pairs[1:] == pairs[:-1]).all(axis=1)
    lived = np.where(alive.any(axis=0), span - 1 - alive[::-1].argmax(axis=0), -1)  # each robot's last iteration alive
    until = np.where(again, np.roll(start, -1) - 1, lived[pairs].min(axis=1))
    some = until > last
    every = np.ones(int(some.sum()), np.bool_)
    apart = Spells(pairs[some], first + last[some] + 1, (until - last)[some], every, again[some])
    return together, apart


def reach(links: Sequence[Links], alive: Alive, first: int = 0) -> Reach:
    """When each robot first hears each other one, in a window that begins with iteration `first` of the run.

    Only direct messages count, as in one-hop sharing; nothing is relayed. Raises ValueError as `snapshots` does.
    """
    _check(links, alive)
    span, robots = alive.shape
    present: NDArray[np.bool_] = np.asarray(alive.any(axis=0))
    heard_first = np.full((robots, robots), -1, np.int64)
    counted = np.zeros((span, robots), np.int64)
    for row, pairs in enumerate(links):
        new = pairs[heard_first[pairs[:, 0], pairs[:, 1]] < 0]
        heard_first[new[:, 0], new[:, 1]] = first + row
        counted[row] = ((heard_first >= 0) & present).sum(axis=1)
    others = int(present.sum()) - 1
    share = np.where(present & (others > 0), counted / max(others, 1), np.nan)
    among = heard_first[np.ix_(present, present)]
    never = np.iinfo(np.int64).max
    when = np.where(among < 0, never, among)
    pieces, _ = connected_components(among >= 0, connection="strong")
    return Reach(
        heard_first, present, share, _last(when, never), _last(np.minimum(when, when.T), never), bool(pieces <= 1)
    )


def _last(when: Ints, never: int) -> int | None:
    """The latest of the iterations (n, n) off the diagonal; None if there are none or one is `never`."""
    latest = max(when[~np.eye(len(when), dtype=np.bool_)].tolist(), default=never)
    return None if latest == never else int(latest)


def _check(links: Sequence[Links], alive: Alive) -> None:
    if len(links) != len(alive) or not len(links):
        raise ValueError(
            f"links of {len(links)} iterations, robots alive in {len(alive)}; expected as many, at least 1"
        )


def _adjacency(links: Links, robots: int) -> NDArray[np.bool_]:
    heard = np.zeros((robots, robots), np.bool_)
    heard[links[:, 0], links[:, 1]] = True
    return heard


def _turnover(before: NDArray[np.bool_], now: NDArray[np.bool_], both: Alive) -> float:
    kept: NDArray[np.int64] = (before & now)[both].sum(axis=1)
    ever: NDArray[np.int64] = (before | now)[both].sum(axis=1)
    jaccard = np.where(ever > 0, kept / np.maximum(ever, 1), 1.0)
    return 1.0 - float(jaccard.mean()) if len(jaccard) else np.nan


def _snapshot(heard: NDArray[np.bool_], alive: Alive, turnover: float) -> LinkGraph:
    live: NDArray[np.bool_] = heard[np.ix_(alive, alive)]
    robots = len(live)
    weak, weak_sizes = _components(live, "weak")
    strong, strong_sizes = _components(live, "strong")
    return LinkGraph(
        degrees=heard[alive].sum(axis=1),
        listeners=heard[:, alive].sum(axis=0),
        reciprocity=float((live & live.T).sum() / live.sum()) if live.any() else np.nan,
        clustering=_clustering(live) if robots else np.nan,
        weak_components=weak,
        strong_components=strong,
        weak_share=weak_sizes.max() / robots if robots else np.nan,
        strong_share=strong_sizes.max() / robots if robots else np.nan,
        turnover=turnover,
    )


def _components(live: NDArray[np.bool_], connection: str) -> tuple[int, Ints]:
    count: int
    labels: Ints
    count, labels = connected_components(live, connection=connection)
    return count, np.bincount(labels)


def _clustering(live: NDArray[np.bool_]) -> float:
    """The mean over robots of Fagiolo's coefficient; `live` (n, n) has no self links."""
    either = live.astype(np.float64) + live.T
    around = ((either @ either) * either).sum(axis=1)  # the diagonal of the cube, as it is symmetric
    degree, mutual = either.sum(axis=1), (live & live.T).sum(axis=1)
    possible = 2.0 * (degree * (degree - 1.0) - 2.0 * mutual)
    return float(np.divide(around, possible, out=np.zeros(len(live)), where=possible > 0.0).mean())
