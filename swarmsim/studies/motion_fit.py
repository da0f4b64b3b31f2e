"""What a log of a robot tells of its speed, its acceleration, and the noise of its poses and its scanner."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from swarmsim.recording.logs import RobotLog

WINDOW: Final = 0.6  # s, in which a robot is taken to move at one velocity
FEWEST: Final = 5  # poses in a window
STEADY: Final = 2.0  # times the usual misfit, up to which a window counts as one of steady motion
NEAR: Final = 2.5  # standard errors from the top speed, within which a window counts as at it
STARTS: Final = 60  # starts that are fitted together, at most
_MAD: Final = 1.4826  # of a normal distribution: its standard deviation over its median absolute deviation
Reals = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class MotionFit:
    """Estimates, each with how many windows, starts or distances it rests on; NaN where a log does not tell."""

    speed: float  # m/s, the top speed
    windows: int
    acceleration: float  # m/s^2, from rest to that speed
    starts: int
    pose_noise: float  # m, the standard deviation of x and of y at rest
    range_noise: float  # m, the standard deviation of one distance of a robot that stands
    ranges: int


@dataclass(frozen=True, slots=True, eq=False)
class _Steps:
    """One robot's windows, one after the other."""

    rows: list[slice]
    speed: Reals  # (w,): m/s
    error: Reals  # (w,): m/s, the standard error of that
    misfit: Reals  # (w,): m


def fitted_motion(log: RobotLog) -> MotionFit:
    """The estimates for all robots of a log together, taken as alike.

    A straight line through the poses of each window gives its velocity and misfit. The top speed is the mean of the
    steady windows around the fastest ones. Each time a robot goes from rest to that speed, its way is that of constant
    acceleration, then constant speed: least squares over all such starts, with a time and a place for each. Noise of
    distances comes from successive scans at rest, so that it needs neither walls nor poses. Robots with fewer than
    FEWEST poses in WINDOW, 6.7 a second, do not count.
    """
    steps = {robot: _windows(rows) for robot, rows in log.poses.items() if _dense(rows)}
    noise = _typical(np.concatenate([one.misfit for one in steps.values()] or [np.empty(0)]))
    for one in steps.values():
        one.error[:] *= noise
    speed, windows = _top_speed(list(steps.values()), noise)
    still = np.concatenate([one.misfit[_resting(one, speed)] for one in steps.values()] or [np.empty(0)])
    ramps = [ramp for robot, one in steps.items() for ramp in _starts(log.poses[robot], one, speed)][:STARTS]
    differences = np.concatenate([_at_rest(log, robot, one, speed) for robot, one in steps.items()] or [np.empty(0)])
    return MotionFit(
        speed, windows, _acceleration(ramps, speed), len(ramps), _typical(still),
        _MAD * float(np.median(np.abs(differences))) / np.sqrt(2.0) if len(differences) else np.nan, len(differences),
    )  # fmt: skip


def _dense(rows: Reals) -> bool:
    """Whether a robot's poses are close enough in time to tell how it gathers speed."""
    return len(rows) >= FEWEST and 0.0 < float(np.median(np.diff(rows[:, 0]))) * (FEWEST - 1) <= WINDOW


def _typical(values: Reals) -> float:
    return float(np.sqrt(np.median(values**2))) if len(values) else float("nan")


def _windows(rows: Reals) -> _Steps:
    """Windows of WINDOW s; `error` is yet for poses with a noise of 1 m."""
    every = float(np.median(np.diff(rows[:, 0])))
    count = max(FEWEST, round(WINDOW / every))
    slices = [slice(first, first + count) for first in range(0, len(rows) - count + 1, max(1, count // 2))]
    found = np.empty((3, len(slices)))
    for number, one in enumerate(slices):
        time = rows[one, 0] - rows[one, 0].mean()
        square = float(time @ time) or 1e-12
        velocity = time @ rows[one, 1:3] / square
        rest = rows[one, 1:3] - rows[one, 1:3].mean(axis=0) - time[:, None] * velocity
        found[:, number] = np.hypot(*velocity), square**-0.5, np.sqrt((rest**2).sum() / (2 * (count - 2)))
    return _Steps(slices, *found)


def _top_speed(steps: list[_Steps], noise: float) -> tuple[float, int]:
    """The top speed, and how many windows were at it."""
    speeds = np.concatenate([one.speed for one in steps] or [np.empty(0)])
    errors = np.concatenate([one.error for one in steps] or [np.empty(0)])
    steady = np.concatenate([one.misfit <= STEADY * noise + 1e-9 for one in steps] or [np.empty(0, np.bool_)])
    speeds, errors = speeds[steady], errors[steady]
    if not len(speeds):
        return float("nan"), 0
    top, near = float(np.quantile(speeds, 0.9)), np.ones(len(speeds), np.bool_)
    for _ in range(20):
        near = np.abs(speeds - top) <= np.maximum(NEAR * errors, 0.02 * top)
        if not near.any():
            return float("nan"), 0
        # the length of a noisy velocity is too large on average, by half its variance over itself
        top = float(np.mean(speeds[near] - 0.5 * errors[near] ** 2 / np.maximum(speeds[near], 1e-12)))
    return top, int(near.sum())


def _resting(one: _Steps, speed: float) -> NDArray[np.bool_]:
    return np.asarray(one.speed <= np.maximum(3.0 * one.error, 0.02 * speed))


def _starts(rows: Reals, one: _Steps, speed: float) -> list[Reals]:
    """Times and places (m, 2) on the way from rest to the top speed, straight ahead."""
    resting, fast, found = _resting(one, speed), one.speed >= speed - np.maximum(3.0 * one.error, 0.05 * speed), []
    for window in np.flatnonzero(resting[:-1] & ~resting[1:]):
        later = np.flatnonzero(fast[window:] | (resting[window:] & (np.arange(len(resting) - window) > 0)))
        if len(later) and fast[window + later[0]]:
            piece = rows[one.rows[window].start : one.rows[window + later[0]].stop]
            ahead = piece[-FEWEST:, 1:3].mean(axis=0) - piece[:FEWEST, 1:3].mean(axis=0)
            along = (piece[:, 1:3] - piece[:FEWEST, 1:3].mean(axis=0)) @ (ahead / np.hypot(*ahead))
            found.append(np.column_stack([piece[:, 0] - piece[0, 0], along]))
    return found


def _acceleration(ramps: list[Reals], speed: float) -> float:
    """The acceleration of all starts together, in m/s^2."""
    if not ramps:
        return float("nan")

    def misfit(given: Reals) -> Reals:
        rise = np.exp(given[0])  # s, until the top speed is reached
        gaps = []
        for ramp, begins, place in zip(ramps, given[1::2], given[2::2], strict=True):
            passed = np.maximum(ramp[:, 0] - begins, 0.0)
            early = np.minimum(passed, rise)
            gaps.append(place + speed * (0.5 * early**2 / rise + passed - early) - ramp[:, 1])
        return np.concatenate(gaps)

    begins = [max(0.0, ramp[-1, 0] - ramp[-1, 1] / speed - 0.25) for ramp in ramps]
    first = np.concatenate([[np.log(0.5)], *([begin, 0.0] for begin in begins)])
    found = optimize.least_squares(misfit, first, loss="soft_l1", f_scale=0.01)
    return float(speed / np.exp(found.x[0]))


def _at_rest(log: RobotLog, robot: int, one: _Steps, speed: float) -> Reals:
    """Differences of each beam's successive distances while a robot stands."""
    scans = log.scans.get(robot)
    if scans is None:
        return np.empty(0)
    rows, spans = log.poses[robot], []
    for window in np.flatnonzero(_resting(one, speed)):
        piece = rows[one.rows[window], 0]
        inside = scans[(scans[:, 0] >= piece[0]) & (scans[:, 0] <= piece[-1]), 1:]
        spans.append(np.diff(inside, axis=0).ravel())
    found = np.concatenate(spans or [np.empty(0)])
    return np.asarray(found[np.isfinite(found)])
