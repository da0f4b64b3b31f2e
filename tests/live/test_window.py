"""The window without a screen: what keys and the mouse do to a run, and that what was done can be repeated."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from itertools import count
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT

from swarmsim.core.errors import InputError
from swarmsim.core.events import Begins, BoxStands
from swarmsim.core.scenario.file import load
from swarmsim.live.session import Replay, Session
from swarmsim.recording.reader import Recording

pygame = pytest.importorskip("pygame")


@pytest.fixture(autouse=True)
def no_screen(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    yield
    pygame.display.quit()


@pytest.fixture
def session(tmp_path: Path) -> Iterator[Session]:
    path = ROOT / "scenarios" / "room.toml"
    made = Session(
        load(path, ["robots.count=4", "stop.when_done='continue'", "stop.iterations=400"]), str(path), tmp_path
    )
    yield made
    made._recorder.close()


def still() -> float:
    """A clock by which everything is done in no time."""
    return 0.0


def window(show, folder: Path, clock=still):
    from swarmsim.view.window import Window

    return Window(show, folder, size=(960, 604), clock=clock)


def press(opened, *keys: int) -> None:
    for key in keys:
        pygame.event.post(pygame.event.Event(pygame.KEYDOWN, key=key))
    for event in pygame.event.get(pygame.KEYDOWN):
        opened.handle(event)


def click(opened, at, button: int = 1, until=None) -> None:
    at, until = tuple(map(int, at)), tuple(map(int, until or at))
    opened.handle(pygame.event.Event(pygame.MOUSEBUTTONDOWN, pos=at, button=button))
    if until != at and button == 1:
        rel = (until[0] - at[0], until[1] - at[1])
        opened.handle(pygame.event.Event(pygame.MOUSEMOTION, pos=until, rel=rel, buttons=(1, 0, 0)))
    opened.handle(pygame.event.Event(pygame.MOUSEBUTTONUP, pos=until, button=button))


def place(opened, robot: int):
    return opened._canvas.pixels(opened._scene.at(opened.time).pose[robot, :2])


def test_a_live_run_goes_on_pauses_steps_and_goes_back(session: Session, tmp_path: Path) -> None:
    opened = window(session, tmp_path)
    for _ in range(10):
        opened.frame(0.1)
    assert opened.time == pytest.approx(20.0)
    assert session.recording.iterations in (20, 21)  # tenths add up to 2 but for the last bit
    press(opened, pygame.K_SPACE)
    was = opened.time
    opened.frame(0.5)
    assert opened.time == was
    press(opened, pygame.K_RIGHT)
    assert opened.time == int(was) + 1
    assert session.recording.iterations >= opened.time
    press(opened, pygame.K_LEFT, pygame.K_LEFT)
    assert opened.time == int(was) - 1
    before = session.recording.iterations
    click(opened, (12 + (960 - 24) * 0.5, 604 - 50))  # the time line
    assert opened.time == pytest.approx(0.5 * before, abs=1.0)
    press(opened, pygame.K_PLUS)
    assert opened.words == "50 iterations a second"
    press(opened, pygame.K_h)
    opened.frame(0.0)
    press(opened, pygame.K_q)
    assert not opened.open


def test_what_is_seen_while_it_runs_is_what_is_recorded(session: Session, tmp_path: Path) -> None:
    from swarmsim.view.style import Style
    from swarmsim.view.video import frame

    opened = window(session, tmp_path)
    for _ in range(15):
        opened.frame(0.1)
    press(opened, pygame.K_SPACE)
    shot = opened._scene.at(12.5)
    path = session.close()
    whole = Recording(path)
    from swarmsim.view.scene import Scene

    assert np.array_equal(Scene(whole).at(12.5).pose, shot.pose)
    assert np.array_equal(Scene(whole).cells(12), opened._scene.cells(12))
    bare = Style(layers=frozenset())
    assert frame(whole, 12.5, (640, 360), bare).any()


def test_faults_by_key_and_mouse_are_recorded_and_verified(session: Session, tmp_path: Path) -> None:
    opened = window(session, tmp_path)
    for _ in range(10):
        opened.frame(0.1)
    press(opened, pygame.K_SPACE, pygame.K_k)
    assert opened.words == "pick a robot first: click on it"
    for robot, key, word in ((2, pygame.K_k, "killed"), (1, pygame.K_b, "blinded"), (0, pygame.K_m, "muted")):
        click(opened, place(opened, robot))
        assert opened.picked == robot
        press(opened, key, pygame.K_RIGHT, pygame.K_RIGHT)
        assert any(isinstance(event, Begins) and event.robots == (robot,) for event in session.recording.events()), word
    press(opened, pygame.K_p, pygame.K_RIGHT)
    corners = [opened._canvas.pixels(np.array(corner)) for corner in ((2.55, 2.4), (2.75, 1.6))]
    click(opened, corners[0], button=3, until=tuple(corners[1]))
    assert opened.words.endswith("door closed"), opened.words
    for _ in range(4):
        press(opened, pygame.K_RIGHT)
    uses = [fault.use for fault in session.scenario.faults]
    assert uses == ["crash", "sensor", "radio", "push", "door"]
    press(opened, pygame.K_SPACE)
    for _ in range(10):
        opened.frame(0.1)
    path = session.close()
    recording = Recording(path)
    events = recording.events()
    assert [fault.use for fault in recording.scenario.faults] == uses
    struck = [event.fault for event in events if isinstance(event, Begins)]
    assert struck[:4] == [0, 1, 2, 3]
    assert any(isinstance(event, BoxStands) for event in events) or recording.iterations < 60
    done = subprocess.run(
        [sys.executable, "-m", "swarmsim", "verify", str(tmp_path)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"equal in all {recording.iterations} iterations" in done.stdout


def test_a_strike_in_the_past_drops_what_came_after_and_can_be_taken_back(session: Session, tmp_path: Path) -> None:
    opened = window(session, tmp_path)
    for _ in range(15):
        opened.frame(0.1)
    poses = session.recording["pose"].copy()
    press(opened, pygame.K_SPACE)
    opened._go_to(10.0)
    click(opened, place(opened, 1))
    press(opened, pygame.K_r)
    assert session.recording.iterations == 12
    assert np.array_equal(session.recording["pose"][:11], poses[:11])
    assert not session.recording["alive"][11, 1]
    press(opened, pygame.K_BACKSPACE)
    assert session.scenario.faults == ()
    for _ in range(10):
        press(opened, pygame.K_RIGHT)
    assert np.array_equal(session.recording["pose"][:20], poses[:20])


@pytest.mark.parametrize("until", [10.0, 10.5])
def test_a_strike_gives_the_same_run_whatever_the_clock(tmp_path: Path, until: float) -> None:
    path, found = ROOT / "scenarios" / "room.toml", []
    clocks = {"fast": still, "slow": count(0.0, 1.0).__next__, "uneven": count(0.0, 0.02).__next__}
    for name, clock in clocks.items():
        (tmp_path / name).mkdir()
        session = Session(load(path, ["robots.count=4", "stop.when_done='continue'"]), str(path), tmp_path / name)
        opened, frames = window(session, tmp_path, clock), 0
        while opened.time < until:
            opened.frame(0.1 if until - opened.time >= 2.0 else (until - opened.time) / 20.0)
            frames += 1
        if name == "uneven":  # somebody looked ahead, and came back
            opened._go_to(30.0)
            opened._go_to(until)
        opened.picked = 2
        press(opened, pygame.K_r)
        assert opened.words == "iteration 11: robot 2 removed"
        while opened.time < 30.0:
            opened.frame(0.1)
        found.append((session.scenario, session.recording["digests"][:30].tolist()))
        assert name != "slow" or frames >= 9  # one iteration a frame, after the first
        session._recorder.close()
    assert found[0] == found[1] == found[2]


def test_a_key_steps_by_an_iteration_however_slow_the_machine(session: Session, tmp_path: Path) -> None:
    opened = window(session, tmp_path, count(0.0, 100.0).__next__)
    for step in range(1, 6):
        press(opened, pygame.K_RIGHT)
        assert opened.time == step
    opened._go_to(40.0)
    assert (opened.time, session.recording.iterations) == (40.0, 40)


def test_nothing_strikes_a_run_that_is_over(tmp_path: Path) -> None:
    path = ROOT / "scenarios" / "room.toml"
    session = Session(load(path, ["robots.count=4", "stop.iterations=12"]), str(path), tmp_path)
    opened = window(session, tmp_path)
    opened._go_to(50.0)
    opened.picked = 1
    press(opened, pygame.K_k)
    assert opened.words == "the run ended after 12 iterations; go back in time to strike"
    press(opened, pygame.K_LEFT, pygame.K_LEFT, pygame.K_k)
    assert opened.words == "iteration 11: robot 1 killed"
    session._recorder.close()


def test_a_fault_that_cannot_be_is_told_and_changes_nothing(session: Session, tmp_path: Path) -> None:
    opened = window(session, tmp_path)
    for _ in range(5):
        opened.frame(0.1)
    was = session.recording.iterations
    click(opened, (30, 500), button=3, until=(31, 501))
    assert "box" in opened.words
    assert session.scenario.faults == ()
    assert session.recording.iterations == was
    with pytest.raises(InputError, match="expected 1 to"):
        session.strike({"use": "crash", "robots": [0]}, 99)


def test_the_wheel_zooms_where_the_pointer_is_and_dragging_moves(session: Session, tmp_path: Path) -> None:
    opened = window(session, tmp_path)
    opened.frame(0.1)
    pygame.mouse.set_pos((300, 200))
    at = pygame.mouse.get_pos()
    there = opened._canvas.camera.metres(*at)
    opened.handle(pygame.event.Event(pygame.MOUSEWHEEL, y=2))
    assert opened._canvas.camera.scale > 0
    assert opened._canvas.camera.metres(*at) == pytest.approx(there)
    was = opened._canvas.pixels(np.array([2.0, 2.0]))
    click(opened, (400, 300), until=(450, 320))
    assert opened._canvas.pixels(np.array([2.0, 2.0])) - was == pytest.approx([50.0, 20.0])
    opened.frame(0.0)
    press(opened, pygame.K_0)
    assert opened._camera is None


def test_layers_themes_and_own_maps_are_chosen_by_keys(session: Session, tmp_path: Path) -> None:
    opened = window(session, tmp_path)
    for _ in range(5):
        opened.frame(0.1)
    press(opened, pygame.K_3)
    assert opened.words == "links hidden"
    press(opened, pygame.K_t)
    assert opened._look.theme == "light"
    click(opened, place(opened, 3))
    press(opened, pygame.K_o)
    assert opened._look.focus == 3
    opened.frame(0.0)
    press(opened, pygame.K_ESCAPE)
    assert (opened._look.focus, opened.picked) == (None, None)
    opened.handle(pygame.event.Event(pygame.VIDEORESIZE, size=(960, 604), w=960, h=604))
    opened.frame(0.0)
    opened.handle(pygame.event.Event(pygame.QUIT))
    assert not opened.open


def test_a_recording_is_replayed_filmed_and_cannot_be_struck(room: Path, tmp_path: Path) -> None:
    opened = window(Replay(Recording(room)), tmp_path)
    for _ in range(200):
        opened.frame(0.1)
    assert opened.time == Recording(room).iterations
    assert not opened.playing
    press(opened, pygame.K_LEFT)
    click(opened, place(opened, 0))
    press(opened, pygame.K_k)
    assert opened.words.startswith("this is a recording: faults strike live runs only")
    press(opened, pygame.K_f)
    assert (tmp_path / "film-1.mp4").stat().st_size > 10_000


def test_the_verb_needs_a_display_and_leaves_nothing(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "swarmsim", "view", str(ROOT / "scenarios" / "room.toml")]
    bare = {key: value for key, value in os.environ.items() if key not in ("DISPLAY", "WAYLAND_DISPLAY")}
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, env={**bare, "SDL_VIDEODRIVER": "x11"}, cwd=tmp_path
    )
    assert done.returncode == 2
    assert "without a display use swarmsim video or swarmsim report" in done.stderr
    assert not list(tmp_path.rglob("*.h5"))
