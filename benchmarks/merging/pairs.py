"""One meeting of two robots in a building: how often the maps are put together rightly, wrongly, or left apart.

Each robot has seen a box of 4.5 m to 7 m around the place where they met, off its middle, and its map is turned and
shifted at random. The excess of contradictions that proves a place was chosen on the pairs of `CHOOSE`; those of
`JUDGE` are in other buildings, and had no part in the choice. Run: `python benchmarks/merging/pairs.py`.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass

import numpy as np
from alike import EQUAL, ORDINARY, drawn, truth
from scipy import ndimage

from swarmsim.core.state import FREE, OCCUPIED, UNKNOWN
from swarmsim.operations.mapping.sharing.places import Transform
from swarmsim.operations.mapping.sharing.registration import Meetings, register

CHOOSE, JUDGE = range(25), range(1000, 1040)  # seeds of buildings and of what robots have seen in them
WITHIN = 7.0  # cells: the greatest distance of robots that meet, about 1 m
WRONG = 2.5  # cells: the error of a corner of the told map


@dataclass(frozen=True)
class Pair:
    """Two maps, one meeting, and what is true."""

    first: np.ndarray
    other: np.ndarray
    met: Meetings
    right: Transform  # how the other lies in the first

    def error(self, found: Transform) -> float:
        """How far the worst corner of the other map lies from its place, in cells."""
        known = np.argwhere(self.other != UNKNOWN)
        low, high = known.min(axis=0), known.max(axis=0) + 1
        corners = np.array([(row, column) for row in (low[0], high[0]) for column in (low[1], high[1])], float)
        return float(np.hypot(*(found.apply(corners) - self.right.apply(corners)).T).max())


def seen(whole: np.ndarray, at: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """A box of the map around a place, which is somewhere in the middle half of it."""
    size = random.uniform(30, 47, 2)
    low = np.maximum(np.round(at - size * random.uniform(0.25, 0.75, 2)).astype(int), 0)
    high = np.round(low + size).astype(int)
    part = np.zeros_like(whole)
    part[low[0] : high[0], low[1] : high[1]] = whole[low[0] : high[0], low[1] : high[1]]
    return part


def noisy(cells: np.ndarray, noise: float, random: np.random.Generator) -> np.ndarray:
    """The map with this share of its cells wrong."""
    wrong = (random.random(cells.shape) < noise) & (cells != UNKNOWN)
    return np.where(wrong, np.where(cells == FREE, OCCUPIED, FREE), cells).astype(np.uint8)


def pair(kind: str, seed: int, noise: float = 0.0, apart: bool = False) -> Pair:
    """One pair; `apart`: the robots are in two buildings of a kind, and take themselves to have met."""
    random, whole = np.random.default_rng([seed, 7, *kind.encode()]), truth(drawn(kind, seed))
    free = np.argwhere(whole == FREE)
    here = free[random.integers(len(free))].astype(float)
    near = free[np.hypot(*(free - here).T) <= WITHIN - 1.0]
    there = near[random.integers(len(near))].astype(float)
    other_one = whole
    if apart:
        other_one = truth(drawn(kind, seed + 500))
        free = np.argwhere(other_one == FREE)
        there = free[random.integers(len(free))].astype(float)
    first = noisy(seen(whole, here, random), noise, random)
    second = noisy(seen(other_one, there, random), noise, random)
    turn, side = random.uniform(-np.pi, np.pi), int(np.ceil(np.hypot(*second.shape))) + 4
    matrix = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    middle, centre = (np.array(second.shape) - 1) / 2.0, np.full(2, (side - 1) / 2.0) + random.uniform(-1.0, 1.0, 2)
    other = ndimage.affine_transform(second, matrix, middle - matrix @ centre, (side, side), order=0, cval=UNKNOWN)
    moved = (there - middle) @ matrix + centre
    back = matrix @ (centre + 0.5)  # a point p of the first is (p - middle) @ matrix + centre in the other
    right = Transform(-turn, *(middle + 0.5 - back).tolist())
    rows, columns = (np.flatnonzero((first != UNKNOWN).any(axis=axis)) for axis in (1, 0))
    first = first[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    corner = np.array([rows[0], columns[0]], float)
    right = Transform(0.0, *(-corner).tolist()).after(right)
    return Pair(first, other, Meetings((here - corner)[None], moved[None], WITHIN), right)


def main() -> None:
    """Print, for each kind of building, what became of its pairs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", choices=["choose", "judge"], default="judge")
    parser.add_argument("--noise", type=float, default=0.0, help="share of cells that are wrong")
    parser.add_argument("--apart", action="store_true", help="in two different buildings: every answer is wrong")
    arguments = parser.parse_args()
    seeds, total, began = {"choose": CHOOSE, "judge": JUDGE}[arguments.pairs], np.zeros(4, int), time.process_time()
    print("building    pairs  right  wrong  undecided")
    for kind in (*EQUAL, *ORDINARY):
        counts = np.zeros(4, int)
        for seed in seeds:
            one = pair(kind, seed, arguments.noise, arguments.apart)
            match = register(one.first, one.other, one.met)
            told = match is not None and match.accepted()
            right = told and not arguments.apart and one.error(match.best.transform) <= WRONG
            counts += [1, right, told and not right, not told]
        total += counts
        print(f"{kind:10}  {counts[0]:5}  {counts[1]:5}  {counts[2]:5}  {counts[3]:9}", flush=True)
    print(f"{'all':10}  {total[0]:5}  {total[1]:5}  {total[2]:5}  {total[3]:9}")
    print(f"{(time.process_time() - began) / total[0]:.2f} s of processor time a pair")


if __name__ == "__main__":
    main()
