"""Topologies from the Delaunay triangulation of the live robots: neighbours without another robot between them.

Each contains the next: `delaunay`, `gabriel`, `relative-neighbourhood`. They are defined by the robots' places alone,
as a triangulation is not unique where four robots stand on one circle:

- robots in the same place hear each other, and the same others;
- robots all on one line hear the next on either side, in all three topologies;
- angles and lengths that differ by less than one part in 10^9 count as equal, so that rounding does not decide.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray
from scipy.spatial import Delaunay as Triangulation

from swarmsim.core.context import BuildContext
from swarmsim.core.parts import Links
from swarmsim.core.state import State
from swarmsim.kernels import graph, triangulation

EQUAL = 1e-9  # relative: angles and lengths this close count as equal

Edges = NDArray[np.int32]  # (e, 2): two robots in any order, each pair once
Points = NDArray[np.float64]  # (p, 2): x, y in m


class Delaunay(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Two robots hear each other if some circle through both has every other robot strictly outside.

    These are the edges that all Delaunay triangulations of the robots share; the Voronoi cells of such robots have a
    side in common. Of four robots on one circle, opposite ones do not hear each other. Only live robots are
    triangulated: the graph closes around a dead one.
    """

    def build(self, context: BuildContext) -> ProximityLinks:
        return ProximityLinks(delaunay)


class Gabriel(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Two robots hear each other if the closed disc with them at opposite ends holds no other live robot.

    Gabriel & Sokal 1969; equivalent to Delaunay edges seen under an acute angle from both adjacent corners: Matula &
    Sokal 1980. Around a dead robot the graph closes.
    """

    def build(self, context: BuildContext) -> ProximityLinks:
        return ProximityLinks(gabriel)


class RelativeNeighbourhood(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Two robots hear each other if no other live robot is nearer to both than they are to each other.

    Toussaint 1980: the lune of the two, open, is empty. Around a dead robot the graph closes.
    """

    def build(self, context: BuildContext) -> ProximityLinks:
        return ProximityLinks(relative_neighbourhood)


class ProximityLinks:
    """Links among live robots along the edges that a rule picks from their triangulation."""

    def __init__(self, pick: Callable[[Mesh], Edges]) -> None:
        self._pick = pick

    def links(self, state: State) -> Links:
        """The links of this moment; with each its reverse."""
        live = np.flatnonzero(state.alive)
        mesh = triangulate(state.pose[live, :2])
        edges = _between_all(self._pick(mesh), mesh.place)
        links: Links = graph.both_ways(live[edges].astype(np.int32), state.robots)
        return links


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """A Delaunay triangulation of points, or the line on which all of them lie."""

    points: Points
    place: NDArray[np.intp]  # (p,): which point represents the place of each in the edges; mostly itself
    edges: Edges
    angles: NDArray[np.float64]  # (e, 2), rad: under which the corners on either side see an edge; 0 without corner


def triangulate(points: Points) -> Mesh:
    """The mesh of any number of points, whether or not some of them coincide."""
    points = points - points.mean(axis=0) if len(points) else points  # far from the origin qhull has fewer digits
    place = np.arange(len(points))
    order = _in_line(points)
    if order is not None:
        # Points close together along the line share one place.
        apart = np.linalg.norm(np.diff(points[order], axis=0), axis=1)
        fresh = np.concatenate([[True], apart > EQUAL * apart.sum()])[: len(order)]
        stops = order[fresh]
        place[order] = stops[np.cumsum(fresh) - 1]
        edges = np.stack([stops[:-1], stops[1:]], axis=1).astype(np.int32)
        return Mesh(points, place, edges, np.zeros((len(edges), 2)))
    found = Triangulation(points)
    place[found.coplanar[:, 0]] = found.coplanar[:, 2]  # points that coincide with a corner, but for rounding
    return Mesh(points, place, *triangulation.opposite_angles(points, found.simplices, found.neighbors))


def _in_line(points: Points) -> NDArray[np.intp] | None:
    """The order of the points along the line on which all of them lie; None if they are on no line."""
    if not len(points):
        return np.arange(0)
    from_first = points - points[0]
    direction = from_first[np.argmax(np.hypot(*from_first.T))]
    across = direction[0] * from_first[:, 1] - direction[1] * from_first[:, 0]
    if np.abs(across).max() > EQUAL * (direction @ direction):
        return None
    return np.argsort(from_first @ direction, kind="stable")


def _between_all(edges: Edges, place: NDArray[np.intp]) -> NDArray[np.intp]:
    """The edges (e, 2) among all points, given those among the representative points."""
    if np.array_equal(place, np.arange(len(place))):
        return edges.astype(np.intp)
    near = np.eye(len(place), dtype=np.bool_)
    near[edges[:, 0], edges[:, 1]] = near[edges[:, 1], edges[:, 0]] = True
    return np.argwhere(np.triu(near[np.ix_(place, place)], k=1))


def delaunay(mesh: Mesh) -> Edges:
    """The edges that all Delaunay triangulations share: the angles opposite to each add up to less than pi."""
    kept: Edges = mesh.edges[mesh.angles.sum(axis=1) < np.pi * (1.0 - EQUAL)]
    return kept


def gabriel(mesh: Mesh) -> Edges:
    """The Delaunay edges opposite to which both angles are acute (Matula & Sokal 1980)."""
    kept: Edges = mesh.edges[mesh.angles.max(axis=1) < 0.5 * np.pi * (1.0 - EQUAL)]
    return kept


def relative_neighbourhood(mesh: Mesh) -> Edges:
    """The Gabriel edges whose lunes are empty (Toussaint 1980)."""
    edges: Edges = triangulation.with_empty_lunes(mesh.points, gabriel(mesh), EQUAL)
    return edges
