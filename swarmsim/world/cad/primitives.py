"""The entities of a DXF file, one by one, as lines and fills in the file's own unit."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, cast

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, affinity
from shapely.geometry.base import BaseGeometry

from swarmsim.core.errors import InputError
from swarmsim.world.areas import polygons
from swarmsim.world.shapes import NOTHING, Line

if TYPE_CHECKING:
    from ezdxf.document import Drawing
    from ezdxf.entities.circle import Circle
    from ezdxf.entities.dxfgfx import DXFGraphic
    from ezdxf.entities.insert import Insert
    from ezdxf.entities.lwpolyline import LWPolyline
    from ezdxf.entities.polygon import DXFPolygon
    from ezdxf.entities.polyline import Polyline
    from ezdxf.math import Vec3

MOST: Final = 100_000  # things in a drawing; blocks may multiply a small file endlessly
_DEEPEST: Final = 50  # blocks within blocks
_FARTHEST: Final = 1e15  # units, beyond which numbers have no digits left
_CURVED: Final = 1e7  # flatnesses, the largest size of a curve; its chords already number thousands
_CHORDS: Final = 6  # of an arc, at least, to recognise door swings
_LINES: Final = "LINE LWPOLYLINE POLYLINE ARC CIRCLE ELLIPSE SPLINE HELIX"
_FILLS: Final = "SOLID TRACE HATCH MPOLYGON"
_NOTES: Final = (
    "TEXT MTEXT ATTRIB ATTDEF DIMENSION ARC_DIMENSION LARGE_RADIAL_DIMENSION LEADER MULTILEADER MLEADER TOLERANCE "
    "ACAD_TABLE POINT RAY XLINE VIEWPORT LIGHT SUN CAMERA SECTION RTEXT ARCALIGNEDTEXT GEOPOSITIONMARKER SEQEND"
)
_UNPLOTTED: Final = "defpoints"  # the layer that no program prints


@dataclass(frozen=True, slots=True, eq=False)
class Primitive:
    """One thing that a DXF file shows, in its unit until it is scaled."""

    layer: str  # the DXF layer
    where: str  # as in `LINE 2F`
    lines: tuple[Line, ...] = ()
    pen: float = 0.0  # the width of its lines, 0 for hairlines
    stroke: MultiPolygon = NOTHING  # the area of a pen of that width
    fill: MultiPolygon = NOTHING
    brightness: int = 0  # of the fill's brightest colour channel, up to 255

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """Left, lower, right, upper."""
        boxes = [(*line.min(axis=0), *line.max(axis=0)) for line in self.lines]
        boxes += [area.bounds for area in (self.fill, self.stroke) if not area.is_empty]
        left, low, right, high = np.array(boxes).T
        return float(left.min()), float(low.min()), float(right.max()), float(high.max())

    def scaled(self, factor: float) -> Primitive:
        """The same, times `factor`."""
        return replace(
            self,
            lines=tuple(line * factor for line in self.lines),
            pen=self.pen * factor,
            stroke=affinity.scale(self.stroke, factor, factor, origin=(0.0, 0.0)),
            fill=affinity.scale(self.fill, factor, factor, origin=(0.0, 0.0)),
        )

    def shifted(self, x: float, y: float) -> Primitive:
        """The same, moved by (dx, dy)."""
        return replace(
            self,
            lines=tuple(line + np.array([x, y]) for line in self.lines),
            stroke=affinity.translate(self.stroke, x, y),
            fill=affinity.translate(self.fill, x, y),
        )


class Entities:
    """Finds the visible things in a document's model space, and counts those ignored."""

    def __init__(self, document: Drawing, name: str) -> None:
        """`name`: of the file in messages."""
        self._document = document
        self._name = name
        self._layers = {layer.dxf.name.casefold(): layer for layer in document.layers}
        self._forget()

    def primitives(self, flatness: float) -> Iterator[Primitive]:
        """All visible things, in the order of the file; curves become chords, at most `flatness` away.

        Raises InputError for more than `MOST`.
        """
        self._forget()
        yield from self._seen(self._document.modelspace(), "", flatness, 0)

    def told(self) -> list[str]:
        """What the last call of `primitives` ignored, in sentences."""
        told = []
        if self._hidden:
            told.append(
                "what is invisible, or in layers that are frozen or off, does not count: by layer, "
                f"{_listed(self._hidden)}"
            )
        if self._notes:
            told.append(f"{_listed(self._notes)} are passed over: none of these is a wall")
        if self._foreign:
            told.append(
                f"{_listed(self._foreign)} cannot be read as lines; explode them, or export to plain 2D, if "
                "they are walls"
            )
        if self._elsewhere:
            told.append(
                f"other drawings that it refers to are not read ({_listed(self._elsewhere)}); bind them to have them in"
            )
        return told

    def nothing(self) -> str:
        """Why nothing is visible."""
        if self._elsewhere or self._foreign or self._hidden:
            return "nothing in its model space can be a wall; " + "; ".join(self.told())
        if any(len(layout) for layout in self._document.layouts if layout.name != "Model"):
            return "its model space shows nothing that can be a wall, and layouts are not read; draw in model space"
        return "its model space shows nothing that can be a wall; expected lines or solid fills"

    def _forget(self) -> None:
        self._count = 0
        self._hidden: Counter[str] = Counter()  # things, by layer
        self._notes: Counter[str] = Counter()  # things, by kind
        self._foreign: Counter[str] = Counter()  # things, by kind
        self._elsewhere: Counter[str] = Counter()  # insertions, by file

    def _seen(self, entities: Iterable[DXFGraphic], above: str, flatness: float, depth: int) -> Iterator[Primitive]:
        """The visible entities; things in layer 0 are in the layer `above`, that of their block's insertion."""
        for entity in entities:
            self._count += 1
            if self._count > MOST:
                raise InputError(f"{self._name}: holds more than {MOST} things; simplify it")
            kind = entity.dxftype()
            own = str(entity.dxf.get("layer", "0"))
            layer = above if above and own == "0" else own
            if kind == "INSERT":
                yield from self._inserted(cast("Insert", entity), layer, flatness, depth)
            elif kind in _NOTES.split():
                self._notes[kind] += 1
            elif self._is_hidden(layer) or entity.dxf.get("invisible", 0):
                self._hidden[layer] += 1
            elif kind in _LINES.split():
                yield from self._line(entity, layer, flatness)
            elif kind in _FILLS.split():
                yield from self._filled(entity, layer, flatness)
            elif (parts := self._parts(entity)) and depth < _DEEPEST:
                yield from self._seen(parts, layer, flatness, depth + 1)
            else:
                self._foreign[kind] += 1

    def _inserted(self, insert: Insert, layer: str, flatness: float, depth: int) -> Iterator[Primitive]:
        """The visible things of a block at each of its insertions."""
        from ezdxf.xclip import XClip

        block = insert.block()
        if self._is_frozen(layer) or insert.dxf.get("invisible", 0):
            self._hidden[layer] += 1
            return
        if block is None or block.block is None:
            self._foreign["INSERT of a block that is not there"] += 1
            return
        if block.block.is_xref:
            self._elsewhere[str(block.block.dxf.get("xref_path", "")) or insert.dxf.name] += 1
            return
        if depth >= _DEEPEST:
            raise InputError(f"{self._name}: blocks stand in each other more than {_DEEPEST} deep; explode them")
        if insert.mcount > MOST:
            raise InputError(f"{self._name}: holds more than {MOST} things; simplify it")
        clip = XClip(insert)
        window = None
        if clip.has_clipping_path and clip.is_clipping_enabled and not clip.is_inverted_clip:
            window = _area([np.array([(v.x, v.y) for v in clip.get_wcs_clipping_path().vertices])])
        for one in insert.multi_insert() if insert.mcount > 1 else (insert,):
            for shown in self._seen(one.virtual_entities(), layer, flatness, depth + 1):
                clipped = shown if window is None else _clipped(shown, window)
                if clipped is not None:
                    yield clipped

    def _line(self, entity: DXFGraphic, layer: str, flatness: float) -> Iterator[Primitive]:
        """A line of any kind, and its pen's area if it has a width."""
        from ezdxf.path import make_path

        kind = entity.dxftype()
        if kind == "POLYLINE" and not (
            cast("Polyline", entity).is_2d_polyline or cast("Polyline", entity).is_3d_polyline
        ):
            self._foreign["POLYLINE of faces"] += 1
            return
        path = make_path(entity)
        corners = np.array([(v.x, v.y) for v in path.control_vertices()]).reshape(-1, 2)
        if not self._is_real(corners, kind, flatness if path.has_curves else math.inf):
            return
        chords = _chords(cast("Circle", entity), flatness) if kind in ("ARC", "CIRCLE") else path.flattening(flatness)
        line = np.array([(v.x, v.y) for v in chords]).reshape(-1, 2)
        line = line[np.append(True, np.any(np.diff(line, axis=0), axis=1))] if len(line) else line
        pen, stroke = 0.0, NOTHING
        if kind in ("LWPOLYLINE", "POLYLINE"):
            pen, stroke = _pen(cast("LWPolyline | Polyline", entity), line)
        if len(line) > 1:
            yield Primitive(layer, _where(entity), (line,), pen, stroke)

    def _filled(self, entity: DXFGraphic, layer: str, flatness: float) -> Iterator[Primitive]:
        """A solid fill; patterns are ignored."""
        from ezdxf.path import from_hatch

        kind = entity.dxftype()
        if kind in ("SOLID", "TRACE"):
            rings = [np.array([(v.x, v.y) for v in entity.wcs_vertices()])]  # type: ignore[attr-defined]
        else:
            hatch = cast("DXFPolygon", entity)
            if not (hatch.dxf.get("solid_fill", 0) or hatch.has_gradient_data):
                self._notes[f"{kind} of a pattern"] += 1
                return
            rings = []
            for path in from_hatch(hatch):
                corners = np.array([(v.x, v.y) for v in path.control_vertices()]).reshape(-1, 2)
                if self._is_real(corners, kind, flatness if path.has_curves else math.inf):
                    rings.append(np.array([(v.x, v.y) for v in path.flattening(flatness)]).reshape(-1, 2))
        if all(self._is_real(ring, kind, math.inf) for ring in rings):
            fill = _area(rings)
            if not fill.is_empty:
                yield Primitive(layer, _where(entity), fill=fill, brightness=self._brightness(entity, layer))

    def _parts(self, entity: DXFGraphic) -> list[DXFGraphic]:
        """A program-specific entity, if the file gives it as lines; otherwise nothing."""
        from ezdxf.protocols import SupportsVirtualEntities, virtual_entities

        return list(virtual_entities(entity)) if isinstance(entity, SupportsVirtualEntities) else []

    def _is_real(self, corners: Line, kind: str, flatness: float) -> bool:
        """Whether a thing has finite corners, and is not a curve of far too many chords; notes it otherwise."""
        real = bool(len(corners)) and bool(np.isfinite(corners).all()) and bool(np.abs(corners).max() < _FARTHEST)
        real = real and (flatness == math.inf or float(np.ptp(corners, axis=0).max()) < _CURVED * flatness)
        if not real:
            self._foreign[f"{kind} without a place"] += 1
        return real

    def _is_frozen(self, name: str) -> bool:
        layer = self._layers.get(name.casefold())
        return layer is not None and bool(layer.is_frozen())

    def _is_hidden(self, name: str) -> bool:
        layer = self._layers.get(name.casefold())
        return name.casefold() == _UNPLOTTED or (layer is not None and bool(layer.is_frozen() or layer.is_off()))

    def _brightness(self, entity: DXFGraphic, layer: str) -> int:
        """The brightest channel of a colour, of 255; black for the colour that is white on black screens."""
        from ezdxf import colors

        if entity.rgb is not None:
            return max(entity.rgb)
        index = int(entity.dxf.get("color", colors.BYLAYER))
        own = self._layers.get(layer.casefold())
        if index in (colors.BYLAYER, colors.BYBLOCK):
            if own is not None and own.rgb is not None:
                return max(own.rgb)
            index = abs(int(own.dxf.color)) if own is not None else 7
        return 0 if index == 7 or not 0 < index < 256 else max(colors.aci2rgb(index))


def _chords(circle: Circle, flatness: float) -> Iterator[Vec3]:
    """The corners of a circle or an arc, exactly on it (a path has Bezier curves), and never only a few."""
    if circle.dxftype() == "ARC":
        turn = math.radians((circle.dxf.end_angle - circle.dxf.start_angle) % 360.0) or math.tau
        fine = abs(float(circle.dxf.radius)) * (1.0 - math.cos(turn / (2.0 * _CHORDS)))
        flatness = min(flatness, fine) or flatness
    return iter(circle.flattening(flatness))


def _pen(entity: LWPolyline | Polyline, line: Line) -> tuple[float, MultiPolygon]:
    """The width of a polyline, the middle one if it varies, and the area of a pen of that width."""
    from ezdxf.render.trace import TraceBuilder

    widths = np.abs(_widths(entity))
    if len(line) < 2 or not widths.any() or not np.isfinite(widths).all():
        return 0.0, NOTHING
    pen = float(np.median(widths))
    if np.ptp(widths) < 1e-6 * widths.max():
        closed = len(line) > 3 and bool((line[0] == line[-1]).all())
        path = shapely.LinearRing(line) if closed else shapely.LineString(line)
        return pen, polygons(shapely.buffer(path, pen / 2.0, cap_style="flat", join_style="mitre"))
    faces = TraceBuilder.from_polyline(entity).polygons_wcs(entity.ocs(), 0.0)
    parts = [_area([np.array([(v.x, v.y) for v in face])]) for face in faces]
    return pen, polygons(shapely.union_all(parts))


def _widths(entity: LWPolyline | Polyline) -> NDArray[np.float64]:
    """The widths of a polyline at the starts and ends of its parts, in the file's unit."""
    if entity.dxftype() == "LWPOLYLINE":
        flat = cast("LWPolyline", entity)
        same = flat.dxf.get("const_width", 0.0)
        widths = [(same, same) if same else point[2:4] for point in flat.lwpoints]
        closed = flat.closed
    else:
        whole = cast("Polyline", entity)
        if not whole.is_2d_polyline:
            return np.zeros(1)
        first, last = (whole.dxf.get(f"default_{end}_width", 0.0) for end in ("start", "end"))
        widths = [(v.dxf.get("start_width", first), v.dxf.get("end_width", last)) for v in whole.vertices]
        closed = whole.is_closed
    return np.array(widths if closed else widths[:-1], dtype=np.float64).ravel()


def _area(rings: list[Line]) -> MultiPolygon:
    """The inside of rings, where a ring within another is a hole."""
    area: BaseGeometry = NOTHING
    for ring in rings:
        if len(np.unique(ring, axis=0)) >= 3:
            area = shapely.symmetric_difference(area, shapely.make_valid(shapely.Polygon(ring)))
    return polygons(area)


def _clipped(shown: Primitive, window: MultiPolygon) -> Primitive | None:
    """The part of a thing within the window, or None."""
    cut = shapely.get_parts(shapely.intersection([shapely.LineString(line) for line in shown.lines], window))
    lines = tuple(shapely.get_coordinates(part) for part in cut if part.length > 0.0)
    stroke, fill = (polygons(shapely.intersection(area, window)) for area in (shown.stroke, shown.fill))
    if not lines and fill.is_empty:
        return None
    return replace(shown, lines=lines, stroke=stroke, fill=fill)


def _where(entity: DXFGraphic) -> str:
    handle = entity.dxf.get("handle")
    return f"{entity.dxftype()} {handle}" if handle else entity.dxftype()


def _listed(counts: Counter[str]) -> str:
    most = counts.most_common(8)
    more = f" and {len(counts) - 8} more" if len(counts) > 8 else ""
    return ", ".join(f"{count} {name}" for name, count in most) + more
