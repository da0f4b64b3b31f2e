from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from swarmsim.build import Run, build
from swarmsim.core.parts import Building, Survey
from swarmsim.core.scenario import load
from swarmsim.core.state import Inbox, Moment

ROOT = Path(__file__).parent.parent


@pytest.fixture(scope="session")
def root() -> Path:
    return ROOT


def inbox_of(receivers, senders, values, origins, iteration: int = 0) -> Inbox:
    """Messages of one tile each, which its sender has just sensed."""
    senders = np.asarray(senders, np.int32)
    return Inbox(receivers, senders, values, origins, senders, np.full(len(senders), iteration, np.int32))


def building(walls=()) -> Building:
    """These walls (s, 4), and nothing that could be explored."""
    segments = np.asarray(walls, float).reshape(-1, 4)
    nothing = np.zeros((0, 0), bool)
    return Building(segments, nothing, nothing, np.zeros((0, 2)), lambda boxes: Survey(segments, nothing, nothing))


def made(*overrides: str, scenario: str = "room") -> Run:
    path = ROOT / "scenarios" / f"{scenario}.toml"
    return build(load(path, overrides), str(path))


def moments_of(run: Run) -> list[Moment]:
    """Every moment of a run, done to its end."""
    moments: list[Moment] = []

    class Keep:
        def sample(self, moment: Moment) -> None:
            moments.append(moment)

    run.simulation.run([Keep()])
    return moments


@pytest.fixture(scope="session")
def room(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The recording of a whole run in the small room."""
    path = tmp_path_factory.mktemp("room") / "recording.h5"
    run = made()
    with run.recorder(path) as recorder:
        assert run.simulation.run([recorder])
    return path
