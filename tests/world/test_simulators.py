"""Worlds of Stage and Gazebo: where their walls are, and where their robots stand."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import shapely
from PIL import Image

from swarmsim.core.errors import InputError
from swarmsim.core.scenario.decoding import convert
from swarmsim.core.scenario.file import World
from swarmsim.world.shapes import Drawing
from swarmsim.world.simulators import sdf, stage


def layer(drawing: Drawing, name: str) -> shapely.Geometry:
    return shapely.union_all([shape.fill for shape in drawing.shapes if shape.layer == name])


def solid_at(drawing: Drawing, *points: tuple[float, float]) -> list[bool]:
    walls = layer(drawing, "walls")
    return [bool(shapely.contains_xy(walls, *point)) for point in points]


# --- Stage


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A picture of 60 x 40 px with margins of 6 and 4 px: a frame of 2 px around two rooms with a door between them."""
    levels = np.full((40, 60, 3), 255, np.uint8)
    levels[4:36, 6:54, 0] = 0
    levels[6:34, 8:52, 0] = 255
    levels[6:34, 29:31, 0] = 127  # the darkest grey that is still a wall
    levels[16:24, 29:31, 0] = 128
    levels[20, 20, 1:] = 0  # red is light
    (tmp_path / "bitmaps").mkdir()
    Image.fromarray(levels).save(tmp_path / "bitmaps" / "rooms.png")
    (tmp_path / "map.inc").write_text("define map model ( # walls\n  obstacle_return 0  ranger_return 0.5\n)\n")
    return tmp_path


def staged(folder: Path, text: str, **keys: object) -> Drawing:
    path = folder / "w.world"
    path.write_text(text)
    assert not sdf.holds(path)
    return stage.read(path, convert({"file": str(path), **keys}, World))


ROBOTS = """
include "map.inc"
define r2 position ( size [0.4 0.4 0.3] ranger ( sensor ( range [0 5] ) ) )
interval_sim 100
window ( size [ 600 400 ] scale 20 )
map ( name "rooms" pose [0 0 0 0] size [24 16 1] bitmap "bitmaps/rooms.png" )
r2 ( name "a" pose [-8 -4 0 45] color "red" )
r2 ( name "b" pose [-6 -4 0 [ )
""".replace("[-6 -4 0 [ )", '[-6 -4 0 0] ctrl "wander" list [ 1 "red" 2 ] )')


def test_the_box_of_the_dark_pixels_is_fitted_to_the_size(folder: Path) -> None:
    drawing = staged(folder, ROBOTS)
    assert drawing.page == pytest.approx((-12.0, -8.0, 12.0, 8.0))
    assert drawing.unit == "m"
    assert layer(drawing, "walls").area == pytest.approx(24 * 16 - 22 * 14 + 1 * 10)  # 0.5 m a pixel
    assert solid_at(drawing, (-11.8, 0), (0, 6), (0, -6), (11.8, 7.9)) == [True] * 4
    assert solid_at(drawing, (0, 0), (-5, 5), (5, -5), (-10.8, -6.8)) == [False] * 4


def test_x_and_y_are_fitted_apart_and_models_are_turned_in_degrees(folder: Path) -> None:
    turned = ROBOTS.replace("pose [0 0 0 0] size [24 16 1]", "pose [30 0 0 90] size [24 32 1]")
    drawing = staged(folder, turned)
    assert drawing.page == pytest.approx((14.0, -12.0, 46.0, 12.0))
    assert layer(drawing, "walls").area == pytest.approx(2 * (24 * 16 - 22 * 14 + 1 * 10))
    assert solid_at(drawing, (30, 0), (40, 0), (20, 0)) == [False, True, True]


def test_robots_stand_in_the_spawn_area(folder: Path) -> None:
    drawing = staged(folder, ROBOTS)
    [spawn] = [shape for shape in drawing.shapes if shape.layer == "spawn"]
    assert spawn.spawn == "spawn"
    assert spawn.fill.bounds == pytest.approx((-8.5, -4.5, -5.5, -3.5))
    near = staged(folder, ROBOTS.replace("[-8 -4 0 45]", "[-0.8 -4 0 45]").replace("[-6 -4", "[-1 -4"))
    area = layer(near, "spawn")
    assert area.bounds == pytest.approx((-1.5, -4.5, -0.5, -3.5))  # not beyond the wall


def test_scale_and_width_apply(folder: Path) -> None:
    assert staged(folder, ROBOTS, scale=2.0).page == pytest.approx((-24.0, -16.0, 24.0, 16.0))
    assert staged(folder, ROBOTS, width=12.0).page == pytest.approx((-6.0, -4.0, 6.0, 4.0))


def test_boxes_blocks_and_nested_models_are_solid(folder: Path) -> None:
    text = """
    define wall model ( size [2 0.2 1] )
    define post wall ( size [1 1 1]
      block ( points 4 point[0] [0 0] point[1] [9 0] point[2] [9 5] point[3] [0 5] z [0 1] )
      block ( points 3 point[0] [0 5] point[1] [9 5] point[2] [0 10] ) )
    wall ( pose [1 0 0 0] )
    wall ( pose [0 5 0 90] wall ( pose [3 0 0 0] ) )
    post ( pose [-4 0 0 0] )
    model ( size [10 10 1] pose [0 0 0 0] obstacle_return 0 )
    model ( size [10 10 1] bitmap "bitmaps/rooms.png" ranger_return -1 )
    position ( pose [9 9 0 0] )
    """
    drawing = staged(folder, text)
    assert layer(drawing, "walls").area == pytest.approx(3 * 0.4 + 0.5 + 0.25)
    assert solid_at(drawing, (1.9, 0), (0, 5.9), (0, 7.1), (0, 8.9), (-4.4, -0.1), (-4.4, 0.4)) == [True] * 6
    assert solid_at(drawing, (-3.6, 0.4), (0.5, 5), (9, 9), (3, 3)) == [False] * 4


def test_a_boundary_closes_the_outline(folder: Path) -> None:
    drawing = staged(folder, "model ( size [10 8 1] boundary 1 bitmap bitmaps/rooms.png )")
    assert drawing.page == pytest.approx((-5.1, -4.1, 5.1, 4.1))


def test_what_is_not_there_is_told(folder: Path) -> None:
    (folder.parent / "away.inc").write_text("define tank position ( )")
    text = (
        'include "../away.inc"\ninclude "gone.inc"\ntank ( pose [1 1 0 0] )\n'
        'model ( size [24 16 1] bitmap "/home/me/rooms.png" )'
    )
    (folder / "rooms.png").write_bytes((folder / "bitmaps" / "rooms.png").read_bytes())
    drawing = staged(folder, text)
    told = " ".join(drawing.notices)
    for words in (
        "../away.inc",
        "gone.inc",
        "the picture /home/me/rooms.png, which is not here",
        "where its robots stand (1)",
    ):
        assert words in told


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("model ( size [1 1", "line 1: it ends in the middle"),
        ("model (\n size [a b] )", "line 1: size is not a list of numbers"),
        ("\n)", r"line 2: '\)' where a word should be"),
        ('name "x', "line 1: a quotation mark without its second"),
        ("model ( size [0 1 1] )", "size is out of range"),
        ("model ( size [1 1 1] pose [1 inf 0 0] )", "pose is not a list of numbers"),
        ("model ( size [1 1 1] pose [1 1e9 0 0] )", "farther than 10000 m"),
        ('model ( size [1 1 1] bitmap "gone.png" )', "no such file"),
        ('model ( size [1 1 1] bitmap "white.png" )', "no pixel in it is dark"),
        ("position ( pose [0 0 0 0] )", "no model in it has a bitmap"),
        ("model ( " * 99, "nested deeper"),
        ("# nothing", "no model in it"),
    ],
)
def test_bad_worlds_of_stage_are_refused(folder: Path, text: str, message: str) -> None:
    Image.new("L", (4, 4), 255).save(folder / "white.png")
    with pytest.raises(InputError, match=message):
        staged(folder, text)


def test_definitions_cannot_multiply_without_end(folder: Path) -> None:
    lines = ["define m0 model ( size [1 1 1] )"]
    lines += [f"define m{k} model ( {f'm{k - 1} ( ) ' * 10} )" for k in range(1, 12)]
    with pytest.raises(InputError, match="more than 20000 models"):
        staged(folder, "\n".join([*lines, "m11 ( )"]))
    (folder / "map.inc").write_text('include "w.world"\ninclude "map.inc"\ndefine map model ( )')
    assert staged(folder, ROBOTS).page == pytest.approx((-12.0, -8.0, 12.0, 8.0))


# --- Gazebo

HALF = math.pi / 2


def gazebo(tmp_path: Path, inside: str, **keys: object) -> Drawing:
    path = tmp_path / "g.world"
    path.write_text(f'<?xml version="1.0" ?>\n<sdf version="1.6"><world name="w">\n{inside}\n</world></sdf>')
    assert sdf.holds(path)
    return sdf.read(path, convert({"file": str(path), **keys}, World))


def box(size: str, pose: str = "", collision: str = "") -> str:
    placed = f"<pose>{pose}</pose>" if pose else ""
    own = f"<pose>{collision}</pose>" if collision else ""
    return (
        f"<model name='m'>{placed}<static>1</static><link name='l'><collision name='c'>{own}<geometry><box><size>{size}"
        "</size></box></geometry></collision></link></model>"
    )


def test_boxes_lie_where_nested_poses_say(tmp_path: Path) -> None:
    nested = (
        "<model name='house'><pose>10 0 0 0 0 1.5707963267948966</pose><static>true</static>"
        "<link name='wall'><pose>2 0 0.5 0 0 0</pose><collision name='c'><pose>0 1 0 0 0 0</pose>"
        "<geometry><box><size>4 0.2 1</size></box></geometry></collision></link>"
        f"{box('1 1 1', '5 0 0.5 0 0 0')}</model>"
    )
    drawing = gazebo(tmp_path, nested + box("100 100 0.1", "0 0 -0.05 0 0 0") + box("6 6 0.2", "0 0 2.5 0 0 0"))
    assert layer(drawing, "walls").area == pytest.approx(0.8 + 1.0)
    assert solid_at(drawing, (9, 0.1), (9, 3.9), (10, 5.4), (9.6, 4.6)) == [True] * 4
    assert solid_at(drawing, (10, 2), (0, 0), (9, 4.1), (11, 1)) == [False] * 4


@pytest.mark.parametrize(
    ("size", "pose", "area"),
    [
        ("1 2 1", "0 0 0.5 0 0 0.7", 2.0),
        ("1 2 0.1", "0 0 0.35 0 0 0", 0.0),  # just above
        ("1 2 0.1", "0 0 0.3 0 0 0", 2.0),
        ("1 2 0.1", "0 0 0 0 0 0", 0.0),  # a doorstep of 5 cm
        ("1 1 4", f"0 0 0 {HALF} 0 0", 4.0),  # a beam that lies down
        ("0.02 1 8", f"0 0 0 0 {HALF / 2} 0", (0.25 + 0.02 * math.sqrt(2)) * 1.0),  # a ramp of 45 degrees
    ],
)
def test_what_counts_is_what_a_robot_would_hit(tmp_path: Path, size: str, pose: str, area: float) -> None:
    drawing = gazebo(tmp_path, box(size, pose) + box("1 1 1", "50 50 0.5 0 0 0"))
    assert layer(drawing, "walls").area - 1.0 == pytest.approx(area, abs=1e-6)


def test_cylinders_and_balls(tmp_path: Path) -> None:
    def model(geometry: str, pose: str) -> str:
        return (
            f"<model name='a'><pose>{pose}</pose><link name='l'><collision name='c'><geometry>{geometry}"
            "</geometry></collision></link></model>"
        )

    cylinder = "<cylinder><radius>0.5</radius><length>2</length></cylinder>"
    drawing = gazebo(
        tmp_path,
        model(cylinder, "0 0 1 0 0 0")
        + model(cylinder, f"9 0 0.5 {HALF} 0 0")
        + model("<sphere><radius>1</radius></sphere>", "0 9 1 0 0 0"),
    )
    [upright, lying, ball] = [shape.fill for shape in drawing.shapes]
    assert upright.area == pytest.approx(math.pi / 4, rel=0.01)
    assert lying.bounds == pytest.approx((9 - math.sqrt(0.21), -1, 9 + math.sqrt(0.21), 1), abs=1e-3)
    assert ball.area == pytest.approx(math.pi * (1 - 0.7**2), rel=0.01)  # at the height of 0.3 m


def test_what_is_not_read_is_named(tmp_path: Path) -> None:
    more = (
        "<include><uri>model://sun</uri></include><include><uri>model://cafe_table</uri></include>"
        "<model name='chair'><link name='l'><collision name='c'><geometry><mesh><uri>model://chair.dae</uri></mesh>"
        "</geometry></collision></link></model>"
        "<model name='paint'><link name='l'><visual name='v'/></link></model>"
        "<model name='burger'><pose>2 0 0 0 0 0</pose><link name='l'/><joint name='a' type='continuous'/>"
        "<joint name='b' type='revolute'/></model>"
    )
    drawing = gazebo(tmp_path, box("10 0.2 1", "0 4 0.5 0 0 0") + box("10 0.2 1", "0 -4 0.5 0 0 0") + more)
    told = " ".join(drawing.notices)
    for words in ("not read: cafe_table", "not read: chair", "stop no robot: paint", "models with wheels are robots"):
        assert words in told
    assert "sun" not in told
    assert layer(drawing, "spawn").bounds == pytest.approx((1.5, -0.5, 2.5, 0.5))


def test_models_are_where_they_were_when_the_world_was_saved(tmp_path: Path) -> None:
    state = "<state world_name='w'><model name='m'><pose>7 0 0.5 0 0 0</pose></model></state>"
    assert solid_at(gazebo(tmp_path, box("1 1 1", "0 0 0.5 0 0 0") + state), (7, 0), (0, 0)) == [True, False]


def test_poses_may_be_relative_to_links_and_in_degrees(tmp_path: Path) -> None:
    model = (
        "<model name='m'><pose degrees='true'>1 0 0 0 0 90</pose>"
        "<frame name='f'><pose>2 0 0 0 0 0</pose></frame>"
        "<link name='a'><pose relative_to='f'>0 1 0.5 0 0 0</pose></link>"
        "<link name='b'><pose relative_to='a'>3 0 0 0 0 0</pose><collision name='c'>"
        "<geometry><box><size>1 1 1</size></box></geometry></collision></link></model>"
    )
    assert layer(gazebo(tmp_path, model), "walls").bounds == pytest.approx((-0.5, 4.5, 0.5, 5.5))
    with pytest.raises(InputError, match="is relative to 'x', no link of it"):
        gazebo(tmp_path, model.replace("relative_to='f'", "relative_to='x'"))
    with pytest.raises(InputError, match="is relative to"):
        gazebo(tmp_path, model.replace("relative_to='f'", "relative_to='b'"))


@pytest.mark.parametrize(
    ("inside", "message"),
    [
        ("<model", r"line \d, column \d+: not XML"),
        (box("1 1"), "line 3: <box> without a size; expected 3 lengths in m"),
        (box("1 1 -1"), "<box> without a size"),
        (box("1 1 1", "1 2"), "<pose> is not six numbers"),
        (box("1 1 1", "1e9 0 0 0 0 0"), "<pose> is not six numbers"),
        (
            "<include><uri>model://house</uri></include>",
            "no box or cylinder in it .*; models of other files .* house",
        ),
    ],
)
def test_bad_worlds_of_gazebo_are_refused(tmp_path: Path, inside: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        gazebo(tmp_path, inside)
