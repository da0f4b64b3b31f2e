"""Every part's contract, and each part's purpose."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

import swarmsim as sw
from swarmsim.core.scenario.part import Part
from swarmsim.testing import check_transport, parametrize_with_checks

SCENARIOS = Path(__file__).parents[1] / "scenarios"
WARMEST, STORM = SCENARIOS / "warmest.toml", SCENARIOS / "storm.toml"


@parametrize_with_checks(WARMEST)
def test_warmest(check: Callable[[], None]) -> None:
    check()


@parametrize_with_checks(STORM)
def test_storm(check: Callable[[], None]) -> None:
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
