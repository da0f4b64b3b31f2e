"""The plug-in's own tests, as its author would run them with swarmsim and the plug-in installed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import swarmsim as sw
from swarmsim.testing import check_contracts

ROOM = """<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 4 4" width="4m" height="4m">
  <g id="walls"><path fill-rule="evenodd" d="M0 0H4V4H0Z M0.2 0.2V3.8H3.8V0.2Z"/></g>
  <g id="spawn"><rect id="floor" x="0.5" y="0.5" width="3" height="3"/></g>
</svg>"""
PLAIN = """
world = "room.svg"
[robots]
count = 5
spawn = "floor"
[network.topology]
use = "next-alive"
"""
WARM = """
[field]
use = "day"
[mind.computation]
use = "hottest"
[mind.strategy]
use = "to-the-hottest"
[task]
use = "warmth"
"""
PARTS = {
    "greenhouse": "",
    "wind": '[physics]\nuse = "wind"\n',
    "fog": '[sensor]\nuse = "fog"\nx = 2.0\n',
    "horn": '[[actuators]]\nuse = "horn"\n',
    "rounded": '[localisation]\nuse = "rounded"\n',
    "sharing": '[mind.computation]\nsharing = {use = "now-and-then"}\n',
    "showers": '[network.channel]\nuse = "showers"\n',
    "ice": '[motion]\nuse = "against-ice"\n',
    "on-ice": '[kinematics]\nuse = "on-ice"\ngrip = 0.5\n',
    "lightning": '[[faults]]\nuse = "lightning"\nat = 5\n',
    "thermometers": '[field]\nuse = "day"\n[[probes]]\nuse = "thermometers"\nevery = 2\n',
    "warmth": WARM,
}


@pytest.fixture
def write(tmp_path: Path):
    (tmp_path / "room.svg").write_text(ROOM)

    def written(*names: str) -> Path:
        path = tmp_path / "scenario.toml"
        plain = PLAIN
        if "greenhouse" in names:
            plain = plain.replace('"room.svg"', '{generate = {use = "greenhouse"}}').replace('"floor"', '"spawn"')
        path.write_text(plain + "".join(PARTS[name] for name in names))
        return path

    return written


@pytest.mark.parametrize("name", PARTS)
def test_every_part_keeps_its_contract(write, name: str) -> None:
    check_contracts(write(name))


def test_robots_agree_on_the_warmest_place_and_go_there(write) -> None:
    path = write("warmth")
    run = sw.run(path)
    assert run.finished
    assert run.iterations <= 5  # a ring of five, in which news travel one robot an iteration
    moments = list(sw.simulate(path, overrides={"stop.when_done": "continue", "stop.iterations": 60}))
    assert np.ptp(moments[-1].knowledge.warmth) == 0.0
    start, end = (moments[i].state.pose[:, 0].mean() for i in (0, -1))
    assert end < start - 0.3  # it is warmer on the left


def test_wind_blows_and_fog_hides(write) -> None:
    still = {"mind.strategy": {"use": "stand"}, "stop.iterations": 20}
    moments = list(sw.simulate(write("wind"), overrides=still))
    np.testing.assert_allclose(moments[-1].state.pose[:, 0] - moments[0].state.pose[:, 0], 19 * 0.02, atol=1e-9)
    for moment in sw.simulate(write("fog"), overrides=still):
        hidden = moment.state.pose[:, 0] < 2.0
        assert not moment.readings.tiles.values[hidden].any()
        assert moment.readings.tiles.values[~hidden].any()


def test_showers_lose_all_or_nothing_and_lightning_strikes_once(write) -> None:
    moments = list(sw.simulate(write("showers", "lightning"), overrides={"stop.iterations": 40}))
    rainy = [len(dict(moment.delivery.lost)["rain"]) > 0 for moment in moments]
    assert 2 <= sum(rainy) <= 25
    assert all((len(moment.delivery.heard) == 0) == rains for moment, rains in zip(moments, rainy, strict=True))
    assert [int(moment.state.alive.sum()) for moment in moments[4:6]] == [5, 4]
    assert all(len(moment.links) == 4 for moment in moments[5:])


def test_ice_makes_slow(write) -> None:
    moments = sw.simulate(write("ice"), overrides={"stop.iterations": 30})
    assert 0.05 < max(np.abs(moment.state.wheels).max() for moment in moments) <= 0.075 + 1e-9


def test_thermometers_are_read_back(write) -> None:
    run = sw.run(write("thermometers"), overrides={"stop.iterations": 5})
    assert run.recording["warmth.there"].shape == (3, 5)
    np.testing.assert_allclose(run.recording["warmth.mean"], run.recording["warmth.there"].mean(axis=1))
    assert "there (degrees)" in run.frame("warmth").columns
