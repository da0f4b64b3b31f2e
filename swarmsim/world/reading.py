"""The solid part of a drawing: by its layers, by its ink, or by its strokes alone."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon
from shapely.geometry.base import BaseGeometry

from swarmsim.core.errors import InputError
from swarmsim.core.events import Box
from swarmsim.core.scenario.file import World
from swarmsim.world.areas import connected, joined, polygons, united
from swarmsim.world.doors import FURNITURE, THICK, MadeDoors, cut_by_symbols, inward, make_doors, opened
from swarmsim.world.plan import DOORS_LAYER, FLOOR_LAYER, SOLID_LAYERS, SPAWN_LAYER, UNKNOWN_LAYER, FloorPlan
from swarmsim.world.shapes import NOTHING, Drawing, Shape

DOOR: Final = 0.9  # m, of doors made in plans of rooms, unless `world.doors` says otherwise
PARTITION: Final = 0.1  # m, the thickness of walls along the borders of rooms drawn without any
STROKE_INK, FILL_INK = 0.2, 0.5  # least contrast to the paper of strokes and fills of walls
BLACK: Final = 0.75  # darker fills are not floor
WIDE: Final = 0.6  # m, 2 area / perimeter: fills of walls are narrower, those of rooms wider
_NEAR: Final = 1e-6  # m
PAPER: Final = 0.03  # largest contrast to the paper of a shape that counts as paper
ROOMS: Final = (0.5, 0.4, 3)  # of the building's hull solid, and covered by wide light fills, and their number
AROUND: Final = 0.95  # of fewer fills, the share inside of dark ink if they are floor
SHEET: Final = 0.1  # m, largest thickness of a sheet's frame; it is also at most half as thick as walls
BUILDING: Final = 0.05  # of a sheet's frame, the least share of the hull of the building in it


@dataclass(frozen=True, slots=True)
class Read:
    """The solids in a drawing without layers, and how they were found."""

    solid: MultiPolygon
    rooms: MultiPolygon  # of a plan of rooms, the fills that are floor
    is_rooms: bool  # whether it is one
    notices: list[str]


def plan_of(drawing: Drawing, world: World) -> FloorPlan:
    """The floor plan in a drawing, with its doors cut and missing ones made.

    Layers say what is solid; the rest is decoration. Without them all of the drawing is solid, except its paper and
    shapes of the paper's colour, which cut those below them. With `world.solid = "strokes"`, or if it is plainly a plan
    of rooms, dark strokes and thin dark fills are walls, and all other fills are floor that covers shapes below. Raises
    InputError if nothing is solid.
    """
    page = drawing.page
    by_layer: defaultdict[str, list[Shape]] = defaultdict(list)
    for shape in drawing.shapes:
        by_layer[shape.layer].append(shape)
    notices = list(drawing.notices)
    undecided, rooms = by_layer[""], bool(by_layer[FLOOR_LAYER])
    painted = [shape.fill for shape in by_layer[FLOOR_LAYER]]
    if drawing.says_solid:
        layers = {layer: united(_layer(by_layer[layer], world, page)) for layer in SOLID_LAYERS}
        rooms |= world.solid == "strokes"
        if beside := [shape for shape in undecided if not _fills(shape, page)]:
            notices.append(_decoration(beside, by_layer))
    else:
        read = _read(undecided, world, page)
        painted.append(read.rooms)
        layers = {layer: read.solid if layer == "walls" else MultiPolygon() for layer in SOLID_LAYERS}
        rooms |= read.is_rooms
        notices += read.notices
    if floors := by_layer[FLOOR_LAYER]:
        layers = _with_rooms(layers, floors)
    if openings := by_layer[DOORS_LAYER]:
        cuts = united(_area(shape) for shape in openings)
        layers = {layer: opened(shape, cuts) for layer, shape in layers.items()}
    if world.despeckle:
        layers = {layer: _without_specks(shape, world.despeckle) for layer, shape in layers.items()}
    unknown = united(_area(shape) for shape in by_layer[UNKNOWN_LAYER])
    if all(layer.is_empty for layer in layers.values()) and (unknown.is_empty or world.unknown != "wall"):
        raise InputError(
            f"{drawing.name}: nothing in it is solid{drawing.nothing}; draw the walls as filled shapes or as strokes"
        )
    walls = united(layers.values()) if drawing.says_solid else joined(layers.values())
    ground, made = united(painted), MadeDoors((), MultiPolygon())
    width = world.doors if world.doors is not None else DOOR if rooms else 0.0
    if width:
        fixed = walls if layers["furniture"].is_empty else joined([layers["walls"], layers["pillars"]])
        made = make_doors(fixed, width, ground)  # the inside of furniture is not a room
    if made.doors:
        layers = {layer: opened(shape, made.cuts) for layer, shape in layers.items()}
        walls = opened(walls, made.cuts)
        doors = "1 door was" if len(made.doors) == 1 else f"{len(made.doors)} doors were"
        notices.append(f"{doors} of {width:g} m made, for rooms that are drawn closed; world.doors = 0 makes none")
    if world.unknown == "wall" and not unknown.is_empty:
        walls = joined([walls, unknown])
    spawns: dict[str, MultiPolygon] = {}
    for name in dict.fromkeys(shape.spawn for shape in by_layer[SPAWN_LAYER]):
        spawns[name] = united(_area(shape) for shape in by_layer[SPAWN_LAYER] if shape.spawn == name)
    told = tuple(f"{drawing.name}: {notice}" for notice in notices)
    guessed = not drawing.says_solid and not by_layer[FLOOR_LAYER]
    return FloorPlan(walls, layers, spawns, page, unknown, told, openings=made.boxes(), painted=ground, guessed=guessed)


def _area(shape: Shape) -> MultiPolygon:
    """The whole paint of a shape."""
    return joined([shape.fill, shape.stroke])


def _layer(shapes: Sequence[Shape], world: World, page: Box) -> list[MultiPolygon]:
    """The area of a solid layer's shapes."""
    return [_strokes(shapes, page, 0.0)] if world.solid == "strokes" else [_area(shape) for shape in shapes]


def _read(shapes: Sequence[Shape], world: World, page: Box) -> Read:
    """The solids among shapes without layers."""
    whole = [_fills(shape, page) for shape in shapes]
    paper, shown = (
        [shape for shape, fills in zip(shapes, whole, strict=True) if fills is own] for own in (True, False)
    )
    ground = paper[-1].fill_ink if paper else 0.0
    notes = [f"{paper[-1].where} fills the page and is taken for its paper, not for a wall"] if paper else []
    if not shown:
        return Read(NOTHING, NOTHING, False, notes)
    if world.solid != "all":
        shown = [*_rims(paper, shown), *shown]
        shown, frames = _without_frames(shown, page, ground)
        shown, faint = _without_faint(shown, ground)
        notes += [*frames, *faint]
    drawn, symbols = cut_by_symbols(shown)
    share = 0.0 if world.solid == "all" else _share_of_rooms(drawn, page, ground)
    rooms = world.solid == "strokes" or share > 0.0
    if share:
        notes.append(
            f"filled areas cover {100.0 * share:.0f} % of the building: its strokes are taken for walls and its fills "
            'for floor (world.solid = "strokes"); world.solid = "all" takes all of it for walls'
        )
    elif not rooms:
        number = "its visible shape is a wall" if len(shown) == 1 else f"all {len(shown)} visible shapes are walls"
        notes.append(f"it has no layer of {', '.join(SOLID_LAYERS)}, so that {number}")
    solid = _strokes(drawn, page, ground) if rooms else _all(drawn, ground)
    inner = inward(symbols, solid)
    if inner:
        count = "1 door symbol cuts" if len(inner) == 1 else f"{len(inner)} door symbols cut"
        notes.append(f"{count} the walls")
        solid = opened(solid, shapely.union_all(inner))
    if outer := len(symbols) - len(inner):
        count = "1 door symbol leads" if outer == 1 else f"{outer} door symbols lead"
        notes.append(f"{count} outside, where walls that run on stay closed")
    painted = united(shape.fill for shape in drawn if _is_light(shape, ground)) if rooms else NOTHING
    return Read(solid, painted, rooms, notes)


def _fills(shape: Shape, page: Box) -> bool:
    """Whether a shape is as large as the page."""
    left, low, right, high = page
    if shape.fill.area < 0.999 * (right - left) * (high - low):
        return False
    inner = shapely.buffer(shapely.box(*page), -1e-3 * max(right - left, high - low))
    return bool(shape.fill.covers(inner))


def _rims(paper: Sequence[Shape], shapes: Sequence[Shape]) -> list[Shape]:
    """The strokes around page-filling shapes, if they are walls: another shape is within a wall's thickness."""
    rims = [replace(shape, fill=NOTHING) for shape in paper if not shape.stroke.is_empty]
    tree = shapely.STRtree([_area(shape) for shape in shapes])
    return [rim for rim in rims if len(tree.query(rim.stroke, predicate="dwithin", distance=THICK))]


def _without_frames(shapes: list[Shape], page: Box, ground: float) -> tuple[list[Shape], list[str]]:
    """The shapes without their sheet's frames, and notices of these.

    A frame is a thin rectangle around all else, with shapes that touch it, such as a title block. It holds a building:
    large, mostly free, and with thicker walls.
    """
    told = []
    while (found := _frame(shapes, page, ground)) is not None:
        frame, shapes = found
        left, low, right, high = frame.bounds
        told.append(
            f"a frame of {right - left:.3g} m x {high - low:.3g} m around the drawing is taken for that of its sheet; "
            'world.solid = "all" takes it for walls'
        )
    return shapes, told


def _frame(shapes: list[Shape], page: Box, ground: float) -> tuple[shapely.Polygon, list[Shape]] | None:
    """The outline of the outermost frame, and all shapes that are not part of it; None without a frame."""
    areas = np.array([_area(shape) for shape in shapes], object)
    bounds = shapely.bounds(areas)  # NaN for shapes of lines only
    low, high = np.nanmin(bounds[:, :2], axis=0, initial=np.inf), np.nanmax(bounds[:, 2:], axis=0, initial=-np.inf)
    edge: NDArray[np.bool_] = ((bounds[:, :2] <= low + _NEAR) | (bounds[:, 2:] >= high - _NEAR)).any(axis=1)
    piece = connected(areas)
    own: NDArray[np.bool_] = piece == piece[edge.argmax()]
    if not edge.any() or own.all() or not own[edge].all():
        return None
    whole = polygons(shapely.union_all(areas[own]))
    outline = max((shapely.Polygon(part.exterior) for part in whole.geoms), key=lambda part: part.area)
    if outline.area < 0.99 * outline.envelope.area or _breadth(whole) > SHEET:
        return None
    rest = [shape for shape, framed in zip(shapes, own, strict=True) if not framed]
    walls = _strokes(rest, page, ground)
    large = [part for part in walls.geoms if shapely.convex_hull(part).area >= max(BUILDING * outline.area, FURNITURE)]
    building = max(map(polygons, large), key=_breadth, default=NOTHING)
    free = building.area < ROOMS[0] * shapely.convex_hull(building).area
    apart = shapely.distance(outline.exterior, building) > THICK and _breadth(whole) <= 0.5 * _breadth(building)
    return (outline, rest) if free and apart else None


def _without_faint(shapes: list[Shape], ground: float) -> tuple[list[Shape], list[str]]:
    """The shapes without strokes too faint for walls, as of a grid, if there are darker ones, and a notice."""
    inks = np.array([0.0 if shape.stroke.is_empty else abs(shape.stroke_ink - ground) for shape in shapes])
    faint = (inks > PAPER) & (inks < STROKE_INK)
    if not faint.any() or inks.max() < 2.0 * STROKE_INK:
        return shapes, []
    kept = [replace(one, stroke=NOTHING, lines=()) if pale else one for one, pale in zip(shapes, faint, strict=True)]
    count = "1 faint stroke is" if faint.sum() == 1 else f"{faint.sum()} faint strokes are"
    return kept, [f'{count} taken for a grid or a mark, not for walls; world.solid = "all" takes all for walls']


def _all(shapes: Sequence[Shape], ground: float) -> MultiPolygon:
    """All paint; shapes of the paper's colour cut those below."""
    ink = [(number, _area_of_ink(shape, ground, PAPER, PAPER)) for number, shape in enumerate(shapes)]
    covers = [(number, _area_of_paper(shape, ground, PAPER, PAPER)) for number, shape in enumerate(shapes)]
    return _painted(ink, covers)


def _strokes(shapes: Sequence[Shape], page: Box, ground: float) -> MultiPolygon:
    """Dark strokes and thin dark fills; all other opaque paint covers shapes below."""
    ink, covers = [], []
    for number, shape in enumerate(shapes):
        dark = abs(shape.fill_ink - ground) >= FILL_INK and _breadth(shape.fill) < WIDE
        filled = FILL_INK if dark else np.inf
        ink.append((number, _area_of_ink(shape, ground, filled, STROKE_INK)))
        covers.append((number, _area_of_paper(shape, ground, filled, STROKE_INK)))
    return _painted(ink, covers)


def _area_of_ink(shape: Shape, ground: float, fill: float, stroke: float) -> MultiPolygon:
    """A shape's paint that differs from the paper's ink `ground` by at least the given contrasts."""
    parts = [shape.fill] if abs(shape.fill_ink - ground) >= fill else []
    parts += [shape.stroke] if abs(shape.stroke_ink - ground) >= stroke else []
    return joined(parts)


def _area_of_paper(shape: Shape, ground: float, fill: float, stroke: float) -> MultiPolygon:
    """A shape's other opaque paint, without the part under its own stroke."""
    stroked = abs(shape.stroke_ink - ground) >= stroke
    parts = [shape.fill] if shape.opaque and abs(shape.fill_ink - ground) < fill else []
    parts += [shape.stroke] if not stroked and not shape.stroke.is_empty else []
    return joined(parts)


def _painted(ink: list[tuple[int, MultiPolygon]], covers: list[tuple[int, MultiPolygon]]) -> MultiPolygon:
    """The union of ink, each without the covers of later shapes."""
    ink = [(number, shape) for number, shape in ink if not shape.is_empty]
    covers = [(number, shape) for number, shape in covers if not shape.is_empty]
    if not covers or not ink:
        return united(shape for _, shape in ink)
    tree = shapely.STRtree([shape for _, shape in covers])
    order = np.array([number for number, _ in covers])
    left, found = tree.query([shape for _, shape in ink], predicate="intersects")
    later = order[found] > np.array([number for number, _ in ink])[left]
    hidden: defaultdict[int, list[BaseGeometry]] = defaultdict(list)
    for which, cover in zip(left[later], found[later], strict=True):
        hidden[int(which)].append(covers[cover][1])
    return united(
        shape if number not in hidden else shapely.difference(shape, shapely.union_all(hidden[number]))
        for number, (_, shape) in enumerate(ink)
    )


def _share_of_rooms(shapes: Sequence[Shape], page: Box, ground: float) -> float:
    """The share of the building covered by fills of rooms, if it is plainly a plan of rooms, and 0 otherwise.

    Rooms are wide and light, most of the building is painted, and its strokes follow most of their borders: strokes
    alone would make no walls otherwise.
    """
    light = [shape.fill for shape in shapes if _is_light(shape, ground)]
    if not light:
        return 0.0
    whole = shapely.union_all([_area(shape) for shape in shapes])
    hull = shapely.convex_hull(whole).area
    share = float(shapely.union_all(light).area / hull)
    if whole.area <= ROOMS[0] * hull or share < ROOMS[1]:
        return 0.0
    walls = _strokes(shapes, page, ground)
    if len(light) < ROOMS[2]:
        enclosed = shapely.intersection(shapely.union_all(light), shapely.convex_hull(walls)).area
        return share if enclosed >= AROUND * share * hull else 0.0
    near = shapely.buffer(walls, 0.02)
    borders = shapely.boundary(np.array(light))
    lined = shapely.length(shapely.intersection(borders, near)) >= 0.5 * shapely.length(borders)
    return share if lined.mean() >= 0.5 else 0.0


def _is_light(shape: Shape, ground: float) -> bool:
    """Whether a shape has a room's fill: wide, and not black."""
    return _breadth(shape.fill) >= WIDE and abs(shape.fill_ink - ground) < BLACK


def _breadth(shape: MultiPolygon) -> float:
    """2 area / perimeter (m), the width of a long shape; 0 for an empty one."""
    return 2.0 * shape.area / shape.length if shape.length else 0.0


def _with_rooms(layers: dict[str, MultiPolygon], floors: Sequence[Shape]) -> dict[str, MultiPolygon]:
    """The layers with rooms, which cover solids and have walls along their borders."""
    borders = [
        shape.stroke
        if not shape.stroke.is_empty
        else polygons(shapely.buffer(shape.fill.boundary, PARTITION / 2.0, join_style="mitre", cap_style="flat"))
        for shape in floors
    ]
    covered = shapely.union_all([shape.fill for shape in floors])
    kept = {layer: polygons(shapely.difference(shape, covered)) for layer, shape in layers.items()}
    return {**kept, "walls": united([kept["walls"], *borders])}


def _without_specks(shape: MultiPolygon, least: float) -> MultiPolygon:
    """A layer without pieces smaller than `least` (m2)."""
    return MultiPolygon([piece for piece in shape.geoms if piece.area >= least])


def _decoration(shapes: Sequence[Shape], by_layer: dict[str, list[Shape]]) -> str:
    """The contents of a drawing with layers outside of them."""
    solid = [shape for layer in SOLID_LAYERS for shape in by_layer[layer]]
    ink = sum(_area(shape).area for shape in shapes)
    total = ink + sum(_area(shape).area for shape in solid)
    groups = Counter(shape.group for shape in shapes)
    listed = ", ".join(f"{f'`{group}`' if group else 'no layer'} {count}" for group, count in groups.most_common(6))
    more = f" and {len(groups) - 6} more" if len(groups) > 6 else ""
    first = next((group for group, _ in groups.most_common() if group), "")
    hint = f'; if walls are among it, say so: world.layers = {{walls = ["{first}"]}}' if first else ""
    count = "1 visible shape" if len(shapes) == 1 else f"{len(shapes)} visible shapes"
    share = 100.0 * ink / total if total else 0.0
    return (
        f"{count} outside of its layers, {share:.0f} % of what is drawn, {'is' if len(shapes) == 1 else 'are'} "
        f"decoration ({listed}{more}){hint}"
    )
