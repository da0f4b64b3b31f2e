"""Maps and polygons: map_server pairs, bitmaps, GeoJSON and WKT, in and out, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import shapely
from drawn import read_floor_plan
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from PIL import Image
from shapely import affinity

from swarmsim.core.errors import InputError
from swarmsim.core.lattice import Lattice
from swarmsim.core.scenario.decoding import convert
from swarmsim.core.scenario.file import World
from swarmsim.core.state import FREE, OCCUPIED, UNKNOWN
from swarmsim.world import drawing, geojson, rosmap
from swarmsim.world.arena import Arena
from swarmsim.world.plan import FloorPlan
from swarmsim.world.rasters import rasterised
from swarmsim.world.source import floor_plan, read_world
from swarmsim.world.tracing import traced

WORLDS = Path(__file__).parents[2] / "worlds"
CELL = 0.15
masks = arrays.arrays(np.bool_, st.tuples(st.integers(1, 9), st.integers(1, 9)))


def opened(path: Path, cell: float = CELL, **keys: object) -> FloorPlan:
    world = convert({"file": str(path), **keys}, World)
    return floor_plan(read_world(world, cell), world)


def square(row: int, column: int) -> shapely.Polygon:
    return shapely.box(column, row, column + 1, row + 1)


def grey(path: Path, levels: list[list[int]], mode: str = "L") -> Path:
    Image.fromarray(np.array(levels, np.uint8), mode).save(path)
    return path


@pytest.fixture
def pair(tmp_path: Path):
    """Writes a map_server pair with these grey levels, upper row first."""

    def write(levels: list[list[int]], **keys: object) -> Path:
        grey(tmp_path / "m.png", levels)
        about = {"image": "m.png", "resolution": 0.5, "origin": [0, 0, 0], "negate": 0, **keys}
        text = "".join(f"{key}: {json.dumps(value)}\n" for key, value in about.items() if value is not None)
        (tmp_path / "m.yaml").write_text(text)
        return tmp_path / "m.yaml"

    return write


# --- outlines of pixels


@given(masks)
@settings(max_examples=200, deadline=None)
def test_outlines_cover_exactly_their_pixels(mask: np.ndarray) -> None:
    shape = traced(mask)
    assert shape.is_valid
    assert shape.symmetric_difference(shapely.union_all([square(*at) for at in np.argwhere(mask)])).area < 1e-9


@given(masks, st.sampled_from([0.5, 1.0]))
@settings(max_examples=200, deadline=None)
def test_simpler_outlines_stay_near_and_leave_no_gap(mask: np.ndarray, tolerance: float) -> None:
    exact, simple = traced(mask), traced(mask, tolerance)
    assert simple.is_valid
    assert len(simple.geoms) == len(exact.geoms)
    if not mask.any():
        return
    for one, other in zip(_rings(exact), _rings(simple), strict=True):
        assert other.hausdorff_distance(one) <= tolerance + 1e-9
    apart = shapely.STRtree(simple.geoms)
    for i, j in zip(*shapely.STRtree(exact.geoms).query(exact.geoms, predicate="touches"), strict=True):
        first, second = exact.geoms[i], exact.geoms[j]
        corner = first.intersection(second)
        near = apart.query(corner.buffer(1e-9), predicate="intersects")
        assert len(near) >= 2  # pixels that touch by a corner still do


def _rings(shape: shapely.MultiPolygon) -> list[shapely.LinearRing]:
    rings = shapely.get_rings(shapely.get_parts(shape))
    return sorted(rings, key=lambda ring: ring.bounds)


def test_stairs_become_straight_walls() -> None:
    rows, columns = np.indices((400, 400))
    leaning = np.abs(rows - 0.37 * columns - 60.0) < 5.0
    stairs, straight = traced(leaning), traced(leaning, 1.5)
    assert shapely.get_num_coordinates(stairs) > 500
    assert shapely.get_num_coordinates(straight) < 30


# --- what pixels mean


def test_the_first_row_is_the_upper_one_and_a_pixel_is_as_large_as_it_says(pair) -> None:
    plan = opened(pair([[0, 254, 254], [254, 254, 254]]), 0.5, unknown="space")
    assert plan.page == (0.0, 0.0, 1.5, 1.0)
    assert plan.walls.equals(shapely.box(0.0, 0.5, 0.5, 1.0))


@pytest.mark.parametrize(
    ("keys", "levels", "states"),
    [
        ({}, [0, 89, 90, 205, 206, 255], [2, 2, 0, 0, 1, 1]),  # 205 is just unknown
        ({"free_thresh": 0.25}, [0, 89, 90, 205, 191, 255], [2, 2, 0, 1, 0, 1]),
        ({"negate": 1}, [0, 49, 50, 165, 166, 255], [1, 1, 0, 0, 2, 2]),
        ({"negate": True}, [0, 255], [1, 2]),
        ({"mode": "scale"}, [0, 89, 90, 205, 206, 255], [2, 2, 0, 0, 1, 1]),
        ({"mode": "raw"}, [0, 19, 20, 64, 65, 100, 101, 255], [1, 1, 0, 0, 2, 2, 0, 0]),
        ({"resolution": "5e-1", "occupied_thresh": 0.5}, [120, 130], [2, 0]),
    ],
)
def test_grey_levels_mean_what_map_server_says(pair, keys: dict, levels: list[int], states: list[int]) -> None:
    assert rosmap.read(pair([levels], **keys)).states.tolist() == [states]


@pytest.mark.parametrize("kind", ["P5\n3 2\n255\n", "P2\n# made by hand\n3 2\n255\n"])
def test_binary_and_plain_pgm_are_the_same(tmp_path: Path, kind: str) -> None:
    levels = [0, 205, 254, 254, 254, 0]
    body = bytes(levels) if kind.startswith("P5") else " ".join(map(str, levels)).encode()
    (tmp_path / "m.pgm").write_bytes(kind.encode() + body)
    bitmap = rosmap.read(tmp_path / "m.pgm", 0.1)
    assert bitmap.states.tolist() == [[FREE, FREE, OCCUPIED], [OCCUPIED, UNKNOWN, FREE]]


def test_transparent_pixels_are_unknown_on_a_scale(tmp_path: Path) -> None:
    picture = np.array([[[0, 0, 0, 255], [255, 255, 255, 0]]], np.uint8)
    Image.fromarray(picture, "RGBA").save(tmp_path / "m.png")
    (tmp_path / "m.yaml").write_text("image: m.png\nresolution: 1\norigin: [0, 0, 0]\nmode: scale\n")
    assert rosmap.read(tmp_path / "m.yaml").states.tolist() == [[OCCUPIED, UNKNOWN]]


@given(
    arrays.arrays(np.uint8, st.tuples(st.integers(1, 6), st.integers(1, 6)), elements=st.integers(0, 2)),
    st.floats(-3.2, 3.2),
)
@settings(max_examples=60, deadline=None)
def test_an_origin_moves_and_turns_the_map(states: np.ndarray, yaw: float) -> None:
    bitmap = rosmap.Bitmap(states, 0.5, (3.0, -2.0, yaw))
    plan = bitmap.plan("m.yaml", 0.5, False)
    squares = [square(*at) for at in np.argwhere(states == OCCUPIED)]
    turned = affinity.rotate(affinity.scale(shapely.union_all(squares), 0.5, 0.5, origin=(0, 0)), yaw, (0, 0), True)
    assert plan.walls.symmetric_difference(affinity.translate(turned, 3.0, -2.0)).area < 1e-9


def test_what_nobody_knows_is_a_wall_or_a_space_that_does_not_count(pair) -> None:
    levels = [[0] * 8, *[[0, 254, 254, 254, 205, 205, 205, 0]] * 3, [0] * 8]
    path = pair(levels, resolution=CELL)
    solid, open_ = opened(path), opened(path, unknown="space")
    assert solid.walls.area == pytest.approx(31 * CELL**2)
    assert open_.walls.area == pytest.approx(22 * CELL**2)
    arenas = [Arena.open(plan, CELL, 8, "m.yaml") for plan in (solid, open_)]
    reachable = [arena.reachable("", 0.05) for arena in arenas]
    assert [int(cells.sum()) for cells in reachable] == [9, 18]
    domain = arenas[1].explorable(reachable[1], np.ones(arenas[1].lattice.shape, np.bool_))
    assert int((domain & ~arenas[1].occupied).sum()) == 9


def test_a_map_that_runs_off_its_edge_is_closed_by_a_frame(tmp_path: Path) -> None:
    path = grey(tmp_path / "m.png", [[254] * 20] * 20)
    plan = opened(path, resolution=CELL)
    assert Arena.open(plan, CELL, 8, "m.png").reachable("", 0.05).sum() == 400
    plan = opened(path, resolution=CELL, unknown="space")
    assert plan.walls.is_empty
    assert Arena.open(plan, CELL, 8, "m.png").reachable("", 0.05).sum() == 400


def test_a_picture_takes_its_width_or_the_file_beside_it(pair) -> None:
    path = pair([[0, 254], [254, 254]]).with_name("m.png")
    assert opened(path).width == 1.0
    assert opened(path, width=8.0).width == 8.0
    assert opened(path.with_name("m.yaml"), width=8.0).width == 8.0
    path.with_name("m.yaml").unlink()
    with pytest.raises(InputError, match=r"how large is a pixel\? .*resolution = METRES"):
        opened(path)


@pytest.mark.parametrize("named", ["/home/x/maps/m.png", "C:\\\\maps\\\\m.png", "../maps/m.png"])
def test_a_picture_of_another_machine_lies_beside_its_yaml(pair, named: str) -> None:
    path = pair([[0, 254], [254, 254]], image=named)
    bitmap = rosmap.read(path)
    assert bitmap.states.tolist() == [[FREE, FREE], [OCCUPIED, FREE]]
    [notice] = bitmap.notices
    assert "is not here; m.png beside it was taken" in notice
    assert opened(path, width=8.0).width == 8.0
    path.with_name("m.png").unlink()
    with pytest.raises(InputError, match="no such file"):
        rosmap.read(path)


def test_unknown_that_becomes_floor_is_told(pair) -> None:
    levels = [[0, 205, 254, 254], [205, 254, 254, 254]]
    [notice] = rosmap.read(pair(levels, free_thresh=0.25)).notices
    assert notice.startswith("25 % of its pixels are grey 205")
    assert "by free_thresh 0.25 they are floor" in notice
    for keys in ({}, {"negate": 1, "free_thresh": 0.25}, {"mode": "raw"}):
        assert rosmap.read(pair(levels, **keys)).notices == ()


# --- there and back


@pytest.mark.parametrize("name", ["basilica.svg", "room.svg", "arena.svg"])
def test_a_world_as_a_map_keeps_every_cell(tmp_path: Path, name: str) -> None:
    plan = opened(WORLDS / name)
    states, lattice = rasterised(plan, CELL, name)
    rosmap.write(tmp_path / "m.yaml", states, lattice)
    again, there = rasterised(opened(tmp_path / "m.yaml"), CELL, "m.yaml")
    assert there == lattice
    assert (again == states).all()
    truth = Arena.open(plan, CELL, 1, name)
    first = truth.lattice.cells(np.array([lattice.x0 + CELL / 2, lattice.y0 + CELL / 2]))
    own = truth.occupied[first[0] : first[0] + lattice.rows, first[1] : first[1] + lattice.columns]
    assert ((again == OCCUPIED) == own).all()


@given(arrays.arrays(np.uint8, st.tuples(st.integers(1, 12), st.integers(1, 12)), elements=st.integers(0, 2)))
@settings(max_examples=50, deadline=None)
def test_a_map_keeps_unknown_unknown(tmp_path_factory: pytest.TempPathFactory, states: np.ndarray) -> None:
    folder = tmp_path_factory.mktemp("maps")
    lattice = Lattice(-1.25, 3.1, 0.05, *states.shape)
    rosmap.write(folder / "m.yaml", states, lattice)
    bitmap = rosmap.read(folder / "m.yaml")
    assert (bitmap.states == states).all()
    assert (bitmap.origin, bitmap.resolution) == ((-1.25, 3.1, 0.0), 0.05)
    rosmap.write(folder / "m.json", states, lattice)
    grid = json.loads((folder / "m.json").read_text())
    assert (grid["info"]["width"], grid["info"]["height"]) == (lattice.columns, lattice.rows)
    wanted = {UNKNOWN: -1, FREE: 0, OCCUPIED: 100}
    assert grid["data"] == [wanted[int(state)] for state in states.reshape(-1)]


@pytest.mark.parametrize("ending", [".yaml", ".json"])
def test_origins_are_written_without_the_dust_of_sums(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"m{ending}"
    rosmap.write(path, np.zeros((2, 3), np.uint8), Lattice(-13.399999999999999, 0.30000000000000004, 0.1, 2, 3))
    assert "-13.4" in path.read_text()
    assert "0.30000" not in path.read_text()


@pytest.mark.parametrize("name", ["basilica.svg", "room.svg", "arena.svg"])
def test_a_world_as_polygons_or_as_a_drawing_is_the_same(name: str) -> None:
    plan = opened(WORLDS / name)
    for again in (
        geojson.plan_from(geojson.written(plan), "w.geojson"),
        read_floor_plan(drawing.drawn(plan, "A <plan>"), "w.svg"),
    ):
        assert again.page == pytest.approx(plan.page)
        assert again.spawns.keys() == plan.spawns.keys()
        for layer, shape in plan.layers.items():
            assert again.layers[layer].symmetric_difference(shape).area < 1e-5


# --- polygons


def test_geojson_has_layers_lines_and_a_page(tmp_path: Path) -> None:
    def feature(kind: str, coordinates: list, **properties: object) -> dict:
        return {
            "type": "Feature",
            "properties": properties,
            "geometry": {"type": kind, "coordinates": coordinates},
        }

    ring = [[0, 0], [6, 0], [6, 4], [0, 4], [0, 0]]
    hole = [[0.5, 0.5], [0.5, 3.5], [5.5, 3.5], [5.5, 0.5], [0.5, 0.5]]
    features = [
        feature("Polygon", [ring, hole], layer="Walls"),
        feature("LineString", [[3, 0.5, 9], [3, 2, 9]], layer="walls", width=0.2),
        feature("Point", [1, 1], name="a lamp"),
        feature("Polygon", [[[1, 1], [2, 1], [2, 2], [1, 1]]], layer="spawn", id="start"),
        feature("Polygon", [[[4, 1], [5, 1], [5, 2], [4, 1]]], layer="carpet"),
    ]
    path = tmp_path / "w.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "bbox": [-1, -1, 7, 5], "features": features}))
    plan = opened(path)
    assert plan.walls.area == pytest.approx(24 - 15 + 0.3)
    assert plan.page == (-1.0, -1.0, 7.0, 5.0)
    assert list(plan.spawns) == ["start"]
    assert "1 points are passed over" in plan.notices[0]
    assert opened(path, width=16.0).walls.area == pytest.approx(4 * 9.3)
    assert opened(path, layers={"walls": ["carpet"]}).walls.area == pytest.approx(0.5)


def test_wkt_is_read_whole_or_by_lines(tmp_path: Path) -> None:
    path = tmp_path / "w.wkt"
    path.write_text(
        "POLYGON ((0 0, 4 0, 4 3, 0 3, 0 0), (1 1, 1 2, 3 2, 3 1, 1 1))\n\nPOLYGON ((5 0, 6 0, 6 1, 5 0))\n"
    )
    assert opened(path).walls.area == pytest.approx(10.5)
    assert opened(path, scale=2.0).walls.area == pytest.approx(42.0)


BAD_POLYGONS = {
    "{": "line 1, column 2: not JSON",
    "[1]": "no GeoJSON object",
    '{"type": "FeatureCollection", "features": 3}': "features is not a list",
    '{"type": "FeatureCollection", "features": [{"type": "Feature", "geometry": 7}]}': "feature 1: .*not an object",
    '{"type": "Polygon", "coordinates": [[0, 0]]}': "feature 1: its geometry is not GeoJSON",
    '{"type": "Polygon", "coordinates": [[[0, 0], [2, 2], [2, 0], [0, 2], [0, 0]]]}': "not a valid area .Self-inters",
    '{"type": "Polygon", "coordinates": [[[0, 0], [2e9, 2], [2, 0], [0, 0]]]}': "farther than 10000 m",
    '{"type": "LineString", "coordinates": [[0, 0], [2, 2]]}': "a line has no area; give it a property 'width'",
    '{"type": "Point", "coordinates": [0, 0]}': "nothing in it is solid",
    '{"type": "Point", "coordinates": [0, 0], "bbox": [0, 0, 0, 1]}': "bbox is not a box",
}


@pytest.mark.parametrize(("text", "message"), BAD_POLYGONS.items(), ids=range(len(BAD_POLYGONS)))
def test_bad_polygons_are_refused(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "w.geojson").write_text(text)
    bad = "[[[0, 0], [1, 1], [0, 0], [0, 0]], 3]"
    several = f'{{"type": "FeatureCollection", "features": [{{"type": "Polygon", "coordinates": {bad}}}, 4]}}'
    with pytest.raises(InputError, match=message):
        opened(tmp_path / "w.geojson")
    (tmp_path / "w.json").write_text(several)
    with pytest.raises(InputError, match=r"2 problems:\n  feature 1: .*\n  feature 2 is not an object"):
        opened(tmp_path / "w.json")
    (tmp_path / "w.wkt").write_text("secret\nPOLYGON EMPTY")
    with pytest.raises(InputError, match="2 problems:\n  line 1: not WKT") as caught:
        opened(tmp_path / "w.wkt")
    assert "secret" not in str(caught.value)


# --- what is refused


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"image": "away.png"}, "no such file"),
        ({"image": None}, "image: required key is missing"),
        ({"resolution": 0}, "resolution: expected `float` > 0"),
        ({"resolution": "coarse"}, "resolution: expected `float`"),
        ({"origin": [1]}, "origin: expected `array` of length >= 2"),
        ({"origin": [1e9, 0, 0]}, "is the origin right"),
        ({"negate": 3}, "negate: "),
        ({"mode": "grey"}, "mode: invalid enum value"),
        ({"occupied_thresh": 0.1}, "free_thresh: above occupied_thresh"),
        ({"occupied_thresh": 65}, "occupied_thresh: expected `float` <= 1"),
    ],
)
def test_a_bad_yaml_is_refused(pair, keys: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        opened(pair([[0, 254]], **keys))


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("m.yaml", b"a: [1, secret", "line 1: not YAML"),
        ("m.yaml", b"secret", "no keys in it"),
        ("m.yaml", b"a: &a [*a, *a]", "image, resolution: required keys are missing"),
        ("m.yaml", b"\xff\xfe", "not YAML"),
        ("m.pgm", b"secret", "no image that can be read"),
        ("m.png", b"\x89PNG\r\n\x1a\nsecret", "no image that can be read"),
        ("m.pgm", b"P5\n4 4\n255\nab", "a broken image"),
        ("m.pgm", b"P5\n100000 100000\n255\n", "100000 x 100000 pixels; expected at most"),
        ("m.pgm", b"P2\n2 1\n255\n1 secret", "a broken image"),
    ],
)
def test_broken_maps_are_refused_and_never_repeated(tmp_path: Path, name: str, content: bytes, message: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=message) as caught:
        opened(tmp_path / name, resolution=0.1)
    assert "secret" not in str(caught.value)


def test_a_bomb_is_not_unpacked(tmp_path: Path) -> None:
    Image.new("1", (30_000, 30_000)).save(tmp_path / "m.png")
    assert (tmp_path / "m.png").stat().st_size < 200_000
    with pytest.raises(InputError, match="30000 x 30000 pixels"):
        opened(tmp_path / "m.png", resolution=0.1)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"file": "", "generate": {}}, "either a file or a table"),
        ({"file": "a.svg", "scale": 2.0, "width": 3.0}, "the same in three ways"),
    ],
)
def test_contradictory_worlds_are_refused(keys: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        World(**keys)


@pytest.mark.parametrize("path", ["/dev/zero", "/tmp", "/nowhere/plan.svg"])
def test_only_plain_files_are_read(path: str) -> None:
    with pytest.raises(InputError, match=r"no plain file|no such file"):
        read_world(World(file=path), CELL)
