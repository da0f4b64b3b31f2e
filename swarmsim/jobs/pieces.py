"""Fixed pieces of a domain: connected, about equal, with the cells around them that their steps read."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.jobs import Domain, Piece, Values

CROSS: Final = ndimage.generate_binary_structure(2, 1)  # a cell and the four across its edges
SLACK: Final = 0.15  # of a half's size, by which a shorter cut may miss it

Mask = NDArray[np.bool_]  # (rows, columns)
Cells = NDArray[np.int32]  # (c, 2): row, column


def given(context: BuildContext) -> Domain:
    """The free cells that are connected to the entrance, as a floor plan handed out before the run tells them."""
    lattice, free = context.lattice, ~context.building.occupied
    parts, _ = ndimage.label(free, CROSS)
    rows, columns = lattice.cells(context.building.entrance).T
    return Domain(lattice, free & np.isin(parts, parts[rows, columns]))


def bisected(domain: Domain, count: int, halo: int) -> tuple[Piece, ...]:
    """A domain in `count` pieces by recursive bisection, with halos `halo` cells wide along free cells.

    Pieces of a connected domain are connected. Each cut is the shortest of a vertical, a horizontal and a curved one
    that leaves both sides connected and about as large as their numbers of pieces ask. Raises InputError for more
    pieces than cells.
    """
    cells = int(np.count_nonzero(domain.free))
    if not 1 <= count <= cells:
        raise InputError(f"pieces: {count} of {cells} free cells; expected 1 to {cells}")
    of = np.full(domain.free.shape, -1, np.int32)
    for number, mask in enumerate(_halved(domain.free, count)):
        of[mask] = number
    return pieces_of(domain, of, halo)


def pieces_of(domain: Domain, of: NDArray[np.int32], halo: int) -> tuple[Piece, ...]:
    """The pieces whose numbers `of` (rows, columns) gives for each cell; -1 outside of the domain."""
    count, shown, halos = int(of.max()) + 1, np.zeros(of.shape, np.bool_), []
    for number in range(count):
        mine = of == number
        near = ndimage.binary_dilation(mine, CROSS, halo, mask=domain.free) & ~mine if halo else np.zeros_like(mine)
        halos.append(_cells(near))
        shown |= near
    pieces = []
    for number, around in enumerate(halos):
        cells = _cells(of == number)
        rim = np.flatnonzero(shown[cells[:, 0], cells[:, 1]])
        pieces.append(Piece(number, cells, around, of[around[:, 0], around[:, 1]], rim))
    return tuple(pieces)


def _cells(mask: Mask) -> Cells:
    return np.argwhere(mask).astype(np.int32)


def _halved(mask: Mask, count: int) -> Iterator[Mask]:
    """The pieces of a part of a domain."""
    if count == 1:
        yield mask
        return
    first = _cut(mask, count // 2 / count)
    size, whole = int(np.count_nonzero(first)), int(np.count_nonzero(mask))
    mine = min(max(round(count * size / whole), 1, count - (whole - size)), count - 1, size)
    yield from _halved(first, mine)
    yield from _halved(mask & ~first, count - mine)


def _cut(mask: Mask, share: float) -> Mask:
    """The first of two parts, with about this share of the cells."""
    cells, wanted = _cells(mask), share * np.count_nonzero(mask)
    tries = [_trimmed(mask, cells[order[: round(wanted)]]) for order in _orders(mask, cells)]
    best = min(abs(np.count_nonzero(one) - wanted) for one in tries)
    fair = [one for one in tries if abs(np.count_nonzero(one) - wanted) <= max(best, SLACK * wanted)]
    return min(fair, key=lambda one: _edges(mask, one))


def _orders(mask: Mask, cells: Cells) -> Iterator[NDArray[np.int64]]:
    """The cells in order of their columns, of their rows, and of the length of the way from one end."""
    yield np.lexsort((cells[:, 0], cells[:, 1]))
    yield np.lexsort((cells[:, 1], cells[:, 0]))
    far = _ways(mask, cells[0])[cells[:, 0], cells[:, 1]].argmax()
    yield np.argsort(_ways(mask, cells[far])[cells[:, 0], cells[:, 1]], kind="stable")


def _ways(mask: Mask, start: NDArray[np.int32]) -> NDArray[np.int32]:
    """The steps (rows, columns) from a cell to each other one; those out of reach are farthest."""
    steps = np.full(mask.shape, np.iinfo(np.int32).max, np.int32)
    reached = np.zeros(mask.shape, np.bool_)
    reached[start[0], start[1]] = True
    edge, step = reached, 0
    while edge.any():
        steps[edge], step = step, step + 1
        edge = ndimage.binary_dilation(edge, CROSS) & mask & ~reached
        reached = reached | edge
    return np.where(mask, steps, -1).astype(np.int32)


def _trimmed(mask: Mask, first: Cells) -> Mask:
    """The same part, given what else the largest connected rest cuts off; so the rest stays connected.

    What this leaves unconnected of the part itself goes to the rest, which it touches.
    """
    part = np.zeros(mask.shape, np.bool_)
    part[first[:, 0], first[:, 1]] = True
    return _largest(mask & ~_largest(mask & ~part))


def _largest(mask: Mask) -> Mask:
    """The largest connected part; the first of equal ones."""
    parts, count = ndimage.label(mask, CROSS)
    if count < 2:
        return mask
    found: Mask = parts == np.bincount(parts[mask]).argmax()
    return found


def _edges(mask: Mask, part: Mask) -> int:
    """How many edges between cells a part has in common with the rest."""
    rest = mask & ~part
    down = (part[1:] & rest[:-1]) | (rest[1:] & part[:-1])
    across = (part[:, 1:] & rest[:, :-1]) | (rest[:, 1:] & part[:, :-1])
    return int(np.count_nonzero(down) + np.count_nonzero(across))


@dataclass(frozen=True, slots=True, eq=False)
class Joint:
    """What a piece reads of another one."""

    piece: int  # the other one
    shown: NDArray[np.int64]  # (k,): which values that it shows ...
    halo: NDArray[np.int64]  # (k,): ... are those of which cells of the halo


def joints(pieces: Sequence[Piece]) -> list[tuple[Joint, ...]]:
    """Each piece's joints, by the other piece's number."""
    rims = [{tuple(cell): row for row, cell in enumerate(one.cells[one.rim].tolist())} for one in pieces]
    found = []
    for one in pieces:
        mine = []
        for other in np.unique(one.owners).tolist():
            rows = np.flatnonzero(one.owners == other)
            shown = [rims[other][tuple(cell)] for cell in one.halo[rows].tolist()]
            mine.append(Joint(other, np.array(shown, np.int64), rows))
        found.append(tuple(mine))
    return found


def joined(piece: Piece, its: Sequence[Joint], shown: Sequence[Values]) -> Values:
    """The values (h, ...) of a piece's halo, from what the pieces of its joints show."""
    return assembled(piece, its, [values[joint.shown] for joint, values in zip(its, shown, strict=True)])


def assembled(piece: Piece, its: Sequence[Joint], parts: Sequence[Values]) -> Values:
    """The same from the values that it reads of each."""
    around = np.empty((len(piece.halo), *(parts[0].shape[1:] if parts else ())))
    for joint, values in zip(its, parts, strict=True):
        around[joint.halo] = values
    return around
