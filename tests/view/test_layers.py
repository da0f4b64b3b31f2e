"""Layers of a scenario's own: one list of shapes that film, window, page, MCAP and Rerun show."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pygame
import pytest
from conftest import called, made
from mcap.reader import make_reader

import swarmsim as sw
from swarmsim.core import drawing
from swarmsim.core.drawing import INKS, Circles, Lines, Polygons, Raster, Rays, Texts, wrong
from swarmsim.core.errors import PartError
from swarmsim.core.scenario import registry
from swarmsim.recording.reader import Recording
from swarmsim.view.camera import Camera
from swarmsim.view.canvas import Canvas
from swarmsim.view.layers import LayerStack
from swarmsim.view.layers.own import left_out
from swarmsim.view.lettering import Lettering
from swarmsim.view.page.document import replay_page
from swarmsim.view.painter import Painter
from swarmsim.view.scene import Scene
from swarmsim.view.style import Style
from swarmsim.view.theme import THEMES
from swarmsim.view.video import frame

ODD = (255, 0, 255)  # of no theme
LAYER = """
import numpy as np
from swarmsim.core.drawing import Circles

def beacon(shown, *, breaks_at: int = 99, shape: str = "right"):
    "A bright disc above everything."
    if shown.iteration >= breaks_at:
        raise RuntimeError("the bulb has burnt out")
    centre = shown.pose[:1, :2] if shape == "right" else np.full((1, 2), np.nan)
    return [Circles(centre, 0.4, "#ff00ff", None, name="glow", z=200.0)]
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("layers")


@pytest.fixture(scope="module")
def recording(folder: Path) -> Recording:
    return recorded(folder, "")


def recorded(folder: Path, keys: str) -> Recording:
    (folder / "beacon.py").write_text(LAYER)
    path = folder / f"recording{abs(hash(keys))}.h5"
    with registry.own_code(True):
        run = made("stop.iterations=12", f"layers=[{{use='{folder}/beacon.py:beacon'{keys}}}, {{use='trails'}}]")
        with run.recorder(path) as recorder:
            run.simulation.run([recorder])
    return Recording(path)


def has(picture: np.ndarray, colour: tuple[int, int, int] = ODD) -> bool:
    return int((picture == colour).all(axis=2).sum()) > 100


def test_a_layer_is_seen_in_films_with_its_sign_and_can_be_hidden(recording: Recording) -> None:
    with registry.own_code(True):
        scene = Scene(recording)
        canvas = Canvas(scene, (1280, 720))
        picture = frame(recording, 6, (1280, 720))
        column, row = np.rint(canvas.pixels(scene.at(6).pose[0, :2])).astype(int)
        assert tuple(picture[row, column]) == ODD
        hidden = Style(layers=frozenset(set(Style().layers) - {"own"}))
        assert not has(frame(recording, 6, (1280, 720), hidden))
        assert {"glow", "trail"} <= {sign.kind for sign in LayerStack(scene).signs(scene, Style())}


def test_a_layer_is_seen_in_the_window(recording: Recording, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from swarmsim.live.session import Replay
    from swarmsim.view.window import Window

    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    with registry.own_code(True):
        window = Window(Replay(recording), folder)
        window.frame(0.1)
        assert has(pygame.surfarray.array3d(pygame.display.get_surface()))


def test_a_layer_is_in_pages_and_in_the_files_of_viewers(recording: Recording, tmp_path: Path) -> None:
    from rerun.chunk import RrdReader

    from swarmsim.view.viewers.foxglove import write_mcap
    from swarmsim.view.viewers.rerun import write_rrd

    with registry.own_code(True):
        page = replay_page(recording)
        write_mcap(recording, tmp_path / "run.mcap")
        write_rrd(recording, tmp_path / "run.rrd")
    assert '"name":"glow"' in page
    assert '<input type="checkbox" name="beacon" checked>' in page
    assert "[255,0,255]" in page
    with (tmp_path / "run.mcap").open("rb") as file:
        topics = {channel.topic for _, channel, _ in make_reader(file).iter_messages()}
    assert {"/beacon", "/trails"} <= topics
    entities = {chunk.entity_path for chunk in RrdReader(tmp_path / "run.rrd").stream()}
    assert {"/world/beacon/glow", "/world/trails/trail"} <= entities


def test_a_recording_runs_no_code_to_be_looked_at_and_says_what_is_missing(
    recording: Recording, tmp_path: Path
) -> None:
    recording = Recording(recording.path)  # of which no part has been looked at
    assert "beacon" in str(left_out(recording.scenario))
    assert not has(frame(recording, 6, (1280, 720)))
    assert '"name":"trail"' in replay_page(recording)
    for verb, out in (("video", "a.gif"), ("report", "a.html")):
        options = ["--fps", 1, "--size", "480x270"] if verb == "video" else []
        arguments = [verb, recording.path, *(["-o"] if verb == "report" else []), out, *options]
        done = called(*arguments, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        assert " ".join((done.stdout + done.stderr).split()).count("--allow-code lets layers") == 1
        done = called(*arguments, "--allow-code", cwd=tmp_path)
        assert (done.returncode, "--allow-code lets" in done.stdout + done.stderr) == (0, False)
    with registry.own_code(True):
        assert left_out(Recording(recording.path).scenario) is None


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        (", breaks_at=5", r"layer .*beacon.*iteration 5: RuntimeError: the bulb has burnt out"),
        (", shape='odd'", r"drew Circles whose 'centre' has numbers that cannot be drawn"),
    ],
)
def test_a_layer_that_fails_or_draws_what_cannot_be_is_named(
    folder: Path, tmp_path: Path, keys: str, words: str
) -> None:
    broken = recorded(folder, keys)
    with registry.own_code(True), pytest.raises(PartError, match=words):
        frame(broken, 5, (480, 270), Style(layers=frozenset({"own"})))
    done = called("video", broken.path, "a.gif", "--fps", 1, "--speed", 1, "--allow-code", cwd=tmp_path)
    assert done.returncode == 3, done.stderr
    assert "beacon" in done.stderr


def test_in_python_layers_from_files_are_drawn_if_it_is_said(recording: Recording, tmp_path: Path) -> None:
    for allowed in (False, True):
        run = sw.Run(Recording(recording.path))
        assert has(run.picture(6, allow_code=allowed)) == allowed
        run = sw.Run(Recording(recording.path))  # whose own code has not been run
        page = run.report(tmp_path / "page.html", allow_code=allowed)
        run.export(mcap=tmp_path / "run.mcap", allow_code=allowed)
        film = run.film(tmp_path / f"{allowed}.gif", size=(480, 270), fps=1, cards=False, allow_code=allowed)
        with (tmp_path / "run.mcap").open("rb") as file:
            topics = {channel.topic for _, channel, _ in make_reader(file).iter_messages()}
        assert ('"name":"glow"' in page.read_text(), "/beacon" in topics) == (allowed, allowed)
        assert film.stat().st_size > 1000
    assert (tmp_path / "False.gif").read_bytes() != (tmp_path / "True.gif").read_bytes()


PLACE, ENDS, ONE = np.zeros((2, 2)), np.array([2]), np.array([0])


@pytest.mark.parametrize(
    ("found", "words"),
    [
        (None, "drew None; expected a list of Circles"),
        ([PLACE], "expected Circles, Polygons"),
        ([Circles(np.zeros(2), 1.0)], "'centre' is of shape (2,); expected (2, 2)"),
        ([Circles(PLACE, np.ones(3))], "'radius' is of shape (3,); expected (2,)"),
        ([Circles(PLACE, 1.0, "pink")], "ink is 'pink'; expected '#rrggbb', 'robot I' or one of background"),
        ([Circles(PLACE, 1.0, ["mark"])], "'ink' or 'edge' has the wrong length"),
        ([Circles(PLACE, 1.0, unit="body")], "'of' is missing"),
        ([Circles(PLACE, 1.0, of=np.array([0, 4]))], "'of' names unknown robots; expected 0 to 3"),
        ([Polygons(PLACE, np.array([3]))], "'ends' do not rise to 2"),
        ([Lines(PLACE, ENDS, width=float("nan"))], "sizes are invalid"),
        ([Texts(PLACE, ["one"])], "'texts' do not fit; expected 2 texts"),
        ([Raster(np.zeros((2, 2)), (0.0, 0.0), 1.0, [])], "'values', 'corner' or 'cell' is invalid"),  # type: ignore[arg-type]
        ([Rays(PLACE[:1], np.zeros(1), np.zeros(3), np.zeros((1, 2)), ONE)], "'length' is of shape (1, 2)"),
    ],
)
def test_what_cannot_be_drawn_is_told_with_what_would_be_right(found: object, words: str) -> None:
    assert words in str(wrong(found, 4))


def test_every_kind_of_shapes_can_be_drawn_and_every_theme_has_every_ink(recording: Recording) -> None:
    marks = [
        Circles(PLACE, 0.1), Circles(PLACE, 0.2, stroke=0.05, opacity=0.5), Polygons(np.eye(3)[:, :2], np.array([3])),
        Polygons(np.eye(3)[:, :2], np.array([3]), None),
        Lines(PLACE + np.array([[0.0], [1.0]]), ENDS, arrow=True, dash="dotted"),
        Rays(PLACE[:1], np.zeros(1), np.zeros(3), np.ones((1, 3)), ONE), Texts(PLACE, ["a", "b"]),
        Raster(np.ones((2, 2), np.uint8), (0.0, 0.0), 1.0, [(1, 1, "hot", "hot")]),
    ]  # fmt: skip
    assert wrong(marks, 4) is None
    assert set(map(type, marks)) == set(drawing.KINDS)
    canvas = Canvas(Scene(recording), (480, 270))
    for mark in marks:
        sheet = pygame.Surface((480, 270))
        canvas._painter.paint(sheet, mark, np.full(4, 8.0))
        assert pygame.surfarray.array3d(sheet).any(), mark
    for theme in THEMES.values():
        assert all(len(theme.ink(name)) == 3 for name in (*INKS, "robot 11", "on robot 11", "#0102ff"))


@pytest.mark.parametrize("turned", [0.0, 0.7, 2.0, 4.0])
@pytest.mark.parametrize("on_robot", [True, False])
def test_the_edge_of_a_thin_area_runs_along_both_of_its_sides(turned: float, on_robot: bool) -> None:
    painter = Painter(THEMES["dark"], Camera(10.0, 100.0, 100.0), 1.0, Lettering())
    bar = np.array([(0.0, -0.3), (8.0, -0.3), (8.0, 0.3), (0.0, 0.3)])
    cosine, sine = np.cos(turned), np.sin(turned)
    lying = bar @ np.array([(cosine, sine), (-sine, cosine)])
    mark = (
        Polygons(bar, ENDS + 2, "#ffffff", "#ff00ff", 6.0, at=PLACE[:1], yaw=np.array([turned]), unit="body", of=ONE)
        if on_robot
        else Polygons(lying, ENDS + 2, "#ffffff", "#ff00ff", 6.0)
    )
    sheet = pygame.Surface((200, 200))
    painter.paint(sheet, mark, np.array([10.0]))
    for along in (10.0, 40.0, 70.0):
        for aside, ink in ((5.5, ODD), (0.0, (255, 255, 255)), (-5.5, ODD)):
            x, y = 100.0 + along * cosine - aside * sine, 100.0 - along * sine - aside * cosine
            assert sheet.get_at((round(x), round(y)))[:3] == ink


@pytest.mark.parametrize("turned", [0.2, 0.8, 1.3, 2.5])
def test_dashes_end_at_right_angles(turned: float) -> None:
    painter = Painter(THEMES["dark"], Camera(1.0, 10.0, 190.0), 1.0, Lettering())
    middle, along = np.array([90.0, 90.0]), np.array([np.cos(turned), np.sin(turned)])
    aside, width = np.array([-along[1], along[0]]), 10.0
    sheet = pygame.Surface((200, 200))
    line = Lines(middle + np.array([[-80.0], [70.0]]) * along, ENDS, "#ff00ff", None, width, dash="dashed")
    painter.paint(sheet, line, np.empty(0))
    for ahead, ink in ((4.0, ODD), (56.0, ODD), (64.0, (0, 0, 0)), (116.0, (0, 0, 0)), (124.0, ODD)):
        for side in (-3.0, 3.0):
            x, y = painter.camera.pixels(middle + (ahead - 80.0) * along + side * aside)
            assert sheet.get_at((round(x), round(y)))[:3] == ink


def test_a_part_brings_layers_along(recording: Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    class Lamp:
        name = "lamp"

        def draw(self, shown: drawing.Shown) -> list[drawing.Mark]:
            return [Circles(shown.pose[:, :2], 0.3, "#ff00ff", None, z=200.0)]

    task = recording.scenario.task.parameters
    monkeypatch.setattr(type(task), "drawn", (Lamp(),), raising=False)
    assert has(frame(recording, 6, (1280, 720)))


def test_a_layer_changes_no_scenario_that_has_none() -> None:
    scenario = made().scenario
    assert msgspec.structs.asdict(scenario)["layers"] == ()
