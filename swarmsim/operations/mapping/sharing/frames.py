"""Frames of reference: where a robot's own begins, and maps and tiles put from one into another."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.lattice import Lattice
from swarmsim.core.state import UNKNOWN
from swarmsim.operations.mapping.sharing.places import Cells, Transform


def moved(
    values: NDArray[np.uint8], origins: NDArray[np.int32], errors: NDArray[np.float64]
) -> tuple[NDArray[np.uint8], NDArray[np.int32]]:
    """Tiles (t, rows, columns) and their origins (t, 2) where `errors` (t, 3) put them, resampled on the lattice."""
    size = np.array(values.shape[1:])
    cos, sin = np.cos(errors[:, 0]), np.sin(errors[:, 0])
    middles = origins + size / 2.0
    row, column = middles[:, 0], middles[:, 1]
    middle = np.stack([row * cos + column * sin, column * cos - row * sin], axis=1) + errors[:, 1:]
    placed = np.round(middle - size / 2.0).astype(np.int32)
    cells = placed[:, :, None, None] + np.indices(values.shape[1:]) + 0.5 - errors[:, 1:, None, None]
    turn = cos[:, None, None], sin[:, None, None]
    rows = np.floor(cells[:, 0] * turn[0] - cells[:, 1] * turn[1]).astype(np.int64) - origins[:, 0, None, None]
    columns = np.floor(cells[:, 0] * turn[1] + cells[:, 1] * turn[0]).astype(np.int64) - origins[:, 1, None, None]
    inside: NDArray[np.bool_] = (rows >= 0) & (rows < size[0]) & (columns >= 0) & (columns < size[1])
    at = np.arange(len(values))[:, None, None], np.where(inside, rows, 0), np.where(inside, columns, 0)
    return np.where(inside, values[at], np.uint8(UNKNOWN)), placed


def presented(cells: Cells, frame: Transform) -> tuple[Cells, NDArray[np.int64]]:
    """The known part of a map in another frame, resampled on that frame's cells, and the cell it begins at (2,)."""
    rows, columns = (np.flatnonzero((cells != UNKNOWN).any(axis=axis)) for axis in (1, 0))
    corners = np.array([(row, column) for row in (rows[0], rows[-1] + 1) for column in (columns[0], columns[-1] + 1)])
    there = frame.apply(corners.astype(float))
    low, high = np.floor(there.min(axis=0)).astype(np.int64), np.ceil(there.max(axis=0)).astype(np.int64)
    shape = tuple((high - low).tolist())
    centres = (np.indices(shape).reshape(2, -1).T + low) + 0.5
    at = np.floor(frame.inverse().apply(centres)).astype(np.int64)
    row, column = at[:, 0], at[:, 1]
    inside: NDArray[np.bool_] = (row >= 0) & (row < cells.shape[0]) & (column >= 0) & (column < cells.shape[1])
    found = np.where(inside, cells[np.where(inside, row, 0), np.where(inside, column, 0)], np.uint8(UNKNOWN))
    return found.reshape(shape), low


def cropped(cells: Cells) -> tuple[Cells, NDArray[np.int64]]:
    """The known part of a map and the cell it begins at."""
    rows, columns = (np.flatnonzero((cells != UNKNOWN).any(axis=axis)) for axis in (1, 0))
    return cells[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1], np.array([rows[0], columns[0]])


def into_own_frame(pose: NDArray[np.float64], lattice: Lattice) -> Transform:
    """From the lattice to the frame of a robot that starts at a pose: its place is 0, and it looks along a row."""
    turn = Transform(-float(pose[2]), 0.0, 0.0)
    start: list[float] = turn.apply(cells_at(pose, lattice)[None]).ravel().tolist()
    return Transform(turn.turn, -start[0], -start[1])


def cells_at(pose: NDArray[np.float64], lattice: Lattice) -> NDArray[np.float64]:
    """Row and column of places (..., 3), in cells from the corner of cell (0, 0)."""
    return np.stack([pose[..., 1] - lattice.y0, pose[..., 0] - lattice.x0], axis=-1) / lattice.cell
