"""Lights of robots, in films and pages: the colour that was recorded, and none where there is none."""

from __future__ import annotations

from pathlib import Path

import pygame
import pytest
from conftest import made

from swarmsim.recording.reader import Recording
from swarmsim.view.canvas import Canvas
from swarmsim.view.page.document import replay_page
from swarmsim.view.scene import Scene, lights

COLOUR = (255, 0, 255)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    folder = tmp_path_factory.mktemp("lights")
    run = made("stop.iterations=10", scenario="operations/lights")
    with run.recorder(folder / "recording.h5") as recorder:
        run.simulation.run([recorder])
    return Recording(folder)


def painted(recording: Recording, iteration: float) -> int:
    """How many pixels of a frame have the colour."""
    pixels = pygame.surfarray.array3d(Canvas(Scene(recording), (960, 540)).draw(iteration))
    return int((pixels == COLOUR).all(axis=2).sum())


def test_a_frame_has_the_colour_as_often_as_robots_shine(recording: Recording) -> None:
    lit = recording["led"].any(axis=2).sum(axis=1)
    assert (lit[0], lit[1]) == (0, 1)
    assert painted(recording, 0.0) == 0
    one = painted(recording, 1.0)
    assert one > 20
    assert lit[9] > 1
    assert painted(recording, 9.0) == pytest.approx(lit[9] * one, rel=0.3)


def test_a_page_holds_the_colours(recording: Recording) -> None:
    assert '"name":"light"' in replay_page(recording)
    assert "[255,0,255]" in replay_page(recording)


def test_a_run_without_lights_shows_none(room: Path) -> None:
    recording = Recording(room)
    assert lights(recording) is None
    assert Scene(recording).at(1.0).lights is None
    assert '"name":"light"' not in replay_page(recording)
    assert painted(recording, 1.0) == 0
