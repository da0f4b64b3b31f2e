"""Robots on two wheels, on three that go anywhere and on those of a car: against closed forms, traction and walls."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, building, made, moments_of, setting_of
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import cumulative_trapezoid
from typer.testing import CliRunner

from swarmsim.cli import app
from swarmsim.core.errors import InputError, PartError
from swarmsim.core.kinematics import Drives, Wheels
from swarmsim.core.scenario.file import load, table_of
from swarmsim.core.scenario.registry import own_code
from swarmsim.core.scenario.robots import Robots
from swarmsim.core.state import Intents
from swarmsim.engine.build import build
from swarmsim.learning.environment import SwarmEnv
from swarmsim.recording.recorder import text_of
from swarmsim.robots.bodies import Pymunk, RigidDiscs
from swarmsim.robots.kinematics import GRAVITY, Bicycle, Car, ThreeWheels, TwoWheels
from swarmsim.robots.motion import PurePursuit
from swarmsim.studies.requests import asked
from swarmsim.testing import check_contracts

RADIUS, BASE, SPEED, ACCELERATION, TRACTION = 0.055, 0.10, 0.15, 1.0, 0.6
CAR = Car()
KINDS = ("differential", "omni", "car")


def kinematics_of(kind, robots, car=CAR):
    return {"differential": TwoWheels, "omni": ThreeWheels}[kind](robots) if kind != "car" else Bicycle(car, robots)


class Swarm:
    """Robots of one kinematics, driven by commands or velocities that stay the same or are functions of the time."""

    def __init__(self, kind, pose=(0.0, 0.0, 0.0), walls=(), substep=1 / 64, car=CAR, **changes):
        pose = np.array(pose, float).reshape(-1, 3)
        robots = Robots(count=len(pose), spawn="anywhere", **changes)
        self.kinematics = kinematics_of(kind, robots, car)
        self.drives = Drives([Wheels(kind, self.kinematics, slice(0, len(pose)), False, 0.0)])
        self.bodies = RigidDiscs(robots, Pymunk(substep=substep), building(walls), pose, self.drives)
        self.substep, self.asked, self.poses = substep, 0, []

    def command(self, pose):
        self.poses.append(pose.copy())
        self.asked += 1
        return self.wanted((self.asked - 1) * self.substep)

    def drive(self, wanted, seconds):
        """With a command for each robot, or a function of the time (s) that gives them."""
        count = len(self.bodies.state().alive)
        self.wanted = wanted if callable(wanted) else lambda time: np.tile(np.array(wanted, float), (count, 1))
        return self.bodies.drive(self, seconds)

    def turn(self, twist, seconds):
        """At a velocity: m/s ahead, m/s to the left, rad/s."""
        count = len(self.bodies.state().alive)
        return self.drive(self.kinematics.command(np.tile(np.array(twist, float), (count, 1)))[0].copy(), seconds)


def rear(pose, base=CAR.wheelbase):
    """Where a car's rear axle is."""
    return pose[..., :2] - 0.5 * base * np.stack([np.cos(pose[..., 2]), np.sin(pose[..., 2])], axis=-1)


def circle_through(points):
    """Middle and radius of the circle that fits points (k, 2) best (Kasa 1976)."""
    a = np.column_stack([2.0 * points, np.ones(len(points))])
    x, y, c = np.linalg.lstsq(a, (points**2).sum(axis=1), rcond=None)[0]
    return np.array([x, y]), math.sqrt(c + x * x + y * y)


# --- closed forms --------------------------------------------------------------------------------


@pytest.mark.parametrize(("speed", "turn"), [(0.1, 0.5), (0.05, -1.0), (-0.08, 0.4)])
def test_two_wheels_drive_an_arc_whose_radius_is_speed_over_turn(speed, turn):
    swarm = Swarm("differential")
    swarm.turn((speed, 0.0, turn), 1.0)  # past the start
    swarm.poses.clear()
    swarm.turn((speed, 0.0, turn), 2.0 * math.pi / abs(turn))
    middle, radius = circle_through(np.array(swarm.poses)[:, 0, :2])
    assert radius == pytest.approx(abs(speed / turn), rel=2e-3)
    assert_allclose(np.hypot(*(np.array(swarm.poses)[:, 0, :2] - middle).T), radius, rtol=2e-3)


def twisted(time, ahead, left, turn):
    """The pose after a time at a constant velocity of the body, closed form; (0, 0, 0) at the start."""
    angle = turn * time
    x = (ahead * np.sin(angle) - left * (1.0 - np.cos(angle))) / turn
    y = (ahead * (1.0 - np.cos(angle)) + left * np.sin(angle)) / turn
    return np.stack([x, y, angle], axis=-1)


@pytest.mark.parametrize("twist", [(0.08, 0.05, 0.3), (0.0, 0.1, -0.5), (-0.04, 0.02, 1.0)])
def test_three_wheels_drive_the_path_of_a_constant_velocity_of_the_body(twist):
    """Once it has its speed, the pose seen from where that was is that of the closed form."""
    swarm = Swarm("omni")
    x, y, yaw = swarm.turn(twist, 1.0).pose[0]
    end = swarm.turn(twist, 5.0).pose[0]
    ahead, left, turned = twisted(5.0, *twist)
    expected = x + ahead * np.cos(yaw) - left * np.sin(yaw), y + ahead * np.sin(yaw) + left * np.cos(yaw), yaw + turned
    assert_allclose(end, expected, atol=0.002 * 5.0 * math.hypot(*twist[:2]))


def test_three_wheels_go_straight_to_the_side_while_they_turn():
    """A velocity that is the same in the world, asked for in the body's frame of every moment."""
    swarm, turn, speed = Swarm("omni", substep=1 / 256), 0.6, 0.06

    def wanted(time):
        yaw = swarm.poses[-1][0, 2]
        return np.array([[speed * np.sin(yaw), speed * np.cos(yaw), turn]])

    end = swarm.drive(wanted, 10.0).pose[0]
    assert end[2] == pytest.approx(10.0 * turn, rel=0.01)
    assert end[1] == pytest.approx(10.0 * speed, rel=0.01)
    assert abs(end[0]) < 0.01 * 10.0 * speed


@pytest.mark.parametrize("steering", [0.1, 0.35, -0.6])
@pytest.mark.parametrize("speed", [0.1, -0.07])
def test_the_rear_axle_of_a_car_drives_a_circle_of_wheelbase_over_the_tangent_of_its_steering(steering, speed):
    swarm = Swarm("car")
    radius = CAR.wheelbase / math.tan(abs(steering))
    swarm.drive((speed, steering), 1.0)
    swarm.poses.clear()
    swarm.drive((speed, steering), 2.0 * math.pi * radius / abs(speed))
    path = rear(np.array(swarm.poses)[:, 0])
    middle, found = circle_through(path)
    assert found == pytest.approx(radius, rel=2e-3)
    assert_allclose(np.hypot(*(path - middle).T), radius, rtol=4e-3)
    turned = swarm.poses[-1][0, 2] - swarm.poses[0][0, 2]
    assert math.copysign(1.0, turned) == math.copysign(1.0, speed * steering)


def test_a_car_that_steers_at_a_constant_rate_drives_the_clothoid_of_quadrature():
    """The turn is speed times the tangent of the steering angle over the wheelbase, whose angle climbs at its rate."""
    car, speed, seconds = Car(steering_rate=0.1, steering=0.6), 0.1, 6.0
    swarm = Swarm("car", car=car)
    start = swarm.drive((speed, 0.0), 1.0).pose[0]
    end = swarm.drive((speed, 0.6), seconds)
    time = np.linspace(0.0, seconds, 60_001)
    yaw = cumulative_trapezoid(speed * np.tan(0.1 * time) / car.wheelbase, time, initial=0.0)
    x = rear(start)[0] + cumulative_trapezoid(speed * np.cos(yaw), time)[-1]
    y = rear(start)[1] + cumulative_trapezoid(speed * np.sin(yaw), time)[-1]
    assert end.wheels[0].tolist() == pytest.approx([speed, 0.6])
    assert end.pose[0, 2] == pytest.approx(yaw[-1], rel=0.01)
    assert math.dist(rear(end.pose[0]), (x, y)) < 0.01 * speed * seconds


def test_steering_stays_within_its_angle_and_its_rate():
    swarm = Swarm("car")
    angles = [swarm.drive((0.1, 3.0), 1 / 64).wheels[0, 1] for _ in range(64)]
    assert max(np.diff(angles)) == pytest.approx(CAR.steering_rate / 64)
    wanted = swarm.kinematics.command(np.array([[0.01, 0.0, 9.0]]))
    assert wanted.tolist() == [[SPEED, CAR.steering]]


@pytest.mark.parametrize("kind", KINDS)
def test_halving_the_sub_step_moves_the_end_of_a_drive_by_ever_less(kind):
    """Against a drive of 16 times finer sub-steps; each halving at least nearly halves the error."""
    twist = {"differential": (0.1, 0.0, 0.5), "omni": (0.06, 0.05, 0.5), "car": (0.1, 0.0, 0.5)}[kind]
    ends = [Swarm(kind, substep=1 / 64 / 2**halvings).turn(twist, 8.0).pose[0] for halvings in (0, 1, 2, 6)]
    errors = [float(np.linalg.norm(end[:2] - ends[-1][:2])) for end in ends[:-1]]
    assert errors[0] < 0.01 * 8.0 * 0.1
    assert errors[1] < 0.6 * errors[0]
    assert errors[2] < 0.6 * errors[1]


# --- what a kinematics cannot --------------------------------------------------------------------


def aside_of(kind):
    """How far a robot gets to its left that is asked for that alone, or is asked for all of it that it can."""
    return Swarm(kind).turn((0.0, 0.1, 0.0), 3.0).pose[0, 1]


def test_only_three_wheels_move_to_the_side():
    assert aside_of("omni") == pytest.approx(0.3, rel=0.06)
    assert aside_of("differential") == 0.0
    assert aside_of("car") == 0.0


def test_a_car_turns_on_no_spot_and_two_wheels_do():
    spun = {kind: Swarm(kind).turn((0.0, 0.0, 1.0), math.pi).pose[0] for kind in KINDS}
    for kind in ("differential", "omni"):
        assert spun[kind][2] == pytest.approx(math.pi, rel=0.04)
        assert np.hypot(*spun[kind][:2]) < 1e-6
    fastest = SPEED * math.cos(CAR.steering) / CAR.bend  # rad/s
    assert spun["car"][2] == pytest.approx(fastest * math.pi, rel=0.12)  # it has to steer first
    assert spun["car"][1] > 1.5 * CAR.bend


# --- traction ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "command", "most"),
    [
        ("differential", (9.0, 9.0), 1.0),
        ("omni", (9.0, 0.0, 0.0), 1.0 / math.sqrt(3.0)),  # two of three wheels push, 30 degrees from straight ahead
        ("car", (9.0, 0.0), 1.0),
    ],
)
def test_nobody_starts_faster_than_wheels_have_grip(kind, command, most):
    swarm = Swarm(kind, speed=9.0, acceleration=1e3, traction=TRACTION, radius=0.5)
    velocity = swarm.drive(command, 0.25).velocity[0]
    assert velocity[0] == pytest.approx(most * TRACTION * GRAVITY * 0.25, rel=1e-6)
    assert_allclose(velocity[1:], 0.0, atol=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_robots_hold_a_bend_within_their_grip_and_slip_outward_in_one_beyond_it(kind):
    """A bend of radius r at speed v takes v^2 / r of sideways acceleration, and mu g is what there is."""
    radius, base = 1.0, 0.2
    limit = math.sqrt(TRACTION * GRAVITY * radius)
    car = Car(wheelbase=base, steering_rate=100.0)
    widest = {}
    for share in (0.5, 1.5):
        speed = share * limit
        given = {"speed": 4.0 * limit, "acceleration": 100.0, "traction": TRACTION, "wheel_base": base, "radius": 0.1}
        swarm = Swarm(kind, car=car, substep=1 / 512, **given)
        swarm.turn((speed, 0.0, 0.0), 2.0)  # up to speed, straight on
        swarm.poses.clear()
        swarm.turn((speed, 0.0, speed / radius), 1.5 * radius / speed)
        x, y, _ = np.array(swarm.poses)[:, 0].T
        widest[share] = np.hypot(x - x[0], y - radius).max() - radius  # from the bend's middle
    assert widest[0.5] < 0.02 * radius
    assert widest[1.5] > 0.3 * radius


@pytest.mark.parametrize("kind", KINDS)
def test_no_wall_is_passed_and_no_disc_enters_one(kind):
    side = 1.0
    corners = [(0.0, 0.0), (side, 0.0), (side, side), (0.0, side)]
    walls = [[*corners[i], *corners[i - 1]] for i in range(4)]
    rng = np.random.default_rng(4)
    places = np.stack(np.meshgrid(np.arange(0.15, 0.9, 0.2), np.arange(0.15, 0.9, 0.2)), axis=-1).reshape(-1, 2)
    swarm = Swarm(kind, np.column_stack([places, rng.uniform(-np.pi, np.pi, len(places))]), walls)
    deepest, touched = 0.0, 0
    for _ in range(60):
        twists = rng.uniform(-1.0, 1.0, (len(places), 3)) * (SPEED, SPEED, 3.0)
        wanted = swarm.kinematics.command(twists).copy()
        state = swarm.drive(lambda time, wanted=wanted: wanted, 1.0)
        poses = np.array(swarm.poses)[..., :2]
        swarm.poses.clear()
        gap = np.minimum(poses, side - poses).min(axis=(1, 2))
        deepest, touched = max(deepest, RADIUS - gap.min()), touched + int((gap < RADIUS).sum())
    assert touched > 200
    assert deepest < 0.05 * RADIUS
    assert ((state.pose[:, :2] > 0.0) & (state.pose[:, :2] < side)).all()
    assert np.linalg.norm(state.pose[:, :2] - places, axis=1).mean() > RADIUS


@pytest.mark.parametrize("kind", KINDS)
def test_a_heavy_robot_pushes_a_light_one_before_it(kind):
    """And not one as heavy as itself whose wheels are braked with the same grip."""
    for other, is_pushed in ((0.05, True), (5.0, False)):
        groups = [
            {"count": 1, "mass": 1.0},
            {"count": 1, "mass": other},
        ]
        robots = Robots(count=2, spawn="anywhere", groups=tuple(made_group(one) for one in groups))
        kinematics = kinematics_of(kind, robots)
        drives = Drives([Wheels(kind, kinematics, slice(0, 2), False, 0.0)])
        pose = np.array([[0.0, 0.0, 0.0], [0.15, 0.0, 0.0]])
        bodies = RigidDiscs(robots, Pymunk(), building(), pose, drives)

        class One:
            wanted = kinematics.command(np.array([[0.1, 0.0, 0.0], [0.0, 0.0, 0.0]])).copy()

            def command(self, pose):
                return self.wanted

        end = bodies.drive(One(), 3.0).pose
        assert (end[1, 0] > 0.2) == is_pushed
        assert end[1, 0] - end[0, 0] > 2.0 * RADIUS * 0.95


def made_group(table):
    return load(ROOT / "scenarios" / "room.toml", changes={"robots": [table]}).robots.groups[0]


# --- ways ----------------------------------------------------------------------------------------


def followed(kind, way, seconds):
    """How far from the end of a way (w, 2) in the open a robot ends up, and its state there."""
    context = setting_of(1, (40, 40), start=[[3.0, 3.0, 0.0]])
    bend = CAR.bend if kind == "car" else 0.0
    drives = Drives([Wheels(kind, kinematics_of(kind, context.robots), slice(0, 1), False, bend)])
    context = replace(context, kinematics=drives)
    motion = PurePursuit().build(context)
    points = np.concatenate([[[0.0, 0.0]], np.array(way)]) + 3.0
    motion.follow(Intents.along({0: points}, 1, np.zeros(1, np.bool_)))
    state = Pymunk().build(context).drive(motion, seconds)
    return math.dist(state.pose[0, :2], points[-1]), state


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("way", [[(0.4, 0.0)], [(0.3, 0.2)], [(-0.4, 0.1)], [(0.0, 0.4)], [(0.02, 0.08)]])
def test_everybody_gets_to_places_ahead_behind_and_beside(kind, way):
    """A car backs out to what lies in its turning circle."""
    missed, state = followed(kind, way, 20.0)
    assert missed <= 0.1 * max(0.05, CAR.bend if kind == "car" else 0.0) * 1.05
    assert_allclose(state.velocity[0], 0.0, atol=1e-3)


def test_three_wheels_do_not_turn_on_their_way():
    assert followed("omni", [(0.3, 0.3)], 10.0)[1].velocity[0, 2] == pytest.approx(0.0, abs=1e-9)


# --- scenarios -----------------------------------------------------------------------------------

MIXED = (
    'robots=[{count=2}, {count=2, kinematics={use="omni"}}, {count=2, kinematics={use="car", steering=0.7}}]',
    "stop.iterations=40",
)


def test_groups_have_kinematics_of_their_own_and_two_wheels_are_what_they_are_alone():
    run = made(*MIXED)
    drives = run.context.kinematics
    assert drives.names == set(KINDS)
    assert drives.width == 3
    assert drives.sideways.tolist() == [False, False, True, True, False, False]
    assert drives.bends.tolist() == pytest.approx([0.0] * 4 + [0.1 / math.tan(0.7)] * 2)
    moments = moments_of(run)
    wheels = np.array([moment.state.wheels for moment in moments])
    assert wheels.shape[1:] == (6, 3)
    assert (wheels[:, [0, 1, 4, 5], 2] == 0.0).all()
    assert np.abs(wheels[:, 4:, 1]).max() > 0.3  # steering angles
    moved = np.abs(moments[-1].state.pose - moments[0].state.pose)[:, :2].max(axis=1)
    assert (moved > 0.1).all()
    alone = made(MIXED[0].replace('"omni"', '"differential"').replace('"car", steering=0.7', '"differential"'))
    plain = made("robots=[{count=2}, {count=2}, {count=2}]")
    for _ in range(20):
        one, other = alone.simulation.tick().state, plain.simulation.tick().state
        assert_array_equal(one.pose, other.pose)
        assert_array_equal(one.wheels, other.wheels)


def test_a_default_is_in_no_text_and_another_kinematics_changes_what_is_asked_for():
    path = ROOT / "scenarios" / "room.toml"
    plain, said = load(path), load(path, ['kinematics.use="differential"'])
    other = load(path, ['kinematics={use="car", steering=0.5}'])
    assert text_of(plain) == text_of(said)
    assert "[kinematics]" not in text_of(plain)
    assert asked(plain) == asked(said) != asked(other)
    assert table_of(other)["kinematics"] == {"use": "car", "wheelbase": 0.1, "steering": 0.5, "steering_rate": 3.0}
    groups = table_of(load(path, [MIXED[0]]))["robots"]["groups"]
    assert "kinematics" not in groups[0]
    assert groups[1]["kinematics"] == {"use": "omni"}


@pytest.mark.parametrize("kind", ["omni", "car"])
def test_a_recorded_run_verifies(kind, tmp_path: Path):
    scenario = str(ROOT / "scenarios" / "room.toml")
    given = ["--set", f'kinematics={{use="{kind}"}}', "--set", "stop.iterations=20", "--out", str(tmp_path / "run")]
    done = CliRunner().invoke(app, ["run", scenario, *given])
    assert done.exit_code == 1, done.output  # it is not finished
    done = CliRunner().invoke(app, ["verify", str(tmp_path / "run")])
    assert done.exit_code == 0, done.output


@pytest.mark.parametrize("kind", ["omni", "car"])
def test_strict_runs_hold_kinematics_to_their_contract(kind):
    check_contracts(ROOT / "scenarios" / "room.toml", [f'kinematics={{use="{kind}"}}'], iterations=6)


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (['kinematics={use="tank"}'], r"kinematics\.use: .*'tank'"),
        (['kinematics={use="car", steering=2.0}'], r"kinematics\.steering: "),
        (['robots=[{count=1, kinematics={use="car", steer=1}}]'], r"robots\[0\]\.kinematics\.steer: unknown key"),
        (['kinematics={use="omni"}', 'physics={use="particles"}'], r"physics\.use: particles move .* not as 'omni'"),
        (
            ['kinematics={use="car"}', 'faults=[{use="motor", failure="off", wheel="left", at=1}]'],
            r"faults\[0\]\.wheel: 'left' is of robots on two wheels, not of 'car'",
        ),
        (
            ['kinematics={use="omni"}', 'faults=[{use="motor", failure="stuck", at=1}]'],
            r"faults\[0\]\.failure: 'stuck' is of robots on two wheels, not of 'omni'",
        ),
    ],
)
def test_what_does_not_go_together_is_refused(overrides, words):
    with pytest.raises(InputError, match=words):
        made(*overrides)


def test_a_motor_that_is_off_stands_and_still_steers():
    fault = 'faults=[{use="motor", failure="off", at=0, robots=[0]}]'
    run = made('kinematics={use="car"}', "robots.count=2", "stop.iterations=15", fault)
    moments = moments_of(run)
    wheels = np.array([moment.state.wheels for moment in moments])
    assert (wheels[:, 0, 0] == 0.0).all()
    assert np.abs(wheels[:, 0, 1]).max() > 0.0
    assert np.abs(wheels[:, 1, 0]).max() > 0.1


def test_odometry_of_robots_that_move_to_the_side_knows_turns_from_ways():
    """Without noise of ways, a robot that never turns has no error; one that is taken to turn would have."""
    quiet = "localisation={use='odometry', slip=0.0, veer=0.0, spin=0.05, bias=0.0, tick=0.0}"
    errors = {}
    for kind in ("omni", "differential"):
        run = made(f'kinematics={{use="{kind}"}}', quiet, "robots.count=2", "stop.iterations=12")
        for moment in moments_of(run):
            errors[kind] = float(np.abs(moment.believed - moment.state.pose).max())
    assert errors["omni"] < 1e-3
    assert errors["differential"] > 1e-3


ALONE = (
    'network.topology={use="none"}', 'task={use="spacing"}', "robots.count=1", "stop.iterations=3",
    'stop.when_done="continue"',
)  # fmt: skip
MIND = """
class Crab:
    def step(self, me):
        return me.drive(0.0, 0.2, left=0.1)
"""


def test_a_mind_drives_to_the_side_where_its_wheels_can(tmp_path: Path):
    (tmp_path / "crab.py").write_text(MIND)
    mind = f'mind={{use="{tmp_path}/crab.py:Crab"}}'
    with own_code(True):
        (first, _, last) = moments_of(made(mind, 'kinematics={use="omni"}', *ALONE))
        assert first.intents.twists.tolist() == [[0.0, 0.2, 0.1]]
        assert last.state.wheels[0].tolist() == pytest.approx([0.0, 0.1, 0.2])
        run = made(mind, 'kinematics={use="car"}', *ALONE)
        with pytest.raises(PartError, match=r"me\.drive: left: 0\.1 m/s, but this robot cannot .*; expected 0, or"):
            run.simulate()


def test_velocities_to_the_side_of_others_name_the_robot():
    run = made(*MIXED)
    twists = np.zeros((6, 3))
    twists[[2, 5], 2] = 0.1
    with pytest.raises(InputError, match=r"kinematics\.use: robot 5 shall move to the side .* 'car'; expected 'omni'"):
        run.simulation.parts.motion.follow(Intents.twisting(twists))


def test_agents_that_learn_drive_any_kinematics_but_no_wheels_that_are_not_there():
    scenario, overrides = ROOT / "scenarios" / "room.toml", {"kinematics": {"use": "car"}, "robots.count": 2}
    with pytest.raises(InputError, match="action: 'wheels' is of robots on two wheels, not 'car'"):
        SwarmEnv(scenario, overrides, action="wheels")
    env = SwarmEnv(scenario, overrides, action="twist")
    env.reset()
    for _ in range(3):
        env.step({agent: np.array([1.0, 0.0], np.float32) for agent in env.agents})
    assert env.run.simulation.state.wheels[:, 0].tolist() == pytest.approx([SPEED, SPEED])


def test_kinematics_have_their_schema_for_swarms_and_groups():
    from swarmsim.core.scenario.schema import schema

    found = json.loads(json.dumps(schema()))
    for of in (found, found["$defs"]["Group"]):
        assert of["properties"]["kinematics"]["$ref"] == "#/$defs/kinematics"


def test_bodies_of_the_fast_path_are_those_of_the_slow_one_in_a_mixed_swarm():
    """A swarm of two groups on two wheels takes the loop in Python, one without groups the compiled one."""
    groups = 'robots=[{count=2, kinematics={use="differential"}}, {count=2}]'
    mixed, plain = made(groups), made("robots.count=4")
    for _ in range(20):
        one, other = mixed.simulation.tick().state, plain.simulation.tick().state
        assert_array_equal(one.pose, other.pose)
        assert_array_equal(one.wheels, other.wheels)


def test_a_run_of_cars_finds_all_of_a_room():
    run = build(load(ROOT / "scenarios" / "room.toml", ['kinematics.use="car"']), "room.toml")
    assert run.simulate()
