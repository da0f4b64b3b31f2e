"""What can be chosen of a picture: layers, themes, one robot's map, two runs in step, cards; shapes in metres."""

from __future__ import annotations

from pathlib import Path

import av
import numpy as np
import pytest
from conftest import made
from PIL import Image

from swarmsim.core.errors import InputError
from swarmsim.core.state import FREE, OCCUPIED, UNKNOWN
from swarmsim.recording.reader import Recording
from swarmsim.view.canvas import Canvas
from swarmsim.view.discs import LEAST
from swarmsim.view.scene import Scene
from swarmsim.view.style import LAYERS, Style, look
from swarmsim.view.theme import DARK, THEMES, Theme
from swarmsim.view.title_cards import first_lines, last_lines
from swarmsim.view.video import Film, Stage, frame, write_film

SIZE = (1280, 720)
BARE = Style(layers=frozenset())


@pytest.fixture(scope="module")
def recording(room: Path) -> Recording:
    return Recording(room)


@pytest.fixture(scope="module")
def busy(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    """People, losses, a robot that comes late and one without a motor."""
    path = tmp_path_factory.mktemp("busy") / "recording.h5"
    faults = """faults=[{use="people", count=2}, {use="join", at=10},
        {use="motor", failure="off", at=5, robots=[0]}]""".replace("\n", "")
    run = made("robots.count=4", "stop.iterations=40", faults, 'network.channel={use="bernoulli", loss=0.4}',
               "network.topology={use='full'}")  # fmt: skip
    with run.recorder(path) as recorder:
        run.simulation.run([recorder])
    return Recording(path)


def colours(picture: np.ndarray, canvas: Canvas, cells: np.ndarray, scene: Scene) -> np.ndarray:
    columns, rows = np.rint(canvas.pixels(scene.lattice.centres(cells))).astype(int).T
    return np.asarray(picture[rows, columns])


@pytest.mark.parametrize("theme", THEMES.values(), ids=THEMES)
def test_floor_is_coloured_by_how_many_robots_know_it(recording: Recording, theme: Theme) -> None:
    scene = Scene(recording)
    view = Style(theme=next(name for name, one in THEMES.items() if one is theme), layers=frozenset())
    canvas, row = Canvas(scene, SIZE, view), 40
    known, cells = scene.known(row).copy(), scene.cells(row)
    maps = np.stack([scene.own_cells(robot, row) for robot in range(scene.robots)])
    assert (known == (maps != UNKNOWN).sum(axis=0)).all()
    assert (cells == maps.max(axis=0)).all()
    picture = frame(recording, row, SIZE, view)
    off_walls = recording["domain"] & (cells == FREE)
    for count in range(1, scene.robots + 1):
        places = np.argwhere(off_walls & (known == count))
        wanted = theme.between("few", "all", np.array((count - 1) / (scene.robots - 1)))
        got = colours(picture, canvas, places, scene)
        assert len(places) > 3
        assert (np.abs(got.astype(int) - wanted).max(axis=1) <= 2).mean() > 0.9  # a robot may stand on a cell


@pytest.mark.parametrize("robot", [0, 2])
def test_focus_shows_the_map_of_one_robot(recording: Recording, robot: int) -> None:
    scene, row = Scene(recording), 30
    view = Style(layers=frozenset(), focus=robot)
    canvas = Canvas(scene, SIZE, view)
    own = scene.own_cells(robot, row).copy()
    picture = frame(recording, row, SIZE, view)
    floor = recording["domain"] & ~recording["truth"]
    for cells, wanted in (
        ((own == FREE) & floor, DARK.all), ((scene.cells(row) == UNKNOWN) & floor, DARK.unexplored),
        ((own == OCCUPIED) & floor, DARK.seen),
    ):  # fmt: skip
        got = colours(picture, canvas, np.argwhere(cells), scene)
        assert not len(got) or (np.abs(got.astype(int) - wanted).max(axis=1) <= 4).mean() > 0.8  # under the magnifier
    others = (own == UNKNOWN) & (scene.cells(row) == FREE) & floor
    got = colours(picture, canvas, np.argwhere(others), scene)
    assert len(got) > 5
    assert (np.abs(got.astype(int) - DARK.all).max(axis=1) > 30).mean() > 0.85


def test_cells_that_are_forgotten_are_dark_again(tmp_path: Path) -> None:
    run = made("stop.iterations=60", "stop.when_done='continue'", "mind.computation.decay=0.2")
    with run.recorder(tmp_path / "r.h5") as recorder:
        run.simulation.run([recorder])
    recording = Recording(tmp_path / "r.h5")
    scene = Scene(recording)
    was, then = scene.cells(20).copy(), scene.cells(50).copy()
    gone = np.argwhere((was != UNKNOWN) & (then == UNKNOWN))
    assert len(gone) > 5
    canvas = Canvas(scene, SIZE, BARE)
    canvas.draw(20)
    picture = frame(recording, 50, SIZE, BARE)
    stepped = Stage([recording], Film(look=BARE, cards=False))
    stepped.at(20.0)
    assert np.array_equal(stepped.at(50.0), picture)
    got = colours(picture, canvas, gone, scene).astype(int)
    assert (np.abs(got - DARK.unexplored).max(axis=1) <= 4).mean() > 0.6  # the others lie under walls


def test_discs_never_overlap_more_than_the_bodies_do(tmp_path: Path) -> None:
    run = made("robots.count=9", "stop.iterations=30")
    with run.recorder(tmp_path / "r.h5") as recorder:
        run.simulation.run([recorder])
    scene = Scene(Recording(tmp_path / "r.h5"))
    canvas = Canvas(scene, (480, 270))
    discs = canvas.discs
    assert discs.enlarged > 1.5
    for iteration in range(0, 30, 3):
        shot = scene.at(iteration)
        radii, places = discs.radii(shot), canvas.pixels(shot.pose[:, :2])
        apart = np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1))
        touching = radii[:, None] + radii[None]
        least = np.maximum(2.0 * LEAST, 2.0 * canvas.camera.scale * scene.radius)
        far = ~np.eye(9, dtype=bool)
        assert (touching[far] <= np.maximum(apart[far], least) + 1e-9).all()
        assert (radii >= canvas.camera.scale * scene.radii - 1e-9).all()


def test_people_and_states_and_fates_are_in_the_shot(busy: Recording) -> None:
    scene = Scene(busy)
    shot = scene.at(20)
    assert shot.people.shape == (2, 3)
    assert shot.people == pytest.approx(busy["people"][20])
    assert scene.at(20.5).people == pytest.approx((busy["people"][20] + busy["people"][21]) / 2)
    assert shot.marks == ["fault", "", "", "joined"]
    letters = busy.letters(20)
    assert sorted(map(tuple, shot.lost.tolist())) == sorted(map(tuple, letters[letters[:, 4] > 0, :2].tolist()))
    assert shot.heard == (letters[:, 4] == 0).sum() > 0
    assert len(shot.lost) > 0
    view = Style(layers=frozenset({"people"}))
    canvas = Canvas(scene, SIZE, view)
    x, y = np.rint(canvas.pixels(shot.people[0, :2])).astype(int)
    ring = round(0.7 * canvas.camera.scale * shot.people[0, 2])
    picture = frame(busy, 20, SIZE, view)
    around = [tuple(picture[y + dy, x + dx]) for dx, dy in ((ring, 0), (-ring, 0), (0, ring), (0, -ring))]
    assert around.count(DARK.person) >= 3  # a robot may stand in the way
    without = frame(busy, 20, SIZE, BARE)
    assert (without == DARK.person).all(axis=2).sum() < 0.2 * (picture == DARK.person).all(axis=2).sum()


def test_groups_are_those_that_hear_each_other(busy: Recording) -> None:
    import networkx as nx

    scene = Scene(busy)
    for row in range(0, 40, 5):
        graph, letters = nx.Graph(), busy.letters(row)
        graph.add_nodes_from(np.flatnonzero(busy["alive"][row]).tolist())
        graph.add_edges_from(letters[letters[:, 4] == 0, :2].tolist())
        assert scene.groups(row) == scene.at(row).groups == nx.number_connected_components(graph)


def test_beams_end_where_the_sensor_met_walls_and_people(busy: Recording) -> None:
    scene = Scene(busy)
    shot = scene.at(20)
    length = scene.beams(0, shot)
    assert length.shape == (72,)
    angles = shot.pose[0, 2] + np.array(scene.bearings[0])
    ends = shot.pose[0, :2] + length[:, None] * np.stack([np.cos(angles), np.sin(angles)], 1)
    reach = 0.15 * np.hypot(3.5, 4.0)
    assert length.max() <= reach + 1e-9
    cells = scene.lattice.cells(ends - 1e-6 * (ends - shot.pose[0, :2]))
    free = length > reach - 1e-9  # these met nothing: they end on the floor
    assert not busy["truth"][tuple(cells[free].T)].any()


def test_layers_can_be_shown_and_hidden(busy: Recording) -> None:
    full, bare = frame(busy, 20, SIZE), frame(busy, 20, SIZE, BARE)
    assert (full[:, 960:] != bare[:, 960:]).any()
    for layer in LAYERS.keys() - {"beams", "own", "jobs"}:  # of which it has none
        assert not np.array_equal(frame(busy, 20, SIZE, Style(layers=frozenset(LAYERS) - {layer})), full), layer
    one = Style(robots=(1,))
    assert not np.array_equal(frame(busy, 20, SIZE, one), full)


def test_looks_are_made_from_words_and_wrong_ones_are_named(busy: Recording) -> None:
    assert look("light", "tiles,links", "links", 1, "0, 2") == Style("light", frozenset({"tiles"}), 1, (0, 2))
    for words, message in (
        (("pink", None, None, None, None), "--theme pink: no such theme; expected dark or light"),
        (("dark", "tile", None, None, None), "--show tile: no such layer; expected some of beams, tiles"),
        (("dark", None, "map", None, None), "--hide map: no such layer"),
        (("dark", None, None, None, "a"), "--robots a: not a list of robots"),
    ):
        with pytest.raises(InputError, match=message):
            look(*words)
    for wrong in (Style(focus=4), Style(robots=(9,))):
        with pytest.raises(InputError, match="no such robot; expected 0 to 3"):
            frame(busy, 1, SIZE, wrong)


def test_two_runs_are_shown_in_step_and_the_shorter_one_waits(recording: Recording, busy: Recording) -> None:
    stage = Stage([recording, busy], Film(cards=False))
    picture = stage.at(30.0)
    assert picture.shape == (720, 1280, 3)
    halves = [frame(one, 30, (640, 720)) for one in (recording, busy)]
    assert np.array_equal(picture[:, :640], halves[0])
    assert np.array_equal(picture[:, 642:], halves[1][:, 2:])
    late = stage.at(float(recording.iterations))
    assert np.array_equal(late[:, 642:], frame(busy, busy.iterations, (640, 720))[:, 2:])


def test_films_begin_with_the_scenario_and_end_with_the_result(busy: Recording, tmp_path: Path) -> None:
    scene = Scene(busy)
    assert first_lines(busy, scene) == [
        "Quick trial: 4 robots in a small room", "4 robots in room, seed 1",
        "network: full, channel bernoulli, loss = 0.4", "fault: people, count 2", "fault: join, at 10",
        "fault: motor off, at 5, robots [0]",
    ]  # fmt: skip
    assert last_lines(busy, scene)[0] == "not finished after 40 iterations"
    film = Film(fps=5, speed=40.0, size=(640, 360))
    write_film(busy, tmp_path / "film.mp4", film)
    with av.open(str(tmp_path / "film.mp4")) as opened:
        pictures = [picture.to_ndarray(format="rgb24") for picture in opened.decode(opened.streams.video[0])]
    assert len(pictures) == 10 + 5 + 10 + 10
    for card, moment in ((pictures[3], 0), (pictures[-3], busy.iterations)):
        assert card.mean() < 0.8 * frame(busy, moment, (640, 360)).mean()  # dimmed behind the words
        assert (card.max(axis=2) > 150).sum() > 300


def test_a_film_can_be_numbered_pictures(recording: Recording, tmp_path: Path) -> None:
    film = Film(fps=5, speed=100.0, size=(480, 270))
    write_film(recording, tmp_path / "frames" / "room.png", film)
    moving = -(-recording.iterations // 20)
    names = [path.name for path in sorted((tmp_path / "frames").iterdir())]
    assert names == [f"room-{number:05d}.png" for number in range(moving + 1)]
    last = np.asarray(Image.open(tmp_path / "frames" / names[-1]))
    assert np.array_equal(last, frame(recording, recording.iterations, (480, 270)))
