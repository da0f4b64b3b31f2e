"""Floor plans in DXF files, as CAD programs write them."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
import shapely
from shapely import MultiPolygon
from shapely.geometry.base import BaseGeometry

from swarmsim.core.errors import InputError
from swarmsim.core.scenario.file import World
from swarmsim.world.areas import polygons
from swarmsim.world.cad.conventions import Conventions
from swarmsim.world.cad.primitives import Entities, Primitive
from swarmsim.world.cavities import Cavities, cavities
from swarmsim.world.outlines import FLATNESS
from swarmsim.world.plan import DOORS_LAYER, FLOOR_LAYER, SOLID_LAYERS, SPAWN_LAYER, UNKNOWN_LAYER
from swarmsim.world.shapes import NOTHING, Drawing, Line, Shape
from swarmsim.world.sites import kept, moved

if TYPE_CHECKING:
    from ezdxf.document import Drawing as Document

WALL: Final = 0.1  # m, the pen of a line without a width that is a wall by itself
THIN: Final = 0.02  # m, the pen of a line that is the side of a wall, or of something else
_AREAS: Final = (SPAWN_LAYER, UNKNOWN_LAYER, DOORS_LAYER, FLOOR_LAYER)  # the inside of their outlines counts
_NARROW: Final = 0.6  # m, twice the area by the outline: a wider fill is a room's colour, unless it is black
_BLACK: Final = 80  # of 255, the brightest channel of a black colour
_MARKS: Final = {b"AC10": "DWG", b"%PDF": "PDF"}


def read(path: Path, world: World) -> Drawing:
    """The contents of a DXF file's model space, in metres by its unit ($INSUNITS).

    `world.scale` multiplies the metres (the default unit of a file); `world.width` gives the width of the whole
    drawing. Things in layer 0 of a block are in the layer of its insertion. Frozen layers, those turned off and
    invisible things do not count, nor do texts, dimensions, points and hatches other than solid fills. A solid fill
    counts if its layer is solid, and otherwise if it is narrow, like a wall, or black.

    A line with a width has a pen of that width. Lines without one are walls in two ways. Two side by side, 0.05 to
    0.6 m apart, are the sides of a wall: their inside is filled, and sides that enclose nothing get a pen of 0.02 m.
    Any other such line is a wall by itself, 0.1 m thick, unless its layer says otherwise.

    `group` is the name of the DXF layer, `layer` its meaning by `world.layers`, `world.floor` or a usual name.
    Symbols of doors have no layer.

    Raises InputError, with the file and what would be right.
    """
    document, notices = _opened(path)
    unit, metre = _unit(document)
    factor = metre * (world.scale or 1.0)
    entities = Entities(document, str(path))
    with _quiet(path):
        if world.width is not None:
            rough, _ = kept(list(entities.primitives(1e9)))
            factor = world.width / _across(rough, path)
        drawn = list(entities.primitives(FLATNESS / factor))
    drawn, strays = kept(drawn)
    if not unit and world.scale is None and world.width is None:
        notices.append(
            "it does not say its unit ($INSUNITS is 0), which is taken to be the metre; say world.scale, as in "
            "0.001 for millimetres, or world.width in metres"
        )
    notices += [*entities.told(), *strays]
    if not drawn:
        raise InputError(f"{path}: {entities.nothing()}")
    drawn, shift = moved([one.scaled(factor) for one in drawn], str(path))
    known = dict.fromkeys([*(layer.dxf.name for layer in document.layers), *(one.layer for one in drawn)])
    names = Conventions(known, world, str(path))
    shapes = [shape for shape in _shapes(drawn, names, notices) if not _is_blank(shape)]
    if not shapes:
        raise InputError(f"{path}: nothing in it can be a wall; expected lines or solid fills in its model space")
    solids = [area for shape in shapes for area in (shape.fill, shape.stroke)]
    left, low, right, high = shapely.total_bounds(
        [*solids, *(shapely.LineString(line) for shape in shapes for line in shape.lines)]
    ).tolist()
    says_solid = any(shape.layer in SOLID_LAYERS for shape in shapes)
    return Drawing(str(path), tuple(shapes), (left, low, right, high), unit, (*notices, *shift), says_solid)


def _shapes(drawn: Sequence[Primitive], names: Conventions, notices: list[str]) -> Iterator[Shape]:
    """The shapes, lowest first, then the insides of walls with two sides."""
    known = {name: (names.layer_of(name), names.draws_doors(name)) for name in {one.layer for one in drawn}}
    walls = _Walls(drawn, [None if known[one.layer][1] else known[one.layer][0] for one in drawn])
    colours = leaves = 0
    for i, one in enumerate(drawn):
        layer, is_door = known[one.layer]
        pen, fill, stroke = one.pen or float(walls.pens[i]), one.fill, one.stroke
        if not fill.is_empty and (is_door or not (layer or _is_wall(one))):
            leaves, colours, fill = leaves + is_door, colours + (not is_door), NOTHING
        if layer in _AREAS:
            rings = [shapely.Polygon(line) for line in one.lines if _is_closed(line)]
            fill, stroke = polygons(shapely.union_all([fill, *shapely.make_valid(np.array(rings, object))])), NOTHING
        elif not one.pen:
            stroke = _drawn(one.lines, pen, walls.within[i])
        yield Shape(
            fill=fill,
            stroke=stroke,
            opaque=False,
            layer=layer,
            group=one.layer,
            spawn=one.layer if layer == SPAWN_LAYER else "",
            lines=one.lines,
            pen=pen if one.lines else 0.0,
            where=one.where,
        )
    yield from walls.insides
    if colours:
        notices.append(
            f"solid fills that are wider than {_NARROW:g} m and not black, in layers that are no walls, are passed "
            f"over as the colours of rooms ({colours})"
        )
    if leaves:
        notices.append(f"solid fills in layers of doors are passed over ({leaves})")


class _Walls:
    """The meaning of lines without a width: pens for them, and the insides of walls with two sides."""

    def __init__(self, drawn: Sequence[Primitive], layers: Sequence[str | None]) -> None:
        """`layers` has the layer of each thing; None for symbols of doors."""
        self.pens = np.full(len(drawn), THIN)  # m
        self.within: list[list[BaseGeometry]] = [[] for _ in drawn]  # where they need no pen
        self.insides: list[Shape] = []
        hairlines = [(i, line) for i, one in enumerate(drawn) if not one.pen for line in one.lines]
        for layer in ("", "walls"):
            own = [(i, line) for i, line in hairlines if layers[i] == layer]
            found = cavities([line for _, line in own], [line for i, line in hairlines if layers[i] != layer])
            self.pens[[i for (i, _), paired in zip(own, found.paired, strict=True) if not paired]] = WALL
            for inside, beside in zip(found.between, found.beside, strict=True):
                fill, group = MultiPolygon([inside]), drawn[own[beside][0]].layer
                where = "the inside of a wall"
                self.insides.append(Shape(fill=fill, opaque=False, layer=layer, group=group, where=where))
            for i, inside in _along(own, found):
                self.within[i].append(inside)


def _along(own: Sequence[tuple[int, Line]], found: Cavities) -> Iterator[tuple[int, BaseGeometry]]:
    """Each shape that touches the inside of a wall, with that inside, slightly enlarged: it needs no pen there."""
    if len(found.between):
        grown = shapely.buffer(found.between, FLATNESS, join_style="mitre")
        lines = np.array([shapely.LineString(line) for _, line in own], object)
        for line, inside in shapely.STRtree(grown).query(lines, predicate="intersects").T:
            yield own[line][0], grown[inside]


def _drawn(lines: Sequence[Line], pen: float, within: Sequence[BaseGeometry]) -> MultiPolygon:
    """The area of a pen along lines, except where they border the inside of a wall."""
    shown = np.array([_ring(line) for line in lines], object)
    for inside in within:
        shown = shapely.difference(shown, inside)
    drawn = shapely.buffer(shown, pen / 2.0, cap_style="flat", join_style="mitre")
    return polygons(drawn[0] if len(drawn) == 1 else shapely.union_all(drawn))


def _ring(line: Line) -> BaseGeometry:
    return shapely.LinearRing(line) if _is_closed(line) else shapely.LineString(line)


def _is_closed(line: Line) -> bool:
    return len(line) > 3 and bool((line[0] == line[-1]).all())


def _is_wall(one: Primitive) -> bool:
    """Whether a fill in an unknown layer is a wall."""
    return one.brightness <= _BLACK or 2.0 * one.fill.area < _NARROW * one.fill.length


def _is_blank(shape: Shape) -> bool:
    return shape.fill.is_empty and shape.stroke.is_empty and not shape.lines


def _across(drawn: Sequence[Primitive], path: Path) -> float:
    """The width of the whole drawing, in the file's units."""
    left, _, right, _ = np.array([one.bounds for one in drawn]).T if drawn else np.zeros((4, 1))
    if not right.max() > left.min():
        raise InputError(f"{path}: nothing in it is wide, so that world.width says nothing; expected walls")
    return float(right.max() - left.min())


def _unit(document: Document) -> tuple[str, float]:
    """The unit's name, empty for none, and its length in metres."""
    from ezdxf.enums import InsertUnits
    from ezdxf.units import conversion_factor, decode

    code = int(document.header.get("$INSUNITS", 0))
    try:
        metres = float(conversion_factor(InsertUnits(code), InsertUnits.Meters))
    except (ValueError, KeyError, TypeError, ZeroDivisionError):
        return "", 1.0
    return (str(decode(code)), metres) if code else ("", 1.0)


def _opened(path: Path) -> tuple[Document, list[str]]:
    """The document in a file, repaired if damaged. Raises InputError."""
    try:
        from ezdxf import recover
        from ezdxf.filemanagement import readfile
        from ezdxf.lldxf.const import DXFError
    except ImportError as problem:
        raise InputError(
            f'world: {path.name} needs ezdxf; install it with: pip install "swarmsim-lab[cad]"'
        ) from problem
    try:
        with path.open("rb") as file:
            start = file.read(4)
    except OSError as problem:
        raise InputError(f"world: {path} cannot be read ({problem.strerror}); expected a DXF file") from problem
    if start in _MARKS:
        raise InputError(f"{path}: is a {_MARKS[start]} file; save the drawing as DXF")
    with _quiet(path):
        try:
            return readfile(path), []
        except (DXFError, ValueError, KeyError, AttributeError, TypeError, IndexError, OSError):
            document, auditor = recover.readfile(path)
        errors = len(auditor.errors) + len(auditor.fixes)
        return document, [f"it is damaged; {errors} faults were mended, so that something may be missing"]


@contextmanager
def _quiet(path: Path) -> Iterator[None]:
    """Hides the library's log, and reports any of its failures as one of the file."""
    log = logging.getLogger("ezdxf")
    silent, log.disabled = log.disabled, True
    try:
        yield
    except (InputError, MemoryError):
        raise
    except Exception as problem:
        raise InputError(
            f"{path}: not a DXF file that can be read ({type(problem).__name__}: {_first_line(problem)}); expected one "
            "as CAD programs write it"
        ) from None
    finally:
        log.disabled = silent


def _first_line(problem: Exception) -> str:
    return (str(problem).splitlines() or [""])[0][:120]
