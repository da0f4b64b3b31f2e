"""Fleets at a free pace: nobody waits, what is late is counted, and faults strike processes."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from fleet.crews import free_fleet, in_threads
from fleet.places import free, transport, until

import swarmsim as sw
from swarmsim.api.fleets import pace_of, strikes
from swarmsim.core.errors import InputError
from swarmsim.core.events import Begins, Ends, Lost, Regained
from swarmsim.core.robot import Deed, idle
from swarmsim.fleet import running, wire
from swarmsim.fleet.diaries import lives
from swarmsim.fleet.lines import RobotLines
from swarmsim.fleet.logbook import entries
from swarmsim.fleet.processes import Processes
from swarmsim.fleet.robot_end import RobotEnd
from swarmsim.fleet.robot_process import RobotAsked
from swarmsim.fleet.robot_process import run as robot_run
from swarmsim.fleet.terms import PATIENCE, from_robot
from swarmsim.fleet.transport import WORLD
from swarmsim.fleet.watchdog import Watchdog
from swarmsim.fleet.wire import Telegram

ROOM = ROOT / "scenarios" / "room.toml"
FORMATION = ROOT / "scenarios" / "operations" / "formation.toml"
BASILICA = ROOT / "scenarios" / "basilica.toml"


class Kept:
    """An observer that keeps all moments."""

    def __init__(self) -> None:
        self.moments = []

    def sample(self, moment) -> None:
        self.moments.append(moment)


@pytest.mark.parametrize("links", ["simulated", "real"])
def test_time_runs_on_while_robots_map_and_tell_each_other(links: str, tmp_path: Path) -> None:
    fleet, kept = free_fleet(ROOM, pace=15.0, links=links, iterations=30), Kept()
    with in_threads(fleet, str(tmp_path)) as (there, _):
        begun = time.monotonic()
        fleet.run.simulation.run([kept])
        took = time.monotonic() - begun
    assert 30 / 15.0 - 0.1 < took < 30 / 15.0 + there.free.slipped + 0.3
    last = kept.moments[-1]
    assert last.measured.progress > 0.3
    assert there.free.iterations == 30
    heard = sum(len(one.inbox) for one in kept.moments)
    assert heard > 30  # of 6 a period, on a busy machine
    for moment in kept.moments:
        assert {(receiver, sender) for receiver, sender in moment.links.tolist()} >= set(
            zip(moment.inbox.receivers.tolist(), moment.inbox.senders.tolist(), strict=True)
        )


def test_with_real_links_each_listens_to_the_nearest_that_it_hears(tmp_path: Path) -> None:
    fleet, kept = free_fleet(ROOM, "network.topology.k=1", pace=10.0, links="real", iterations=12), Kept()
    with in_threads(fleet, str(tmp_path)):
        fleet.run.simulation.run([kept])
    chosen = [
        (moment.state.pose, receiver, sender)
        for moment in kept.moments[2:]
        for receiver, sender in moment.links.tolist()
    ]
    assert chosen
    by_receiver = defaultdict(set)
    for number, moment in enumerate(kept.moments):
        for receiver, sender in moment.links.tolist():
            by_receiver[number, receiver].add(sender)
    assert max(map(len, by_receiver.values())) == 1
    right = 0
    for pose, receiver, sender in chosen:
        distances = np.hypot(*(pose[:, :2] - pose[receiver, :2]).T)
        right += distances[sender] <= np.partition(distances, 1)[1] + 0.15 * 2  # tiles tell places to a cell
    assert right >= 0.8 * len(chosen)  # frames that came too late are not there to choose from


@pytest.mark.parametrize(
    ("overrides", "told"),
    [
        (['faults=[{use="radio", failure="off", at=3}]'], r"faults\[0\]: radio off acts on simulated links alone"),
        (
            ['faults=[{use="byzantine", failure="spoof", at=3}]'],
            r"faults\[0\]: byzantine spoof acts on simulated links al",
        ),
        (
            ['network.channel={use="bernoulli", loss=0.2}'],
            "network.channel.use: 'bernoulli' is simulated; with --links",
        ),
    ],
)
def test_real_links_have_no_simulated_radio(overrides: list[str], told: str) -> None:
    with pytest.raises(InputError, match=told):
        free_fleet(ROOM, *overrides, pace=10.0, links="real", iterations=3)


def test_a_body_goes_on_with_the_last_decision_and_then_stands() -> None:
    fleet = free_fleet(ROOM, pace=10.0, iterations=3)
    charges = fleet.charges()
    dog = Watchdog(charges, fleet.minds.combined)
    blank = idle(charges[0])
    way = np.array([[[1.0, 1.0], [1.1, 1.0], [1.2, 1.0]]])
    intents = replace(
        blank.intents, waypoints=way, counts=np.array([3], np.int32), planned=np.ones(1, bool), goals=way[:, -1]
    )
    deed = Deed(5, intents, blank.report, blank.heard)
    poses = np.tile([1.1, 1.0, 0.0], (3, 1))
    done = [dog.taken(now, poses, [[deed] if now == 5 else [], [], []])[0] for now in range(5, 10)]
    assert [int(one.intents.counts[0]) for one in done] == [3, 1, 1, 0, 0]  # PATIENCE
    assert [bool(one.intents.planned[0]) for one in done] == [True, False, False, False, False]
    assert done[1].intents.waypoints[0, 0].tolist() == [1.2, 1.0]
    assert 5 + PATIENCE == 8


def test_what_several_late_deeds_tell_is_put_together() -> None:
    fleet = free_fleet(ROOM, pace=10.0, iterations=3)
    head = lambda count: np.array([0, count, 1], np.int32)  # noqa: E731
    blank = idle(fleet.charges()[0]).report
    first = (head(2), np.array([[7, 1], [9, 1]], np.int32), *blank[2:])
    later = (head(1), np.array([[7, 2], [8, 1]], np.int32), *blank[2:])
    whole = fleet.minds.combined(0, blank, [first, later])
    assert whole[1].tolist() == [[7, 2], [8, 1], [9, 1]]
    assert whole[0].tolist() == [-1, 3, 1]
    assert fleet.minds.combined(0, later, [])[1].tolist() == []
    formation = free_fleet(FORMATION, pace=10.0, iterations=3).minds
    assert formation.combined(0, (np.ones(3),), [])[0].tolist() == [1.0, 1.0, 1.0]  # what is known stays known


def up(folder: Path, *more: str) -> subprocess.CompletedProcess[str]:
    words = ["fleet", "up", str(ROOM), "--pace", "10", "--transport", "udp", "--quiet", "--out", str(folder), *more]
    return subprocess.run(
        [sys.executable, "-m", "swarmsim", *words], capture_output=True, text=True, cwd=ROOT, timeout=120, check=False
    )


def long(iterations: int) -> tuple[str, str]:
    return "--set", f'stop={{iterations={iterations}, when_done="continue"}}'


def happened(recording) -> dict[tuple[type, str, tuple[int, ...]], int]:
    """When faults begin and end, by kind and robots."""
    events = [event for event in recording.events() if isinstance(event, Begins | Ends)]
    return {(type(one), recording.scenario.faults[one.fault].use, one.robots): one.iteration for one in events}


@pytest.mark.thorough
def test_processes_are_killed_and_paused(tmp_path: Path) -> None:
    done = up(tmp_path / "run", *long(40), "--kill", "0@8", "--pause", "1@15:15")
    assert done.returncode < 2, done.stderr  # finished or not
    recording = sw.open(tmp_path / "run").recording
    found = happened(recording)
    assert 8 <= found[Begins, "crash", (0,)] <= 10
    assert 15 <= found[Begins, "mind", (1,)] <= 17
    assert 30 <= found[Ends, "mind", (1,)] <= 32
    moved = np.hypot(*np.diff(recording["pose"][:, 1, :2], axis=0).T)
    assert moved[20:29].max() < 0.01  # it stands
    assert moved[:15].max() > 0.05
    assert sw.open(tmp_path / "run").verify().equal  # by its logs, the world goes the same way again
    told = sw.fleet_status(tmp_path / "run")
    assert told.free is not None
    assert told.free.behind <= told.free.iterations == 40
    assert told.alive == dict.fromkeys(("world", "robot 0", "robot 1", "robot 2"), False)


@pytest.mark.slow
def test_robots_come_late_and_come_back_with_an_empty_map_or_their_own(tmp_path: Path) -> None:
    back = 'faults=[{use="crash", at=20, duration=5, robots=[1], min_alive=0}]'
    done = up(tmp_path / "run", *long(250), "--set", back, "--late", "2@5", "--kill", "0@20:5")
    assert done.returncode < 2, done.stderr
    recording = sw.open(tmp_path / "run").recording
    found = happened(recording)
    assert found[Begins, "remove", (2,)] == 0
    assert 5 <= found[Ends, "remove", (2,)] < 200  # once it has started
    ends = [event for event in recording.events() if isinstance(event, Ends)]
    came = {robot: event.iteration for event in ends for robot in event.robots}
    assert 25 < came[0] < 200
    assert 25 < came[1] < 200
    lost = {
        robot: sum(
            int((mine[mine[:, 0] == robot, 2] == 0).sum())
            for t in range(20, came[robot] + 3)
            for mine in [recording.changes(t)]
        )
        for robot in (0, 1)
    }
    assert lost[0] > 20  # its map is empty again
    assert lost[1] == 0  # it has read its own log
    logged = list(lives(tmp_path / "run" / "logs" / "robot-1.log"))
    assert any(one.recalls for one in logged)


@pytest.mark.slow
def test_a_robot_that_is_lost_is_told_and_its_body_stays(tmp_path: Path) -> None:
    words = ["fleet", "up", str(ROOM), "--pace", "10", "--transport", "udp", "--quiet", "--out", str(tmp_path / "run")]
    world = subprocess.Popen([sys.executable, "-m", "swarmsim", *words, *long(25)], cwd=ROOT)
    file = tmp_path / "run" / "fleet.json"
    until(file.exists, 60.0)
    os.kill(json.loads(file.read_text())["robots"]["1"], signal.SIGKILL)
    assert world.wait(60) < 2
    recording = sw.open(tmp_path / "run").recording
    lost = [event for event in recording.events() if isinstance(event, Lost | Regained)]
    assert [(type(one), one.robots) for one in lost] == [(Lost, (1,))]
    assert recording["alive"][-1].tolist() == [True, False, True]
    assert np.ptp(recording["pose"][lost[0].iteration + 1 :, 1], axis=0).max() < 0.01


def test_options_stand_for_faults_in_words() -> None:
    assert strikes(["1,3@200", "2@5:7"], ["2@400:80"], ["3,4@300"]) == [
        "crash min_alive=0 at=200 robots=[1,3]",
        "crash min_alive=0 at=5 robots=[2] duration=7 map=lost",
        "mind frozen min_alive=0 at=400 robots=[2] duration=80",
        "remove min_alive=0 between=[0,300] robots=[3,4]",
    ]
    for wrong in (["1-3@200"], ["1@"], ["@5"]):
        with pytest.raises(
            InputError, match=r"--kill .*: expected robots and an iteration, as in 1,3@200 or 1,3@200:80"
        ):
            strikes(wrong)
    with pytest.raises(InputError, match=r"--late 1@5:6: expected robots and an iteration, as in 1,3@200$"):
        strikes(late=["1@5:6"])
    assert pace_of("2.5") == 2.5
    with pytest.raises(InputError, match="--pace fast: expected lockstep, or how many times real time"):
        pace_of("fast")


def joined(link, count: int = 1) -> RobotLines:
    """A world that robots join, until they are ready."""
    fleet = free_fleet(ROOM, pace=10.0, iterations=3)
    lines, ready = RobotLines(link, fleet.charges(), fleet.terms), 0
    while ready < count:
        for telegram in lines.heard(5.0):
            if telegram.kind == wire.JOIN:
                lines.admit(telegram)
            ready += telegram.kind == wire.READY
    return lines


def test_a_robot_ends_with_its_world_or_waits_for_another_one(
    capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    place, codes, udp = free(), dict[str, int](), transport("udp")
    for after, id_ in (("end", 0), ("wait", 1)):
        asked = RobotAsked(transport="udp", join=place, id=id_, log=tmp_path / f"{id_}.log", after_world=after)
        threading.Thread(target=lambda asked=asked: codes.update({asked.after_world: robot_run(asked)})).start()
    first = udp.open(place, WORLD)
    joined(first, 2)
    first.close()  # without a word, as if it had died
    assert until(lambda: codes == {"end": 3}) < 0.5  # a period of this world is 0.1 s
    assert "has gone" in capfd.readouterr().err
    second = udp.open(place, WORLD)
    joined(second).end()
    until(lambda: codes == {"end": 3, "wait": 0})
    second.close()
    kinds = [entry.kind for entry in entries(tmp_path / "1.log")]
    assert kinds.count(wire.CHARGE) == 2  # its log goes on


def test_strangers_at_a_free_pace_are_counted(tmp_path: Path) -> None:
    fleet = free_fleet(ROOM, pace=10.0, iterations=6)
    with in_threads(fleet, str(tmp_path)) as (there, _):
        stranger = transport("memory").open(str(tmp_path), 9).channel(from_robot(1))
        fleet.run.simulation.tick()
        for data in (b"hello", Telegram(wire.JOIN, 1, 12345).packed(), Telegram(wire.DEED, 1, 5).packed()):
            stranger.say(data)
        late = Telegram(wire.DEED, 1, 0, tuple(np.zeros(2) for _ in range(8))).packed()
        stranger.say(late)
        fleet.run.simulation.run([])
    counts = there.lines.counts
    assert counts["no telegram"] == 1
    assert counts["second of its number"] == 1
    assert counts["out of turn"] >= 2


class Unseen:
    """A world's link that at times does not know who is there."""

    def __init__(self, link) -> None:
        self._link, self.hides = link, False
        self.channel, self.close, self.mtu = link.channel, link.close, link.mtu

    def present(self) -> set[int]:
        return set() if self.hides else self._link.present()


def test_robots_that_are_away_for_a_while_come_back(tmp_path: Path) -> None:
    fleet, place = free_fleet(ROOM, pace=10.0, iterations=40), str(tmp_path)
    world = Unseen(transport("memory").open(place, WORLD))
    robots = [RobotEnd(transport("memory").open(place, number), number) for number in range(3)]
    threads = [threading.Thread(target=one.run) for one in robots]
    for one in threads:
        one.start()
    kept = Kept()
    with running.met(fleet, world, fleet.charges(), Processes([])) as there:
        simulation = fleet.run.simulation
        simulation.tick([kept])
        world.hides = True
        simulation.tick([kept])
        assert not [event for event in kept.moments[-1].events if isinstance(event, Lost)]  # they go on deciding
        there.free.ready.discard(2)  # told nothing, it is silent
        while not (lost := [event for event in kept.moments[-1].events if isinstance(event, Lost)]):
            simulation.tick([kept])
        assert lost[0].robots == (2,)
        assert simulation.state.iteration <= 2 + PATIENCE + 2
        world.hides = False
        while not (back := [event for event in kept.moments[-1].events if isinstance(event, Regained)]):
            simulation.tick([kept])
        assert back[0].robots == (2,)
        simulation.tick([kept])
        simulation.tick([kept])
    assert kept.moments[-1].state.alive.all()
    assert there.free.ready == {0, 1, 2}
    for one in threads:
        one.join()
    world.close()


def test_no_process_is_left_when_a_world_with_a_paused_robot_is_killed(tmp_path: Path) -> None:
    words = ["fleet", "up", str(ROOM), "--pace", "10", "--transport", "udp", "--quiet", "--out", str(tmp_path / "run")]
    world = subprocess.Popen([sys.executable, "-m", "swarmsim", *words, "--pause", "1@2"], cwd=ROOT)
    file = tmp_path / "run" / "fleet.json"
    until(file.exists, 60.0)
    pids = list(json.loads(file.read_text())["robots"].values())
    until(lambda: Path(f"/proc/{pids[1]}/stat").read_text().rpartition(")")[2].split()[0] == "T", 10.0)
    world.kill()
    world.wait()
    until(lambda: not any(Path(f"/proc/{pid}").exists() for pid in pids), 10.0)
    assert not any(Path(f"/proc/{pid}").exists() for pid in pids)
