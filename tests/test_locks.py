"""The installed packages are the listed ones, file by file."""

from __future__ import annotations

import re
import tomllib

import pytest
from conftest import ROOT
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
LISTS = sorted((ROOT / "locks").glob("*.txt"))
BENEATH = {"run": (), "test": ("run",), "browser": ("run", "test"), "docs": ("run",), "slurm": ("run",)}


def listed(name: str) -> dict[str, Requirement]:
    """The pins of a list and of the lists that it extends, by name."""
    lines = [line for part in (*BENEATH[name], name) for line in (ROOT / f"locks/{part}.txt").read_text().splitlines()]
    pins = [Requirement(line.removesuffix(" \\")) for line in lines if line and not line.startswith((" ", "#"))]
    return {canonicalize_name(pin.name): pin for pin in pins}


@pytest.mark.parametrize("path", LISTS, ids=lambda path: path.stem)
def test_every_pin_has_hashes_and_no_list_has_an_address(path) -> None:
    text = path.read_text()
    pins = re.split(r"\n(?! )", text.strip())
    for pin in pins:
        assert re.fullmatch(r"[a-z0-9-]+==[^\s;]+( ;[^\\\n]+)?( \\\n    --hash=sha256:[0-9a-f]{64})+", pin), pin
    assert "//" not in text
    assert "index" not in text


@pytest.mark.parametrize("name", sorted(BENEATH))
def test_what_the_project_asks_for_is_listed(name) -> None:
    extras = PROJECT["project"]["optional-dependencies"]
    asked = (
        extras[name] if name in extras else [*PROJECT["project"]["dependencies"], *PROJECT["build-system"]["requires"]]
    )
    pins = listed(name)
    for one in map(Requirement, asked):
        pin = pins[canonicalize_name(one.name)]
        assert pin.marker is None
        assert one.specifier.contains(next(iter(pin.specifier)).version), (one, pin)


def test_lists_agree_on_versions() -> None:
    pins = [(key, str(pin.specifier)) for name in BENEATH for key, pin in listed(name).items()]
    assert len(set(pins)) == len(dict(pins))
    assert {path.stem for path in LISTS} == {*BENEATH, "uv"}


def test_make_installs_nothing_that_is_not_listed() -> None:
    """Except the package itself, whose needs are listed, and third-party simulators."""
    lines = (ROOT / "Makefile").read_text().splitlines()
    installs = [line for line in lines if "pip install" in line and ".venv-" not in line]
    assert len(installs) == 3
    assert all("--require-hashes" in line or "--no-deps --no-build-isolation" in line for line in installs)
