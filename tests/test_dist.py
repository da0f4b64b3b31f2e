"""The archives of a release, built by `make dist`, and the wheel used without the repository."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest
from conftest import ROOT
from test_docs import PROJECT, blocks, commands_of

import swarmsim

pytestmark = pytest.mark.dist
NAME = f"swarmsim_lab-{swarmsim.__version__}"
WHEEL = ROOT / "dist" / f"{NAME}-py3-none-any.whl"
#: The Pythons that try the wheel, each with the listed versions; Python 3.11 also with the lowest that it asks for.
PYTHONS = os.environ.get("PYTHONS", sys.executable).split()


def version_of(python: str) -> str:
    """As in 3.11."""
    asked = [python, "-c", "import sys; print('%d.%d' % sys.version_info[:2])"]
    return subprocess.run(asked, capture_output=True, text=True, check=True).stdout.strip()


WAYS = [(one, "run") for one in PYTHONS] + [(one, "lowest") for one in PYTHONS if version_of(one) == "3.11"]


def test_the_archives_hold_the_whole_project_and_nothing_else() -> None:
    with tarfile.open(ROOT / "dist" / f"{NAME}.tar.gz") as archive:
        held = {name.removeprefix(f"{NAME}/") for name in archive.getnames()}
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True)
    assert held == {*listed.stdout.splitlines(), "PKG-INFO"}


def test_the_wheel_holds_the_package_and_all_that_ships() -> None:
    with zipfile.ZipFile(WHEEL) as wheel:
        names = set(wheel.namelist())
        metadata = wheel.read(f"{NAME}.dist-info/METADATA").decode()
    code = {f"swarmsim/{path.relative_to(ROOT / 'swarmsim')}" for path in ROOT.glob("swarmsim/**/*.py")}
    shipped = {
        f"swarmsim/{path.relative_to(ROOT)}"
        for folder in ("papers", "scenarios", "worlds")
        for path in (ROOT / folder).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    assert code | shipped | {"swarmsim/py.typed"} <= names
    assert {name.split("/")[0] for name in names} == {"swarmsim", f"{NAME}.dist-info"}
    assert f"{NAME}.dist-info/licenses/LICENSE" in names
    assert "Author: the swarmsim developers" in metadata
    assert set(re.findall(r"^Classifier: (.*)$", metadata, re.MULTILINE)) == set(PROJECT["classifiers"])


@pytest.fixture(scope="module", params=WAYS, ids=[f"{Path(python).name}-{lock}" for python, lock in WAYS])
def environment(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The variables of a shell in which the wheel is installed, and nothing of the repository is known."""
    python, lock = request.param
    home = tmp_path_factory.mktemp("environment")
    subprocess.run([python, "-m", "venv", home], check=True)
    pip = [home / "bin" / "python", "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    subprocess.run([*pip, "--require-hashes", "--requirement", ROOT / "locks" / f"{lock}.txt"], check=True)
    subprocess.run([*pip, "--no-deps", WHEEL], check=True)
    variables = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "VIRTUAL_ENV"))}
    return variables | {"PATH": f"{home / 'bin'}:{os.environ['PATH']}"}


def done(command: str, folder: Path, environment: dict[str, str]) -> str:
    """What a command prints in a folder."""
    ended = subprocess.run(
        command, shell=True, cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    assert ended.returncode == 0, f"{command}\n{ended.stdout}{ended.stderr}"
    return ended.stdout


def test_the_wheel_alone_does_the_tutorial_in_an_empty_folder(environment: dict[str, str], tmp_path: Path) -> None:
    place = Path(done("python -c 'import swarmsim; print(swarmsim.__file__)'", tmp_path, environment).strip())
    assert "site-packages" in place.parts
    assert not place.is_relative_to(ROOT)
    print("\n", done("swarmsim doctor", tmp_path, environment | {"COLUMNS": "150"}), sep="")
    (listing,) = blocks("docs/tutorial.md", "toml")
    (tmp_path / "tutorial").mkdir()
    (tmp_path / "tutorial" / "deaths.toml").write_text(listing)
    for command in commands_of("docs/tutorial.md"):
        done(command, tmp_path, environment)
    assert (tmp_path / "runs" / "first.mp4").stat().st_size > 10_000
