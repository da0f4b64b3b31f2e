"""Building information models, cut at the robots' height: the work on IFC files, done in a separate process."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
import shapely
from shapely import MultiPolygon, affinity

from swarmsim.core.errors import InputError
from swarmsim.core.scenario.file import World
from swarmsim.world.areas import polygons
from swarmsim.world.bim.entities import Entity, Model
from swarmsim.world.bim.sections import section
from swarmsim.world.bim.storeys import chosen, storeys
from swarmsim.world.plan import DOORS_LAYER
from swarmsim.world.shapes import Drawing, Shape
from swarmsim.world.sites import moved

CUT: Final = 0.3  # m above the storey, the robots' height; higher up, windows on sills would be holes
_STEPS: Final = (0.1, 0.2)  # m, further cuts of stairs and ramps, so that robots do not climb the first step
_LAYERS: Final = {  # of solid classes, the first that fits; every other built class is `walls`
    "IfcColumn": "pillars",
    "IfcPile": "pillars",
    "IfcFurnishingElement": "furniture",
    "IfcFlowTerminal": "furniture",
    "IfcTransportElement": "furniture",
    "IfcTransportationDevice": "furniture",
    "IfcBuildingElementProxy": "furniture",
}
_BUILT: Final = ("IfcBuildingElement", "IfcBuiltElement", "IfcBuildingElementPart")
_PASSED_OVER: Final = ("IfcDoor", "IfcSlab", "IfcRoof", "IfcCovering", "IfcFooting")  # built, but no obstacles
_CLIMBED: Final = ("IfcStair", "IfcStairFlight", "IfcRamp", "IfcRampFlight")
_WELD: Final = 0.05  # m, around solids: gaps of twice that lead nowhere
_UNITS: Final = {0.001: "mm", 0.01: "cm", 0.1: "dm", 1.0: "m", 0.0254: "in", 0.3048: "ft"}


@dataclass(frozen=True, slots=True, eq=False)
class _Piece:
    """The area of one element at the cut."""

    area: MultiPolygon
    layer: str
    kind: str  # its class
    where: str
    outer: bool | None = None  # of a door, whether the file says that it is an outer one

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        left, low, right, high = self.area.bounds
        return left, low, right, high

    def shifted(self, x: float, y: float) -> _Piece:
        return replace(self, area=affinity.translate(self.area, x, y))

    def scaled(self, factor: float) -> _Piece:
        return replace(self, area=affinity.scale(self.area, factor, factor, origin=(0.0, 0.0)))


def cut(path: Path, world: World) -> Drawing:
    """The result of `ifc.read`, found in this process, which a damaged model may crash.

    Raises InputError, with the file and what would be right.
    """
    model = _opened(path)
    try:
        return _drawing(model, path, world)
    except (InputError, MemoryError):
        raise
    except Exception as problem:  # a broken model can raise anything here
        raise InputError(_broken(path, problem)) from None


def _drawing(model: Model, path: Path, world: World) -> Drawing:
    from ifcopenshell.util.unit import calculate_unit_scale

    metre = float(calculate_unit_scale(model))
    holders = _holders(model)
    walls, doors = (
        [holders[one.id()] for one in model.by_type(kind) if one.id() in holders] for kind in ("IfcWall", "IfcDoor")
    )
    levels = storeys(model, metre, walls, doors)
    if not levels:
        raise InputError(f"{path}: has no storey (IfcBuildingStorey); expected a building")
    storey, notices = chosen(levels, world.level, str(path))
    height = storey.height + CUT
    above = {one.id for one in levels if one.height > height}
    elements = [one for one in _elements(model) if holders.get(one.id()) not in above]
    geometry = _Geometry(model, height)
    pieces = list(geometry.pieces(elements))
    gaps, windows = _gaps(model, elements, geometry)
    pieces += windows
    if not pieces:
        others = [one for one in levels if one is not storey]
        there = f"; other storeys: {', '.join(map(str, others))}" if others else ""
        lost = f"; {geometry.lost()}" if geometry.lost() else ""
        raise InputError(f"{path}: nothing is solid {CUT} m above the storey {storey}{lost}{there}")
    outer = _leading_out([piece.area for piece in pieces], gaps)
    shut = [gap for gap, leads in zip(gaps, outer, strict=True) if leads]
    if shut and world.border is not False:
        pieces += [replace(gap, layer="walls") for gap in shut]
        gaps = [gap for gap, leads in zip(gaps, outer, strict=True) if not leads]
        notices.append(
            f"what leads out of the building is closed ({_listed(Counter(gap.kind for gap in shut))}); world.border = "
            "false leaves it open"
        )
    notices += geometry.told()
    factor = world.scale or 1.0
    if world.width is not None:
        left, _, right, _ = shapely.total_bounds([piece.area for piece in pieces]).tolist()
        factor = world.width / (right - left)
    pieces, shift = moved([piece.scaled(factor) for piece in [*pieces, *gaps]], str(path))
    left, low, right, high = shapely.total_bounds([piece.area for piece in pieces]).tolist()
    shapes = tuple(Shape(fill=p.area, layer=p.layer, group=p.kind, where=p.where) for p in pieces)
    unit = _UNITS.get(round(metre, 9), f"{metre:g} m")
    return Drawing(str(path), shapes, (left, low, right, high), unit, (*notices, *shift), says_solid=True)


class _Geometry:
    """Cuts elements at a height, and notes those that cannot be cut."""

    def __init__(self, model: Model, height: float) -> None:
        """`height` of the cut in the model's coordinates, m."""
        self._model = model
        self._height = height
        self._lost: Counter[str] = Counter()

    def pieces(self, elements: Sequence[Entity]) -> Iterator[_Piece]:
        """The elements' areas with their openings cut out, in the order of their numbers."""
        areas = self.areas(elements, {})
        self._lost.update(one.is_a() for one in elements if one.Representation is None and not one.IsDecomposedBy)
        for one in elements:
            if one.id() in areas and not areas[one.id()].is_empty:
                yield _Piece(areas[one.id()], _layer(one), one.is_a(), _where(one))

    def areas(self, elements: Sequence[Entity], settings: Mapping[str, bool]) -> dict[int, MultiPolygon]:
        """The elements' areas, by their numbers."""
        from ifcopenshell import geom

        shown = sorted((one for one in elements if one.Representation is not None), key=lambda one: int(one.id()))
        if not shown:
            return {}
        chosen = geom.settings()
        chosen.set("use-world-coords", True)
        for key, value in settings.items():
            chosen.set(key, value)
        shapes = geom.iterator(chosen, self._model, os.cpu_count() or 1, include=shown)
        kinds = {one.id(): one.is_a() for one in shown}
        areas: dict[int, MultiPolygon] = {}
        going = shapes.initialize()
        while going:
            shape = shapes.get()
            corners = np.array(shape.geometry.verts, dtype=np.float64).reshape(-1, 3)
            triangles = np.array(shape.geometry.faces, dtype=np.int64).reshape(-1, 3)
            if np.isfinite(corners).all():
                steps = _STEPS if any(self._model.by_id(shape.id).is_a(kind) for kind in _CLIMBED) else ()
                heights = [self._height, *(self._height - CUT + step for step in steps)]
                areas[shape.id] = polygons(shapely.union_all([section(corners, triangles, at) for at in heights]))
            going = shapes.next()
        self._lost.update(kinds[number] for number in kinds if number not in areas)
        return areas

    def told(self) -> list[str]:
        """The ignored elements, in sentences."""
        counts = Counter(one.is_a() for kind in _PASSED_OVER[1:] for one in self._model.by_type(kind))
        told = [f"{_listed(counts)} are passed over: none of these is in the way"] if counts else []
        return [*told, self.lost()] if self._lost else told

    def lost(self) -> str:
        """The elements that could not be cut, in a sentence, if any."""
        return f"the shapes of {_listed(self._lost)} are missing or broken, and left out" if self._lost else ""


def _elements(model: Model) -> list[Entity]:
    """All elements that are solid, each once, in the order of their numbers."""
    found = {one.id(): one for kind in (*_BUILT, *_LAYERS) for one in _of(model, kind)}
    return [one for _, one in sorted(found.items()) if not any(_whole(one).is_a(kind) for kind in _PASSED_OVER)]


def _of(model: Model, kind: str) -> Sequence[Entity]:
    try:
        return model.by_type(kind)
    except RuntimeError:  # another version of IFC has this class
        return ()


def _whole(element: Entity) -> Entity:
    """The whole that a part belongs to, or the element itself."""
    from ifcopenshell.util.element import get_aggregate

    whole: Entity | None = get_aggregate(element) if element.is_a("IfcBuildingElementPart") else None
    return whole or element


def _layer(element: Entity) -> str:
    return next((layer for kind, layer in _LAYERS.items() if _whole(element).is_a(kind)), "walls")


def _holders(model: Model) -> dict[int, int]:
    """The id of the storey that holds each element, by the element's."""
    from ifcopenshell.util.element import get_container

    found = {}
    for element in model.by_type("IfcElement"):
        storey = get_container(element, ifc_class="IfcBuildingStorey")
        if storey is not None:
            found[element.id()] = storey.id()
    return found


def _gaps(model: Model, elements: Sequence[Entity], geometry: _Geometry) -> tuple[list[_Piece], list[_Piece]]:
    """The openings that robots can pass, and those that windows fill, as thick as their walls."""
    hosts = {one.id(): one for one in elements}
    pairs = [
        (voids.RelatingBuildingElement, voids.RelatedOpeningElement)
        for voids in model.by_type("IfcRelVoidsElement")
        if voids.RelatingBuildingElement is not None and voids.RelatingBuildingElement.id() in hosts
    ]
    holes = geometry.areas([opening for _, opening in pairs], {})
    pairs = [(host, hole) for host, hole in pairs if not holes.get(hole.id(), MultiPolygon()).is_empty]
    whole = geometry.areas(
        list({host.id(): host for host, _ in pairs}.values()), {"disable-opening-subtractions": True}
    )
    gaps: list[_Piece] = []
    windows: list[_Piece] = []
    filled: set[int] = set()
    for host, opening in sorted(pairs, key=lambda pair: int(pair[1].id())):
        hole = holes[opening.id()]
        area = polygons(shapely.intersection(hole, whole[host.id()])) if host.id() in whole else hole
        fillings = [fills.RelatedBuildingElement for fills in opening.HasFillings]
        doors = [one for one in fillings if one.is_a("IfcDoor")]
        filled.update(one.id() for one in doors)
        if area.is_empty:
            continue
        if fillings and not doors:
            windows.append(_Piece(area, "walls", fillings[0].is_a(), _where(fillings[0])))
        else:
            gaps.append(_gap(area, doors[0] if doors else opening))
    free = [door for door in model.by_type("IfcDoor") if door.id() not in filled and not door.FillsVoids]
    for number, area in geometry.areas(free, {}).items():
        if not area.is_empty:
            gaps.append(_gap(polygons(shapely.minimum_rotated_rectangle(area)), model.by_id(number)))
    return [gap for gap in gaps if not gap.area.is_empty], windows


def _gap(area: MultiPolygon, through: Entity) -> _Piece:
    from ifcopenshell.util.element import get_pset

    outer = get_pset(through, "Pset_DoorCommon", "IsExternal") if through.is_a("IfcDoor") else None
    return _Piece(area, DOORS_LAYER, through.is_a(), _where(through), outer if isinstance(outer, bool) else None)


def _leading_out(solids: Sequence[MultiPolygon], gaps: Sequence[_Piece]) -> list[bool]:
    """Whether each gap has the outside on one side and a room on the other, unless the file denies it."""
    closed = shapely.buffer(shapely.union_all([*solids, *(gap.area for gap in gaps)]), _WELD, join_style="mitre")
    left, low, right, high = closed.bounds
    page = shapely.box(left - 1.0, low - 1.0, right + 1.0, high + 1.0)
    pieces = shapely.get_parts(polygons(shapely.difference(page, closed)))
    outside = shapely.intersects(pieces, page.exterior)
    leading = []
    for gap in gaps:
        met = shapely.intersects(pieces, shapely.buffer(gap.area, 2.0 * _WELD))
        rooms = bool((met & ~outside).any()) or gap.outer is True
        leading.append(bool((met & outside).any()) and rooms and gap.outer is not False)
    return leading


def _where(element: Entity) -> str:
    name = str(element.Name or "").strip()
    return f"{element.is_a()} {name!r} (#{element.id()})" if name else f"{element.is_a()} (#{element.id()})"


def _listed(counts: Counter[str]) -> str:
    return ", ".join(f"{count} {kind}" for kind, count in counts.most_common(8))


def _opened(path: Path) -> Model:
    """The model in a file. Raises InputError."""
    import ifcopenshell

    try:
        with path.open("rb") as file:
            start = file.read(200)
            file.seek(max(0, path.stat().st_size - 400))
            end = file.read()
    except OSError as problem:
        raise InputError(f"world: {path} cannot be read ({problem.strerror}); expected an IFC file") from problem
    if b"ISO-10303-21" not in start:
        raise InputError(f"{path}: not an IFC file, which starts with ISO-10303-21; expected one in this form (STEP)")
    if b"END-ISO-10303-21" not in end:
        raise InputError(f"{path}: is not whole: END-ISO-10303-21 is missing at its end; expected the complete file")
    try:
        model: Model = ifcopenshell.open(path)
    except Exception as problem:
        raise InputError(_broken(path, problem)) from None
    return model


def _broken(path: Path, problem: Exception) -> str:
    first = (str(problem).strip().splitlines() or [""])[0][:120].removesuffix(", check logs")
    return f"{path}: not an IFC model that can be read ({type(problem).__name__}: {first}); expected a building"
