"""What is printed: text from files steers no terminal; an output that cannot be written is told in a sentence."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT, called
from offspring import Offspring

from swarmsim.core.errors import StorageError

FULL = Path("/dev/full")
ROOM = ROOT / "scenarios" / "room.toml"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run."""
    folder = tmp_path_factory.mktemp("printed") / "run"
    called("run", ROOM, "--out", folder, "--quiet", "--set", "stop.iterations=3")
    return folder


@pytest.mark.skipif(not FULL.exists(), reason="this system has no /dev/full")
@pytest.mark.parametrize(
    "words", [("show", "RUN"), ("show", "RUN", "--json"), ("schema",), ("parts",), ("--help",), ("run", "SCENARIO")]
)
def test_an_output_that_is_full_is_told_in_a_sentence(
    run: Path, offspring: Offspring, tmp_path: Path, words: tuple[str, ...]
) -> None:
    places = {"RUN": run, "SCENARIO": ROOM}
    done = offspring.ended([places.get(word, word) for word in words], tmp_path, out=FULL)
    assert (done.returncode, done.stderr) == (
        4, "swarmsim: standard output: cannot be written (No space left on device)\n"
    )  # fmt: skip


@pytest.mark.parametrize("words", [("show", "RUN"), ("show", "RUN", "--json"), ("schema",), ("--help",)])
def test_a_reader_that_has_seen_enough_ends_a_verb_quietly(run: Path, words: tuple[str, ...]) -> None:
    read, write = os.pipe()
    os.close(read)
    command = [sys.executable, "-m", "swarmsim", *(str(run) if word == "RUN" else word for word in words)]
    done = subprocess.run(command, text=True, check=False, timeout=120, stdout=write, stderr=subprocess.PIPE)
    os.close(write)
    assert (done.returncode, done.stderr) == (141, "")


def test_a_console_in_the_progress_of_another_still_shows_text_plainly(capsys: pytest.CaptureFixture[str]) -> None:
    from swarmsim.cli.printed import printed
    from swarmsim.cli.progress import progress_bar

    with printed(), progress_bar(quiet=False) as progress:
        progress.console.print("one\x1b[2J")
        print("two\x1b[2J")
    assert capsys.readouterr().out.startswith("one[2J\ntwo")


def test_other_streams_are_told_apart() -> None:
    from swarmsim.cli.printed import Printed

    class Broken:
        def write(self, text: str) -> int:
            raise BrokenPipeError

    class Full:
        def write(self, text: str) -> int:
            raise OSError(28, "No space left on device")

    with pytest.raises(BrokenPipeError):
        Printed(Broken()).write("x")  # type: ignore[arg-type]
    with pytest.raises(StorageError, match="No space left"):
        Printed(Full()).write("x")  # type: ignore[arg-type]
