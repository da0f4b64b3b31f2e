"""What a new user meets first: examples, the doctor, help with an example, completion in the shell."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import click
import msgspec
import pytest
import typer
from conftest import ROOT, called
from numba.core import event

from swarmsim.cli import app
from swarmsim.cli.completion import example_names, fault_words, set_keys
from swarmsim.cli.progress import RunBar
from swarmsim.core.errors import InputError
from swarmsim.core.scenario import shipped
from swarmsim.core.scenario.file import load
from swarmsim.core.state import Moment
from swarmsim.faults.in_words import fault_in_words
from swarmsim.kernels.checks import counts_hold, links_hold

FIRST_RUN = "the first run on a machine compiles its kernels"


def swarmsim(*arguments: object, cwd: Path, **more: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "swarmsim", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd=cwd, env={**os.environ, **more})


def commands(group: click.Group, name: str = "swarmsim") -> list[tuple[str, click.Command]]:
    found: list[tuple[str, click.Command]] = []
    for key, command in group.commands.items():
        found.append((f"{name} {key}", command))
        if isinstance(command, click.Group):
            found += commands(command, f"{name} {key}")
    return found


COMMANDS = dict(commands(typer.main.get_command(app)))


@pytest.mark.parametrize("name", COMMANDS)
def test_the_help_of_every_command_shows_an_example_that_parses(name: str) -> None:
    command = COMMANDS[name]
    examples = re.findall(r"(swarmsim [^\n]+)", (command.help or "").split("Example:")[-1])
    assert "Example:" in (command.help or ""), name
    assert examples
    assert examples[0].startswith(name.split(" -")[0]) or isinstance(command, click.Group)


def test_examples_are_listed_run_and_copied(tmp_path: Path) -> None:
    listed = swarmsim("examples", cwd=tmp_path, COLUMNS="200")
    assert listed.returncode == 0
    for name in shipped.examples():
        assert f" {name} " in listed.stdout
    assert "{robots.count}" not in listed.stdout
    done = swarmsim("examples", "run", "room", "--out", "mine", "--quiet", cwd=tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert (tmp_path / "mine" / "recording.h5").exists()
    done = swarmsim("examples", "copy", "faults/partition", "here", cwd=tmp_path)
    assert done.stdout.splitlines() == [
        "here/scenarios/faults/partition.toml", "here/worlds/basilica.svg",
        "use it: swarmsim run here/scenarios/faults/partition.toml",
    ]  # fmt: skip
    done = swarmsim("examples", "run", "partition", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr == "swarmsim: partition: no such example; did you mean 'faults/partition'?\n"


@pytest.mark.parametrize("name", shipped.examples())
def test_every_copied_example_can_be_opened(tmp_path: Path, name: str) -> None:
    path, *_ = shipped.copy(name, tmp_path)
    copied, ours = load(path), load(ROOT / "scenarios" / f"{name}.toml")
    assert msgspec.structs.replace(copied, world=ours.world) == ours
    assert not copied.world.file or Path(copied.world.file).is_relative_to(tmp_path)
    assert not copied.world.file or Path(copied.world.file).read_text() == Path(ours.world.file).read_text()
    assert shipped.copy(name, tmp_path)[0] == path  # again: nothing differs
    path.write_text("title = 'mine'")
    with pytest.raises(InputError, match="exists already, and is another file"):
        shipped.copy(name, tmp_path)


@pytest.mark.thorough
def test_the_doctor_tells_what_works_and_what_to_do(tmp_path: Path) -> None:
    done = swarmsim("doctor", cwd=tmp_path, COLUMNS="200", SDL_VIDEODRIVER="dummy")
    assert done.returncode == 0, done.stdout + done.stderr
    for name in ("python", "versions", "name", "simulation", "film", "letters", "compiled code", "folder"):
        assert re.search(rf"{name} +│ works", done.stdout), name
    assert "only swarmsim view needs one" in done.stdout
    broken = swarmsim("doctor", cwd=tmp_path, COLUMNS="200", IMAGEIO_FFMPEG_EXE="/nowhere/ffmpeg")
    assert broken.returncode == 1
    assert "pip install --force-reinstall imageio-ffmpeg" in " ".join(broken.stdout.replace("│", " ").split())


def test_the_doctor_notices_the_other_package_of_the_same_name(tmp_path: Path) -> None:
    (tmp_path / "swarmsim-1.2.0.dist-info").mkdir()
    (tmp_path / "swarmsim-1.2.0.dist-info" / "METADATA").write_text(
        "Metadata-Version: 2.1\nName: swarmsim\nVersion: 1.2.0\n"
    )
    done = swarmsim("doctor", cwd=tmp_path, COLUMNS="300", PYTHONPATH=str(tmp_path))
    assert done.returncode == 1
    told = " ".join(done.stdout.replace("│", " ").split())
    assert "the package swarmsim 1.2.0 is another simulator" in told
    assert "pip uninstall swarmsim swarmsim-lab" in told


def test_keys_and_parts_are_completed() -> None:
    assert "robots.count=" in set_keys("rob")
    assert 'network.topology={use="knn"}' in set_keys("network.top")
    assert "network.topology.k=" in set_keys("network.topology.")
    assert set_keys("nonsense") == []
    assert len(set_keys("")) > 60
    for text in set_keys("mind.strategy={"):
        load(ROOT / "scenarios" / "room.toml", [text.replace('use="formation"', 'use="formation",offsets=[]')])
        break
    assert fault_words("mot") == ["motor"]
    assert set(fault_words("motor ")) >= {"motor off", "motor slow", "motor stuck", "motor at="}
    assert fault_words("motor off fr") == ["motor off fraction="]
    assert "crash at=5 count=" in fault_words("crash at=5 c")
    assert "crash at=5 at=" not in fault_words("crash at=5 a")
    assert fault_words("nothing ") == []
    assert fault_in_words("motor off fraction=0.5 at=3").table["failure"] == "off"
    assert example_names("faults/b") == [
        "faults/batteries",
        "faults/blind",
        "faults/byzantine",
        "faults/byzantine-quorum",
    ]


def test_the_shell_completes(tmp_path: Path) -> None:
    more = {"_SWARMSIM_COMPLETE": "complete_bash", "COMP_WORDS": "swarmsim run --set robots.c", "COMP_CWORD": "3"}
    script = "from swarmsim.cli import app; app(prog_name='swarmsim')"
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False, cwd=tmp_path,
        env={**os.environ, **more},
    )  # fmt: skip
    assert "robots.count=" in done.stdout.split()


#: Compiles one kernel, as a verb does.
COMPILES = """
import numpy as np
from swarmsim.cli.progress import compiling, progress_bar
from swarmsim.kernels.checks import counts_hold
with progress_bar(False) as progress, compiling(progress):
    assert counts_hold(np.zeros(1, np.int64), 1)
"""


def test_a_kernel_that_is_compiled_is_told_and_kept_for_the_next_process(tmp_path: Path) -> None:
    command, more = [sys.executable, "-c", COMPILES], {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    first, second = (
        subprocess.run(command, capture_output=True, text=True, check=True, env={**os.environ, **more}).stdout
        for _ in range(2)
    )
    assert first.count(FIRST_RUN) == 1
    assert "compiles" not in second


def test_a_machine_without_kernels_is_told_once_that_it_compiles(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Here numba tells so of two kernels that are compiled already."""
    room, sample = ROOT / "scenarios" / "room.toml", RunBar.sample

    def sampling(self: RunBar, moment: Moment) -> None:
        for kernel in (links_hold, counts_hold) if moment.state.iteration == 0 else ():
            with event.trigger_event("numba:compile", {"dispatcher": kernel}):
                pass
        sample(self, moment)

    run = ("run", room, "--set", "stop.iterations=3")
    assert "compiles" not in called(*run, cwd=tmp_path).stdout
    monkeypatch.setattr(RunBar, "sample", sampling)
    for new in (True, False):  # another kind of scenario compiles more on a machine that is no longer new
        monkeypatch.setattr("swarmsim.kernels.compiling.is_new", lambda new=new: new)
        assert called(*run, cwd=tmp_path).stdout.count(FIRST_RUN) == new


@pytest.mark.slow
def test_the_first_run_says_that_it_compiles_and_later_ones_do_not(tmp_path: Path) -> None:
    room = ROOT / "scenarios" / "room.toml"
    new = tmp_path / "cache"
    first, second = (
        swarmsim("run", room, "--set", "stop.iterations=3", cwd=tmp_path, NUMBA_CACHE_DIR=str(new)) for _ in range(2)
    )
    assert first.stdout.count(FIRST_RUN) == 1
    assert "compiles" not in second.stdout
