"""Plug-ins and the package itself are known by the content of their files."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT

LAMPS = """import msgspec


class Lamp(msgspec.Struct, frozen=True):
    def build(self, context):
        raise NotImplementedError
"""
#: Says what is hashed, in a process of its own; edits a file after it was hashed first, if there is one to edit.
SCRIPT = """
import sys
from pathlib import Path
from swarmsim.core.code import distributions
entry = distributions.parts()["topology"]["lamp"]
print(*distributions.plugin(entry))
if len(sys.argv) > 1:
    Path(sys.argv[1]).write_text("edited = True")
    print(*distributions.plugin(entry))
"""


@pytest.fixture
def lamps(tmp_path: Path) -> Path:
    """An installed distribution with a part in it."""
    package, info = tmp_path / "lamps", tmp_path / "own_lamps-1.0.dist-info"
    package.mkdir()
    info.mkdir()
    (package / "__init__.py").write_text("")
    (package / "parts.py").write_text(LAMPS)
    (package / "weights.bin").write_bytes(b"1")
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: own-lamps\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[swarmsim.topology]\nlamp = lamps.parts:Lamp\n")
    files = ("lamps/__init__.py", "lamps/parts.py", "lamps/weights.bin", "own_lamps-1.0.dist-info/METADATA")
    (info / "RECORD").write_text("".join(f"{file},,\n" for file in files))
    return package


def told(package: Path, *edited: Path) -> list[list[str]]:
    environment = os.environ | {"PYTHONPATH": str(package.parent)}
    command = [sys.executable, "-c", SCRIPT, *map(str, edited)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment, cwd=ROOT)
    return [line.split() for line in done.stdout.splitlines()]


def test_a_plug_in_is_known_by_its_files_and_not_by_its_version(lamps: Path) -> None:
    ((name, first),) = told(lamps)
    assert name == "own-lamps"
    assert told(lamps) == [[name, first]]
    found = {first}
    for file, text in (("weights.bin", "2"), ("parts.py", LAMPS + "#"), ("new.py", "")):
        (lamps / file).write_text(text)
        found.add(told(lamps)[0][1])
    assert len(found) == 4
    (lamps.parent / "own_lamps-1.0.dist-info" / "METADATA").write_text(
        "Metadata-Version: 2.1\nName: own-lamps\nVersion: 1.1\n"
    )
    assert told(lamps)[0][1] in found


def test_files_that_change_while_a_process_uses_them_are_no_known_code(lamps: Path) -> None:
    (_, first), (_, second) = told(lamps, lamps / "parts.py")
    assert second == f"{first}+"
