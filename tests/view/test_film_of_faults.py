"""Faults in pictures: who has one, who is gone, which boxes stand, and what a line says of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import made

from swarmsim.core.events import Begins, Ends
from swarmsim.recording.reader import Recording
from swarmsim.view.canvas import Canvas
from swarmsim.view.legend import signs
from swarmsim.view.scene import Scene
from swarmsim.view.style import Style
from swarmsim.view.theme import DARK
from swarmsim.view.timeline import noted
from swarmsim.view.video import frame

SIZE = (1280, 720)
OFF, CRASHED, REMOVED, LATE = 0, 1, 2, 3  # robots
FAULTS = """faults=[
    {use="join", at=20},
    {use="motor", failure="off", at=5, duration=10, robots=[0]},
    {use="crash", at=8, duration=10, robots=[1]},
    {use="remove", at=9, duration=100, robots=[2]},
    {use="furniture", at=12, duration=9, box=[3.9, 0.9, 4.3, 1.3]},
]""".replace("\n", "").replace(",]", "]")


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    path = tmp_path_factory.mktemp("faults") / "recording.h5"
    run = made("robots.count=4", "seed=3", "stop.iterations=30", FAULTS)
    with run.recorder(path) as recorder:
        run.simulation.run([recorder])
    return Recording(path)


@pytest.fixture(scope="module")
def scene(recording: Recording) -> Scene:
    return Scene(recording)


def marks(scene: Scene, iteration: int) -> list[str]:
    return list(scene.at(iteration).marks)


def test_marks_begin_and_end_with_what_they_mark(scene: Scene) -> None:
    assert marks(scene, 4) == ["", "", "", "late"]
    assert marks(scene, 5) == ["fault", "", "", "late"]
    assert marks(scene, 14) == ["fault", "", "removed", "late"]  # the crashed are seen to be dead
    assert marks(scene, 15) == ["", "", "removed", "late"]
    assert marks(scene, 20) == ["", "", "removed", "joined"]


def test_boxes_stand_from_their_first_iteration_to_their_last(scene: Scene) -> None:
    standing = [len(scene.at(iteration).boxes) for iteration in range(30)]
    assert standing == [0] * 12 + [1] * 9 + [0] * 9
    assert scene.at(15).boxes == ((3.9, 0.9, 4.3, 1.3),)


def test_captions_name_the_newest_three_events_with_their_robots(scene: Scene) -> None:
    assert scene.at(0).captions == ["iteration 0: late: robot 3"]
    assert scene.at(9).captions == [
        "iteration 5: motor off: robot 0", "iteration 8: crashed: robot 1", "iteration 9: removed: robot 2",
    ]  # fmt: skip
    assert scene.at(12).captions[-1] == "iteration 12: furniture placed"
    assert scene.at(29).captions[-1] == "iteration 29: not finished: limit of 30 iterations"


def test_captions_go_after_a_minute(tmp_path: Path) -> None:
    run = made("stop.iterations=70", 'faults=[{use="motor", failure="off", at=5, robots=[0]}]', "period=1.0")
    with run.recorder(tmp_path / "recording.h5") as recorder:
        run.simulation.run([recorder])
    scene = Scene(Recording(tmp_path / "recording.h5"))
    assert [len(scene.at(iteration).captions) for iteration in (4, 5, 64, 65)] == [0, 1, 1, 0]


def test_a_note_counts_robots_that_are_too_many_to_name() -> None:
    scenario = made('faults=[{use="motor", failure="off", at=7}, {use="radio", failure="off", at=7}]').scenario
    few, many = Begins(7, 0, (3, 7, 9)), Begins(7, 1, tuple(range(40)))
    assert noted(few, scenario).text == "iteration 7: motor off: robots 3, 7, 9"
    assert noted(many, scenario).text == "iteration 7: radio off: 40 robots"


def test_a_note_of_a_fault_of_the_whole_network_names_it_once() -> None:
    jam = made('faults=[{use="radio", failure="jam", at=5, duration=3, area=[0.5, 0.5, 1.0, 1.0]}]').scenario
    keys = "at=5 duration=3 area=[0.5,0.5,1.0,1.0]"
    assert noted(Begins(5, 0, ()), jam).text == f"iteration 5: radio jam: {keys}"
    assert noted(Ends(8, 0, ()), jam).text == f"iteration 8: radio jam over: {keys}"


def test_marks_on_the_curve_are_named_by_what_begins(scene: Scene) -> None:
    assert scene.names == {0: "late", 5: "motor off", 8: "crashed", 9: "removed", 12: "furniture placed"}
    assert scene.marks == [0, 5, 8, 9, 12, 15, 18, 20, 21]


def test_the_legend_explains_what_is_shown_and_nothing_else(scene: Scene, room: Path) -> None:
    rare = {"fault", "dead", "removed", "box", "mark"}
    assert rare <= {kind for kind, *_ in signs(scene, Style(), 1.0)}
    assert not rare & {kind for kind, *_ in signs(Scene(Recording(room)), Style(), 1.0)}


def test_the_legend_explains_links_of_those_who_hear_somebody(scene: Scene, tmp_path: Path) -> None:
    alone = made("stop.iterations=2", 'network.topology={use="none"}')
    with alone.recorder(tmp_path / "recording.h5") as recorder:
        alone.simulation.run([recorder])
    links = {"mutual", "one way"}
    assert links <= {kind for kind, *_ in signs(scene, Style(), 1.0)}
    assert not links & {kind for kind, *_ in signs(Scene(Recording(tmp_path / "recording.h5")), Style(), 1.0)}


def colours(recording: Recording, iteration: int, points: np.ndarray) -> list[tuple[int, ...]]:
    """The colours of a picture at points (p, 2) in pixels."""
    columns, rows = np.rint(points).astype(int).T
    return [tuple(colour) for colour in frame(recording, iteration, SIZE)[rows, columns].tolist()]


def around(canvas: Canvas, scene: Scene, iteration: int, robot: int, reach: float) -> np.ndarray:
    """Points (16, 2) on a circle around a robot, of a radius of so many robots' radii, in pixels."""
    angles = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
    centre = canvas.pixels(scene.at(iteration).pose[robot, :2])
    return centre + reach * canvas.radius * np.column_stack([np.cos(angles), np.sin(angles)])


def test_a_ring_is_drawn_around_a_robot_while_it_has_a_fault(recording: Recording, scene: Scene) -> None:
    canvas = Canvas(scene, SIZE)
    ringed = [colours(recording, t, around(canvas, scene, t, OFF, 1.97)).count(DARK.mark) for t in (4, 5, 10, 14, 15)]
    assert ringed[0] == ringed[-1] == 0
    assert min(ringed[1:-1]) > 5  # a link or another robot may hide a part


def test_the_crashed_are_crossed_out_the_removed_are_rings_and_the_late_are_not_there(
    recording: Recording, scene: Scene
) -> None:
    canvas = Canvas(scene, SIZE)
    half = {robot: colours(recording, 14, around(canvas, scene, 14, robot, 0.75)) for robot in (CRASHED, REMOVED, LATE)}
    centre = {robot: colours(recording, 14, around(canvas, scene, 14, robot, 0.0))[0] for robot in half}
    assert half[CRASHED].count(DARK.dead) > 6
    assert half[REMOVED].count(DARK.dead) > 6
    assert half[LATE].count(DARK.dead) == 0
    assert centre[CRASHED] not in (DARK.dead, DARK.floor)  # the cross
    assert centre[REMOVED] != DARK.dead
    assert colours(recording, 14, around(canvas, scene, 14, REMOVED, 0.75)) != colours(
        recording, 8, around(canvas, scene, 14, REMOVED, 0.75)
    )


def test_a_box_is_drawn_where_it_stands(recording: Recording, scene: Scene) -> None:
    canvas = Canvas(scene, SIZE)
    inside = canvas.pixels(np.array([[4.0, 1.0], [4.1, 1.2], [4.2, 1.05]]))
    assert colours(recording, 15, inside) == [DARK.solids["walls"]] * 3
    assert DARK.solids["walls"] not in colours(recording, 11, inside) + colours(recording, 21, inside)


def test_a_caption_is_written_below_the_map(recording: Recording) -> None:
    with_, without = (frame(recording, t, SIZE)[600:, :900] for t in (9, 0))
    bars = (with_ == DARK.mark).all(axis=2).sum()
    assert bars > 2.5 * (without == DARK.mark).all(axis=2).sum() > 0
