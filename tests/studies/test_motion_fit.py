"""Speed, acceleration and noise of robots are found again in noisy logs of robots of which they are known."""

from __future__ import annotations

import numpy as np
import pytest

from swarmsim.recording.logs import RobotLog
from swarmsim.studies.motion_fit import fitted_motion


def drives(
    seed: int, speed: float, acceleration: float, noise: float, range_noise: float, rate: float = 20.0
) -> RobotLog:
    """Two robots that stand, go straight ahead, stop, and turn, twelve times each, with a scan of 24 beams."""
    dice, poses, scans = np.random.default_rng(seed), {}, {}
    for robot in range(2):
        velocity, bearing = [], []
        heading = 0.0
        for _ in range(12):
            heading += dice.uniform(-2.0, 2.0)
            rise = speed / acceleration
            time = np.arange(0.0, 2 * rise + dice.uniform(2.0, 4.0), 0.001)
            profile = np.minimum(np.minimum(time, time[-1] - time) * acceleration, speed)
            velocity += [0.0] * round(1000 * dice.uniform(1.5, 2.5)) + profile.tolist()
            bearing += [heading] * (len(velocity) - len(bearing))
        velocity, bearing = np.array(velocity), np.array(bearing)
        place = 0.001 * np.cumsum(velocity[:, None] * np.column_stack([np.cos(bearing), np.sin(bearing)]), axis=0)
        rows = np.arange(0, len(place), round(1000 / rate))
        seen = place[rows] + dice.normal(0.0, noise, (len(rows), 2))
        poses[robot] = np.column_stack([0.001 * rows, seen, bearing[rows]])
        lengths = 2.0 + 0.3 * np.sin(np.arange(24)) + place[rows, :1]
        scans[robot] = np.column_stack([0.001 * rows, lengths + dice.normal(0.0, range_noise, lengths.shape)])
    return RobotLog(poses, scans)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(
    ("speed", "acceleration", "noise"), [(0.15, 0.25, 0.002), (0.15, 0.5, 0.001), (0.4, 0.6, 0.003)]
)
def test_known_parameters_are_recovered_within_5_percent(
    seed: int, speed: float, acceleration: float, noise: float
) -> None:
    found = fitted_motion(drives(seed, speed, acceleration, noise, 0.012))
    assert found.speed == pytest.approx(speed, rel=0.05)
    assert found.acceleration == pytest.approx(acceleration, rel=0.05)
    assert found.range_noise == pytest.approx(0.012, rel=0.05)
    assert found.pose_noise == pytest.approx(noise, rel=0.05)
    assert found.starts >= 15


def test_what_a_log_does_not_tell_is_no_number() -> None:
    still = np.column_stack([np.arange(50) / 10, np.zeros((50, 3))])
    found = fitted_motion(RobotLog({0: still}))
    assert np.isnan([found.acceleration, found.range_noise]).all()
    assert (found.starts, found.ranges) == (0, 0)
