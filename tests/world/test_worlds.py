"""The shipped worlds: what is drawn, and what robots find in it."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import numpy as np
import pytest
import shapely
from conftest import ROOT, made
from drawn import read_floor_plan

from swarmsim.world.arena import Arena

WORLDS = ROOT / "worlds"
ROBOT = 0.055


def world(name: str) -> Arena:
    return Arena.open(read_floor_plan((WORLDS / name).read_text(encoding="utf-8"), name), 0.15, 8, name)


@pytest.fixture(scope="module")
def basilica() -> Arena:
    return world("basilica.svg")


@pytest.fixture(scope="module")
def source() -> str:
    return (WORLDS / "basilica.svg").read_text(encoding="utf-8")


@pytest.mark.parametrize("file", sorted(WORLDS.glob("*.svg")), ids=lambda file: file.name)
def test_every_world_is_one_piece_from_each_of_its_spawn_areas(file: Path) -> None:
    arena = world(file.name)
    first, *others = [arena.reachable(spawn, ROBOT) for spawn in arena.plan.spawns]
    assert all(np.array_equal(first, other) for other in others)


def test_basilica_is_drawn_by_its_script(source: str) -> None:
    script = runpy.run_path(str(WORLDS / "make_basilica.py"))
    assert script["draw"]() == source


def test_basilica_is_30_m_by_18_m(basilica: Arena) -> None:
    left, low, right, high = basilica.plan.walls.bounds
    assert right - left == pytest.approx(30.0, abs=0.01)
    assert high - low == pytest.approx(18.0, abs=0.01)


def test_basilica_has_about_eight_thousand_free_cells_and_a_robot_reaches_all(basilica: Arena) -> None:
    reachable = basilica.reachable("floor", ROBOT)
    assert np.array_equal(reachable, basilica.floor("floor"))
    assert reachable.sum() == 8142


def test_basilica_is_symmetric_but_for_font_and_chapel_altar(basilica: Arena) -> None:
    uneven = np.argwhere(basilica.occupied != basilica.occupied[::-1])
    x, y = basilica.lattice.centres(uneven).T - np.array([[1.2], [10.2]])
    assert ((x > 19.4) & (x < 21.0) & (abs(y) > 6.3) & (abs(y) < 7.8)).all()


def test_basilica_spawn_areas(basilica: Arena) -> None:
    assert set(basilica.plan.spawns) == {"floor", "entrance"}
    assert basilica.spawn_cells("entrance").sum() == 288
    cells = np.argwhere(basilica.spawn_cells("entrance"))
    x, y = basilica.lattice.centres(cells).T
    assert (x > 1.2 + 3.3).all()  # in the nave, behind the narthex
    assert (x < 1.2 + 6.6).all()
    assert (abs(y - 10.2) < 1.35).all()


def test_basilica_has_no_passage_under_0_45_m(basilica: Arena) -> None:
    plan = basilica.plan
    for radius in (0.22, 0.3):
        free = shapely.box(0, 0, plan.width, plan.height).difference(plan.walls)
        rooms = [r for r in shapely.get_parts(free.buffer(-radius)) if r.bounds[0] > 1.0 and r.area > 0.05]
        assert len(rooms) == 1
        places = {
            "narthex": (1.7, 0), "nave": (10, 0), "north aisle": (10, 2.5), "south aisle": (10, -2.5),
            "crossing": (20, 0), "north chapel": (19.2, 7.7), "south chapel": (19.2, -7.7), "choir": (24, 0),
            "apse": (28.1, 0), "north sacristy": (23, 3.7), "south sacristy": (23, -3.7),
        }  # fmt: skip
        for name, (x, off) in places.items():
            assert rooms[0].intersects(shapely.Point(1.2 + x, 10.2 + off)), name
    assert basilica.reachable("floor", 0.22).sum() > 6000


def test_basilica_walls_fill_their_cells(basilica: Arena) -> None:
    """No floor cell has a neighbour in which robots would see too little wall to notice it."""
    floor, lattice = basilica.floor("floor"), basilica.lattice
    beside = np.zeros_like(floor)
    for axis, shift in ((0, 1), (0, -1), (1, 1), (1, -1)):
        beside |= np.roll(floor, shift, axis)
    corners = lattice.centres(np.argwhere(beside & basilica.occupied)) - lattice.cell / 2
    squares = shapely.box(*corners.T, *(corners + lattice.cell).T)
    shares = shapely.area(shapely.intersection(squares, basilica.plan.walls)) / lattice.cell**2
    assert shares.min() > 0.01
    assert (shares > 0.999).mean() > 0.7


def test_basilica_columns_are_round_and_sit_on_corners_of_cells(basilica: Arena) -> None:
    columns = [part for part in basilica.plan.layers["pillars"].geoms if len(part.exterior.coords) > 20]
    assert len(columns) == 16
    for column in columns:
        assert column.bounds[2] - column.bounds[0] == pytest.approx(0.6, abs=1e-6)
        assert np.array([column.centroid.x, column.centroid.y]) / 0.15 == pytest.approx(
            np.round(np.array([column.centroid.x, column.centroid.y]) / 0.15), abs=1e-6
        )
    gaps = [min(column.distance(other) for other in columns if other is not column) for column in columns]
    assert min(gaps) >= 0.9


def test_basilica_is_a_real_drawing(source: str, basilica: Arena) -> None:
    assert re.search(r'd="[^"]*A2\.55 2\.55', source)
    assert re.search(r'<g transform="translate[^>]*>\s*<g id="colonnade-north">\s*<g transform="translate', source)
    assert '<g id="colonnade-south" transform="scale(1 -1)">' in source
    assert "<use" not in source
    assert set(basilica.plan.layers) == {"walls", "pillars", "furniture"}
    assert all(not layer.is_empty for layer in basilica.plan.layers.values())
    width, height = (float(re.search(rf'{side}="([0-9.]+)"\n? ', source)[1]) for side in ("width", "height"))
    assert width / height == pytest.approx(basilica.plan.width / basilica.plan.height)


def test_room() -> None:
    arena = world("room.svg")
    inside = shapely.box(0.3, 0.3, 4.8, 3.6).difference(arena.plan.walls)
    assert set(arena.plan.spawns) == {"room"}
    assert inside.area == pytest.approx(4.5 * 3.3 - 2.4 * 0.15 - 0.2827, abs=0.01)
    assert arena.reachable("room", ROBOT).sum() == 628


OWN = (
    "basilica",
    "room",
    *(f"worlds/{path.stem}" for path in sorted((WORLDS.parent / "scenarios/worlds").glob("*.toml"))),
)


def test_every_world_has_a_scenario_of_its_own() -> None:
    assert {path.stem for path in WORLDS.glob("*.svg")} == {name.rpartition("/")[2] for name in OWN} | {
        "water"
    }  # buoys float there


@pytest.mark.slow
@pytest.mark.parametrize("name", OWN)
def test_every_world_is_finished_with_twenty_seeds(name: str) -> None:
    assert all(made(f"seed={seed}", scenario=name).simulation.run() for seed in range(1, 21))
