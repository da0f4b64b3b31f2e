"""Attacks by untrusted files and frames, line by line of docs/threats.md."""

from __future__ import annotations

import gzip
import json
import os
import pty
import random
import re
import shutil
import socket
import subprocess
import sys
import time
import tracemalloc
from collections import Counter
from contextlib import ExitStack, closing
from pathlib import Path

import h5py
import numpy as np
import pytest
from conftest import ROOT, made
from fleet.places import free, transport, until
from typer.testing import CliRunner

from swarmsim.cli import app
from swarmsim.core.errors import InputError
from swarmsim.core.messages import HEADER
from swarmsim.fleet.emergency import EVERYBODY, Halt
from swarmsim.fleet.keyring import write_keys
from swarmsim.fleet.transport import WORLD, RobotLink
from swarmsim.fleet.transports.beacons import GONE, HERE, Beacons
from swarmsim.studies.results import write_csv
from swarmsim.testing.transports import collected

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


def test_only_who_has_the_key_of_the_world_can_halt_robots(tmp_path: Path) -> None:
    write_keys(4, tmp_path / "swarm.keys")
    for folder in ("strange", "robots"):
        (tmp_path / folder).mkdir()
    write_keys(4, tmp_path / "strange" / "swarm.keys")
    own = [one for one in (tmp_path / "swarm.keys").read_text().splitlines(True) if not one.startswith("world")]
    (tmp_path / "robots" / "swarm.keys").write_text("".join(own))
    order = Halt(EVERYBODY, True, 1_800_000_000).packed()
    for place, said in ((".", [(order, None)]), ("strange", []), ("robots", [])):
        air = f"{tmp_path}/{place}"
        links = [
            transport("signed", over={"use": "memory"}, keys=str(tmp_path / folder / "swarm.keys"), header=header)
            for folder, header in ((place, 1), (".", 1))
        ]
        number = 2 if place == "robots" else WORLD
        with closing(links[0].open(air, number)) as operator, closing(links[1].open(air, 3)) as robot:
            if place == "robots":
                with pytest.raises(InputError, match="has no key"):
                    operator.say(order)
            else:
                operator.say(order)
                operator.say(order)
            assert robot.heard() == said
            assert sum(robot.counts.values()) == (1 if place == "." else 2 if place == "strange" else 0)


def test_forged_and_repeated_frames_are_not_heard(tmp_path: Path) -> None:
    """A hundred thousand; tests/fleet/test_strangers.py tells the reasons apart."""
    keys, air = str(write_keys(4, tmp_path / "swarm.keys")), str(tmp_path)
    with ExitStack() as opened:
        signed = transport("signed", over={"use": "memory"}, keys=keys)
        robot, listener = (opened.enter_context(closing(signed.open(air, number))) for number in (1, 2))
        check_refused(robot, listener, opened.enter_context(closing(transport("memory").open(air, 9))))


def check_refused(robot: RobotLink, listener: RobotLink, stranger: RobotLink) -> None:
    """What the stranger says is not heard, whether made up, changed or repeated."""
    good = []
    for iteration in range(1000):
        robot.say(HEADER.pack(1, iteration) + bytes(15))
        good += [one for one, _ in stranger.heard()]
    assert len(listener.heard()) == 1000
    dice, sent = random.Random(3), 0
    for i in range(100_000):
        if i == 80_000:  # it is slow
            tracemalloc.start()
        kind, old = i % 4, good[dice.randrange(len(good))]
        if kind == 0:
            hostile = dice.randbytes(dice.randrange(200))
        elif kind == 1:
            hostile = old
        elif kind == 2:
            at = dice.randrange(len(old))
            hostile = old[:at] + bytes([old[at] ^ (1 << dice.randrange(8))]) + old[at + 1 :]
        else:
            hostile = HEADER.pack(dice.randrange(4), dice.randrange(2**32)) + dice.randbytes(23)
        stranger.say(hostile)
        sent += 1
        if i % 1000 == 999:
            assert listener.heard() == []
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert sum(listener.counts.values()) == sent == 100_000
    assert set(listener.counts) == {"forged", "replayed", "too short", "unknown"}
    assert peak < 500_000


def test_floods_take_bounded_memory() -> None:
    with closing(transport("memory").open("flood", 0)) as idle, closing(transport("memory").open("flood", 1)) as loud:
        for i in range(100_000):
            if i == 80_000:
                tracemalloc.start()
            loud.say(i.to_bytes(4) * 100)
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert peak < 5_000_000
        heard = idle.heard()
        assert len(heard) + idle.counts["full"] == 100_000
        assert heard[-1][0][:4] == (99_999).to_bytes(4)


def test_signed_beacons_are_neither_made_up_nor_said_again(tmp_path: Path) -> None:
    keys = {robot: bytes([robot + 2]) * 32 for robot in (WORLD, 1, 2)}
    refused = Counter[str]()
    listener, one = Beacons(WORLD, 60.0, keys, refused), Beacons(1, 60.0, keys, Counter())
    stranger, taken = Beacons(2, 60.0, {**keys, 2: b"x" * 32}, Counter()), one.made(HERE)
    listener.take(taken)
    assert listener.present == {1}
    gone = one.made(GONE)
    listener.take(gone)
    for wrong in (taken, gone, stranger.made(HERE), b"", taken[:-1], Beacons(2, 60.0, {}, Counter()).made(HERE)):
        listener.take(wrong)
    assert listener.present == set()
    assert refused == {"no beacon": 6}
    listener.take(one.made(HERE))
    assert listener.present == {1}
    file, place = str(write_keys(2, tmp_path / "swarm.keys")), free()
    with (
        closing(transport("udp", keys=file).open(place, WORLD)) as world,
        closing(transport("udp", keys=file).open(place, 1)) as robot,
        closing(transport("udp").open(place, 0)),
    ):
        until(lambda: robot.present() == {WORLD} and world.counts["no beacon"] > 0)
        assert world.present() == {1}
    with pytest.raises(InputError, match=r"transport udp: keys: .* has none for robot7"):
        transport("udp", keys=file).open(place, 7)


def test_garbage_at_ports_moves_nobody() -> None:
    """Datagrams on the air and for beacons, and connections to the channels, all with random bytes."""
    address, dice = free(), random.Random(4)
    host, port = address.split(":")
    with ExitStack() as opened:
        world, robot = (
            opened.enter_context(closing(transport("udp", mtu=60).open(address, one))) for one in (WORLD, 0)
        )
        orders, told = world.channel("to/0"), robot.channel("to/0")
        until(lambda: world.present() == {0})
        air = opened.enter_context(socket.socket(type=socket.SOCK_DGRAM))
        air.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        for i in range(100_000):
            if i == 80_000:
                tracemalloc.start()
            air.sendto(dice.randbytes(i % 120), ("127.255.255.255", int(port) + i % 2))
            if i % 1000 == 999:
                world.heard()
        for _ in range(300):
            with socket.create_connection((host, int(port))) as stranger:
                stranger.sendall(dice.randbytes(400))
        with socket.create_connection((host, int(port))) as stranger:
            stranger.sendall(b"\x02\x04" + (2**24 - 1).to_bytes(4) + b"to/0")  # and never what it announces
            until(lambda: world.counts["malformed"] > 200)
            _, peak = tracemalloc.get_traced_memory()
            tracemalloc.stop()
            assert peak < 20_000_000
            assert world.counts["too long"] > 1000
            orders.say(b"go on")
            assert [one for one, _ in collected(told, 1)] == [b"go on"]
        world.heard()
        robot.say(b"here")
        until(lambda: (b"here", None) in world.heard())
        assert world.present() == {0}


def test_who_has_no_key_stays_out_and_nobody_speaks_for_another(tmp_path: Path) -> None:
    keys = str(write_keys(4, tmp_path / "swarm.keys"))
    other = write_keys(4, tmp_path / "other.keys")
    own = tmp_path / "robot1.keys"  # all that a robot needs
    own.write_text("".join(line for line in Path(keys).read_text().splitlines(True) if line.startswith("robot1:")))
    address = free()
    with ExitStack() as opened:
        world = opened.enter_context(closing(transport("zenoh", keys=keys).open(address, WORLD)))
        one = opened.enter_context(closing(transport("zenoh", keys=str(own)).open(address, 1)))
        two = opened.enter_context(closing(transport("zenoh", keys=keys).open(address, 2)))
        until(lambda: one.present() == {WORLD, 2} and two.present() == {WORLD, 1} and world.present() == {1, 2})
        for wrong in ("", str(other)):
            with pytest.raises(InputError, match=r"answers, but does not let robot 3 in; expected .* the same keys"):
                transport("zenoh", keys=wrong, patience=0.5).open(address, 3)
        with pytest.raises(InputError, match=r"robot1\.keys has none for robot3; expected a line robot3:KEY"):
            transport("zenoh", keys=str(own)).open(address, 3)
        mine, others = ([link.channel(f"robots/{number}") for link in (world, one, two)] for number in (1, 2))
        time.sleep(0.2)
        one.say(b"by one")
        mine[1].say(b"done by one")
        others[1].say(b"done by two, says one")
        others[0].say(b"said by the world")
        until(lambda: [frame for frame, _ in two.heard()] == [b"by one"])
        assert [frame for frame, _ in collected(mine[0], 1)] == [b"done by one"]
        assert [frame for frame, _ in collected(others[2], 2)] == [b"said by the world"]
        assert others[0].heard() == []


def test_nothing_listens_beyond_loopback() -> None:
    before = listening()
    for use in ("udp", "zenoh"):
        with closing(transport(use).open(free(), WORLD)) as link:
            link.channel("orders")
            assert listening() - before
            assert {one for one in listening() - before if not one[0].endswith("7F")} == set()  # 127, backwards


def listening() -> set[tuple[str, str]]:
    """Our sockets that take connections or datagrams: their local addresses, as Linux writes them, and their inodes."""
    found = set[tuple[str, str]]()
    for name in ("tcp", "udp", "tcp6", "udp6"):
        for line in Path(f"/proc/self/net/{name}").read_text().splitlines()[1:]:
            words = line.split()
            if words[3] in ("0A", "07"):
                found.add((words[1].split(":")[0], words[9]))
    own = {str(one.readlink())[8:-1] for one in Path("/proc/self/fd").iterdir() if one.is_symlink()}
    return {one for one in found if one[1] in own}
