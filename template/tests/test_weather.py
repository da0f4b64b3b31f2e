"""Every part's contract, and each part's purpose."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from swarmsim_weather.forecast import Coldest, Heun, Night

import swarmsim as sw
from swarmsim.core.jobs import Domain
from swarmsim.core.lattice import Lattice
from swarmsim.core.scenario.part import Part
from swarmsim.jobs.alone import alone
from swarmsim.operations.methods.problem import Problem
from swarmsim.operations.models.emitters import Emission
from swarmsim.operations.models.faces import Faces
from swarmsim.operations.models.job import ModelJob
from swarmsim.testing import check_job, check_transport, parametrize_with_checks

SCENARIOS = Path(__file__).parents[1] / "scenarios"
WARMEST, STORM, FORECAST = (SCENARIOS / f"{name}.toml" for name in ("warmest", "storm", "forecast"))


@parametrize_with_checks(WARMEST)
def test_warmest(check: Callable[[], None]) -> None:
    check()


@parametrize_with_checks(STORM)
def test_storm(check: Callable[[], None]) -> None:
    check()


@parametrize_with_checks(FORECAST)
def test_forecast(check: Callable[[], None]) -> None:
    check()


def test_robots_agree_on_the_warmest_place_and_go_there() -> None:
    run = sw.run(WARMEST)
    assert run.finished
    assert run.iterations <= 5  # a ring of five, where news travels one robot per iteration
    moments = list(sw.simulate(WARMEST, overrides={"stop.when_done": "continue"}))
    assert np.ptp(moments[-1].knowledge.warmth) == 0.0
    start, end = (moments[i].state.pose[:, 0].mean() for i in (0, -1))
    assert end < start - 0.3  # it is warmer on the left


def test_wind_blows_and_fog_hides() -> None:
    calm = {"mind.strategy": {"use": "stand"}, "faults": [], "stop.iterations": 20}
    moments = list(sw.simulate(STORM, overrides=calm))
    np.testing.assert_allclose(moments[-1].state.pose[:, 0] - moments[0].state.pose[:, 0], 19 * 0.02, atol=1e-9)
    foggy = np.array([moment.state.pose[:, 0] < 0.8 for moment in moments])
    assert foggy.any()
    np.testing.assert_array_equal([moment.readings.tiles.values.any(axis=(1, 2)) for moment in moments], ~foggy)


def test_showers_lose_all_or_nothing_and_lightning_strikes_once() -> None:
    moments = list(sw.simulate(STORM, overrides={"stop.iterations": 40}))
    rainy = [len(dict(moment.delivery.lost)["rain"]) > 0 for moment in moments]
    assert 2 <= sum(rainy) <= 25
    assert all((len(moment.delivery.heard) == 0) == rains for moment, rains in zip(moments, rainy, strict=True))
    assert [int(moment.state.alive.sum()) for moment in moments[4:6]] == [5, 4]
    assert all(len(moment.links) == 4 for moment in moments[5:])


def test_ice_makes_slow() -> None:
    moments = sw.simulate(STORM, overrides={"stop.iterations": 30})
    assert 0.05 < max(np.abs(moment.state.wheels).max() for moment in moments) <= 0.075 + 1e-9


def test_thermometers_are_read_back() -> None:
    run = sw.run(STORM, overrides={"stop.iterations": 5})
    assert run.recording["warmth.there"].shape == (3, 5)
    np.testing.assert_allclose(run.recording["warmth.mean"], run.recording["warmth.there"].mean(axis=1))
    assert "there (degrees)" in run.frame("warmth").columns
    assert len(run.plot("climate").axes[0].lines) == 5 + 1


def test_drizzle_loses_some_frames_and_changes_none() -> None:
    check_transport(Part("transport", {"use": "drizzle", "over": {"use": "memory"}}).build(None), "garden")
    sheltered = Part("transport", {"use": "drizzle", "over": {"use": "memory"}}).build(None)
    one, other = (sheltered.open("terrace", robot) for robot in (0, 1))
    for _ in range(1000):
        one.say(b"drop")
    assert 650 < len(other.heard()) < 750
    one.close()
    other.close()


def cooled(dt: float, pieces: int = 3) -> float:
    """The temperature after 8 s of a greenhouse that was at 20 degrees everywhere, by steps of `dt`."""
    domain = Domain(Lattice(0.0, 0.0, 0.15, 6, 6), np.ones((6, 6), np.bool_))
    problem = Problem(Night(loss=0.1).on(domain), Emission((), Faces.of(domain)), dt)
    job = ModelJob.of(problem, Heun(), domain, pieces, 2 * round(8.0 / dt))
    cut = job.pieces(domain)
    check_job(job, domain.free)
    states = alone(job, cut, [np.full(len(piece.cells), 20.0) for piece in cut])
    found = np.concatenate([job.answer(piece, state) for piece, state in zip(cut, states, strict=True)])
    assert np.ptp(found) < 1e-12
    return float(found[0])


def test_a_night_cools_to_the_temperature_outside_with_an_error_of_second_order() -> None:
    exact = 5.0 + 15.0 * np.exp(-0.8)
    coarse, fine = (abs(cooled(dt) - exact) for dt in (0.5, 0.25))
    assert fine < 1e-3
    assert 3.7 < coarse / fine < 4.3


def test_robots_compute_how_a_greenhouse_cools_and_where_it_is_coldest() -> None:
    check_job(Coldest())
    run = sw.run(FORECAST)
    assert run.finished
    assert run.iterations > 40  # a ring of five, where news travels one robot an exchange


def test_a_kite_drifts_and_stands_still_against_the_wind() -> None:
    body = Part("adapter", {"use": "kite", "wind": 0.5}).build(None).open(3)
    start = body.sense().pose
    body.drive(-0.5, 0.0)
    held, began = body.sense().pose, time.monotonic()
    time.sleep(0.2)
    np.testing.assert_allclose(body.sense().pose, held, atol=1e-9)
    body.stop()
    loose = body.sense().pose
    time.sleep(0.2)
    drifted = body.sense().pose[0] - loose[0]
    assert start[1] == 3.0
    assert 0.1 <= drifted <= 0.5 * (time.monotonic() - began)
