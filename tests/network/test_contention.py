"""Radios that share the air, against the closed forms of who collides, and against small cases known by heart."""

from __future__ import annotations

import math

import numpy as np
import pytest
from conftest import made
from test_channels import links_of, opened, state_of

from swarmsim.core.errors import InputError
from swarmsim.kernels import air

ROBOTS, FRAME, BYTES = 200, 0.001, 20  # on the air for a thousandth of a period, times the load


def share_heard(load: float, **keys: object) -> float:
    """Of the air's time, the share with a frame that is received, at a `load` of so many frames in a frame's time."""
    rate = BYTES * ROBOTS / load
    channel = opened({"use": "contention", "bytes_per_second": rate, **keys}, ROBOTS)
    links = links_of(*((robot, (robot + 1) % ROBOTS) for robot in range(ROBOTS)))  # each is heard by one
    sizes, alive = np.full(ROBOTS, BYTES, np.int32), np.ones(ROBOTS, bool)
    heard = [len(channel.deliver(state_of(t, alive), links, sizes).heard) for t in range(400)]
    return load * float(np.mean(heard)) / ROBOTS


@pytest.mark.parametrize("load", [0.1, 0.3, 0.5, 1.0, 1.5])
def test_pure_aloha_gets_through_what_theory_says(load: float) -> None:
    """S = G exp(-2 G) for many robots, at most 1 / 2e (Abramson 1970)."""
    assert share_heard(load, access="aloha") == pytest.approx(load * math.exp(-2.0 * load), rel=0.03)


@pytest.mark.parametrize("load", [0.1, 0.5, 1.0, 2.0])
def test_slotted_aloha_gets_through_what_theory_says(load: float) -> None:
    """S = G exp(-G), at most 1 / e (Roberts 1975)."""
    assert share_heard(load, access="slotted") == pytest.approx(load * math.exp(-load), rel=0.03)


@pytest.mark.parametrize("load", [0.1, 0.5, 1.0, 2.0, 5.0])
def test_who_listens_first_gets_through_what_theory_says(load: float) -> None:
    """S = G / (1 + G) where nobody tries again and all hear each other at once (Kleinrock and Tobagi 1975)."""
    # A receiver that is sending hears nothing; it cannot be, while the air is taken.
    assert share_heard(load, access="csma", retries=0) == pytest.approx(load / (1.0 + load), rel=0.03)


def test_trying_again_gets_more_through_and_a_late_turn_collides() -> None:
    never, often = (share_heard(0.5, access="csma", retries=retries, backoff=0.01) for retries in (0, 8))
    assert often > 1.2 * never


def test_a_frame_that_begins_late_collides_with_those_that_did_not_hear_it() -> None:
    """S = G exp(-a G) / (G (1 + 2 a) + exp(-a G)) for a turnaround of a frames (Kleinrock and Tobagi 1975)."""
    load, late, count = 1.0, 0.1, 200
    frame, random = load / count, np.random.default_rng(3)
    places, airtime, waits = np.zeros((count, 2)), np.full(count, frame), np.zeros((count, 0))
    receivers, senders = (np.arange(count) + 1) % count, np.arange(count)
    heard = 0
    for _ in range(600):
        begins = air.listen_first(random.random(count), airtime, waits, places, math.inf, late * frame)
        sent = ~np.isnan(begins)
        lost = air.collided(receivers[sent], senders[sent], begins, airtime, places, math.inf, 0.0)
        heard += np.count_nonzero(~lost)
    told = load * math.exp(-late * load) / (load * (1.0 + 2.0 * late) + math.exp(-late * load))
    assert load * heard / (600 * count) == pytest.approx(told, rel=0.03)


def test_hidden_robots_collide_at_the_one_between_them_and_far_ones_do_not() -> None:
    alive, sizes, links = np.ones(3, bool), np.array([50, 0, 50], np.int32), links_of((1, 0), (1, 2))
    keys = {"use": "contention", "bytes_per_second": 100.0, "access": "csma", "retries": 0}  # half a period each
    hidden, apart = np.array([[0.0, 0.0], [2.0, 0.0], [4.0, 0.0]]), np.array([[0.0, 0.0], [2.0, 0.0], [8.0, 0.0]])
    lost, heard = opened({**keys, "reach": 3.0}, 3), opened({**keys, "reach": 3.0}, 3)
    reasons = set[str]()
    for t in range(100):
        reasons |= {reason for reason, _ in lost.deliver(state_of(t, alive, hidden), links, sizes).lost}
        far = heard.deliver(state_of(t, alive, apart), links, sizes)
        assert 0 in far.heard[:, 1]  # the receiver is too far from the other to be disturbed
    assert reasons == {"collision"}


def test_a_robot_does_not_hear_while_it_sends() -> None:
    alive, sizes, links = np.ones(2, bool), np.array([90, 90], np.int32), links_of((0, 1), (1, 0))
    channel = opened({"use": "contention", "bytes_per_second": 100.0}, 2)
    assert all(len(channel.deliver(state_of(t, alive), links, sizes).heard) == 0 for t in range(50))


def test_a_robot_that_may_send_for_a_hundredth_of_an_hour_stops_then() -> None:
    alive, sizes, links = np.ones(2, bool), np.array([20, 0], np.int32), links_of((1, 0))
    channel = opened({"use": "contention", "radio": "LoRa SF7"}, 2)
    heard = [len(channel.deliver(state_of(t, alive), links, sizes).heard) for t in range(4000)]
    airtime = 0.0566  # s for 20 bytes
    first = heard.index(0)
    assert first == pytest.approx(36.0 / (airtime - 0.01), rel=0.01)
    assert np.mean(heard[first:]) == pytest.approx(0.01 / airtime, rel=0.01)


def test_a_long_message_is_cut_and_one_longer_than_a_period_is_lost() -> None:
    alive, links = np.ones(2, bool), links_of((1, 0))
    channel = opened({"use": "contention", "radio": "802.15.4"}, 2)
    assert len(channel.deliver(state_of(0, alive), links, np.array([5000, 0], np.int32)).heard) == 1
    ((reason, lost),) = channel.deliver(state_of(1, alive), links, np.array([40_000, 0], np.int32)).lost
    assert (reason, len(lost)) == ("too long", 1)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ("", "radio: expected a radio's name or bytes_per_second, and not both"),
        (', radio="BLE", bytes_per_second=9.0', "radio: expected a radio's name or bytes_per_second, and not both"),
        (', radio="BEL"', "radio: 'BEL' is not known; did you mean 'BLE'"),
        (', radio="BLE", overhead=3.0', "overhead: that of 'BLE' is known"),
        (', bytes_per_second=9.0, access="cdma"', "access"),
    ],
)
def test_an_impossible_radio_is_refused(keys: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        made(f'network.channel={{use="contention"{keys}}}')


def test_a_swarm_on_a_busy_radio_maps_more_slowly_and_the_same_twice() -> None:
    def lost(*changes: str) -> dict[str, int]:
        run = made("stop.iterations=60", *changes).simulation
        found: dict[str, int] = {}
        while not run.over:
            for reason, letters in run.tick().delivery.lost:
                found[reason] = found.get(reason, 0) + len(letters)
        return found

    lora = 'network.channel={use="contention", radio="LoRa SF12", duty=1.0}'
    assert set(lost(lora)) == {"too long"}  # 21 bytes take 1.48 s
    busy = 'network.channel={use="contention", bytes_per_second=60.0}'
    assert lost(busy) == lost(busy) != {}
    assert lost('network.channel={use="contention", radio="ESP-NOW"}') == {}
