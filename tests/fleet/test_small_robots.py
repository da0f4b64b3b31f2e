"""A robot's process imports no world, and does the same to the bit without a compiler."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT
from fleet.crews import fleet_of

from swarmsim.testing.apart import BytesCrew

HEAVY = ["h5py", "matplotlib", "pandas", "pygame", "pymunk", "scipy", "shapely"]
ROOMS = ["swarmsim.api", "swarmsim.cli", "swarmsim.engine", "swarmsim.faults", "swarmsim.network", "swarmsim.recording",
         "swarmsim.robots", "swarmsim.world"]  # fmt: skip
REPLAY = """
import sys, warnings

warnings.simplefilter("error")
path, without = sys.argv[1], sys.argv[2:]
sys.modules.update(dict.fromkeys(without))
import swarmsim.fleet.robot_process
from pathlib import Path

from swarmsim.fleet.diaries import replayed

found = replayed(Path(path))
assert found.equal and found.iterations == 30, found
print(*[name for name in sys.modules if sys.modules[name] is not None], sep="\\n")
"""


def replayed(tmp_path: Path, scenario: str, overrides: tuple[str, ...], number: int, *without: str) -> set[str]:
    """What a process has imported that goes through a robot's log and does the same, without some packages."""
    fleet = fleet_of(ROOT / "scenarios" / f"{scenario}.toml", *overrides, iterations=30)
    crew = BytesCrew(fleet)
    fleet.run.simulation.run()
    crew.diaries[number].write(tmp_path / "log")
    done = subprocess.run(
        [sys.executable, "-c", REPLAY, tmp_path / "log", *without], capture_output=True, text=True, check=False
    )
    assert not done.returncode, done.stderr
    assert not done.stderr
    return set(done.stdout.split())


def test_a_robots_process_has_no_world_in_it(tmp_path: Path) -> None:
    imported = replayed(tmp_path, "basilica", (), 3)
    for name in ("h5py", "matplotlib", "pandas", "pygame", "pymunk", "shapely", *ROOMS):
        assert not [one for one in imported if one == name or one.startswith(f"{name}.")]
    assert "swarmsim.operations.mapping.computation" in imported


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("scenario", "overrides"),
    [
        ("basilica", ()),
        ("exploring", ()),
        ("exploring", ('mind.computation={sharing={use="relay"}, trust="quorum", decay=0.01, hits="spared"}',)),
        ("exploring", ('mind={strategy={use="utility-frontier"}, computation={sharing={use="gossip"}}}',)),
        ("operations/wandering", ()),
        ("operations/heading-consensus", ()),
        ("operations/pursuit", ()),
        ("operations/formation", ()),
    ],
)
def test_without_a_compiler_it_does_the_same(tmp_path: Path, scenario: str, overrides: tuple[str, ...]) -> None:
    imported = replayed(tmp_path, scenario, overrides, 1, "numba", *HEAVY)
    assert not {"numba", "llvmlite", *HEAVY} & imported
