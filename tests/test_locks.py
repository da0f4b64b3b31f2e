"""The installed packages are the listed ones, file by file."""

from __future__ import annotations

import re
import tomllib
from importlib import metadata

import pytest
import yaml
from conftest import ROOT
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

import swarmsim

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
LISTS = sorted((ROOT / "locks").glob("*.txt"))
BENEATH = {
    "run": (),
    "test": ("run",),
    "browser": ("run", "test"),
    "docs": ("run",),
    "slurm": ("run",),
    "dist": ("run",),
}


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
    assert {path.stem for path in LISTS} == {*BENEATH, "lowest", "uv"}


def test_make_installs_nothing_that_is_not_listed() -> None:
    """Except the package itself, whose needs are listed, and third-party simulators."""
    lines = (ROOT / "Makefile").read_text().splitlines()
    installs = [line for line in lines if "pip install" in line and ".venv-" not in line]
    assert len(installs) == 3
    assert all("--require-hashes" in line or "--no-deps --no-build-isolation" in line for line in installs)


def test_the_lowest_versions_are_those_that_the_project_asks_for() -> None:
    """But where another package needs a newer one."""
    pins = [
        Requirement(line.removesuffix(" \\"))
        for line in (ROOT / "locks/lowest.txt").read_text().splitlines()
        if "==" in line
    ]
    found = {canonicalize_name(pin.name): next(iter(pin.specifier)).version for pin in pins}
    for one in map(Requirement, PROJECT["project"]["dependencies"]):
        (lowest,) = [part.version for part in one.specifier if part.operator == ">="]
        assert Version(found[canonicalize_name(one.name)]).release[:2] == Version(f"{lowest}.0").release[:2], one


def licences() -> dict[str, str]:
    """The licence of each package on the page, by name."""
    rows = re.findall(r"^\| ([^|]+) \| ([^|]+) \|$", (ROOT / "docs/licences.md").read_text(), re.MULTILINE)[1:]
    return {name: licence for licence, names in rows for name in names.split(", ")}


FOR_DEVELOPERS = {"test", "browser", "docs", "bench", "dist"}
SAID = {
    "MIT": "MIT", "BSD": "BSD", "Apache": "Apache", "Python": "PSF|Python Software Foundation|matplotlib",
    "ISC": "ISC", "LGPL": "LGPL|Lesser", "MPL": "MPL|Mozilla",
}  # fmt: skip


def test_the_licence_of_every_package_is_on_the_page_as_the_package_says_it() -> None:
    extras = PROJECT["project"]["optional-dependencies"]
    asked = [Requirement(one).name for name, list_ in extras.items() if name not in FOR_DEVELOPERS for one in list_]
    ours = licences()
    assert set(ours) == {*listed("run"), *map(canonicalize_name, asked)}
    for name, licence in ours.items():
        try:
            about = metadata.metadata(name)
        except metadata.PackageNotFoundError:  # of another system, or an extra that tests do without
            continue
        classified = [one for one in about.get_all("Classifier") or () if one.startswith("License")]
        said = " ".join([about.get("License-Expression") or "", (about.get("License") or "")[:200], *classified])
        assert re.search(SAID[re.match(r"\w+", licence)[0]], said), (name, licence, said)
        assert not re.search(
            r"(?<![A-Z])A?GPL|General Public", re.sub(r"L?GPL v2.1|Lesser General Public|LGPL", "", said)
        )


def test_the_citation_is_of_this_version() -> None:
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert (cited["version"], cited["license"]) == (swarmsim.__version__, PROJECT["project"]["license"])
    assert cited["authors"] == PROJECT["project"]["authors"]
    assert cited["keywords"] == PROJECT["project"]["keywords"]
