"""The import contracts hold for future folders too."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

from conftest import ROOT

LINT = Path(sys.executable).with_name("lint-imports")


def broken(folder: Path) -> set[str]:
    """The contracts broken by a copy of the package."""
    done = subprocess.run(
        [LINT, "--cache-dir", folder / "cache"], cwd=folder, capture_output=True, text=True, check=False
    )
    found = dict(re.findall(r"^(\w[\w ]+) (KEPT|BROKEN)", done.stdout, re.MULTILINE))
    assert len(found) == 9, done.stdout + done.stderr
    return {name for name, state in found.items() if state == "BROKEN"}


def test_a_new_folder_is_inside_of_every_contract_until_it_is_let_out(tmp_path: Path) -> None:
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    shutil.copytree(ROOT / "swarmsim", tmp_path / "swarmsim", ignore=shutil.ignore_patterns("__pycache__"))
    assert broken(tmp_path) == set()
    new = tmp_path / "swarmsim" / "gardening"
    new.mkdir()
    (new / "__init__.py").write_text("")
    assert broken(tmp_path) == {"imports point one way"}  # it has no layer
    (new / "weeds.py").write_text("import dask\nimport matplotlib\nimport numba\nimport pygame\nimport pymunk\n")
    libraries = {"pymunk in bodies", "numba in kernels", "pygame in view", "matplotlib in view", "dask in studies"}
    assert broken(tmp_path) == {"imports point one way"} | {f"{one} alone" for one in libraries}
    (new / "weeds.py").unlink()
    within = tmp_path / "swarmsim" / "operations" / "gardening"
    within.mkdir()
    (within / "__init__.py").write_text("import swarmsim.world.plan\n")
    shutil.rmtree(new)
    assert broken(tmp_path) == {"operations know neither world nor bodies"}
