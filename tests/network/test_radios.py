"""Times on the air against published ones, and the table of a scenario's messages."""

from __future__ import annotations

import itertools
import json
import re

import pytest
from conftest import ROOT, called

from swarmsim.network import radios
from swarmsim.network.radios import RADIOS


@pytest.mark.parametrize(
    ("made", "told"),
    [
        # The Things Network's airtime calculator: 13 bytes of LoRaWAN's own around an empty message, and 51 around it
        (lambda: radios.lora(7, 13), 46.3e-3),
        (lambda: radios.lora(12, 13), 1155.1e-3),
        (lambda: radios.lora(7, 64), 118.0e-3),
        # The longest advertisement takes 376 us on each channel (Bluetooth Core)
        (lambda: radios.advertisement(27), 3 * 376e-6),
        # The longest frame, of 127 bytes, takes 4.256 ms (IEEE 802.15.4)
        (lambda: radios.ieee_802_15_4(116), 4.256e-3),
    ],
)
def test_times_are_those_that_others_publish(made, told: float) -> None:
    assert made() == pytest.approx(told, rel=1e-3)


@pytest.mark.parametrize("name", RADIOS)
def test_longer_frames_take_longer(name: str) -> None:
    radio = RADIOS[name]
    times = [radio.airtime(length) for length in range(radio.mtu + 1)]
    assert all(0.0 < a <= b for a, b in itertools.pairwise(times))
    assert times[-1] > times[0]


def test_the_messages_of_a_scenario_are_told_with_their_times() -> None:
    words = ("radio", "airtime", ROOT / "scenarios/room.toml", "--iterations", 5)
    found = json.loads(called(*words, "--json").stdout)
    assert {one["radio"] for one in found} == set(RADIOS)
    tiles = {one["radio"]: one for one in found if one["sharing"] == "current-tile"}
    assert all((one["median"], one["longest"]) == (21, 21) for one in tiles.values())
    assert tiles["802.15.4"]["airtime"] == pytest.approx(38 * 32e-6)
    maps = {one["radio"]: one for one in found if one["sharing"] == "map"}
    assert maps["BLE"]["longest"] > maps["BLE"]["mtu"] == 27
    assert maps["BLE"]["longest_airtime"] is None
    printed = called(*words).stdout
    assert re.search(r"current-tile\W+21\W+21\W+56\.6\W", printed)
    assert re.search(r"map\W+\d+\W+\d+.*-", printed)


def test_minds_without_a_choice_of_sharing_are_told_as_they_are() -> None:
    words = ("radio", "airtime", ROOT / "scenarios/operations/average-consensus.toml", "--iterations", 3, "--json")
    found = json.loads(called(*words).stdout)
    assert len(found) == len(RADIOS)
    assert found[0]["longest"] > 0
