"""The robot's half of the package as a distribution of its own, installed apart from all else."""

from __future__ import annotations

import subprocess
import sys
import sysconfig
import zipfile
from email import message_from_string
from pathlib import Path

import pytest
from conftest import ROOT
from fleet.crews import fleet_of

from swarmsim.api import doctor
from swarmsim.engine.build import build
from swarmsim.fleet import running
from swarmsim.recording.digests import Digests

NEEDED = ["numpy", "numpy.libs", "msgspec"]
LOAD_ALL = """
from swarmsim.core.errors import InputError
from swarmsim.core.scenario import registry
from swarmsim.core.code.distributions import parts

for seam in sorted(parts()):
    if seam != "seam":
        for name in registry.entries(seam):
            try:
                registry.find(seam, name)
            except InputError as problem:
                print(problem)
"""


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the wheel's files and what it requires, and `python` there, which knows nothing else."""
    folder = tmp_path_factory.mktemp("robot")
    wheel = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation"]
    subprocess.run([*wheel, "--wheel-dir", folder, ROOT / "robot"], check=True)
    with zipfile.ZipFile(next(folder.glob("*.whl"))) as packed:
        packed.extractall(folder)
    for name in NEEDED:
        (folder / name).symlink_to(Path(sysconfig.get_path("platlib")) / name)
    python = folder / "python"
    python.write_text(f'#!/bin/sh\nPYTHONPATH={folder} exec {sys.executable} -S -W error "$@"\n')
    python.chmod(0o755)
    return folder


def did(small: Path, *words: str) -> str:
    done = subprocess.run([small / "python", *words], capture_output=True, text=True, check=False)
    assert not done.stderr
    return done.stdout


def test_it_needs_little_and_has_what_the_whole_package_says(small: Path) -> None:
    told = message_from_string(next(small.glob("*.dist-info/METADATA")).read_text())
    hard = [one for one in told.get_all("Requires-Dist", []) if "extra ==" not in one]
    assert [one.partition(">")[0] for one in hard] == ["msgspec", "numpy"]
    assert told.get_all("Provides-Extra") == ["fleet", "minds", "ros2", "thymio"]
    for file in small.glob("swarmsim/**/*.py"):
        assert file.read_bytes() == (ROOT / file.relative_to(small)).read_bytes()


def test_every_part_loads_or_names_the_package_that_it_lacks(small: Path) -> None:
    lacking = did(small, "-c", LOAD_ALL).splitlines()
    assert not [one for one in lacking if not ("package scipy" in one or "package shapely" in one)]
    assert (
        "use: the sharing 'merge' needs the package scipy, which is not installed; expected: pip install scipy"
    ) in lacking
    assert not [one for one in lacking if "nearest-frontier" in one or "utility-frontier" in one]


def test_its_robots_make_the_run_of_one_process(small: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, whole, apart = ROOT / "scenarios" / "room.toml", Digests(), Digests()
    fleet = fleet_of(path, "robots.count=3", iterations=30)
    build(fleet.run.scenario, str(path)).simulation.run([whole])
    monkeypatch.setattr(sys, "executable", str(small / "python"))
    with running.up(fleet, "udp") as crew:
        for pid in crew.processes.pids.values():
            maps = Path(f"/proc/{pid}/maps").read_text()
            assert "/numpy/" in maps
            assert not [name for name in ("numba", "scipy", "shapely", "pymunk") if f"/{name}" in maps]
        fleet.run.simulation.run([apart])
    assert len(apart.rows) == 30
    assert apart.rows == whole.rows


def test_its_program_tells_what_is_wrong(small: Path, tmp_path: Path) -> None:
    assert did(small, "-m", "swarmsim.fleet.robot_command", "--version").startswith("swarmsim-robot ")
    (tmp_path / "3.charge").write_bytes(b"no charge")
    words = [
        "-m",
        "swarmsim.fleet.robot_command",
        "run",
        "--join",
        "127.0.0.1:1",
        "--charge",
        str(tmp_path / "3.charge"),
    ]
    done = subprocess.run([small / "python", *words], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.startswith(f"swarmsim-robot: {tmp_path / '3.charge'}: ")
    assert done.stderr.count("\n") == 1


def test_both_in_one_place_are_told(small: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = next(one for one in doctor.doctor() if one.what == "versions")
    assert found.works
    monkeypatch.syspath_prepend(str(small))
    found = next(one for one in doctor.doctor() if one.what == "versions")
    assert not found.works
    assert found.found.startswith("swarmsim-robot is installed too")
