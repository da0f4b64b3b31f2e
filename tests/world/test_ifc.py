"""Buildings of IFC: what one storey has at the robots' height, by area and place."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from ifcopenshell.api import aggregate, context, feature, geometry, project, pset, root, spatial, unit
from shapely import MultiPolygon

from swarmsim.core.errors import InputError
from swarmsim.core.scenario.decoding import convert
from swarmsim.core.scenario.file import World, load
from swarmsim.engine.build import build
from swarmsim.world.areas import polygons
from swarmsim.world.bim import ifc
from swarmsim.world.bim.cutting import cut
from swarmsim.world.bim.sections import section
from swarmsim.world.plan import SOLID_LAYERS
from swarmsim.world.reading import plan_of
from swarmsim.world.shapes import Drawing
from swarmsim.world.source import floor_plan, read_world

UNITS = {"mm": "MILLI", "cm": "CENTI", "m": None}


class Model:
    """A building of 8 x 5 m with walls of 0.2 m, made by the library's own interface."""

    def __init__(self, metre: str = "mm", heights: Sequence[float] = (0.0,), names: Sequence[str | None] = ("Ground",)):
        self.file = project.create_file(version="IFC4")
        root.create_entity(self.file, ifc_class="IfcProject", name="House")
        length = (
            unit.add_conversion_based_unit(self.file, name="inch")
            if metre == "in"
            else unit.add_si_unit(self.file, unit_type="LENGTHUNIT", prefix=UNITS[metre])
        )
        unit.assign_unit(self.file, units=[length])
        model = context.add_context(self.file, context_type="Model")
        self.body = context.add_context(
            self.file, context_type="Model", context_identifier="Body", target_view="MODEL_VIEW", parent=model
        )
        building = root.create_entity(self.file, ifc_class="IfcBuilding", name="Building")
        aggregate.assign_object(self.file, products=[building], relating_object=self.file.by_type("IfcProject")[0])
        self.metre = {"mm": 0.001, "cm": 0.01, "m": 1.0, "in": 0.0254}[metre]
        self.storeys: list[tuple[Any, float]] = []
        self.origin = (0.0, 0.0)
        for name, height in zip(names, heights, strict=True):
            storey = root.create_entity(self.file, ifc_class="IfcBuildingStorey", name=name)
            if name is not None:
                storey.Elevation = height / self.metre
            aggregate.assign_object(self.file, products=[storey], relating_object=building)
            self.place(storey, 0.0, 0.0, height)
            self.storeys.append((storey, height))

    def place(self, element: Any, x: float, y: float, z: float) -> None:
        matrix = np.eye(4)
        matrix[:3, 3] = x + self.origin[0], y + self.origin[1], z
        geometry.edit_object_placement(self.file, product=element, matrix=matrix)

    def block(
        self,
        kind: str,
        box: tuple[float, float, float, float],
        storey: int | None = 0,
        low: float = 0.0,
        high: float = 2.5,
        **more: Any,
    ) -> Any:
        """An element as a block: left, lower, right, upper and its heights above the storey, m."""
        left, lower, right, upper = box
        element = root.create_entity(self.file, ifc_class=kind, **more)
        shape = geometry.add_wall_representation(
            self.file, context=self.body, length=right - left, height=high - low, thickness=upper - lower
        )
        geometry.assign_representation(self.file, product=element, representation=shape)
        base = self.storeys[storey or 0][1]
        self.place(element, left, lower, base + low)
        if storey is not None:
            spatial.assign_container(self.file, products=[element], relating_structure=self.storeys[storey][0])
        return element

    def hole(
        self,
        wall: Any,
        box: tuple[float, float, float, float],
        filling: str | None,
        storey: int = 0,
        low: float = 0.0,
        high: float = 2.0,
    ) -> None:
        """An opening in a wall, with a door or window in it."""
        opening = self.block(
            "IfcOpeningElement", box, None, low + self.storeys[storey][1], high + self.storeys[storey][1]
        )
        self.place(opening, box[0], box[1], self.storeys[storey][1] + low)
        feature.add_feature(self.file, feature=opening, element=wall)
        if filling:
            inside = self.block(filling, box, storey, low, high)
            feature.add_filling(self.file, opening=opening, element=inside)

    def house(self, storey: int = 0, door: bool = True) -> dict[str, Any]:
        """The walls of one storey: four around, and one across, with a door of 0.9 m."""
        walls = {
            "south": self.block("IfcWall", (0, 0, 8, 0.2), storey),
            "north": self.block("IfcWall", (0, 4.8, 8, 5), storey),
            "west": self.block("IfcWall", (0, 0.2, 0.2, 4.8), storey),
            "east": self.block("IfcWall", (7.8, 0.2, 8, 4.8), storey),
            "middle": self.block("IfcWall", (4, 0.2, 4.2, 4.8), storey),
        }
        if door:
            self.hole(walls["middle"], (3.9, 2, 4.3, 2.9), "IfcDoor", storey)
        return walls

    def drawing(self, folder: Path, **world: Any) -> Drawing:
        path = folder / "plan.ifc"
        self.file.write(str(path))
        return cut(path, convert({"file": str(path), **world}, World))

    def drawing_of_a_house(self, folder: Path) -> Drawing:
        self.house()
        return self.drawing(folder)


def solid(drawing: Drawing) -> MultiPolygon:
    return polygons(shapely.union_all([shape.fill for shape in drawing.shapes if shape.layer in SOLID_LAYERS]))


def floors(drawing: Drawing) -> list[float]:
    """The areas of the pieces of floor, m2, the largest first."""
    free = shapely.get_parts(polygons(shapely.box(*drawing.page).difference(solid(drawing))))
    return sorted((piece.area for piece in free), reverse=True)


def covers(drawing: Drawing, x: float, y: float) -> bool:
    return bool(shapely.contains_xy(solid(drawing), x, y))


@pytest.mark.parametrize("metre", ["mm", "cm", "m", "in"])
def test_two_storeys_have_their_areas_in_any_unit(tmp_path: Path, metre: str) -> None:
    model = Model(metre, (0.0, 3.0), ("Ground", "First"))
    model.house(0)
    model.house(1, door=False)
    ground, first = (model.drawing(tmp_path, level=level) for level in ("Ground", "first"))
    assert (ground.unit, first.unit) == (metre, metre)
    assert solid(ground).area == pytest.approx(5.78, abs=1e-4)
    assert floors(ground) == pytest.approx([34.22], abs=1e-4)
    assert solid(first).area == pytest.approx(5.96, abs=1e-4)
    assert floors(first) == pytest.approx([17.48, 16.56], abs=1e-4)
    assert ground.page == pytest.approx((0, 0, 8, 5), abs=1e-6)
    assert [covers(ground, *point) for point in ((2, 2), (6, 4), (4.1, 2.5))] == [False] * 3
    assert [covers(ground, *point) for point in ((4.1, 1), (0.1, 3), (7.9, 4.9))] == [True] * 3
    assert covers(first, 4.1, 2.5)


def test_a_storey_is_a_floor_plan(tmp_path: Path) -> None:
    model = Model()
    model.hole(model.house()["south"], (1, -0.1, 2, 0.3), "IfcDoor")
    found = plan_of(model.drawing(tmp_path), World(file="plan.ifc"))
    free = shapely.get_parts(polygons(shapely.box(*found.page).difference(found.walls)))
    assert [piece.area for piece in free if piece.area > 1e-6] == pytest.approx([34.22], abs=1e-4)
    assert found.openings == ()


def test_a_storey_is_found_by_name_number_and_elevation(tmp_path: Path) -> None:
    model = Model("mm", (3.0, -2.5, 0.0), ("Upper", "Cellar", "Ground"))
    for storey in range(3):
        model.house(storey, door=storey == 0)
    assert [len(floors(model.drawing(tmp_path, level=level))) for level in ("2", "upper", "3.0", "3.00 m")] == [1] * 4
    assert [len(floors(model.drawing(tmp_path, level=level))) for level in ("0", "1", "Ground", "-2.5")] == [2] * 4
    lowest = model.drawing(tmp_path)  # the cellar has no doors, as foundations have none
    assert any("'Upper' at 3.00 m; others" in one and "'Cellar' at -2.50 m" in one for one in lowest.notices)
    with pytest.raises(InputError, match=r'world\.level: no storey is called "Attic"; it has \'Cellar\' at -2\.50 m'):
        model.drawing(tmp_path, level="Attic")
    with pytest.raises(InputError, match=r'no storey is called "7"'):
        model.drawing(tmp_path, level="7")


def test_the_lowest_storey_with_walls_is_taken(tmp_path: Path) -> None:
    model = Model("mm", (-1.0, 0.0), ("Foundation", "Ground"))
    model.block("IfcFooting", (0, 0, 8, 5), 0, 0.0, 0.9)
    model.house(1)
    drawing = model.drawing(tmp_path)
    assert floors(drawing) == pytest.approx([34.22], abs=1e-4)
    assert any("'Ground' at 0.00 m" in one for one in drawing.notices)


def test_a_storey_may_have_no_name(tmp_path: Path) -> None:
    model = Model("mm", (0.0, 3.0), (None, None))
    model.house(0)
    model.house(1, door=False)
    assert [len(floors(model.drawing(tmp_path, level=level))) for level in ("0", "1", "3.0")] == [1, 2, 2]


def test_two_storeys_of_one_name_are_asked_for_by_number(tmp_path: Path) -> None:
    model = Model("mm", (0.0, 3.0), ("Floor", "Floor"))
    model.house(0)
    model.house(1)
    with pytest.raises(InputError, match=r"2 storeys are called \"Floor\"; say the number, 0 or 1"):
        model.drawing(tmp_path, level="Floor")


def test_windows_are_solid_whatever_their_sill(tmp_path: Path) -> None:
    model = Model()
    walls = model.house()
    model.hole(walls["south"], (1, -0.1, 2.5, 0.3), "IfcWindow", low=0.9)
    model.hole(walls["north"], (1, 4.7, 2.5, 5.1), "IfcWindow", low=0.0)
    drawing = model.drawing(tmp_path)
    assert solid(drawing).area == pytest.approx(5.78 + 2 * 0.1 * 1.5, abs=1e-4)  # a frame that sticks out by 0.1 m
    assert covers(drawing, 1.7, 0.1)
    assert covers(drawing, 1.7, 4.9)
    assert drawing.notices == ()


def test_a_window_without_a_shape_fills_its_opening(tmp_path: Path) -> None:
    model = Model()
    model.hole(model.house()["north"], (1, 4.7, 2.5, 5.1), "IfcWindow")
    geometry.unassign_representation(
        model.file,
        product=model.file.by_type("IfcWindow")[0],
        representation=model.file.by_type("IfcWindow")[0].Representation.Representations[0],
    )
    assert solid(model.drawing(tmp_path)).area == pytest.approx(5.78, abs=1e-4)


@pytest.mark.parametrize("filling", ["IfcDoor", None])
def test_what_leads_out_is_closed(tmp_path: Path, filling: str | None) -> None:
    model = Model()
    model.hole(model.house()["south"], (1, -0.1, 2, 0.3), filling)
    closed, opened = model.drawing(tmp_path), model.drawing(tmp_path, border=False)
    assert solid(closed).area == pytest.approx(5.78, abs=1e-4)
    assert solid(opened).area == pytest.approx(5.58, abs=1e-4)
    assert covers(closed, 1.5, 0.1)
    assert not covers(opened, 1.5, 0.1)
    assert not covers(closed, 4.1, 2.5)
    assert any("world.border = false" in one for one in closed.notices)
    assert not any("world.border" in one for one in opened.notices)
    assert sum(shape.fill.area for shape in closed.shapes if shape.layer == "doors") == pytest.approx(0.18, abs=1e-4)


@pytest.mark.parametrize("external", [True, False])
def test_the_file_says_which_doors_are_outer_ones(tmp_path: Path, external: bool) -> None:
    model = Model()
    walls = model.house()
    model.hole(walls["south"], (1, -0.1, 2, 0.3), "IfcDoor")
    model.file.remove(walls["east"])  # so that both doors seem to lead out
    for door in model.file.by_type("IfcDoor"):
        properties = pset.add_pset(model.file, product=door, name="Pset_DoorCommon")
        pset.edit_pset(model.file, pset=properties, properties={"IsExternal": external})
    drawing = model.drawing(tmp_path)
    assert [covers(drawing, *door) for door in ((4.1, 2.5), (1.5, 0.1))] == [external] * 2


def test_what_is_in_the_way_is_solid_and_what_is_not_is_told(tmp_path: Path) -> None:
    model = Model()
    model.house()
    for kind, left in {
        "IfcColumn": 1.0,
        "IfcFurniture": 2.0,
        "IfcRailing": 3.0,
        "IfcPlate": 5.0,
        "IfcMember": 6.0,
    }.items():
        model.block(kind, (left, 1, left + 0.5, 1.5), high=0.9)
    model.block("IfcSlab", (0, 0, 8, 5), low=-0.2, high=0.4)
    model.block("IfcSanitaryTerminal", (7, 1, 7.5, 1.5), high=0.4)
    model.block("IfcFurniture", (5, 3, 6, 4), low=0.7, high=0.8)  # a shelf that robots pass below
    model.block("IfcStairFlight", (1, 3, 2, 4), high=0.17)  # a first step, lower than the cut
    drawing = model.drawing(tmp_path)
    assert solid(drawing).area == pytest.approx(5.78 + 6 * 0.25 + 1.0, abs=1e-4)
    assert {shape.group: shape.layer for shape in drawing.shapes} == {
        "IfcWall": "walls",
        "IfcColumn": "pillars",
        "IfcFurniture": "furniture",
        "IfcSanitaryTerminal": "furniture",
        "IfcRailing": "walls",
        "IfcPlate": "walls",
        "IfcMember": "walls",
        "IfcStairFlight": "walls",
        "IfcDoor": "doors",
    }
    assert [one for one in drawing.notices if "IfcSlab" in one] == [
        "1 IfcSlab are passed over: none of these is in the way"
    ]


def test_a_wall_of_the_storey_below_is_cut_where_it_reaches_up(tmp_path: Path) -> None:
    model = Model("mm", (0.0, 3.0), ("Ground", "First"))
    model.house(0)
    model.house(1, door=False)
    model.block("IfcCurtainWall", (1, 1, 3, 1.1), 0, high=6.0)
    assert covers(model.drawing(tmp_path, level="First"), 2, 1.05)


def test_scale_and_width_are_followed(tmp_path: Path) -> None:
    model = Model()
    model.house()
    assert solid(model.drawing(tmp_path, scale=2.0)).area == pytest.approx(4 * 5.78, abs=1e-3)
    assert solid(model.drawing(tmp_path, width=4.0)).area == pytest.approx(5.78 / 4, abs=1e-3)


def test_a_building_far_from_the_origin_is_moved_to_it(tmp_path: Path) -> None:
    model = Model("m")
    model.origin = (500_000.5, 5_000_000.25)
    model.house()
    drawing = model.drawing(tmp_path)
    assert solid(drawing).area == pytest.approx(5.78, abs=1e-4)
    assert drawing.page == pytest.approx((0.5, 0.25, 8.5, 5.25), abs=1e-4)
    assert any("(500000, 5000000) m" in one for one in drawing.notices)


def test_nothing_solid_is_refused_with_the_other_storeys(tmp_path: Path) -> None:
    model = Model("mm", (0.0, 3.0), ("Ground", "Roof"))
    model.house(0)
    with pytest.raises(InputError, match=r"nothing is solid 0\.3 m above the storey 'Roof' at 3\.00 m; other storeys"):
        model.drawing(tmp_path, level="Roof")


def test_a_process_of_its_own_finds_the_same(tmp_path: Path) -> None:
    model = Model("mm", (0.0, 3.0), ("Ground", "First"))
    model.house(0)
    model.house(1)
    here = model.drawing(tmp_path, level="Ground")
    there = ifc.read(tmp_path / "plan.ifc", World(file="plan.ifc", level="Ground"))
    assert (there.name, there.page, there.unit, there.notices) == (here.name, here.page, here.unit, here.notices)
    for one, other in zip(here.shapes, there.shapes, strict=True):
        assert (one.layer, one.group, one.where) == (other.layer, other.group, other.where)
        assert one.fill.equals_exact(other.fill)


def test_a_missing_library_is_told_in_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ifcopenshell", None)
    with pytest.raises(InputError) as told:
        ifc.read(tmp_path / "plan.ifc", World(file="plan.ifc"))
    assert str(told.value) == 'world: plan.ifc needs ifcopenshell; install it with: pip install "swarmsim-lab[bim]"'


def refused(content: bytes, path: Path, read: Callable[[Path, World], Drawing] = cut) -> str:
    path.write_bytes(content)
    with pytest.raises(InputError) as told:
        read(path, World(file=str(path)))
    return str(told.value)


def test_damaged_files_are_refused_in_one_sentence(tmp_path: Path) -> None:
    Model().drawing_of_a_house(tmp_path)
    whole = (tmp_path / "plan.ifc").read_bytes()
    path = tmp_path / "damaged.ifc"
    assert refused(whole[: len(whole) // 2], path) == (
        f"{path}: is not whole: END-ISO-10303-21 is missing at its end; expected the complete file"
    )
    assert refused(b"a letter", path).startswith(f"{path}: not an IFC file, which starts with ISO-10303-21")
    assert refused(b"", path).startswith(f"{path}: not an IFC file")
    broken = whole.replace(b"IFCWALL(", b"IFCWALL('")
    assert refused(broken, path, ifc.read).startswith(f"{path}: not an IFC model that can be read (")
    shapeless = refused(whole.replace(b"IFCWALL(", b"IFCWALL(("), path, ifc.read)
    assert "nothing is solid 0.3 m above the storey 'Ground' at 0.00 m; the shapes of " in shapeless
    assert "IfcWall are missing or broken, and left out" in shapeless


def test_a_model_that_ends_the_process_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    Model().drawing_of_a_house(tmp_path)
    monkeypatch.setattr(ifc, "_CHILD", "import os, signal; os.kill(os.getpid(), signal.SIGSEGV)")
    path = tmp_path / "plan.ifc"
    assert refused(path.read_bytes(), path, ifc.read) == (
        f"{path}: ifcopenshell fails on it (exit code -11); expected a building that other programs open"
    )


def test_a_model_that_takes_for_ever_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    Model().drawing_of_a_house(tmp_path)
    monkeypatch.setattr(ifc, "LONGEST", 0.01)
    path = tmp_path / "plan.ifc"
    assert "is not read after 0.01 s" in refused(path.read_bytes(), path, ifc.read)


def test_a_section_of_a_tube_is_a_ring_and_bodies_are_united() -> None:
    def box(left: float, right: float, low: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        corners = np.array(
            [(x, y, z) for z in (low, 1.0) for x, y in ((left, left), (right, left), (right, right), (left, right))]
        )
        sides = [(i, (i + 1) % 4, 4 + i) for i in range(4)] + [((i + 1) % 4, 4 + (i + 1) % 4, 4 + i) for i in range(4)]
        ends = [(0, 1, 2), (0, 2, 3), (4, 5, 6), (4, 6, 7)]
        return corners, np.array(sides + ends)

    outer, faces = box(0.0, 4.0)
    inner, _ = box(1.0, 3.0)
    rims = [(a, (a + 1) % 4, 8 + a) for a in range(4)] + [((a + 1) % 4, 8 + (a + 1) % 4, 8 + a) for a in range(4)]
    rims += [tuple(corner + 4 for corner in rim) for rim in rims]
    tube = np.concatenate([faces[:8], faces[:8] + 8, rims])
    assert section(np.concatenate([outer, inner]), tube, 0.5).area == pytest.approx(12.0)
    assert section(np.concatenate([outer, inner]), np.concatenate([faces, faces + 8]), 0.5).area == pytest.approx(16.0)
    assert section(outer, faces, 1.0).is_empty
    assert section(outer, faces, 2.0).is_empty
    sheet = np.array([(0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (2.0, 0.0, 1.0), (0.0, 0.0, 1.0)])
    assert section(sheet, np.array([(0, 1, 2), (0, 2, 3)]), 0.5).area == pytest.approx(2.0 * 0.02)


def test_robots_run_in_a_storey_and_never_through_its_windows(tmp_path: Path) -> None:
    model = Model("mm", (0.0, 3.0), ("Ground", "First"))
    walls = model.house(0)
    model.hole(walls["south"], (1, -0.1, 2, 0.3), "IfcWindow", low=0.9, high=2.1)
    model.hole(walls["north"], (5, 4.7, 6, 5.1), "IfcDoor")
    model.house(1, door=False)
    model.file.write(str(tmp_path / "plan.ifc"))
    for level, area in (("Ground", 34.22), ("First", 17.48)):
        world = World(file=str(tmp_path / "plan.ifc"), level=level)
        found = floor_plan(read_world(world, 0.15), world)
        (floor,) = found.spawns["spawn"].geoms
        assert floor.area == pytest.approx(area, abs=1e-3)
        assert [shapely.contains_xy(floor, *at) for at in ((1, 1), (2, 4), (3.9, 2.5))] == [True] * 3
        assert not any(shapely.contains_xy(floor, *at) for at in ((1.5, 0.1), (5.5, 4.9), (0.1, 3)))
    scenario = tmp_path / "run.toml"
    scenario.write_text(
        'world = {file = "plan.ifc", level = "Ground"}\n[robots]\ncount = 3\n[stop]\niterations = 3\n'
        '[network.topology]\nuse = "none"\n'
    )
    build(load(scenario), str(scenario)).simulation.run([])
