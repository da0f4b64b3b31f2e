from __future__ import annotations

from pathlib import Path

import pytest

from swarmsim.build import Run, build
from swarmsim.core.scenario import load
from swarmsim.recording import Recorder

ROOT = Path(__file__).parent.parent


@pytest.fixture(scope="session")
def root() -> Path:
    return ROOT


def made(*overrides: str, scenario: str = "room") -> Run:
    path = ROOT / "scenarios" / f"{scenario}.toml"
    return build(load(path, overrides), str(path))


@pytest.fixture(scope="session")
def room(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The recording of a whole run in the small room."""
    path = tmp_path_factory.mktemp("room") / "recording.h5"
    run = made()
    with Recorder(path, run.scenario, run.world, run.arena.lattice, run.domain, run.arena.occupied) as recorder:
        assert run.simulation.run([recorder])
    return path
