"""Rangefinders that err: readings against the laws they follow, and what they are worth against a slow oracle."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import made, setting_of
from scipy import stats

from swarmsim.core.errors import InputError
from swarmsim.core.lattice import Lattice
from swarmsim.core.scenario.decoding import convert
from swarmsim.core.state import FREE, OCCUPIED, UNKNOWN, State
from swarmsim.kernels import evidence, occupancy
from swarmsim.recording.digests import Digests
from swarmsim.robots.ring import held
from swarmsim.robots.sensors import PRESETS, SIX, IrRing

CELL = 0.15
LATTICE = Lattice(0.0, 0.0, CELL, 40, 40)
FACE = 4.05  # m: a wall stands right of it
WALL = np.array([[FACE, 6.0, FACE, 0.0], [FACE + CELL, 0.0, FACE + CELL, 6.0]])
ROBOTS = 4000


def state_of(pose: np.ndarray) -> State:
    """Robots at these poses, at rest and alive."""
    return State(0, pose, np.zeros_like(pose), np.zeros((len(pose), 2)), np.ones(len(pose), bool))


def facing(distance: float, robots: int = ROBOTS) -> np.ndarray:
    """Poses so far before the wall, looking at it."""
    return np.tile([FACE - distance, 3.02, 0.0], (robots, 1))


def sensed(distance: float, robots: int = ROBOTS, **keys: object):
    part = convert({"ranges": True, "bearings": [0.0], **keys}, IrRing)
    pose = facing(distance, robots)
    sensor = part.build(setting_of(robots, walls=WALL, shape=(40, 40)))
    return sensor.sense(state_of(pose))


def readings(distance: float, **keys: object) -> np.ndarray:
    return sensed(distance, **keys).beams.ranges[:, 0]


@pytest.mark.parametrize("distance", [0.2, 0.5, 0.9])
@pytest.mark.parametrize(
    ("keys", "sigma"),
    [
        ({"error": 0.02}, lambda d: 0.02),
        ({"error_share": 0.03}, lambda d: 0.03 * d),
        ({"error_square": 0.072}, lambda d: 0.072 * d * d),
        (
            {"error": 0.01, "error_share": 0.02, "error_square": 0.03},
            lambda d: np.sqrt(1e-4 + (0.02 * d) ** 2 + (0.03 * d * d) ** 2),
        ),
    ],
)  # fmt: skip
def test_readings_err_by_their_law(distance: float, keys: dict, sigma) -> None:
    found = readings(distance, reach=1.5, **keys)
    assert stats.kstest((found - distance) / sigma(distance), "norm").pvalue > 1e-3


def test_sharps_law_is_that_of_its_voltage() -> None:
    """20 mV of noise on V = 0.1 + 0.2786 / d (V, m) are 0.072 d^2."""
    step = 1e-6
    for distance in (0.2, 0.4, 0.8):
        slope = (0.2786 / (distance + step) - 0.2786 / distance) / step
        assert abs(0.02 / slope) == pytest.approx(PRESETS["sharp-gp2y0a21"]["error_square"] * distance**2, rel=0.01)


def test_what_is_too_near_or_too_far_is_not_measured() -> None:
    assert np.isnan(readings(0.09, blind=0.1)).all()
    assert np.isinf(readings(0.9, blind=0.1, reach=0.8)).all()
    near = readings(0.11, blind=0.1, error=0.02)
    assert np.isnan(near).mean() == pytest.approx(stats.norm.cdf(-0.5), abs=0.03)
    assert np.nanmin(near) >= 0.1


def test_readings_drop_out_run_wild_and_are_rounded() -> None:
    assert np.isnan(readings(0.5, drop_out=0.2)).mean() == pytest.approx(0.2, abs=0.02)
    wild = readings(0.5, outliers=0.3, blind=0.1, reach=0.9)
    away = np.abs(wild - 0.5) > 1e-9
    assert away.mean() == pytest.approx(0.3, abs=0.03)
    assert stats.kstest((wild[away] - 0.1) / 0.8, "uniform").pvalue > 1e-3
    stepped = readings(0.5, error=0.05, step=0.01)
    assert np.abs(stepped / 0.01 - np.round(stepped / 0.01)).max() < 1e-9


def test_a_cone_sees_the_nearest_thing_in_it() -> None:
    wide = sensed(0.5, robots=1, cone=60.0, step=1e-6, bearings=[30.0]).beams.ranges
    assert wide[0, 0] == pytest.approx(0.5, abs=1e-5)  # its right edge looks straight ahead
    narrow = sensed(0.5, robots=1, cone=0.0, step=1e-6, bearings=[30.0]).beams.ranges
    assert narrow[0, 0] == pytest.approx(0.5 / np.cos(np.radians(30.0)), abs=1e-5)


def test_errors_are_the_robots_own() -> None:
    few, many = sensed(0.5, 3, error=0.02), sensed(0.5, 9, error=0.02)
    assert (few.beams.ranges == many.beams.ranges[:3]).all()
    assert len(np.unique(many.beams.ranges)) == 9


# --- what a reading is worth


def oracle(reading: float, reach: float, sigma: float, outliers: float, start: float) -> np.ndarray:
    """P(occupied | reading) of the cells ahead, by throwing dice: worlds, beams, surfaces and errors."""
    rng = np.random.default_rng(5)
    worlds, cells = 3_000_000, 8
    occupied = rng.random((worlds, cells)) < 0.5
    stops = occupied & (rng.random((worlds, cells)) > evidence.PASSED)
    first = np.where(stops.any(axis=1), stops.argmax(axis=1), cells)
    edge = start + CELL * first
    at = np.where(rng.random(worlds) < evidence.ON_EDGE, edge, edge + CELL * rng.random(worlds))
    at = np.where((first < cells) & (at < reach), at, np.inf)
    seen = at + np.where(np.isfinite(at), sigma, 0.0) * rng.standard_normal(worlds)
    seen = np.where(rng.random(worlds) < outliers, reach * rng.random(worlds), seen)
    seen[seen > reach] = np.inf
    same = np.isinf(seen) if np.isinf(reading) else np.abs(seen - reading) < 0.004
    return occupied[same].mean(axis=0)


@pytest.mark.parametrize("reading", [0.30, 0.42, 0.50, np.inf])
@pytest.mark.parametrize(("sigma", "outliers"), [(0.02, 0.0), (0.05, 0.1)])
def test_evidence_is_bayes_rule(reading: float, sigma: float, outliers: float) -> None:
    pose = np.array([[10.5 * CELL, 10.5 * CELL, 0.0]])
    values, said = np.empty((1, 1, 17), np.uint8), np.empty((1, 1, 17), np.float32)
    origins = np.array([[10, 2]], np.int32)
    reach, noise = 0.8, np.array([sigma, 0.0, 0.0])
    evidence.tiles(
        pose, np.ones(1, bool), np.array([[[1.0, 0.0]]]), 0, np.array([[reading]]), reach, 0.0, noise, outliers,
        (LATTICE.x0, LATTICE.y0, CELL), values, origins, said,
    )  # fmt: skip
    wanted = oracle(reading, reach, sigma, outliers, 0.5 * CELL)
    wanted = np.log(wanted / (1.0 - wanted))
    found = said[0, 0, 9:14]
    assert found == pytest.approx(np.clip(wanted[: len(found)], evidence.CLEAR, evidence.SURE), abs=0.15)
    assert (said[0, 0, :8] == 0.0).all()  # behind the robot nothing was measured
    assert said[0, 0, 8] == pytest.approx(evidence.CLEAR)
    assert ((values == OCCUPIED) == (said >= evidence.OCCUPIED)).all()
    assert ((values == FREE) == (said <= evidence.FREE)).all()


def test_without_errors_evidence_agrees_with_the_ideal_ring() -> None:
    pose = facing(0.6, 50)
    pose[:, 2] = np.linspace(-3.0, 3.0, 50)
    ideal, precise = (
        convert({"bearings": list(SIX), **keys}, IrRing).build(setting_of(50, walls=WALL, shape=(40, 40)))
        for keys in ({}, {"step": 1e-6})
    )
    exact, found = (sensor.sense(state_of(pose)).tiles.values for sensor in (ideal, precise))
    both = (exact != UNKNOWN) & (found != UNKNOWN)
    assert both.sum() > 600
    assert (exact[both] == found[both]).mean() > 0.99
    assert ((exact == OCCUPIED) & (found == FREE)).sum() == 0


def test_what_a_sensor_says_goes_into_the_robots_own_map() -> None:
    maps, known = np.zeros((1, 1, 3), np.float32), np.zeros((1, 1, 3), bool)
    nobody = np.empty(0, np.int32)
    tile, said = np.array([[[2, 1, 1]]], np.uint8), np.array([[[3.0, -1.0, np.nan]]], np.float32)
    occupancy.fuse(
        maps, known, np.ones(1, bool), tile, said, np.zeros((1, 2), np.int32), nobody, np.empty((0, 1, 3), np.uint8),
        np.empty((0, 2), np.int32), np.float32(2.0), np.float32(-0.5), np.float32(-9), np.float32(9),
        np.empty(1, np.int32),
    )  # fmt: skip
    assert maps.ravel().tolist() == [3.0, -1.0, -0.5]


# --- rings


def test_a_preset_fills_what_is_left_out() -> None:
    ring = convert({"preset": "gternal", "reach": 0.7}, IrRing)
    assert (ring.reach, ring.error_share, ring.bearings, ring.beams) == (0.7, 0.03, SIX, 6)
    assert convert({}, IrRing).beams == 72
    assert convert({"preset": "gternal", "beams": 90}, IrRing).bearings is None


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"beams": 3, "bearings": [0.0]}, "beams and bearings contradict"),
        ({"blind": 1.0}, "blind is not below reach"),
        ({"preset": "lidar"}, "preset: invalid enum value"),
    ],
)
def test_contradictory_rings_are_refused(keys: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        convert(keys, IrRing)


def test_beams_can_die() -> None:
    sensor = convert({"bearings": [0.0, 90.0], "error": 0.01, "ranges": True}, IrRing).build(
        setting_of(1, walls=WALL, shape=(40, 40))
    )
    assert np.isnan(sensor.without([0]).sense(state_of(facing(0.5, 1))).beams.ranges[0]).tolist() == [True, False]
    with pytest.raises(InputError, match="there is no beam 2; expected 0 to 1"):
        sensor.without([2])


@pytest.mark.parametrize("yaw", [0.0, 0.4, 1.5707963, 2.6])
def test_a_tile_can_turn_with_its_robot(yaw: float) -> None:
    pose = np.array([[1.53, 2.05, yaw]])
    ring = convert({"tile": [4, 7], "frame": "robot"}, IrRing)
    tiles = ring.build(setting_of(1, walls=WALL, shape=(40, 40))).sense(state_of(pose)).tiles
    cells = np.argwhere(tiles.values[0] != UNKNOWN) + tiles.origins[0]
    away = LATTICE.centres(cells) - pose[0, :2]
    turned = away @ np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    assert np.abs(turned[:, 0]).max() <= 3.5 * CELL
    assert np.abs(turned[:, 1]).max() <= 2.0 * CELL
    assert len(cells) == pytest.approx(28, abs=5)
    inside = held(pose, tiles.origins, (4, 7), ring.whole.shape, (LATTICE.x0, LATTICE.y0, CELL))
    assert inside.sum() == len(cells)  # all of it is seen in the open, and nothing else is told


def test_hits_on_robots_that_one_knows_of_are_taken_back() -> None:
    rng = np.random.default_rng(3)
    for _ in range(50):
        n, m = 3, int(rng.integers(0, 7))
        tiles = rng.integers(0, 3, (n, 3, 4)).astype(np.uint8)
        origins = rng.integers(0, 6, (n, 2)).astype(np.int32)
        receivers = np.sort(rng.integers(0, n, m)).astype(np.int32)
        heard = rng.integers(0, 3, (m, 3, 4)).astype(np.uint8)
        places, fresh = rng.integers(0, 6, (m, 2)).astype(np.int32), rng.random(m) < 0.7
        own, told = tiles.copy(), heard.copy()
        occupancy.spare(own, origins, receivers, told, places, fresh, 1.3)

        def spared(tile: np.ndarray, origin: np.ndarray, others: list) -> np.ndarray:
            tile = tile.copy()
            for r, c in np.argwhere(tile == OCCUPIED):
                centre = origin + np.array([r + 0.5, c + 0.5])
                if any(np.hypot(*(centre - other - np.array([1.5, 2.0]))) <= 1.3 for other in others):
                    tile[r, c] = UNKNOWN
            return tile

        for i in range(n):
            known = [places[k] for k in range(m) if receivers[k] == i and fresh[k]]
            assert (own[i] == spared(tiles[i], origins[i], known)).all()
        for k in range(m):
            i = receivers[k]
            known = [places[j] for j in range(m) if receivers[j] == i and fresh[j] and j != k]
            assert (told[k] == spared(heard[k], places[k], [*known, origins[i]])).all()


def test_ghosts_of_robots_are_unlearned_by_free_readings() -> None:
    hit, miss = (np.float32(np.log(p / (1 - p))) for p in (0.9, 0.4))
    low, high = (np.float32(np.log(p / (1 - p))) for p in (0.12, 0.97))
    maps, known = np.zeros((1, 1, 1), np.float32), np.zeros((1, 1, 1), bool)
    nobody = (np.empty(0, np.int32), np.empty((0, 1, 1), np.uint8), np.empty((0, 2), np.int32))
    for tile in [2, 2, *[1] * 9]:
        assert tile == 2 or maps[0, 0, 0] > 0.0
        occupancy.fuse(
            maps, known, np.ones(1, bool), np.full((1, 1, 1), tile, np.uint8), np.empty((0, 0, 0), np.float32),
            np.zeros((1, 2), np.int32), *nobody, hit, miss, low, high, np.empty(1, np.int32),
        )  # fmt: skip
    assert maps[0, 0, 0] < 0.0


def _summary(*overrides: str) -> tuple[bool, dict, str]:
    run, digests = made(*overrides, scenario="basilica"), Digests()
    summaries = run.simulation.parts.task.summaries()
    finished = run.simulation.run([digests, *summaries])
    return finished, {key: value for one in summaries for key, value in one.summary().items()}, digests.total()


def test_ideal_rings_map_the_basilica_without_a_wrong_cell() -> None:
    finished, found, _ = _summary()
    assert finished
    assert found["union_iou"] >= 0.99
    assert found["union_false_occupied"] == 0


def test_six_beams_finish_the_basilica() -> None:
    finished, found, _ = _summary("sensor={bearings=[0, 45, 90, 180, -90, -45]}")
    assert finished
    assert found["union_iou"] >= 0.99
    assert found["union_false_occupied"] == 0


def test_errors_are_the_same_each_time_and_others_for_another_seed() -> None:
    noisy = ('sensor={preset="ebot"}', 'localisation={use="odometry"}', "stop.iterations=40")
    first, again, other = (_summary(*noisy, f"seed={seed}")[2] for seed in (1, 1, 2))
    assert first == again != other


def test_beams_that_reach_no_cell_are_refused():
    with pytest.raises(InputError, match=r"sensor: robots see no cell from anywhere; expected .* reach farther"):
        made("sensor.reach=0.001")
