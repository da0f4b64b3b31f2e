"""Which piece of free space is the floor of a building, and the border that closes an open one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon

from swarmsim.core.errors import InputError
from swarmsim.core.events import Box
from swarmsim.world.areas import polygons
from swarmsim.world.doors import FURNITURE, stands_free

ENCLOSED: Final = 0.3  # of the largest open piece inside of the walls' hull; a larger closed piece is the floor
FIELD: Final = 0.5  # of the edge of a drawing's extent; a floor that runs off along more of it has no outline
UNSURE: Final = (0.1, 2.0)  # between these, a user should choose the piece
BLOCK: Final = 0.5  # of its own hull; a more solid building with robots around it was misread
HELD: Final = 0.1  # of a closed piece, the least size of one that it surrounds and that may be the floor
BORDER: Final = 0.1  # m, how thick a border is
_AT_EDGE: Final = 1e-6  # m


@dataclass(frozen=True, slots=True, eq=False)
class Floor:
    """The free space that robots start in."""

    piece: shapely.Polygon
    border: MultiPolygon  # that closes it; empty if walls do
    opening: tuple[float, float] | None  # m, where it runs off, if it does
    share: float  # of the box's edge along which it runs off
    sure: bool  # whether no other piece comes close


def floor_of(
    solid: MultiPolygon, drawn: MultiPolygon, inside: Box, held: list[MultiPolygon], unusable: MultiPolygon
) -> Floor | None:
    """The floor between `solid` shapes, or None if nothing is free.

    `inside` is the box within which space may be floor: the page of a map, the extent of a drawing. `held` areas, of
    spawning or painted floor, lie mostly in the floor; without them, the floor is the largest closed piece, or the
    largest open one if no closed piece has at least `ENCLOSED` of its area inside of the hull of all `drawn` shapes.
    Racks, pillars and specks reach 0.03 of that at most, real buildings 0.5 and more. An open floor gets a border along
    `inside`. Robots do not start on `unusable` areas.
    """
    box = shapely.box(*inside)
    free = polygons(shapely.difference(box, solid))
    pieces = shapely.get_parts(free)
    if not len(pieces):
        return None
    is_open = _touches_edge(pieces, inside)
    usable = pieces if unusable.is_empty else shapely.difference(pieces, unusable)
    areas = shapely.area(usable)
    sure = True
    if held:
        own = shapely.area(shapely.intersection(pieces, shapely.union_all(held)))
        taken = int((own if own.any() else areas).argmax())
    else:
        hull = box if drawn.is_empty else shapely.convex_hull(drawn)
        loose = [not out and stands_free(piece, pieces) for piece, out in zip(pieces, is_open, strict=True)]
        closed, open_ = np.where(is_open | loose, 0.0, areas), np.where(is_open, areas, 0.0)
        within = float(shapely.area(shapely.intersection(usable[open_.argmax()], hull))) if open_.any() else 0.0
        ratio = closed.max() / within if within > 0.0 else np.inf
        taken = int(closed.argmax() if closed.any() and ratio >= ENCLOSED else areas.argmax())
        around = is_open[taken] or not _holds_another(taken, pieces, is_open)
        sure = (around and not UNSURE[0] < ratio < UNSURE[1]) or closed.max() < UNSURE[0] * open_.max()
    floor = usable[taken]
    if floor.geom_type != "Polygon":
        floor = max(polygons(floor).geoms, key=lambda part: part.area, default=pieces[taken])
    if not is_open[taken]:
        return Floor(floor, MultiPolygon(), None, 0.0, sure)
    frame = shapely.difference(shapely.buffer(box, BORDER, join_style="mitre"), box)
    opening, share = _opening(pieces[taken], box)
    return Floor(floor, polygons(frame), opening, share, sure)


def _holds_another(taken: int, pieces: NDArray[np.object_], is_open: NDArray[np.bool_]) -> bool:
    """Whether a piece surrounds closed space that may be the building, like the frame of a sheet."""
    around = pieces[taken]
    holes = [shapely.Polygon(ring) for ring in around.interiors]
    others: NDArray[np.object_] = pieces[~is_open & (shapely.area(pieces) >= max(HELD * around.area, FURNITURE))]
    return bool(len(shapely.STRtree(others).query(holes, predicate="contains")[0])) if len(others) and holes else False


def check_outside(drawn: MultiPolygon, floor: Floor, name: str) -> None:
    """Raise InputError if robots would run around a solid block that is probably a building with filled rooms."""
    hull = shapely.convex_hull(drawn).area
    if floor.opening is not None and hull > 0.0 and drawn.area > BLOCK * hull:
        raise InputError(
            f"{name}: {100.0 * drawn.area / hull:.0f} % of the building is solid, and the free space is the page "
            'around it: filled areas cover the rooms. With world.solid = "strokes" only strokes are walls and fills '
            "are floor; world.floor names the classes that are floor; if robots shall run around it, say "
            "world.border = true"
        )


def _touches_edge(pieces: NDArray[np.object_], inside: Box) -> NDArray[np.bool_]:
    """Which of the pieces reach the edge of a box."""
    bounds, edge = shapely.bounds(pieces), np.array(inside)
    low, high = bounds[:, :2] - edge[:2] < _AT_EDGE, edge[2:] - bounds[:, 2:] < _AT_EDGE
    return np.asarray((low | high).any(axis=1))


def _opening(piece: shapely.Polygon, box: shapely.Polygon) -> tuple[tuple[float, float], float]:
    """The middle of the longest stretch along which a piece runs off a box, and the share of all such stretches."""
    edge = shapely.buffer(box.exterior, _AT_EDGE)
    parts = shapely.get_parts(shapely.line_merge(shapely.intersection(piece.exterior, edge)))
    lines = [part for part in parts if part.length > 0.0]
    middle = (
        max(lines, key=lambda part: part.length).interpolate(0.5, normalized=True)
        if lines
        else piece.point_on_surface()
    )
    return (middle.x, middle.y), sum(part.length for part in lines) / box.length
