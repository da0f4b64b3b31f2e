"""Pictures and films: what they show is where the recording says, and files are whole or absent."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import av
import numpy as np
import pytest
from conftest import made
from PIL import Image

from swarmsim.core.errors import InputError
from swarmsim.core.events import Begins
from swarmsim.core.state import FREE, UNKNOWN, Moment
from swarmsim.recording.reader import Recording
from swarmsim.recording.recorder import Recorder
from swarmsim.view.canvas import Canvas
from swarmsim.view.scene import Scene
from swarmsim.view.theme import DARK, Colour, colour_of
from swarmsim.view.video import Film, check_film, frame, write_film

SMALL = (640, 360)
DEATH = 6  # iteration from which robot 1 is dead in the doctored recording


@pytest.fixture(scope="module")
def recording(room: Path) -> Recording:
    return Recording(room)


class Doctor:
    """Hands on what it samples, but with robot 0 facing away from x and robot 1 dead after a while."""

    def __init__(self, recorder: Recorder) -> None:
        self._recorder = recorder

    def sample(self, moment: Moment) -> None:
        iteration = moment.state.iteration
        pose, alive = moment.state.pose.copy(), moment.state.alive.copy()
        pose[0, 2] = 3.1 if iteration % 2 else -3.1
        alive[1] = iteration < DEATH
        events = (Begins(iteration, 0, (1,)),) if iteration == DEATH else ()
        links = moment.links[alive[moment.links].all(axis=1)]
        state = replace(moment.state, pose=pose, alive=alive)
        self._recorder.sample(replace(moment, state=state, links=links, events=events + moment.events))


@pytest.fixture(scope="module")
def doctored(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    path = tmp_path_factory.mktemp("doctored") / "recording.h5"
    run = made("stop.iterations=12", 'faults=[{use="remove", at=100, robots=[1]}]')  # which the doctor brings forward
    with run.recorder(path) as recorder:
        run.simulation.run([Doctor(recorder)])
    return Recording(path)


def close(colour: np.ndarray, other: Colour) -> bool:
    return bool(np.abs(colour.astype(int) - other).max() <= 2)


def test_frames_have_the_asked_size_and_differ_as_time_goes_on(recording: Recording) -> None:
    pictures = [frame(recording, share * recording.iterations, SMALL) for share in (0.0, 0.5, 1.0)]
    assert {picture.shape for picture in pictures} == {(360, 640, 3)}
    assert {picture.dtype for picture in pictures} == {np.dtype(np.uint8)}
    assert not np.array_equal(pictures[0], pictures[1])
    assert not np.array_equal(pictures[1], pictures[2])


def test_a_picture_does_not_depend_on_those_drawn_before(recording: Recording) -> None:
    canvas = Canvas(Scene(recording), SMALL)
    first = canvas.draw(20.5).copy()
    canvas.draw(100)
    assert canvas.draw(20.5).get_buffer().raw == first.get_buffer().raw


@pytest.mark.parametrize("size", [SMALL, (1280, 720), (1000, 1000), (480, 270)])
@pytest.mark.parametrize("iteration", [0, 40.5])
def test_a_robot_is_drawn_where_its_pose_says(recording: Recording, size: tuple[int, int], iteration: float) -> None:
    scene = Scene(recording)
    canvas = Canvas(scene, size)
    robot = scene.robots - 1  # the last one is drawn over the others
    x, y, yaw = scene.at(iteration).pose[robot]
    # The middle of the disc bears the id.
    at = canvas.pixels(np.array([x, y])) - 0.75 * canvas.radius * np.array([np.cos(yaw), -np.sin(yaw)])
    column, row = np.rint(at).astype(int)
    assert close(frame(recording, iteration, size)[row, column], colour_of(robot))


def test_cells_become_light_once_observed(recording: Recording) -> None:
    scene = Scene(recording)
    canvas = Canvas(scene, SMALL)
    before, after = scene.cells(5), scene.cells(60)
    columns, rows = (
        np.rint(canvas.pixels(scene.lattice.centres(np.argwhere((before == UNKNOWN) & (after == FREE))))).astype(int).T
    )
    dark, light = (frame(recording, t, SMALL)[rows, columns].mean(axis=1) for t in (5, 60))
    assert len(rows) > 50
    assert np.median(dark) < 70
    assert np.median(light) > 85
    assert (light > dark).mean() > 0.98  # a link or a disc may lie over some


def test_poses_turn_the_short_way_round(doctored: Recording) -> None:
    scene = Scene(doctored)
    assert np.cos(scene.at(2.5).pose[0, 2]) == pytest.approx(-1.0)
    halfway = (doctored["pose"][2, 0, :2] + doctored["pose"][3, 0, :2]) / 2
    assert scene.at(2.5).pose[0, :2] == pytest.approx(halfway)


def test_the_dead_stay_where_they_died_with_neither_links_nor_goals(doctored: Recording) -> None:
    scene = Scene(doctored)
    canvas = Canvas(scene, SMALL)
    shot = scene.at(DEATH + 0.5)
    assert not shot.alive[1]
    assert np.isnan(shot.goals[1]).all()
    assert not len(shot.ways[1])
    assert scene.marks == [DEATH]
    column, row = np.rint(canvas.pixels(shot.pose[1, :2]) + np.array([0.0, 0.75 * canvas.radius])).astype(int)
    assert close(frame(doctored, DEATH + 0.5, SMALL)[row, column], DARK.dead)
    assert not close(frame(doctored, DEATH - 0.5, SMALL)[row, column], DARK.dead)


def test_links_are_parted_into_mutual_and_one_way(recording: Recording) -> None:
    scene = Scene(recording)
    for iteration in range(0, recording.iterations, 10):
        shot = scene.at(iteration)
        assert (shot.mutual[:, 0] < shot.mutual[:, 1]).all()
        parts = [shot.mutual, shot.mutual[:, ::-1], shot.one_way]
        assert sorted(map(tuple, np.concatenate(parts).tolist())) == sorted(
            map(tuple, recording.links(iteration).tolist())
        )


def test_a_way_leads_from_the_robot_to_its_goal_and_shrinks(recording: Recording) -> None:
    scene = Scene(recording)
    seen = 0
    for iteration in np.arange(1.0, recording.iterations - 1, 3.5):
        shot = scene.at(iteration)
        for way, place, goal in zip(shot.ways, shot.pose[:, :2], shot.goals, strict=True):
            if len(way) > 1:
                seen += 1
                assert way[0] == pytest.approx(place)
                assert way[-1] == pytest.approx(goal, abs=1e-5)
    assert seen > 50


def test_the_last_moment_counts_all_iterations(recording: Recording) -> None:
    shot = Scene(recording).at(recording.iterations)
    assert shot.iteration == recording.iterations
    assert shot.time == recording.iterations * recording.scenario.period
    assert shot.value == 1.0
    assert shot.messages == recording["messages"].sum()


def test_no_display_is_needed_and_nothing_is_printed(room: Path) -> None:
    code = (
        "import sys; from pathlib import Path; from swarmsim.recording.reader import Recording\n"
        "from swarmsim.view.video import frame; import pygame\n"
        "assert frame(Recording(Path(sys.argv[1])), 3, (480, 270)).any()\n"
        "assert not pygame.display.get_init()"
    )
    hidden = {"DISPLAY", "WAYLAND_DISPLAY", "XDG_RUNTIME_DIR", "SDL_VIDEODRIVER", "PYGAME_HIDE_SUPPORT_PROMPT"}
    bare = {name: value for name, value in os.environ.items() if name not in hidden}
    done = subprocess.run(
        [sys.executable, "-c", code, str(room)], env=bare, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_an_mp4_is_h264_that_plays_everywhere(recording: Recording, tmp_path: Path) -> None:
    out, calls = tmp_path / "film.mp4", []
    out.write_text("an older film")
    film = Film(fps=25, speed=100.0, size=SMALL, cards=False)
    write_film(recording, out, film, progress=lambda done, of: calls.append((done, of)))
    frames = -(-recording.iterations * 25 // 100) + 50
    with av.open(str(out)) as film:
        stream = film.streams.video[0]
        assert (stream.codec_context.name, stream.codec_context.pix_fmt) == ("h264", "yuv420p")
        assert (stream.width, stream.height, stream.average_rate) == (*SMALL, 25)
        pictures = [picture.to_ndarray(format="rgb24") for picture in film.decode(stream)]
    assert len(pictures) == frames
    assert calls == [(done, frames) for done in range(1, frames + 1)]
    end = frame(recording, recording.iterations, SMALL).astype(int)
    assert np.abs(pictures[-1] - end).mean() < 4.0
    assert np.abs(pictures[0] - end).mean() > 8.0
    assert [path.name for path in tmp_path.iterdir()] == ["film.mp4"]


def test_a_gif_moves_and_never_ends(recording: Recording, tmp_path: Path) -> None:
    out = tmp_path / "film.GIF"
    write_film(recording, out, Film(fps=10, speed=100.0, size=SMALL, cards=False))
    moving = -(-recording.iterations // 10)
    with Image.open(out) as film:
        assert (film.size, film.info["loop"]) == (SMALL, 0)
        assert film.n_frames == moving + 1  # the end, held for two seconds, is one picture
        film.seek(moving)
        assert film.info["duration"] == 2000
        film.seek(0)
        first = np.asarray(film.convert("RGB")).astype(int)
        film.seek(moving - 1)
        assert film.info["duration"] == 100
        late = np.asarray(film.convert("RGB")).astype(int)
    assert np.abs(first - frame(recording, 0, SMALL)).mean() < 2.0
    assert np.abs(late - frame(recording, 10 * (moving - 1), SMALL)).mean() < 2.0
    assert out.stat().st_size < 300_000


@pytest.mark.parametrize("suffix", [".mp4", ".gif"])
def test_a_film_depends_on_the_recording_alone(room: Path, tmp_path: Path, suffix: str) -> None:
    films = []
    for name in ("one", "two"):
        out = tmp_path / f"{name}{suffix}"
        write_film(Recording(room), out, Film(fps=5, speed=200.0, size=(480, 270)))
        films.append(out.read_bytes())
    assert films[0] == films[1]


@pytest.mark.parametrize(
    ("name", "options", "words"),
    [
        ("film.avi", {}, r"film\.avi: .*\.mp4 or \.gif, .*not in '\.avi'"),
        ("film", {}, r"film: .*\.mp4 or \.gif"),
        ("older.mp4/film.mp4", {}, r"older\.mp4/film\.mp4: .*older\.mp4 is not a folder"),
        ("film.mp4", {"fps": 0}, r"--fps 0: expected 1 to 120"),
        ("film.gif", {"fps": 60}, r"--fps 60: expected 1 to 50"),
        ("film.mp4", {"speed": 0.0}, r"--speed 0: expected more than 0"),
        ("film.mp4", {"speed": -1.0}, r"--speed -1: "),
        ("film.mp4", {"speed": float("nan")}, r"--speed nan: "),
        ("film.mp4", {"size": (641, 360)}, r"--size 641x360: .*642x360"),
        ("film.mp4", {"size": (64, 36)}, r"--size 64x36: expected 480x270 to"),
        ("film.gif", {"size": (99999, 360)}, r"--size 99999x360: "),
    ],
)
def test_options_that_cannot_work_are_named_and_leave_no_file(recording, tmp_path, name, options, words) -> None:
    older = tmp_path / "older.mp4"
    older.touch()
    with pytest.raises(InputError, match=words):
        check_film(tmp_path / name, Film(**options))
    with pytest.raises(InputError, match=words):
        write_film(recording, tmp_path / name, Film(**options))
    assert list(tmp_path.iterdir()) == [older]


@pytest.mark.parametrize("suffix", [".mp4", ".gif"])
@pytest.mark.parametrize("at", [1, 5])
def test_an_interruption_leaves_what_was_there(recording: Recording, tmp_path: Path, suffix: str, at: int) -> None:
    def interrupt(done: int, of: int) -> None:
        if done == at:
            raise KeyboardInterrupt

    out = tmp_path / f"film{suffix}"
    out.write_text("an older film")
    with pytest.raises(KeyboardInterrupt):
        write_film(recording, out, Film(size=(480, 270)), progress=interrupt)
    assert [path.name for path in tmp_path.iterdir()] == [out.name]
    assert out.read_text() == "an older film"


def test_a_moment_outside_of_the_run_is_refused(recording: Recording) -> None:
    for iteration in (-1, recording.iterations + 1, float("nan")):
        with pytest.raises(InputError, match=f"from 0 to {recording.iterations}"):
            frame(recording, iteration, SMALL)


def test_robots_on_a_page_without_edges_cross_them_by_the_short_way(tmp_path: Path) -> None:
    run = made("stop.iterations=60", 'stop.when_done="continue"', scenario="operations/heading-consensus-free")
    with run.recorder(tmp_path / "r.h5") as recorder:
        run.simulation.run([recorder])
    recording = Recording(tmp_path / "r.h5")
    jumps = np.abs(np.diff(recording["pose"][:, :, :2], axis=0)).max(axis=2) > 4.0
    row, robot = np.argwhere(jumps)[0]
    scene = Scene(recording)
    before, halfway, after = (scene.at(row + part) for part in (0.0, 0.5, 1.0))
    ends = np.stack([shot.pose[robot, :2] for shot in (before, halfway)])
    assert np.hypot(*np.diff(ends, axis=0)[0]) <= 0.5 * 0.05 + 1e-9
    assert np.hypot(*(after.pose[robot, :2] - before.pose[robot, :2])) > 4.0
    for shot in (before, halfway):
        for links in (shot.mutual, shot.one_way):
            assert (np.abs(shot.pose[links[:, 0], :2] - shot.pose[links[:, 1], :2]) <= 4.0).all()
    assert len(before.mutual) > 50
