"""Buildings in degrees and indoor maps: GeoJSON, OpenStreetMap, IMDF, wrld3d: how large they are, and what is where."""

from __future__ import annotations

import json
import math
import zipfile
from collections.abc import Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
import pytest
import shapely

from swarmsim.core.errors import InputError
from swarmsim.core.scenario.decoding import convert
from swarmsim.core.scenario.file import World
from swarmsim.world import geojson
from swarmsim.world.indoor import imdf, osm
from swarmsim.world.indoor.levels import levels_of
from swarmsim.world.indoor.projection import Projection
from swarmsim.world.plan import FloorPlan
from swarmsim.world.reading import plan_of
from swarmsim.world.shapes import Drawing

HAMBURG = (9.93, 53.55)
Ring = list[tuple[float, float]]


def degrees(points: Sequence[tuple[float, float]], place: tuple[float, float] = HAMBURG) -> list[list[float]]:
    """Longitudes and latitudes of places in metres, by the series of a degree's length (NGA), not by our projection."""
    turn = math.radians(place[1])
    north = 111132.954 - 559.822 * math.cos(2 * turn) + 1.175 * math.cos(4 * turn)
    east = 111412.84 * math.cos(turn) - 93.5 * math.cos(3 * turn) + 0.118 * math.cos(5 * turn)
    return [[place[0] + x / east, place[1] + y / north] for x, y in points]


def box(left: float, low: float, right: float, high: float) -> Ring:
    return [(left, low), (right, low), (right, high), (left, high), (left, low)]


def area(ring: Ring, place: tuple[float, float] | None = HAMBURG, **tags: object) -> dict:
    corners = [list(point) for point in ring] if place is None else degrees(ring, place)
    return {"type": "Feature", "properties": tags, "geometry": {"type": "Polygon", "coordinates": [corners]}}


def mark(*points: tuple[float, float], place: tuple[float, float] | None = HAMBURG, **tags: object) -> dict:
    corners = [list(point) for point in points] if place is None else degrees(points, place)
    geometry = {"type": "LineString", "coordinates": corners}
    if len(points) == 1:
        geometry = {"type": "Point", "coordinates": corners[0]}
    return {"type": "Feature", "properties": tags, "geometry": geometry}


def text(features: list[dict], **members: object) -> str:
    return json.dumps({"type": "FeatureCollection", **members, "features": features})


def opened(features: list[dict], **keys: object) -> Drawing:
    return geojson.read(text(features), "map.geojson", convert({"file": "map.geojson", **keys}, World))


def layer(drawing: Drawing, name: str) -> shapely.Geometry:
    return shapely.union_all([shape.fill for shape in drawing.shapes if shape.layer == name])


def floor(drawing: Drawing) -> shapely.Geometry:
    """What is inside of rooms, or in a door, and not solid, as it is read in the end."""
    plan = plan_of(drawing, World(file="map.geojson", doors=0.0))
    inside = shapely.union_all([shape.fill for shape in drawing.shapes if shape.layer in ("floor", "doors")])
    return inside.difference(plan.walls)


def check(
    drawing: Drawing, square: float, inside: list[tuple[float, float]], outside: list[tuple[float, float]]
) -> None:
    """One floor of this many m2 that holds these places, and not those."""
    found = floor(drawing)
    assert found.area == pytest.approx(square, rel=0.01)
    assert [shapely.contains_xy(found, *point) for point in inside] == [True] * len(inside)
    assert [shapely.contains_xy(found, *point) for point in outside] == [False] * len(outside)


def two_rooms(place: tuple[float, float] = HAMBURG) -> list[dict]:
    """A corridor of 20 m x 2 m above two rooms of 10 m x 4 m, with doors of 1 m in the middle of their walls."""
    return [
        area(box(0, 4, 20, 6), place, indoor="corridor", level="0"),
        area(box(0, 0, 10, 4), place, indoor="room", level="0", ref="1"),
        area(box(10, 0, 20, 4), place, indoor="room", level="0", ref="2"),
        mark((5, 4), place=place, door="yes", width="1.0"),
        mark((15, 4), place=place, door="yes", width="1.0"),
    ]


TWO_ROOMS = 2 * 9.9 * 3.9 + 19.9 * 1.9 + 2 * 0.1  # m2 of floor
INSIDE, OUTSIDE = [(1, 1), (19, 1), (10, 5), (5, 4), (15, 4)], [(-1, 3), (10, 2), (8, 4), (21, 5), (0, 5)]


# --- degrees


@pytest.mark.parametrize("latitude", [-60.0, 0.0, 45.0, 53.55, 60.0, 78.0])
@pytest.mark.parametrize("size", [6.0, 700.0])
def test_degrees_are_as_long_as_they_are(latitude: float, size: float) -> None:
    corners = [(0.0, 0.0), (size, 0.0), (size, size), (0.0, size)]
    places = np.array(degrees([(x - size / 2, y - size / 2) for x, y in corners], (-71.0, latitude)))
    metres = Projection(-71.0, latitude).metres(places)
    assert np.abs(metres - metres[0] - corners).max() < 1e-3 * size
    assert Projection(-71.0, latitude).metres(np.array([[-71.0, latitude]])) == pytest.approx(np.zeros((1, 2)))


def test_the_projection_is_the_azimuthal_equidistant_one() -> None:
    # By PROJ 9: +proj=aeqd +lat_0=60 +lon_0=10 +ellps=WGS84
    metres = Projection(10.0, 60.0).metres(np.array([[10.1, 60.05], [10.0, 60.05], [10.1, 60.0]]))
    assert metres == pytest.approx(np.array([[5571.58, 5574.85], [0.0, 5570.64], [5580.00, 4.22]]), abs=0.01)


@pytest.mark.parametrize("place", [HAMBURG, (24.9, 60.0), (-68.3, -54.8), (0.0, 0.0)])
def test_rooms_in_degrees_are_as_large_as_they_are(place: tuple[float, float]) -> None:
    drawing = opened(two_rooms(place))
    assert (drawing.page[2] - drawing.page[0], drawing.page[3] - drawing.page[1]) == pytest.approx((20, 6), rel=0.01)
    assert drawing.page[:2] == pytest.approx((0, 0), abs=1e-3)
    assert drawing.unit == "degrees"
    assert "degrees of longitude and latitude" in drawing.notices[0]
    check(drawing, TWO_ROOMS, INSIDE, OUTSIDE)
    naive = 20.0 / math.cos(math.radians(place[1]))
    assert abs(place[1]) < 50 or naive > 1.6 * (drawing.page[2] - drawing.page[0])


def test_a_plan_without_tags_may_be_in_degrees_too() -> None:
    drawing = opened([area(box(0, 0, 20, 6)), area(box(20, 0, 21, 6), layer="walls")])
    assert layer(drawing, "walls").area == pytest.approx(6.0, rel=0.01)
    assert opened([area(box(0, 0, 20, 6))], width=40.0).page[2] == pytest.approx(40.0)


@pytest.mark.parametrize(
    ("features", "members", "keys"),
    [
        ([area(box(0, 0, 4, 3), None)], {}, {}),
        ([area(box(0, 0, 0.6, 0.5), None)], {}, {}),
        ([area(box(0, 0, 0.06, 0.05), None)], {}, {"scale": 100.0}),  # a unit of 100 m, the user says
        ([area(box(0, 0, 0.06, 0.05), None)], {"bbox": [0, 0, 4, 3]}, {}),
        ([area(box(0, 0, 0.06, 0.05), None)], {"swarmsim": {"plan": 1}}, {}),
        ([mark((0, 0), (0.06, 0), place=None, width=0.01)], {}, {}),  # a line that is thin beside the plan
    ],
)
def test_metres_are_not_taken_for_degrees(features: list[dict], members: dict, keys: dict) -> None:
    drawing = geojson.read(text(features, **members), "m.geojson", convert({"file": "m.geojson", **keys}, World))
    assert drawing.unit == "m"
    assert drawing.page[2] == pytest.approx(
        keys.get("scale", 1.0) * (members.get("bbox") or [0.06, 0, 0.06])[2], rel=99
    )
    assert drawing.page[2] < 10.0


def test_indoor_tags_in_metres_are_read_in_metres() -> None:
    metres = [
        area(box(0, 0, 10, 4), None, indoor="room"),
        area(box(0, 4, 10, 6), None, indoor="corridor"),
        mark((5, 4), place=None, door="hinged"),
    ]
    check(opened(metres), 9.9 * 3.9 + 9.9 * 1.9 + 0.09, [(1, 1), (1, 5), (5, 4)], [(1, 4), (-1, 1), (5, 6)])


# --- doors


def doors(drawing: Drawing) -> list[tuple[float, float, float, float]]:
    return [tuple(np.round(shape.fill.bounds, 2)) for shape in drawing.shapes if shape.layer == "doors"]


def rooms_in_metres(*more: dict) -> list[dict]:
    return [
        area(box(0, 0, 10, 4), None, indoor="room"), area(box(10, 0, 20, 4), None, indoor="room"),
        area(box(0, 4, 20, 6), None, indoor="corridor"), *more,
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("at", "width", "found"),
    [
        ((5, 4), "0.8", (4.6, 3.8, 5.4, 4.2)),
        ((5, 4), "80 cm", (4.6, 3.8, 5.4, 4.2)),
        ((5, 4), "1,2 m", (4.4, 3.8, 5.6, 4.2)),
        ((5, 4), "wide", (4.55, 3.8, 5.45, 4.2)),
        ((5, 4), 2.0, (4.0, 3.8, 6.0, 4.2)),
        ((5, 4.1), 0.8, (4.6, 3.8, 5.4, 4.2)),  # beside its wall
        ((10, 0), 0.8, (9.8, 0.05, 10.2, 0.85)),  # at the corner of two rooms and the outer wall
        ((0, 4), 0.8, (0.05, 3.8, 0.85, 4.2)),
    ],
)
def test_a_door_is_an_opening_across_the_wall_that_it_lies_on(
    at: tuple[float, float], width: object, found: tuple[float, ...]
) -> None:
    drawing = opened(rooms_in_metres(mark(at, place=None, door="yes", width=width)))
    assert doors(drawing) == [pytest.approx(found, abs=0.02)]


def test_doors_that_lead_outside_stay_closed_and_are_told() -> None:
    away = [
        mark((0, 2), place=None, door="yes"),
        mark((5, 0), place=None, entrance="main"),
        mark((9, 20), place=None, door="yes"),
    ]
    drawing = opened(rooms_in_metres(*away, mark((15, 4), place=None, door="yes")))
    assert len(doors(drawing)) == 1
    assert any("room to room stay closed (3 of 4)" in notice for notice in drawing.notices)


def test_a_door_is_a_corner_of_the_outlines_as_openstreetmap_has_it() -> None:
    features = [
        area([(0, 0), (10, 0), (10, 4), (5, 4), (0, 4), (0, 0)], None, indoor="room"),
        area([(0, 4), (5, 4), (10, 4), (10, 6), (0, 6), (0, 4)], None, indoor="room"),
        mark((5, 4), place=None, door="yes", width="1"),
    ]
    assert doors(opened(features)) == [pytest.approx((4.5, 3.8, 5.5, 4.2), abs=0.02)]


def test_a_gap_between_rooms_is_a_wall_with_the_door_through_it() -> None:
    features = [
        area(box(0, 0, 10, 4), None, indoor="room"),
        area(box(0, 4.3, 10, 8), None, indoor="room"),
        mark((3, 4), place=None, door="yes", width=1.0),
    ]
    drawing = opened(features)
    assert layer(drawing, "walls").area == pytest.approx(3.0, rel=0.01)
    # Two rooms with walls of 0.05 m inside of them, and the opening of 1 m through these and the gap of 0.3 m.
    check(drawing, 9.9 * 3.9 + 9.9 * 3.6 + 1.0 * 0.4, [(1, 1), (1, 7), (3, 4.15)], [(5, 4.15), (3.6, 4), (-1, 1)])
    assert floor(drawing).geom_type == "Polygon"


def test_a_line_across_an_area_is_a_wall_with_its_door() -> None:
    features = [
        area(box(0, 0, 10, 4), None, indoor="area"),
        mark((5, 0), (5, 4), place=None, indoor="wall", width="0.2"),
        mark((5, 2), place=None, door="yes"),
    ]
    check(opened(features), 9.9 * 3.9 - 0.2 * (3.9 - 0.9), [(1, 1), (9, 1), (5, 2)], [(5, 1), (5, 3.5), (-1, 1)])


def test_corridors_and_areas_that_touch_are_open_to_each_other() -> None:
    features = [
        area(box(0, 0, 10, 4), None, indoor="corridor"),
        area(box(10, 0, 14, 8), None, indoor="area"),
        area(box(11, 5, 12, 6), None, indoor="room"),
    ]
    drawing = opened(features)
    assert len([shape for shape in drawing.shapes if shape.layer == "floor"]) == 2
    assert shapely.contains_xy(floor(drawing), 10.0, 2.0)
    assert not shapely.contains_xy(floor(drawing), 11.0, 5.5)


# --- levels


@pytest.mark.parametrize(
    ("tags", "levels"),
    [
        ({"level": "0"}, {"0"}),
        ({"level": "0;1"}, {"0", "1"}),
        ({"level": "0-3"}, {"0", "1", "2", "3"}),
        ({"level": "-2--1"}, {"-2", "-1"}),
        ({"level": "-1-1;5"}, {"-1", "0", "1", "5"}),
        ({"level": "0.5"}, {"0.5"}),
        ({"level": 2}, {"2"}),
        ({"level": "1", "repeat_on": "3-4"}, {"1", "3", "4"}),
        ({"level": "0-99999999"}, {"0-99999999"}),
        ({"level_id": "a-b", "level": "7"}, {"a-b"}),
        ({}, set()),
    ],
)
def test_levels_are_lists_and_ranges(tags: dict, levels: set[str]) -> None:
    assert levels_of(tags) == levels


def test_one_level_is_read_and_several_are_listed() -> None:
    features = [
        area(box(0, 0, 10, 4), None, indoor="room", level="0"),
        area(box(0, 4, 10, 6), None, indoor="room", level="0;1"),
        area(box(0, 0, 5, 4), None, indoor="room", level="1"),
        mark((2, 4), place=None, door="yes"),
        area(box(12, 0, 15, 4), None, indoor="room", room="stairs", level="0-5"),
    ]
    with pytest.raises(
        InputError, match=r'has 2 levels; expected world.level = one of "0" \(2 rooms\), "1" \(2 rooms\)'
    ):
        opened(features)
    with pytest.raises(InputError, match=r"world.level: no level '7'; expected one of"):
        opened(features, level="7")
    check(
        opened(features, level="0"), 9.9 * 3.9 + 9.9 * 1.9 + 0.09, [(1, 1), (9, 1), (2, 4)], [(13, 1), (5, 4), (-1, 1)]
    )
    check(
        opened(features, level="1.0"), 4.9 * 3.9 + 9.9 * 1.9 + 0.09, [(1, 1), (9, 5), (2, 4)], [(13, 1), (9, 1), (5, 1)]
    )
    assert "no floor, and closed: stairs 1" in opened(features, level="0").notices
    with pytest.raises(InputError, match="nothing in it says its level"):
        opened([area(box(0, 0, 10, 4), None, indoor="room")], level="0")


# --- wrld3d


def test_walls_and_windows_of_wrld3d_are_solid_and_its_outer_doors_closed() -> None:
    ring = [degrees(box(0, 0, 12, 8)), degrees(box(0.2, 0.2, 11.8, 7.8))]
    features = [
        {"type": "Feature", "properties": {"type": "wall"}, "geometry": {"type": "Polygon", "coordinates": ring}},
        area(box(5.9, 0.2, 6.1, 7.8), type="wall"),
        area(box(5.9, 3, 6.1, 4), type="door"),
        area(box(0, 2, 0.2, 3), type="door"),
        area(box(0, 0, 12, 8), type="outline"),
        area(box(0.2, 0.2, 5.9, 7.8), type="room", id="r1"),
        area(box(7, 7.8, 9, 8), type="window"),
        area(box(9, 1, 11, 3), type="stairs"),
    ]  # fmt: skip
    drawing = opened(features)
    check(
        drawing,
        11.6 * 7.6 - 0.2 * 6.6 - 2.1 * 2.1,
        [(1, 1), (11, 7), (6, 3.5)],
        [(0.1, 2.5), (6, 6), (8, 7.9), (10, 2), (-1, 1)],
    )
    assert any("stay closed (1 of 2)" in notice for notice in drawing.notices)
    without = opened([feature for feature in features if feature["properties"]["type"] != "outline"])
    assert layer(without, "floor").is_empty
    assert layer(without, "walls").equals(layer(drawing, "walls"))


def test_a_facade_without_walls_is_closed_by_the_outline() -> None:
    features = [
        area(box(0, 0, 12, 8), type="building_outline"),
        area(box(0, 0, 12, 0.2), type="wall"),
        area(box(6, 0.2, 6.2, 4), type="wall"),
        area(box(6, 2, 6.2, 3), type="door"),
    ]
    check(opened(features), 11.9 * 7.75 - 0.2 * 2.8, [(1, 1), (11, 7), (6.1, 2.5)], [(0, 4), (6.1, 1), (12, 4)])


# --- names that the user gives


def test_the_user_says_which_names_are_floor_or_walls() -> None:
    features = [area(box(0, 0, 9, 4), None, room="office"), area(box(0, 4, 9, 5), None, name="Block 7")]
    drawing = opened(features, floor=["office"], layers={"walls": ["Block 7"]})
    assert layer(drawing, "floor").area == pytest.approx(36.0)
    assert layer(drawing, "walls").area == pytest.approx(9.0)
    with pytest.raises(InputError, match=r"layers\.ceiling: unknown key"):
        opened(features, layers={"ceiling": ["a"]})


def test_what_is_neither_floor_nor_wall_is_counted() -> None:
    more = [
        area(box(-5, -5, 30, 9), building="yes"),
        mark((1, 1), amenity="bench"),
        mark((0, 0), (3, 0), indoor="corridor"),  # a corridor without an area
    ]
    told = "passed over, as neither floor nor wall nor door: bench 1, corridor 1, yes 1"
    assert any(told in notice for notice in opened([*two_rooms(), *more]).notices)


def test_levels_lie_above_each_other() -> None:
    features = [area(box(0, 0, 10, 4), indoor="room", level="0"), area(box(4, 2, 6, 4), indoor="room", level="1")]
    assert opened(features, level="0").page == pytest.approx((0, 0, 10, 4), abs=1e-2)
    assert opened(features, level="1").page == pytest.approx((4, 2, 6, 4), abs=1e-2)


def test_doors_and_walls_of_the_user_go_with_floor_of_the_user() -> None:
    features = [
        area(box(0, 0, 9, 4), None, name="Hall"),
        area(box(0, 4, 9, 8), None, name="Kitchen"),
        mark((4, 4), place=None, layer="doors"),
        mark((7, 0), (7, 4), place=None, layer="walls"),
    ]
    drawing = opened(features, floor=["hall", "kitchen"])
    check(drawing, 2 * 8.9 * 3.9 + 0.09 - 0.39, [(1, 1), (1, 5), (4, 4)], [(7, 2), (2, 4), (-1, 1)])


# --- IMDF


def venue(folder: Path) -> Path:
    """A venue of two levels: three rooms, a lift and offices below, one hall above."""
    low, high = "11111111-aaaa", "22222222-bbbb"
    crossed = [(0, 10), (6, 10), (6, 12), (0, 12), (3, 9.9), (0, 10)]
    ground = area(box(0, 0, 20, 12), ordinal=0, name={"en": "Ground Floor"}, short_name={"en": "GF"})
    first = area(box(0, 0, 20, 12), ordinal=1, name={"en": "First Floor"}, short_name={"en": "1F"})
    lost = area([], category="room", level_id=low)  # no coordinates, as some converters write it
    files = {
        "level": [{**ground, "id": low, "geometry": None}, {**first, "id": high}],
        "unit": [
            area(box(0, 0, 10, 4), category="room", level_id=low),
            area(box(10, 0, 20, 4), category="retail", level_id=low),
            area(box(0, 4, 20, 6), category="walkway", level_id=low),
            area(box(0, 6, 4, 10), category="elevator", level_id=low),
            area(box(4, 6, 20, 10), category="nonpublic", level_id=low),
            area(box(0, 0, 20, 10), category="room", level_id=high),
            area(crossed, category="room", level_id=high),
            lost,
        ],
        "opening": [
            mark((4.5, 4), (5.5, 4), category="pedestrian", level_id=low),
            mark((14, 4), (16, 4), category="pedestrian", level_id=low),
            mark((1, 6), (2, 6), category="pedestrian", level_id=low),  # the lift's
            mark((20, 4.5), (20, 5.5), category="pedestrian.principal", level_id=low),  # outside
        ],
        "fixture": [area(box(1, 1, 2, 2), category="furniture", level_id=low)],
        "venue": [area(box(-50, -50, 90, 90), category="mall")],
    }  # fmt: skip
    folder.mkdir()
    for kind, features in files.items():
        own = [{**feature, "feature_type": kind} for feature in features]
        (folder / f"{kind}.geojson").write_text(text(own))
    return folder


@pytest.mark.parametrize("level", ["0", "11111111-AAAA", "ground floor", "GF"])
def test_a_level_of_a_venue_is_its_units_with_openings(tmp_path: Path, level: str) -> None:
    folder = venue(tmp_path / "v")
    drawing = imdf.read(folder, World(file=str(folder), level=level))
    check(
        drawing,
        2 * 9.9 * 3.9 + 19.9 * 1.9 + 0.3 - 1.0,
        [(5, 1), (15, 1), (10, 5), (5, 4), (15, 4)],
        [(1.5, 1.5), (1.5, 8), (1.5, 6), (10, 8), (20, 5), (8, 4)],
    )
    assert len(doors(drawing)) == 2
    assert any("stay closed (2 of 4)" in notice for notice in drawing.notices)
    assert "no floor, and closed: elevator 1, nonpublic 1" in drawing.notices
    assert not plan_of(drawing, World(file="v")).openings  # no door is made into the lift or the offices


def test_an_archive_of_a_venue_is_the_same(tmp_path: Path) -> None:
    folder = venue(tmp_path / "v")
    with zipfile.ZipFile(tmp_path / "v.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        for file in sorted(folder.iterdir()):
            archive.write(file, f"venue/{file.name}")
            archive.writestr(f"__MACOSX/venue/{file.name}", "no JSON")
    one, other = (imdf.read(path, World(file=str(path), level="0")) for path in (folder, tmp_path / "v.zip"))
    assert one.page == other.page
    assert [shape.fill.wkt for shape in one.shapes] == [shape.fill.wkt for shape in other.shapes]


def test_the_levels_of_a_venue_are_listed_and_its_crossed_areas_mended(tmp_path: Path) -> None:
    folder = venue(tmp_path / "v")
    with pytest.raises(
        InputError, match=r'2 levels; .*one of "0" \(Ground Floor, GF, 4 rooms\), "1" \(First Floor, 1F, 2 rooms\)'
    ):
        imdf.read(folder, World(file=str(folder)))
    drawing = imdf.read(folder, World(file=str(folder), level="1"))
    assert layer(drawing, "floor").area > 200.0
    assert any("outlines that cross themselves were mended (1)" in notice for notice in drawing.notices)


def test_archives_that_are_broken_or_swell_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bomb, broken, empty = (tmp_path / name for name in ("bomb.zip", "broken.zip", "empty.zip"))
    with zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("unit.geojson", b" " * 30_000)
        archive.writestr("level.geojson", b" " * 30_000)
    broken.write_bytes(bomb.read_bytes()[:-30])
    with zipfile.ZipFile(empty, "w") as archive:
        archive.writestr("readme.txt", "hello")
    monkeypatch.setattr(imdf, "LARGEST", 20_000)
    for path, message in ((bomb, "unpacks to more than"), (broken, "broken or locked"), (empty, "no unit.geojson")):
        with pytest.raises(InputError, match=message):
            imdf.read(path, World(file=str(path)))
    folder = venue(tmp_path / "v")
    (folder / "unit.geojson").rename(tmp_path / "unit.geojson")
    (folder / "unit.geojson").symlink_to(tmp_path / "unit.geojson")
    with pytest.raises(InputError, match="lies outside of it"):
        imdf.read(folder, World(file=str(folder), level="0"))


# --- OpenStreetMap


def as_osm(path: Path, features: list[dict], more: str = "") -> Path:
    """The same features as nodes and ways, which share the nodes of one place."""
    places: dict[tuple[float, float], int] = {}
    tags_of: dict[int, str] = {}
    ways = ""
    for number, feature in enumerate(features, start=1):
        tags = "".join(f"<tag k={quoteattr(k)} v={quoteattr(str(v))}/>" for k, v in feature["properties"].items())
        geometry = feature["geometry"]
        points = geometry["coordinates"]
        points = {"Point": [points], "LineString": points, "Polygon": points[0]}[geometry["type"]]
        refs = [places.setdefault(tuple(point), len(places) + 1) for point in points]
        if geometry["type"] == "Point":
            tags_of[refs[0]] = tags
        else:
            ways += f'<way id="{number}">' + "".join(f'<nd ref="{ref}"/>' for ref in refs) + tags + "</way>\n"
    nodes = "".join(
        f'<node id="{number}" lon="{lon!r}" lat="{lat!r}">{tags_of.get(number, "")}</node>\n'
        for (lon, lat), number in places.items()
    )
    path.write_text(f'<?xml version="1.0" encoding="UTF-8"?>\n<osm version="0.6">\n{nodes}{ways}{more}</osm>\n')
    return path


def test_openstreetmap_is_read_as_its_geojson_is(tmp_path: Path) -> None:
    path = as_osm(tmp_path / "m.osm", [*two_rooms(), area(box(-50, -50, 90, 90), building="yes")])
    drawing = osm.read(path, World(file=str(path)))
    assert drawing.page == pytest.approx((0, 0, 20, 6), rel=0.01, abs=1e-3)
    check(drawing, TWO_ROOMS, INSIDE, OUTSIDE)


def test_multipolygons_have_holes_and_walls_are_lines(tmp_path: Path) -> None:
    features = [area(box(0, 0, 10, 8)), area(box(4, 4, 6, 6)), mark((5, 0), (5, 3), indoor="wall")]
    relation = (
        '<relation id="9"><member type="way" ref="1" role="outer"/><member type="way" ref="2" role="inner"/>'
        '<tag k="type" v="multipolygon"/><tag k="indoor" v="room"/></relation>'
        '<way id="77"><nd ref="1"/><nd ref="999"/><tag k="indoor" v="room"/></way>'
    )
    path = as_osm(tmp_path / "m.osm", features, relation)
    drawing = osm.read(path, World(file=str(path)))
    check(drawing, 9.9 * 7.9 - 2.1 * 2.1 - 0.1 * 2.95, [(1, 1), (9, 1), (5, 7)], [(5, 5), (5, 2), (-1, 1)])
    assert any("file does not hold are passed over (1)" in notice for notice in drawing.notices)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("<osm><node", r"line 1, column \d+: not XML"),
        ("secret", "not XML"),
        ("<svg/>", "the root is not <osm>"),
        (
            "<osm>\n<node id='1'/>\n<node id='2' lat='x' lon='3'/></osm>",
            "2 problems:\n  line 2: a node.*\n  line 3: a node",
        ),
        ("<osm/>", "nothing in it has a tag indoor=room"),
        ('<!DOCTYPE a [<!ENTITY b SYSTEM "file:///etc/passwd">]><osm>&b;</osm>', "nothing in it has a tag"),
    ],
)
def test_bad_maps_are_refused_and_never_repeated(tmp_path: Path, content: str, message: str) -> None:
    (tmp_path / "m.osm").write_text(content)
    with pytest.raises(InputError, match=message) as caught:
        osm.read(tmp_path / "m.osm", World(file="m.osm"))
    assert "secret" not in str(caught.value)


# --- plans that we have written


def test_a_plan_that_is_written_is_the_same_to_the_bit() -> None:
    third = shapely.MultiPolygon([shapely.box(1 / 3, 0.1, 2 / 3, 7 / 9)])
    layers = {"walls": third, "pillars": shapely.MultiPolygon(), "furniture": shapely.MultiPolygon()}
    border, unknown = (shapely.MultiPolygon([shapely.box(x, 0.1, x + 0.1, 0.2)]) for x in (4.1, 2.3))
    spawns = {"a b": shapely.MultiPolygon([shapely.box(3.0, 0.1, 3.3, 0.7)])}
    plan = FloorPlan(
        third, layers, spawns, (-0.1, 0.0, 4.7, 1.1), unknown, ("f.svg: a notice",), border, ((1.0, 0.1, 1.9, 0.5),)
    )
    written = geojson.written(plan)
    assert geojson.is_ours(written)
    again = geojson.plan_from(written, "other")
    assert again == plan
    for one, other in ((again.walls, plan.walls), (again.border, border), (again.unknown, unknown)):
        assert shapely.to_wkb(one) == shapely.to_wkb(other)
    assert geojson.written(again) == written
    assert geojson.read(written, "w", World(file="w.geojson")).page == plan.page


def test_texts_of_older_recordings_are_read_as_they_were() -> None:
    older = text([area(box(0, 0, 4, 3), None), area(box(0, 0, 1, 1), None, layer="spawn", id="s")], bbox=[0, 0, 5, 5])
    assert not geojson.is_ours(older)
    plan = geojson.plan_from(older, "old", 2.0)
    assert plan.page == (0.0, 0.0, 10.0, 10.0)
    assert plan.walls.area == pytest.approx(48.0)
    assert list(plan.spawns) == ["s"]
    assert plan.notices == ("old: it has no layer of walls, pillars, furniture, so that all 2 shapes are walls",)
