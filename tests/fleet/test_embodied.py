"""Robots with bodies of their own and no world: they sense, talk, drive, and stand when they have to."""

from __future__ import annotations

import math
import signal
import subprocess
import sys
import threading
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from fleet.places import free, transport, until

import swarmsim as sw
from swarmsim.core.charge import Charge
from swarmsim.core.errors import InputError
from swarmsim.core.lattice import Lattice
from swarmsim.core.readings import Channels, range_channel, tile_channels
from swarmsim.core.scenario.file import load
from swarmsim.core.state import OCCUPIED, UNKNOWN
from swarmsim.engine.build import build
from swarmsim.fleet import wire
from swarmsim.fleet.adapter import Felt
from swarmsim.fleet.body_senses import BodySenses
from swarmsim.fleet.diaries import lives, replayed
from swarmsim.fleet.embodied import EmbodiedRobot
from swarmsim.fleet.emergency import EVERYBODY, Halt, say
from swarmsim.fleet.gait import Gait, PursuedWay, Reckoning
from swarmsim.fleet.guard import BodyGuard, Limits
from swarmsim.fleet.logbook import Logbook
from swarmsim.fleet.starting import OneRobot, started
from swarmsim.fleet.transport import WORLD
from swarmsim.fleet.wire import Telegram

ROOM = ROOT / "scenarios" / "room.toml"
SQUARE = f"""
world = "{ROOT}/worlds/room.svg"
period = 0.1
task = {{use = "travelled", distance = 100.0}}
mind.use = "./own.py:Square"
sensor.use = "none"
network.topology.use = "full"
robots = {{count = 1, speed = 0.4, acceleration = 2.0}}
"""
OWN = """
class Square:
    message_fields = {"corner": "u1"}

    def __init__(self):
        self.start, self.corner = None, 0

    def say(self, me):
        return {"corner": self.corner}

    def step(self, me):
        x, y = me.x, me.y
        if self.start is None:
            self.start = x, y
        ways = (-0.4, 0.0), (-0.4, 0.4), (0.0, 0.4), (0.0, 0.0)
        places = [(self.start[0] + right, self.start[1] + up) for right, up in ways]
        if self.corner < 3 and abs(x - places[self.corner][0]) + abs(y - places[self.corner][1]) < 0.03:
            self.corner += 1
        return me.go(places[self.corner])
"""


@pytest.fixture
def square(tmp_path: Path) -> Path:
    """A scenario of one robot that drives along a square and stops."""
    (tmp_path / "own.py").write_text(OWN)
    (tmp_path / "square.toml").write_text(SQUARE)
    return tmp_path / "square.toml"


class Wheels:
    """A body whose wheels do as told, in steps of the test's own clock, and how far it was from where it shall be."""

    def __init__(self, pose: tuple[float, float, float]) -> None:
        self.pose, self.moves = pose, (0.0, 0.0)
        self.trace = [pose]

    def go(self, seconds: float) -> None:
        (x, y, yaw), (ahead, turn) = self.pose, self.moves
        middle = yaw + 0.5 * turn * seconds
        self.pose = x + ahead * seconds * math.cos(middle), y + ahead * seconds * math.sin(middle), yaw + turn * seconds
        self.trace.append(self.pose)

    def sense(self) -> Felt:
        return Felt(self.pose)

    def drive(self, ahead: float, turn: float) -> None:
        self.moves = (ahead, turn)

    def stop(self) -> None:
        self.moves = (0.0, 0.0)

    def close(self) -> None:
        self.stop()


def test_a_guard_follows_a_way_and_stands_at_its_end() -> None:
    body = Wheels((0.0, 0.0, 0.0))
    guard = BodyGuard(body, Limits(period=1.0, patience=100.0))
    guard.follow([(0.1 * i, 0.0) for i in range(1, 6)] + [(0.5, 0.1 * i) for i in range(1, 6)], 0.0)
    for step in range(400):
        guard.tick(0.05 * step)
        body.go(0.05)
    trace = np.array(body.trace)
    assert np.hypot(*(trace[-1, :2] - (0.5, 0.5))) < 0.01
    assert body.moves == (0.0, 0.0)
    off = np.minimum(np.abs(trace[:, 1]), np.abs(trace[:, 0] - 0.5))
    assert off.max() < 0.03  # it cuts the corner by less than its look-ahead


def test_a_robot_does_not_turn_back_to_what_it_has_passed_while_its_mind_thought() -> None:
    points = [(0.1 * i, 0.0) for i in range(6)]
    assert PursuedWay(points, Gait(), 0.3).velocity((0.24, 0.0, 0.0)) == pytest.approx((0.15, 0.0))
    assert PursuedWay(points, Gait(), 0.3).velocity((0.24, 0.3, 0.0))[1] < 0.0  # back to its way
    assert PursuedWay([(0.0, 0.0), (0.5, 0.0)], Gait()).velocity((0.0, 0.0, math.pi))[0] == pytest.approx(
        0.0
    )  # it turns


def test_a_body_that_tells_velocities_alone_is_reckoned_and_one_that_tells_nothing_is_unknown() -> None:
    reckoned = Reckoning((1.0, 1.0, 0.0))
    assert reckoned.at(Felt(velocity=(0.1, 0.0)), 5.0) == (1.0, 1.0, 0.0)
    assert reckoned.at(Felt(velocity=(0.1, 0.0)), 7.0) == pytest.approx((1.2, 1.0, 0.0))
    assert reckoned.at(Felt(pose=(0.0, 0.0, 1.0), velocity=(0.1, 0.0)), 8.0) == (0.0, 0.0, 1.0)
    assert reckoned.at(Felt(), 9.0) is None
    guard = BodyGuard(Wheels((0.0, 0.0, 0.0)), Limits())
    guard._body.pose = None  # type: ignore[attr-defined]
    guard.follow([(1.0, 0.0)], 0.0)
    guard.tick(0.0)
    assert guard.why == "pose unknown"


def test_beams_make_the_tile_that_the_simulated_ring_makes() -> None:
    """Poses all over the room; the body tells 180 beams as a lidar does, with another first bearing."""
    ring = 'sensor={use="ir-ring", beams=180, ranges=true, reach=1.5}'
    run = build(load(ROOM, [ring, "robots.count=12", "stop.iterations=60"]), str(ROOM))
    run.simulation.run()
    state, lattice = run.simulation.state, run.context.lattice
    readings = run.simulation.parts.sensor.sense(state)
    known, same = 0, 0
    senses = BodySenses(run.context.channels, lattice)
    for row in range(12):
        tile, origin, ranges = (column[row] for column in readings.columns)
        shift = 45
        told = {"ranges": tuple(np.roll(ranges, -shift)), "beams": (math.radians(2.0 * shift), math.radians(2.0))}
        felt = Felt(values={**told, "reach": (1.5,)})
        senses.check(felt)
        values, place, beams = senses.readings(felt, tuple(state.pose[row].tolist()))
        assert place.tolist() == origin.tolist()
        assert np.array_equal(beams, ranges)
        known += int((tile != UNKNOWN).sum())
        same += int(((tile == values) & (tile != UNKNOWN)).sum())
        assert ((values == OCCUPIED) & (tile != OCCUPIED)).sum() <= 1
    assert known > 200
    assert same >= 0.97 * known


def test_a_body_that_lacks_what_its_mind_senses_is_refused_in_words() -> None:
    channels = Channels(*tile_channels((6, 7), evidence=False), range_channel(np.zeros(3), 1.0))
    senses = BodySenses(channels, Lattice(0.0, 0.0, 0.15, 10, 10))
    with pytest.raises(InputError, match=r"this mind senses tiles\.values, and the body tells prox\.horizontal; exp"):
        senses.check(Felt(values={"prox.horizontal": (0.0,) * 7}))
    read = BodySenses(channels, Lattice(0.0, 0.0, 0.15, 10, 10)).readings(Felt(), (0.5, 0.5, 0.0))
    assert np.isinf(read[2]).all()


def test_an_order_is_read_as_it_was_packed_and_is_no_message() -> None:
    for order in (Halt(3, True, 1_800_000_000), Halt(EVERYBODY, False, 5)):
        assert Halt.read(order.packed()) == order
    assert Halt.read(b"") is None
    assert Halt.read(bytes(12)) is None
    assert Halt(3, True, 0).is_for(3)
    assert not Halt(3, True, 0).is_for(4)
    assert Halt(EVERYBODY, True, 0).is_for(4)


class Body(Wheels):
    """A body in the place of a guarded one: it stands where it is."""

    why = ""

    def __init__(self, pose: tuple[float, float, float]) -> None:
        super().__init__(pose)
        self.told, self.halted = 0, False

    def follow(self, way: list[tuple[float, float]]) -> None:
        self.told += 1

    def drive(self, ahead: float, turn: float) -> None:
        self.told += 1

    def halt(self) -> None:
        self.halted = True

    def release(self) -> None:
        self.halted = False


def test_two_robots_without_a_world_hear_each_other_agree_on_time_and_obey(tmp_path: Path) -> None:
    path = ROOT / "scenarios" / "operations" / "rendezvous.toml"
    run = build(load(path, ["robots.count=2", "period=0.05", 'sensor={use="none"}']), str(path))
    charges = [Charge.of(robot, run.scenario, run.context) for robot in range(2)]
    place, bodies = str(tmp_path), [Body(charge.starts[charge.robot]) for charge in charges]
    links = [transport("memory").open(place, robot) for robot in range(2)]
    logs = [Logbook(tmp_path / f"robot-{robot}.log") for robot in range(2)]
    robots = [EmbodiedRobot(links[i], charges[i], bodies[i], 0, logs[i]) for i in range(2)]  # type: ignore[arg-type]

    def live(one: int) -> None:
        until(lambda: one == 0 or bodies[0].told > 5, 30.0)
        robots[one].run(iterations=60)

    threads = [threading.Thread(target=live, args=(one,)) for one in range(2)]
    for one in threads:
        one.start()
    with closing(transport("memory").open(place, WORLD)) as operator:
        until(lambda: bodies[1].told > 0, 30.0)
        operator.say(Halt(1, True, 100).packed())
        until(lambda: bodies[1].halted)
        assert not bodies[0].halted
        operator.say(Halt(1, False, 99).packed())  # an old one
        operator.say(Halt(EVERYBODY, True, 101).packed())
        until(lambda: bodies[0].halted)
        assert bodies[1].halted
        operator.say(Halt(EVERYBODY, False, 102).packed())
        until(lambda: not bodies[0].halted and not bodies[1].halted)
    for one in threads:
        one.join()
    for log in logs:
        log.close()
    told = [list(lives(tmp_path / f"robot-{robot}.log")) for robot in range(2)]
    assert told[0][0].iteration == 0
    assert told[1][1].iteration > 3  # it began later, and took on the other's number
    heard = [sum(len(Telegram.read(one.deed).arrays[0]) for one in of) for of in told]
    assert min(heard) > 10
    for robot in range(2):
        assert replayed(tmp_path / f"robot-{robot}.log").equal


def test_what_does_not_go_together_is_refused_in_words(square: Path, tmp_path: Path) -> None:
    from swarmsim.api.fleets import robot_charge

    charge = robot_charge(square, tmp_path / "0.charge", allow_code=True)
    asked = OneRobot(join=free(), charge=charge, transport="memory", allow_code=True)
    for changed, told in (
        ({"id_": 4}, r"--id 4: .*0\.charge is of robot 0"),
        ({"adapter": "thymio", "charge": None}, "--adapter: without a world nobody tells a charge; expected --charge"),
        ({"guard": ("period=1",)}, "--guard: is for robots with a body of their own; expected --adapter, too"),
        ({"charge": None}, "--id: which robot is it"),
    ):
        with pytest.raises(InputError, match=told):
            started(replace(asked, **changed))  # type: ignore[arg-type]


def bearing(*words: str, **more: object) -> subprocess.Popen[str]:
    """A process of the program that rides on robots."""
    command = [sys.executable, "-m", "swarmsim.fleet.robot_command", *words]
    return subprocess.Popen(command, stderr=subprocess.PIPE, text=True, cwd=ROOT)


def trace(log: Path) -> np.ndarray:
    """Where a robot was, by its log (i, 3)."""
    return np.array([wire.sensed_of(Telegram.read(one.sensed.data), Channels(), Channels()).pose for one in lives(log)])


@pytest.mark.slow
def test_a_flown_trace_is_near_the_ideal_one(square: Path, tmp_path: Path) -> None:
    """One mind in the simulator and in a process that drives a stand-in with ROS 2's messages: how far are the ways?"""
    from swarmsim.api.fleets import robot_charge

    moments = sw.simulate(square, overrides=["stop.iterations=90"], allow_code=True)
    ideal = np.array([moment.state.pose[0] for moment in moments])
    place, log = free(), tmp_path / "0.log"
    charge = robot_charge(square, tmp_path / "0.charge", allow_code=True)
    turtle = [sys.executable, str(Path(__file__).with_name("turtle.py")), place.rpartition(":")[2]]
    body = subprocess.Popen([*turtle, *map(str, ideal[0].tolist())], stdout=subprocess.PIPE, text=True)
    try:
        assert body.stdout is not None
        assert body.stdout.readline() == "there\n"
        words = ["--charge", charge, "--adapter", "ros2", "--body", f"address={place}", "--body", "namespace=robot3"]
        words += ["--transport", "udp", "--join", free(), "--log", log, "--iterations", "140", "--allow-code"]
        robot = bearing("run", *map(str, words))
        told = robot.communicate(timeout=120)[1]
    finally:
        body.kill()
        body.communicate()
    assert robot.returncode == 0, told
    flown = trace(log)
    assert np.hypot(*(flown[-1] - ideal[-1])[:2]) < 0.02  # both stand at the end of the square
    steps = np.linspace(ideal[:-1, :2], ideal[1:, :2], 10).reshape(-1, 2)
    off = np.hypot(*(flown[:, None, :2] - steps).transpose(2, 0, 1))
    assert off.min(axis=1).max() < 0.05  # nowhere farther from the ideal way than a robot's radius
    assert off.min(axis=0).max() < 0.1  # and it goes all along it
    assert replayed_own(log)


def replayed_own(log: Path) -> bool:
    from swarmsim.core.scenario import registry

    with registry.own_code(True):
        return replayed(log).equal


@pytest.mark.slow
def test_a_thymio_drives_and_stands_when_its_mind_is_killed_or_halted(square: Path, tmp_path: Path) -> None:
    from swarmsim.api.fleets import robot_charge

    charge = robot_charge(square, tmp_path / "0.charge", allow_code=True)
    place, meet = free(), free()
    aseba = [sys.executable, str(Path(__file__).with_name("aseba.py")), place.rpartition(":")[2]]
    body = subprocess.Popen(aseba, stdout=subprocess.PIPE, text=True)
    assert body.stdout is not None
    lines: list[list[int]] = []
    assert body.stdout.readline() == "there\n"
    reader = threading.Thread(target=lambda: lines.extend([int(word) for word in one.split()] for one in body.stdout))
    reader.start()
    words = ["run", "--charge", str(charge), "--adapter", "thymio", "--body", f"port={place}", "--allow-code"]
    words += ["--transport", "udp", "--join", meet]
    robot = bearing(*words)
    try:
        until(lambda: bool(lines) and max(lines[-1]) > 0, 60.0)
        with closing(transport("udp").open(meet, WORLD)) as operator:
            say(operator, EVERYBODY, True)
            until(lambda: lines[-1] == [0, 0])
            say(operator, EVERYBODY, False)
        until(lambda: lines[-1] != [0, 0], 10.0)
        robot.send_signal(signal.SIGKILL)
        until(lambda: lines[-1] == [0, 0], 5.0)
    finally:
        robot.kill()
        robot.communicate()
        body.kill()
        reader.join()
        body.communicate()


def test_a_robot_whose_body_does_not_answer_ends_in_words(square: Path, tmp_path: Path, capfd) -> None:
    from swarmsim.api.fleets import robot_charge

    charge = robot_charge(square, tmp_path / "0.charge", allow_code=True)
    asked = OneRobot(
        join="desk", charge=charge, transport="memory", adapter="replay", body=("file=nowhere.log",),
        guard=("fence=[0,0,1,1]",), iterations=3, allow_code=True,
    )  # fmt: skip
    assert started(asked) == 2
    assert "nowhere.log: cannot be read" in capfd.readouterr().err
