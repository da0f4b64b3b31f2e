"""The best that two robots can do in a tiny building, by trying everything; shares no code with bounds and tours.

Robots start in the middle of a cell and drive straight to points in cells a king's or a knight's move away, at one cell
an iteration; they see from each such point. Lengths are in cells, points are (row, column), cell (r, c) is the square
from (r, c) to (r + 1, c + 1).
"""

from __future__ import annotations

import heapq
import math

import numpy as np

Cell = tuple[int, int]
Point = tuple[float, float]
KING = {(down, across) for down in (-1, 0, 1) for across in (-1, 0, 1)} - {(0, 0)}
KNIGHT = {(down, across) for down in (-2, -1, 1, 2) for across in (-2, -1, 1, 2) if abs(down) != abs(across)}
FRACTIONS = np.linspace(0.01, 0.99, 9)


class Tiny:
    """A building of walls (rows, columns), and a tile of some rows and columns."""

    def __init__(self, walls: np.ndarray, tile: tuple[int, int]) -> None:
        self.walls, self.tile = walls, tile
        self.floor: list[Cell] = [(int(r), int(c)) for r, c in np.argwhere(~walls)]

    def point(self, cell: Cell) -> Point:
        """Where robots stand in a cell: beside the middle along an even side of the tile, if there is room."""
        at = [cell[0] + 0.5, cell[1] + 0.5]
        for axis in (0, 1):
            if self.tile[axis] % 2 == 0:
                after, before = ((cell[0] + way * (axis == 0), cell[1] + way * (axis == 1)) for way in (1, -1))
                at[axis] += 0.25 if not self.walls[after] else -0.25 if not self.walls[before] else 0.0
        return at[0], at[1]

    def view(self, place: Point) -> set[Cell]:
        """The cells of the tile to which some straight line leads over the floor."""
        first = [
            math.floor(at) - side // 2 if side % 2 else math.floor(at + 0.5) - side // 2
            for at, side in zip(place, self.tile, strict=True)
        ]
        rows, columns = self.walls.shape
        inside = [
            (r, c)
            for r in range(first[0], first[0] + self.tile[0])
            for c in range(first[1], first[1] + self.tile[1])
            if 0 <= r < rows and 0 <= c < columns
        ]
        return {cell for cell in inside if self._sees(place, cell)}

    def _sees(self, place: Point, cell: Cell) -> bool:
        along = np.linspace(0.0, 1.0, 200)[:, None, None, None]
        goal = np.stack(np.meshgrid(cell[0] + FRACTIONS, cell[1] + FRACTIONS, indexing="ij"), axis=-1)
        crossed = np.floor(np.array(place) + along * (goal - np.array(place))).astype(int)
        free = ~self.walls[crossed[..., 0], crossed[..., 1]] | (crossed == cell).all(axis=-1)
        return bool(free.all(axis=0).any())

    def moves(self, cell: Cell) -> list[Cell]:
        """The cells that a king or a knight reaches, over a rectangle of floor."""
        steps = [(down, across) for down in range(-2, 3) for across in range(-2, 3)]
        near = [(cell[0] + down, cell[1] + across) for down, across in steps if (down, across) in KING | KNIGHT]
        return [there for there in near if there in self.floor and self._is_clear(cell, there)]

    def _is_clear(self, one: Cell, other: Cell) -> bool:
        rows, columns = (slice(min(pair), max(pair) + 1) for pair in zip(one, other, strict=True))
        return not self.walls[rows, columns].any()

    def best(self, starts: list[Cell], domain: set[Cell], most: float) -> float:
        """The least length of the longer of two ways, at most `most`, that together see the domain; inf for none."""
        bit = {cell: 1 << number for number, cell in enumerate(sorted(domain))}
        points = {cell: self.point(cell) for cell in self.floor}
        seen = {cell: sum(bit.get(one, 0) for one in self.view(points[cell])) for cell in self.floor}
        moves = {cell: self.moves(cell) for cell in self.floor}
        reached = [self._all_ways(start, points, seen, moves, bit, most) for start in starts]
        return _shortest_pair(*reached, sum(bit.values()))

    def _all_ways(self, start, points, seen, moves, bit, most) -> dict[int, float]:
        """What can be seen on ways from a start: for each set of cells, the least length."""
        middle = start[0] + 0.5, start[1] + 0.5
        first = sum(bit.get(one, 0) for one in self.view(middle))
        waiting = [(0.0, (-1, -1), first)]
        lengths, found = {((-1, -1), first): 0.0}, dict[int, float]()
        while waiting:
            length, cell, mask = heapq.heappop(waiting)
            if length > lengths[cell, mask]:
                continue
            found.setdefault(mask, length)
            here, ways = (middle, [start, *moves[start]]) if cell[0] < 0 else (points[cell], moves[cell])
            for there in ways:
                further = length + math.dist(here, points[there])
                state = there, mask | seen[there]
                if further <= most + 1e-9 and further < lengths.get(state, math.inf):
                    lengths[state] = further
                    heapq.heappush(waiting, (further, *state))
        return found


def _shortest_pair(one: dict[int, float], other: dict[int, float], everything: int) -> float:
    """The least of the longer lengths of two ways that together see everything."""
    pairs = [_undominated(found) for found in (one, other)]
    best = math.inf
    for mask, length in pairs[0]:
        for more, further in pairs[1]:
            if max(length, further) >= best:
                break
            if mask | more == everything:
                best = max(length, further)
    return best


def _undominated(found: dict[int, float]) -> list[tuple[int, float]]:
    """Sets of cells with their lengths, shortest first, without those within a set that is no longer."""
    kept = list[tuple[int, float]]()
    for mask, length in sorted(found.items(), key=lambda one: (one[1], -one[0].bit_count())):
        if not any(mask & ~larger == 0 for larger, _ in reversed(kept)):
            kept.append((mask, length))
    return kept
