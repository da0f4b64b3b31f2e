"""Localisation with errors of its own: what the errors are like, and that everybody acts on them."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import made, moments_of, readings_of, setting_of
from scipy import stats

from swarmsim.core.readings import Tiles
from swarmsim.core.scenario.decoding import convert
from swarmsim.core.state import State
from swarmsim.robots.localisation import Noisy, Odometry

ROBOTS = 3000


def state_of(iteration: int, pose: np.ndarray, alive: np.ndarray | None = None) -> State:
    alive = np.ones(len(pose), bool) if alive is None else alive
    return State(iteration, pose, np.zeros_like(pose), np.zeros((len(pose), 2)), alive)


def walked(keys: dict, ways: list[tuple[float, float, float]], robots: int = ROBOTS) -> tuple[np.ndarray, np.ndarray]:
    """True and believed poses after straight steps, each after a turn: metres, turn before it, turn behind it."""
    part = convert({"slip": 0.0, "veer": 0.0, "spin": 0.0, "bias": 0.0, "tick": 0.0, **keys}, Odometry)
    localisation = part.build(setting_of(robots, shape=(200, 200)))
    pose = np.tile([15.0, 15.0, 0.3], (robots, 1))
    believed = localisation.locate(state_of(0, pose))
    assert (believed == pose).all()  # at the start they know
    for iteration, (metres, before, behind) in enumerate(ways, 1):
        pose = pose.copy()
        pose[:, 2] += before
        pose[:, :2] += metres * np.stack([np.cos(pose[:, 2]), np.sin(pose[:, 2])], axis=1)
        pose[:, 2] += behind
        believed = localisation.locate(state_of(iteration, pose))
    return pose, believed


def test_without_errors_odometry_is_right() -> None:
    rng = np.random.default_rng(1)
    ways = [(float(rng.uniform(-0.3, 0.3)), *rng.uniform(-1.0, 1.0, 2)) for _ in range(50)]
    pose, believed = walked({}, ways, 3)
    assert believed == pytest.approx(pose, abs=1e-9)


@pytest.mark.parametrize("steps", [1, 10])
def test_slip_grows_with_the_root_of_the_way(steps: int) -> None:
    pose, believed = walked({"slip": 0.02}, [(4.0 / steps, 0.0, 0.0)] * steps)
    ahead = (believed - pose)[:, :2] @ np.array([np.cos(0.3), np.sin(0.3)])
    assert stats.kstest(ahead / (0.02 * 2.0), "norm").pvalue > 1e-3
    assert np.abs((believed - pose)[:, :2] @ np.array([-np.sin(0.3), np.cos(0.3)])).max() < 1e-9


def test_the_heading_goes_astray_on_the_way_and_in_turns() -> None:
    pose, believed = walked({"veer": 0.03}, [(1.0, 0.0, 0.0)] * 4)
    assert stats.kstest((believed - pose)[:, 2] / (0.03 * 2.0), "norm").pvalue > 1e-3
    pose, believed = walked({"spin": 0.03}, [(0.0, 0.0, 0.5)] * 8)
    assert stats.kstest((believed - pose)[:, 2] / (0.03 * 2.0), "norm").pvalue > 1e-3


def test_a_robot_has_a_bend_of_its_own() -> None:
    (_, once), (pose, twice) = (walked({"bias": 0.05}, [(1.0, 0.0, 0.0)] * n, 200) for n in (1, 2))
    first, second = once[:, 2] - 0.3, twice[:, 2] - pose[:, 2]
    assert second == pytest.approx(2.0 * first)
    assert np.std(first) == pytest.approx(0.05, rel=0.2)


def test_ticks_add_their_rounding_when_wheels_turn() -> None:
    pose, believed = walked({"tick": 0.01}, [(0.2, 0.0, 0.0)] * 25)
    wanted = 0.01 / np.sqrt(12.0) * np.sqrt(2.0) / 0.1 * 5.0  # two wheels, 10 cm apart
    assert np.std((believed - pose)[:, 2]) == pytest.approx(wanted, rel=0.05)
    pose, believed = walked({"tick": 0.01}, [(0.0, 0.0, 0.0)] * 5)
    assert (believed == pose).all()


def test_noise_is_drawn_anew_and_is_the_robots_own() -> None:
    few, many = (convert({"sigma": 0.1}, Noisy).build(setting_of(n, shape=(99, 99))) for n in (3, ROBOTS))
    poses = [np.tile([7.0, 7.0, 0.0], (n, 1)) for n in (3, ROBOTS)]
    first, second = (many.locate(state_of(t, poses[1])) - poses[1] for t in (0, 1))
    assert stats.kstest(first[:, 0] / 0.1, "norm").pvalue > 1e-3
    assert abs(np.corrcoef(first[:, 0], second[:, 0])[0, 1]) < 0.08
    assert (few.locate(state_of(0, poses[0])) - poses[0] == first[:3]).all()


def test_tiles_lie_where_robots_believe_to_be() -> None:
    localisation = convert({"sigma": 0.5}, Noisy).build(setting_of(50, shape=(99, 99)))
    pose = np.tile([7.05, 7.05, 0.0], (50, 1))
    tiles = Tiles(np.zeros((50, 3, 3), np.uint8), np.full((50, 2), 46, np.int32))
    lattice = setting_of(50, shape=(99, 99)).lattice
    believed = localisation.locate(state_of(0, pose))
    readings = readings_of(tiles).put(pose, believed, lattice)
    cells = np.floor(believed[:, 1::-1] / 0.15).astype(int) - np.floor(pose[:, 1::-1] / 0.15).astype(int)
    assert (readings.tiles.origins == 46 + cells).all()
    assert len(np.unique(readings.tiles.origins, axis=0)) > 10


def test_robots_that_join_know_where_they_are() -> None:
    localisation = convert({"slip": 0.5}, Odometry).build(setting_of(2, shape=(99, 99)))
    pose, alive = np.array([[5.0, 5.0, 0.0], [6.0, 6.0, 0.0]]), np.array([True, False])
    localisation.locate(state_of(0, pose, alive))
    pose = pose + np.array([1.0, 0.0, 0.0])
    believed = localisation.locate(state_of(1, pose, np.ones(2, bool)))
    assert believed[0, 0] != pose[0, 0]
    assert (believed[1] == pose[1]).all()


@pytest.mark.parametrize("use", ["noisy", "odometry"])
def test_robots_act_on_what_they_believe_and_recordings_keep_it(use: str) -> None:
    run = made(f'localisation={{use="{use}"}}', "stop.iterations=40")
    assert not run.simulation.parts.localisation.exact
    moments = moments_of(run)
    apart = [np.abs(moment.believed - moment.state.pose).max() for moment in moments]
    assert 0.0 < apart[-1] < 1.0
