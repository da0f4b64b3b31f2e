"""Buoys: carried by the water, driven by thrusters, against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from conftest import building, made
from numpy.testing import assert_allclose

from swarmsim.core.kinematics import Drives, Wheels
from swarmsim.core.scenario.robots import Robots
from swarmsim.robots.bodies import Pymunk, RigidDiscs
from swarmsim.robots.buoys import Buoy, Thrusters


class Asked:
    """A motion that always gives the same commands."""

    def __init__(self, wanted: list[list[float]]) -> None:
        self.wanted = np.array(wanted)

    def command(self, pose: np.ndarray) -> np.ndarray:
        return self.wanted


def floated(buoy: Buoy, wanted: list[list[float]], seconds: float, pose=None, substep: float = 1 / 64, **robot):
    """The state of buoys that have driven so for some time, from rest."""
    pose = np.zeros((len(wanted), 3)) if pose is None else np.array(pose, float)
    robots = Robots(count=len(pose), spawn="anywhere", acceleration=1e3, **robot)
    drives = Drives([Wheels("buoy", Thrusters(buoy, robots), slice(0, len(pose)), True, 0.0)])
    bodies = RigidDiscs(robots, Pymunk(substep=substep), building(), pose, drives)
    return bodies.drive(Asked(wanted), seconds)


def test_water_carries_what_floats_with_the_lag_of_its_drag() -> None:
    still = [[0.0, 0.0, 0.0]]
    buoy = Buoy(current=(0.03, -0.02), settling=2.0)
    state = floated(buoy, still, 3.0)
    speed = np.array(buoy.current) * (1.0 - math.exp(-1.5))
    assert_allclose(state.velocity[0, :2], speed, rtol=1e-9)
    way = np.array(buoy.current) * (3.0 - 2.0 * (1.0 - math.exp(-1.5)))
    assert_allclose(state.pose[0, :2], way, rtol=0.02)  # Chipmunk moves before it turns forces into speeds
    finer = floated(buoy, still, 3.0, substep=1 / 1024)
    assert_allclose(finer.pose[0, :2], way, rtol=1e-3)
    assert_allclose(finer.velocity, state.velocity, rtol=1e-9)


@pytest.mark.parametrize(("speed", "gains"), [(0.05, True), (0.02, False)])
def test_a_weak_motor_loses_ground_against_a_stronger_current(speed: float, gains: bool) -> None:
    state = floated(Buoy(current=(-0.03, 0.0)), [[speed, 0.0, 0.0]], 60.0, speed=0.15)
    assert (state.pose[0, 0] > 0.0) == gains
    assert_allclose(state.velocity[0, 0], speed - 0.03, rtol=1e-6)


def test_thrusters_push_along_the_body_and_turn_it() -> None:
    state = floated(
        Buoy(settling=0.1),
        [[0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 1.0]],
        2.0,
        [[0, 0, 0.5 * math.pi], [5, 0, 0], [9, 0, 0]],
    )
    assert_allclose(state.velocity, [[0.0, 0.1, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 1.0]], atol=1e-8)


def test_eddies_neither_start_nor_end_and_are_no_faster_than_said() -> None:
    buoy, gap = Buoy(eddies=0.04, eddy_size=3.0), 1e-5
    points = np.random.default_rng(1).uniform(-5.0, 5.0, (500, 2))
    across = [(buoy.flow(points + step) - buoy.flow(points - step)) / (2.0 * gap) for step in ([gap, 0.0], [0.0, gap])]
    assert_allclose(across[0][:, 0] + across[1][:, 1], 0.0, atol=1e-9)
    speeds = np.hypot(*buoy.flow(points).T)
    assert 0.035 < speeds.max() <= 0.04


def test_commands_stay_within_the_thrusters_power() -> None:
    thrusters = Thrusters(Buoy(), Robots(count=2, spawn="anywhere", speed=0.1, radius=0.05))
    strong = thrusters.command(np.array([[3.0, 4.0, 0.0], [0.01, 0.0, 0.1]]))
    assert_allclose(strong, [[0.06, 0.08, 0.0], [0.01, 0.0, 0.1]])
    assert_allclose(
        thrusters.approach(np.array([[3.0, 4.0, 5.0, 0.1], [0.0, 0.0, 0.0, 0.0]])), [[0.06, 0.08, 0.0], [0.0, 0.0, 0.0]]
    )


def test_a_robot_reaches_a_goal_across_a_current_and_a_dead_one_drifts_away() -> None:
    run = made(
        'kinematics={use="buoy", current=[0.02, 0.01], settling=0.5}', "robots.count=2", "network.topology.k=1",
        'faults=[{use="crash", at=5, robots=[1]}]', "stop.iterations=60",
    )  # fmt: skip
    before = run.simulation.state.pose[1].copy()
    run.simulate()
    assert run.simulation.state.pose[1, 0] > before[0] + 0.3
    assert run.astray() == []
