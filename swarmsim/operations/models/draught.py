"""Draughts: potential flows over a floor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph, linalg

from swarmsim.core.errors import InputError
from swarmsim.operations.models.faces import Faces

Point = tuple[float, float]  # x, y in m


@dataclass(frozen=True, slots=True, eq=False)
class Air:
    """How much air crosses each face, m^2/s: its volume in a second by the height of the room."""

    fluxes: NDArray[np.float64]  # (f,): from the first cell of a pair to the second
    entering: NDArray[np.float64]  # (n,): into a cell, from a vent or through its open walls
    leaving: NDArray[np.float64]  # (n,)


def between_vents(faces: Faces, inlet: Point, outlet: Point, flow: float) -> Air:
    """The draught from one vent to another, each as large as a cell. Raises InputError, which starts with the key."""
    entering, leaving = np.zeros(faces.count), np.zeros(faces.count)
    start, end = (_cell(faces, key, at) for key, at in (("inlet", inlet), ("outlet", outlet)))
    entering[start], leaving[end] = flow, flow
    if flow <= 0.0:
        raise InputError(f"vents.flow: {flow:g} m^2/s; expected a number over 0")
    rooms = csgraph.connected_components(_joined(faces))[1]
    if start == end or rooms[start] != rooms[end]:
        raise InputError(
            f"vents.outlet: {list(outlet)} is not connected to another cell, the inlet; expected that it is"
        )
    return Air(_potential(faces, entering - leaving), entering, leaving)


def through(faces: Faces, velocity: NDArray[np.float64]) -> Air:
    """The draught of a velocity (x, y in m/s) that enters and leaves through the outer walls, around all else."""
    out = faces.domain.lattice.cell * (faces.normals @ velocity) * faces.outer
    leaving, entering = (faces.summed(faces.walls, np.maximum(sign * out, 0.0)) for sign in (1.0, -1.0))
    return Air(_potential(faces, entering - leaving), entering, leaving)


def _potential(faces: Faces, gains: NDArray[np.float64]) -> NDArray[np.float64]:
    """The fluxes (f,) of the potential flow in which each cell's gain (n,) flows away (Batchelor 1967, ch. 6)."""
    joined = _joined(faces)
    first = np.unique(csgraph.connected_components(joined)[1], return_index=True)[1]
    pinned = np.zeros(faces.count)
    pinned[first] = 1.0  # the potential of one cell of each room is at will
    potential = linalg.spsolve((csgraph.laplacian(joined) + sparse.diags_array(pinned)).tocsc(), gains)
    return np.asarray(potential[faces.pairs[:, 0]] - potential[faces.pairs[:, 1]])


def _joined(faces: Faces) -> sparse.csr_array:
    """The graph (n, n) of cells that share a face."""
    return faces.matrix(np.ones(len(faces.pairs)), np.ones(len(faces.pairs)), np.zeros(faces.count))


def _cell(faces: Faces, key: str, at: Point) -> int:
    row, column = faces.domain.lattice.cells_within(np.array(at))
    number = -1 if row < 0 else int(faces.number[row, column])
    if number < 0:
        raise InputError(f"vents.{key}: {list(at)} is not on the floor; expected x, y in m of a free place")
    return number
