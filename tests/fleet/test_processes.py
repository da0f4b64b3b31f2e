"""Fleets of real processes: the same run, frames and nothing else on the air, and nobody left behind."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path

import pytest
from conftest import ROOT
from fleet.crews import fleet_of
from fleet.places import free, transport, until

import swarmsim as sw
from swarmsim.core.charge import Charge
from swarmsim.core.errors import InputError
from swarmsim.core.readings import NOTHING
from swarmsim.fleet import running, wire
from swarmsim.fleet.lines import RobotLines
from swarmsim.fleet.lockstep import LockstepEnd
from swarmsim.fleet.opening import opened
from swarmsim.fleet.robot_end import RobotEnd
from swarmsim.fleet.terms import Terms, from_robot
from swarmsim.fleet.transport import WORLD, LinkError
from swarmsim.fleet.wire import Telegram
from swarmsim.operations.mapping.sharing.codecs import TileCodec
from swarmsim.recording.digests import Digests

ROOM = ROOT / "scenarios" / "room.toml"
BASILICA = ROOT / "scenarios" / "basilica.toml"
ROBOTS = 3


def started(folder: Path, *more: str) -> subprocess.Popen[str]:
    words = [
        "fleet",
        "up",
        str(BASILICA),
        "--set",
        f"robots.count={ROBOTS}",
        "--transport",
        "udp",
        "--out",
        str(folder),
    ]
    return subprocess.Popen(
        [sys.executable, "-m", "swarmsim", *words, "--quiet", *more], stderr=subprocess.PIPE, text=True, cwd=ROOT
    )


def robots_of(folder: Path) -> list[int]:
    """The processes of the robots, once the run has begun."""
    until((folder / "fleet.json").exists, 120.0)
    return list(json.loads((folder / "fleet.json").read_text())["robots"].values())


def gone(process: int) -> bool:
    with suppress(ProcessLookupError, FileNotFoundError):
        os.kill(process, 0)
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    return True


def test_a_fleet_of_processes_does_what_one_process_does_and_says_frames_alone(tmp_path: Path) -> None:
    place, tapped = free(), list[bytes]()
    fleet = fleet_of(ROOM)
    ended = threading.Event()
    with running.up(fleet, "udp", place) as there:
        tap = transport("udp").open(place, 77)
        listening = threading.Thread(target=lambda: _listen(tap, tapped, ended))
        listening.start()
        digests = Digests()
        assert fleet.run.simulation.run([digests])
        assert len({os.getpid(), *there.lines.pids.values()}) == ROBOTS + 1
        time.sleep(0.2)
        ended.set()
        listening.join()
    tap.close()
    once = sw.run(ROOM)
    assert digests.total() == once.summary["digest"] == "fe7a9b11740f15421fe473ce84c0ad30"
    assert until(lambda: all(map(gone, there.lines.pids.values()))) < 5.0
    codec = TileCodec((6, 7))
    read = {codec.unpack(frame)[:2] for frame in tapped}  # nothing else is on the air
    assert {len(frame) for frame in tapped} == {21}
    assert len(read) > 0.9 * ROBOTS * once.summary["iterations"]


def _listen(tap, tapped: list[bytes], ended: threading.Event) -> None:
    while not ended.is_set():
        if tap.wait(0.1):
            tapped += [frame for frame, _ in tap.heard()]


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGKILL, -signal.SIGKILL)]
)
def test_no_process_is_left_when_the_world_is_stopped(tmp_path: Path, number: int, code: int) -> None:
    world = started(tmp_path / "run")
    robots = robots_of(tmp_path / "run")
    assert len(robots) == ROBOTS
    assert not any(map(gone, robots))
    time.sleep(0.3)
    world.send_signal(number)
    told = world.communicate(timeout=30)[1]
    assert world.returncode == code
    until(lambda: all(map(gone, robots)), 10.0)
    if number != signal.SIGKILL:
        assert f"iterations are kept in {tmp_path / 'run'}" in told
        assert sw.open(tmp_path / "run").verify().equal


def test_a_robot_that_dies_ends_a_run_in_lockstep_in_words(tmp_path: Path) -> None:
    world = started(tmp_path / "run")
    robots = robots_of(tmp_path / "run")
    os.kill(robots[1], signal.SIGKILL)
    told = world.communicate(timeout=30)[1]
    assert world.returncode == 3
    assert "the process of robot 1 has ended by SIGKILL" in told
    assert "Traceback" not in told
    until(lambda: all(map(gone, robots)), 10.0)
    assert (tmp_path / "run" / "recording.h5").exists()


class Deaf:
    """A link whose air loses every third frame."""

    def __init__(self, link) -> None:
        self._link, self._count = link, 0
        self.channel, self.wait, self.close = link.channel, link.wait, link.close

    def say(self, frame: bytes) -> None:
        self._link.say(frame)

    def heard(self):
        kept = []
        for one in self._link.heard():
            self._count += 1
            kept += [] if self._count % 3 == 0 else [one]
        return kept


def test_what_the_air_loses_is_told_again_so_that_the_run_stays_the_same() -> None:
    fleet, place = fleet_of(ROOM, iterations=8), "loses"
    charges = fleet.charges()
    world = transport("memory").open(place, WORLD)
    lines = RobotLines(world, charges, Terms())
    crew = LockstepEnd(lines, NOTHING, fleet.minds.frame)
    robots = [RobotEnd(Deaf(transport("memory").open(place, number)), number) for number in range(ROBOTS)]
    threads = [threading.Thread(target=one.run) for one in robots]
    for one in threads:
        one.start()
    crew.gather()
    fleet.minds.crew = crew
    digests, alone = Digests(), Digests()
    fleet.run.simulation.run([digests])
    lines.end()
    for one in threads:
        one.join()
    world.close()
    fleet_of(ROOM, iterations=8)
    for moment in sw.simulate(ROOM, overrides=['stop={iterations=8, when_done="continue"}']):
        alone.sample(moment)
    assert digests.total() == alone.total()
    assert sum(one.counts["lost on the air"] for one in robots) > 0
    assert lines.counts["lost on the air"] > 0


def test_strangers_on_the_channel_are_counted_and_a_number_belongs_to_one() -> None:
    fleet, place = fleet_of(ROOM, iterations=2), "strangers"
    world = transport("memory").open(place, WORLD)
    lines = RobotLines(world, fleet.charges(), Terms())
    crew = LockstepEnd(lines, NOTHING, fleet.minds.frame, lambda: "nobody is left")
    stranger = transport("memory").open(place, 9).channel(from_robot(0))
    for data in (b"", b"hello", Telegram(wire.DEED, 0).packed(), *(Telegram(wire.READY, i).packed() for i in (1, 50))):
        stranger.say(data)
    with pytest.raises(LinkError, match="nobody is left"):
        crew.gather()
    assert lines.counts == {"no telegram": 2, "of another robot": 2, "out of turn": 1}
    for process in (11, 12):
        stranger.say(Telegram(wire.JOIN, 0, process).packed())
    with pytest.raises(InputError, match="two robots have joined as number 0, processes 11 and 12"):
        crew.gather()
    world.close()


def test_messages_longer_than_a_frame_are_refused_before_the_run() -> None:
    fleet = fleet_of(ROOT / "scenarios" / "operations" / "formation.toml", iterations=2)
    with pytest.raises(InputError, match=r"--transport udp: takes frames of 10 bytes; these robots may say 22 at once"):
        running._check_lengths(fleet, 10, "udp")
    sharing = 'mind.computation.sharing={use="map"}'
    relay = 'mind.computation.sharing={use="relay", hops=5}'  # 14 other robots, 4 ages, 22 bytes each
    with pytest.raises(InputError, match="takes frames of 1000 bytes; these robots may say 1253 at once"):
        running._check_lengths(fleet_of(BASILICA, relay, iterations=2), 1000, "udp")
    with pytest.raises(InputError, match="takes frames of 1472 bytes; these robots may say 8830 at once"):
        running._check_lengths(fleet_of(BASILICA, sharing, iterations=2), 1472, "udp")


def test_unknown_transports_and_addresses_are_refused_in_words() -> None:
    with pytest.raises(InputError, match="no transport is called 'pigeons'"):
        opened("pigeons", "127.0.0.1:7447", 0)
    with pytest.raises(InputError, match="nobody answers at"):
        RobotEnd(transport("udp", patience=0.2).open(free(), 1), 1)


def test_a_charge_of_another_scenario_is_refused_by_both_digests() -> None:
    fleet, place = fleet_of(ROOM, iterations=2), "other charge"
    other = fleet_of(ROOM, "robots.mass=2.0", iterations=2).charges()[0]
    world = transport("memory").open(place, WORLD)
    lines = RobotLines(world, fleet.charges(), Terms())
    told: list[str] = []
    crew = LockstepEnd(lines, NOTHING, fleet.minds.frame, lambda: "nobody is left" if told else "")

    def join() -> None:
        try:
            RobotEnd(transport("memory").open(place, 0), 0, expected=other).run()
        except InputError as problem:
            told.append(str(problem))

    robot = threading.Thread(target=join)
    robot.start()
    with pytest.raises(LinkError, match="nobody is left"):
        crew.gather()
    robot.join()
    world.close()
    assert len(told) == 1
    assert told[0].startswith(
        f"--charge: is of the scenario {other.title!r} with digest {other.scenario}, and the world "
    )
    assert fleet.charges()[0].scenario in told[0]


def test_a_charge_is_a_file_of_what_one_robot_is_told(tmp_path: Path) -> None:
    words = ["robot", "charge", str(BASILICA), "--id", "3", "--out", str(tmp_path / "3.charge")]
    done = subprocess.run([sys.executable, "-m", "swarmsim", *words], capture_output=True, text=True, check=True)
    assert done.stdout.endswith("bytes, for robot 3\n")
    told = Charge.open(tmp_path / "3.charge")
    assert (told.robot, told.robots.count, told.seed) == (3, 15, 1)
    assert (tmp_path / "3.charge").stat().st_size < 5000
    refused = subprocess.run(
        [sys.executable, "-m", "swarmsim", *words[:4], "15", *words[5:]], capture_output=True, text=True, check=False
    )
    assert refused.returncode == 2
    assert "--id 15: " in refused.stderr
    assert "has robots 0 to 14; expected one of these" in refused.stderr
