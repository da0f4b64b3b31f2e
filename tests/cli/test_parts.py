"""What parts there are, told by themselves; and parts to start from, whose tests pass."""

from __future__ import annotations

import json
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Annotated

import msgspec
import pytest
from conftest import ROOT
from msgspec import Meta
from msgspec import inspect as types
from typer.testing import CliRunner

from swarmsim.api import skeletons
from swarmsim.cli import app
from swarmsim.core.errors import InputError
from swarmsim.core.scenario import describe, registry
from swarmsim.core.seams import SEAMS


def run(*arguments: str) -> str:
    done = CliRunner(env={"COLUMNS": "200"}).invoke(app, [*arguments])
    if isinstance(done.exception, InputError):
        raise done.exception
    assert done.exit_code == 0, done.output
    return done.output


def test_every_part_of_every_seam_is_listed_with_where_it_comes_from() -> None:
    output = run("parts")
    for seam in SEAMS:
        assert f"{seam} (* is the default)" in output
        for name in registry.entries(seam):
            assert name in output
    assert "nearest-frontier *" in output
    assert "0.1.0" in output
    assert "knn" not in run("parts", "channel")


def test_one_part_is_told_whole() -> None:
    output = run("parts", "sensor.ir-ring")
    for words in ("from swarmsim-lab", "the default", "tile", "[whole number from 1 to 99, whole number", "[6,7]",
                  '"ignored" or', "number above 0", "rows, columns"):  # fmt: skip
        assert words in output, words
    (described,) = json.loads(run("parts", "topology.knn", "--json"))
    assert described["parameters"][0] == {
        "key": "k", "kind": "whole number from 0", "default": None, "meaning": "others heard",
    }  # fmt: skip
    assert len(json.loads(run("parts", "--json"))) == sum(len(registry.entries(seam)) for seam in SEAMS)
    assert "It has no keys." in run("parts", "topology.full")


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ("topologies", "topologies: no such seam; did you mean 'topology'"),
        ("topology.kn", "no topology is called 'kn'; did you mean 'knn'"),
        ("brain.knn", "brain: no such seam; known: "),
    ],
)
def test_what_there_is_not_is_told_with_the_nearest(asked: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        run("parts", asked)


def test_every_part_of_ours_has_a_sentence_and_every_number_a_meaning() -> None:
    described = [part for part in describe.parts() if part.origin.startswith("swarmsim-lab")]
    assert len(described) > 60
    assert [f"{part.seam}.{part.name}" for part in described if not part.first.endswith((".", ":"))] == []
    dumb = [
        f"{part.seam}.{part.name}.{one.key}"
        for part in described
        for one in part.parameters
        if "number" in one.kind and not one.meaning
    ]
    assert dumb == []


class Odd(msgspec.Struct):
    share: Annotated[float, Meta(ge=0.0, lt=1.0)] | None = None  #: of everything
    names: list[str] = []
    table: dict[str, int] = {}
    flag: bool = True  # whether
    anything: object = None


def test_types_are_put_in_words() -> None:
    info = types.type_info(Odd)
    assert [describe.words(field.type) for field in info.fields][:4] == [
        "number from 0 below 1", "list of: text", "a table", "true or false",
    ]  # fmt: skip
    assert describe.comments(Odd) == {"share": "of everything", "flag": "whether"}
    nameless = msgspec.defstruct("Nameless", [("x", int, 3)])
    assert describe.comments(nameless) == {}


@pytest.mark.thorough
def test_skeletons_pass_their_own_tests(tmp_path: Path) -> None:
    for kind in skeletons.kinds():
        output = run("new", kind, f"my-{kind}", "--to", str(tmp_path))
        assert f"test_my_{kind}.py" in output
        assert "--allow-code" in output or kind == "transport"  # which stands in no scenario
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-p",
        "no:cacheprovider",
        str(tmp_path),
        "--rootdir",
        str(tmp_path),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert done.returncode == 0, done.stdout
    assert f"{len(skeletons.kinds())} passed" in done.stdout


@pytest.mark.parametrize(
    ("kind", "name", "words"),
    [
        ("minds", "x", "new minds: no such kind of part; did you mean 'mind'"),
        ("mind", "two words", "new mind two words: not a name for a part"),
        ("mind", "class", "new mind class: not a name"),
        ("mind", "../x", "not a name for a part"),
    ],
)
def test_names_that_cannot_be_are_refused(tmp_path: Path, kind: str, name: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        run("new", kind, name, "--to", str(tmp_path))
    assert list(tmp_path.iterdir()) == []


def test_nothing_is_overwritten(tmp_path: Path) -> None:
    (tmp_path / "test_mine.py").write_text("precious")
    with pytest.raises(InputError, match=r"test_mine\.py: exists already"):
        run("new", "task", "mine", "--to", str(tmp_path))
    assert (tmp_path / "test_mine.py").read_text() == "precious"
    assert not (tmp_path / "mine.py").exists()


@pytest.mark.thorough
def test_the_template_is_installed_found_and_passes_its_own_tests(tmp_path: Path) -> None:
    """A copy of it, in a fresh environment that sees what this one has installed, by the lines of its README."""
    copy, env = tmp_path / "weather", tmp_path / "env"
    shutil.copytree(ROOT / "template", copy, ignore=shutil.ignore_patterns("__pycache__", ".*_cache"))
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", env], check=True)
    python = [str(env / "bin" / "python"), "-m"]
    asked = "import sysconfig; print(sysconfig.get_path('purelib'))"
    here, there = (
        subprocess.run([one, "-c", asked], capture_output=True, text=True, check=True).stdout.strip()
        for one in (sys.executable, python[0])
    )
    (Path(there) / "these.pth").write_text(f"import site; site.addsitedir({here!r})\n")
    offline = ["--quiet", "--no-index", "--no-build-isolation", "--no-deps"]
    for line in "".join(re.findall(r"```sh\n(.*?)```", (copy / "README.md").read_text(), re.DOTALL)).splitlines():
        words = shlex.split(line.removeprefix("python -m "))
        command = [*python, *words, *offline] if words[:2] == ["pip", "install"] else [*python, *words]
        done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=copy)
        assert done.returncode == 0, f"{line}\n{done.stdout}{done.stderr}"
    assert (copy / "runs" / "warmest.mp4").stat().st_size > 10_000
    listed = subprocess.run([*python, "swarmsim", "parts", "--json"], capture_output=True, text=True, check=True)
    theirs = [part for part in json.loads(listed.stdout) if part["origin"].startswith("swarmsim-weather")]
    assert {part["seam"] for part in theirs} == SEAMS.keys()
    assert all(part["first"] for part in theirs)
