"""Attacks by untrusted files, line by line of docs/threats.md."""

from __future__ import annotations

import gzip
import json
import os
import pty
import re
import shutil
import socket
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
from conftest import ROOT, made
from typer.testing import CliRunner

from swarmsim.cli import app
from swarmsim.core.errors import InputError
from swarmsim.studies.results import write_csv

ROOM = ROOT / "worlds" / "room.svg"
EMPTY = (f'world="{ROOT}/worlds/arena.svg"', 'robots.spawn="middle"', 'sensor={use="none"}')
PART = """
import pathlib
pathlib.Path({ran!r}).touch()
from swarmsim.operations.mapping.computation import OccupancyGrid
Mine = OccupancyGrid
"""


def done(*words: object) -> str:
    """A command's output; raises its exception."""
    result = CliRunner().invoke(app, [str(word) for word in words])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    assert result.exit_code in (0, 1), result.output
    return result.output


def scenario(folder: Path, world: str = str(ROOM), more: str = "", topology: str = '{use = "none"}') -> Path:
    path = folder / "s.toml"
    path.write_text(
        f'world = "{world}"\nnetwork = {{topology = {topology}}}\n{more}\n[robots]\ncount = 2\n[stop]\niterations = 3\n'
    )
    return path


@pytest.fixture
def foreign(tmp_path: Path) -> tuple[Path, Path]:
    """A scenario with its own code, and a file that exists once that has run."""
    ran = tmp_path / "ran"
    (tmp_path / "mine.py").write_text(PART.format(ran=str(ran)))
    return scenario(tmp_path, more='mind = {computation = {use = "./mine.py:Mine"}}'), ran


def test_every_line_of_the_page_has_its_test() -> None:
    named = set(re.findall(r"\| `(test_\w+)` \|", (ROOT / "docs" / "threats.md").read_text()))
    assert named == {name for name in globals() if name.startswith("test_")} - {
        "test_every_line_of_the_page_has_its_test"
    }


def test_a_scenario_runs_no_code(foreign: tuple[Path, Path], tmp_path: Path) -> None:
    path, ran = foreign
    (tmp_path / "study.toml").write_text('title = "S"\nscenario = "s.toml"\nseeds = 1\n')
    for words in (
        ("run", path, "--out", tmp_path / "run"),
        ("world", "check", path),
        ("study", "run", tmp_path / "study.toml"),
        ("run", scenario(tmp_path, topology='{use = "antigravity:x"}'), "--out", tmp_path / "run"),
    ):
        with pytest.raises((InputError, AssertionError)) as refused:
            done(*words)
        assert words[0] == "study" or "--allow-code" in str(refused.value)
    assert not ran.exists()


def test_a_recording_runs_no_code(foreign: tuple[Path, Path], tmp_path: Path) -> None:
    path, ran = foreign
    run = tmp_path / "run"
    done("run", path, "--out", run, "--allow-code")
    assert ran.exists()
    ran.unlink()
    for module in [name for name in list(__import__("sys").modules) if name.endswith("_mine")]:
        del __import__("sys").modules[module]
    done("show", run)
    done("network", run)
    done("report", run, "--out", tmp_path / "page.html")
    done("export", run, "--map", tmp_path / "map.yaml")
    done("video", run, tmp_path / "film.gif", "--size", "640x360", "--no-cards")
    with pytest.raises(InputError, match="--allow-code"):
        done("verify", run)
    assert not ran.exists()


def test_files_outside_are_named_and_not_repeated(tmp_path: Path) -> None:
    secret = tmp_path / "secret"
    secret.write_text("hunter2 = sesame\n")
    inner = tmp_path / "in"
    inner.mkdir()
    shutil.copy(ROOM, tmp_path / "room.svg")
    assert "lies outside" in " ".join(done("run", scenario(inner, "../room.svg"), "--out", tmp_path / "run").split())
    edges = '{use = "edges", links = {file = "../secret"}}'
    values = 'field = {use = "picture", values = {file = "../secret"}}'
    for path in (
        scenario(inner, "../secret"),
        scenario(inner, "../room.svg", topology=edges),
        scenario(inner, "../room.svg", more=values),
    ):
        with pytest.raises(InputError) as refused:
            done("run", path, "--out", tmp_path / "none")
        assert "hunter2" not in str(refused.value)
        assert "sesame" not in str(refused.value)


ENDLESS = ("/proc/kmsg", "/proc/kpagemap")  # the system reports them as plain files of length 0


def test_devices_and_pipes_are_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.svg")
    for file in ("/dev/zero", str(tmp_path / "pipe.svg"), *(name for name in ENDLESS if Path(name).exists())):
        for words in (
            ("run", scenario(tmp_path, file)),
            ("run", scenario(tmp_path, topology=f'{{use = "edges", links = {{file = "{file}"}}}}')),
            ("run", file),
            ("show", file),
        ):
            with pytest.raises(InputError):
                done(*words, *(("--out", tmp_path / "run") if words[0] == "run" else ()))
    (tmp_path / "map.yaml").write_text("image: /proc/kmsg\nresolution: 0.05\norigin: [0, 0, 0]\n")
    with pytest.raises(InputError, match=r"kmsg"):
        done("run", scenario(tmp_path, "map.yaml"), "--out", tmp_path / "run")
    (tmp_path / "large.csv").write_bytes(b"0,1\n" * 17_000_000)
    with pytest.raises(InputError, match="larger than 64 MB"):
        done(
            "run",
            scenario(tmp_path, topology='{use = "edges", links = {file = "large.csv"}}'),
            "--out",
            tmp_path / "run",
        )


def test_nothing_opens_a_connection(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*given: object) -> None:
        raise AssertionError(f"connects to {given[1:]}")

    monkeypatch.setattr(socket.socket, "connect", refused)
    shutil.copy(ROOM, tmp_path / "room.svg")
    text = (tmp_path / "room.svg").read_text()
    image = '<image href="http://example.org/x.png" width="1" height="1"/>'
    (tmp_path / "room.svg").write_text(text.replace("</svg>", f"{image}</svg>"))
    run = tmp_path / "run"
    done("run", scenario(tmp_path, "room.svg"), "--out", run, "--video", tmp_path / "film.mp4")
    done("report", run, "--out", tmp_path / "page.html")
    assert not re.search(r'(src|href)="(https?:)?//', (tmp_path / "page.html").read_text())


@pytest.mark.parametrize(
    "entities",
    [
        '<!DOCTYPE svg [<!ENTITY x SYSTEM "file:///etc/passwd">]>',
        '<!DOCTYPE svg [<!ENTITY x SYSTEM "http://example.org/x">]>',
        "<!DOCTYPE svg [<!ENTITY a 'aaaaaaaaaa'>"
        + "".join(f"<!ENTITY {chr(98 + i)} '{f'&{chr(97 + i)};' * 50}'>" for i in range(12))
        + "<!ENTITY x '&m;'>]>",
    ],
    ids=["file", "address", "multiplying"],
)
def test_entities_are_not_expanded(entities: str, tmp_path: Path) -> None:
    (tmp_path / "w.svg").write_text(
        f'{entities}<svg xmlns="http://www.w3.org/2000/svg" width="4m" height="4m" viewBox="0 0 4 4"><title>&x;</title>'
        '<g id="walls"><path fill-rule="evenodd" d="M0 0H4V4H0Z M.1 .1V3.9H3.9V.1Z"/></g></svg>'
    )
    result = CliRunner().invoke(app, ["run", str(scenario(tmp_path, "w.svg")), "--out", str(tmp_path / "run")])
    assert isinstance(result.exception, InputError | SystemExit)
    assert "root:" not in f"{result.output} {result.exception}"


def test_bombs_are_refused(tmp_path: Path) -> None:
    (tmp_path / "w.svg").write_bytes(gzip.compress(b" " * 70_000_000))
    with pytest.raises(InputError, match="unpacks to more than 64 MB"):
        done("world", "check", tmp_path / "w.svg")
    header = b"P5 100000 100000 255\n"
    (tmp_path / "w.pgm").write_bytes(header)
    with pytest.raises(InputError, match="pixels; expected at most"):
        done(
            "run",
            scenario(tmp_path, "w.pgm"),
            "--set",
            'world={file="w.pgm", resolution=0.05}',
            "--out",
            tmp_path / "run",
        )


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        (["grid.cell=1e-4"], "more than 25000000"),
        (['world={generate={use="rooms", width=1000.0, height=1000.0}}'], "more than 25000000"),
        ([*EMPTY, "grid.cell=0.016", "robots.count=99999"], "holds 910 robots"),
        (["robots.count=100001"], "<= 100000"),
        (["robots.count=9999"], "holds"),
        (["physics.substep=1e-9"], "at most 100000"),
        (["period=1e9"], "<= 100000"),
        (["sensor.beams=10001"], "<= 10000"),
        (
            ["grid.cell=0.01", "sensor.beams=10000", "sensor.tile=[99, 99]", "budget=60"],
            "takes about .* a budget of 60",
        ),
        (["stop.iterations=100000", "sensor.beams=10000", "budget=60"], "takes about .* a budget of 60"),
        (["sensor.tile=[100, 100]"], "<= 99"),
    ],
)
def test_too_much_is_refused_at_once(changes: list[str], told: str) -> None:
    with pytest.raises(InputError, match=told):
        made(*changes)


def test_pages_escape_what_they_show(tmp_path: Path) -> None:
    evil = "</script><script>alert(1)</script>"
    path = scenario(tmp_path, more=f'title = "{evil}"')
    done("run", path, "--out", tmp_path / "run")
    done("report", tmp_path / "run", "--out", tmp_path / "page.html")
    assert "<script>alert" not in (tmp_path / "page.html").read_text()


EVIL = r"evil \u001b]0;owned\u0007\u001b[2J\u001b[31mred\u009b1A\r\u0008 end"


@pytest.mark.parametrize("kind", ["table", "error", "title"])
def test_text_from_files_does_not_steer_the_terminal(tmp_path: Path, kind: str) -> None:
    path = scenario(tmp_path, more=f'title = "{EVIL}"')
    if kind == "table":
        done("run", path, "--out", tmp_path / "run")
    (tmp_path / "bad.toml").write_text(f'"{EVIL}" = 1\n' + path.read_text())
    (tmp_path / "study.toml").write_text(f'title = "{EVIL}"\nscenario = "s.toml"\nseeds = 1\n')
    words = {
        "table": ["show", str(tmp_path / "run")],
        "error": ["run", str(tmp_path / "bad.toml")],
        "title": ["study", "status", str(tmp_path / "study.toml"), "--store", str(tmp_path / "s.sqlite")],
    }[kind]
    ours, theirs = pty.openpty()
    process = subprocess.Popen(
        [sys.executable, "-m", "swarmsim", *words], stdout=theirs, stderr=theirs, env={**os.environ, "TERM": "xterm"}
    )
    os.close(theirs)
    printed = b""
    try:
        while piece := os.read(ours, 4096):
            printed += piece
    except OSError:  # the end of a terminal
        pass
    process.wait()
    os.close(ours)
    text = printed.decode()
    assert "evil" in text
    assert not any(mark in text for mark in ("\x1b]", "\x1b[2J", "\x1b[31m", "\x07", "\x08", "\x9b"))


def test_spreadsheets_get_no_formulas(tmp_path: Path) -> None:
    write_csv(
        tmp_path / "x.csv", [{"label": '=HYPERLINK("http://x")', "error": "@SUM(1)", "value": -1.5, "plain": "ok"}]
    )
    line = (tmp_path / "x.csv").read_text().splitlines()[1]
    assert line == '"\'=HYPERLINK(""http://x"")",\'@SUM(1),-1.5,ok'


def test_made_up_recordings_are_refused(tmp_path: Path) -> None:
    """tests/recording/test_damage.py tries many more."""
    run = made("stop.iterations=5")
    path = tmp_path / "recording.h5"
    with run.recorder(path) as recorder:
        run.simulation.run([recorder])
    with h5py.File(path, "r+") as file:
        file["letters"][0, 0] = 10**6
        del file["links"]
        file["links"] = np.zeros((3, 2), np.int32)
    with pytest.raises(InputError, match="not a whole recording"):
        done("show", path)


def test_nothing_is_overwritten(tmp_path: Path) -> None:
    run = tmp_path / "run"
    done("run", scenario(tmp_path), "--out", run)
    before = json.loads((run / "summary.json").read_text())
    with pytest.raises(InputError, match="exists"):
        done("run", scenario(tmp_path), "--out", run)
    assert json.loads((run / "summary.json").read_text()) == before
