from __future__ import annotations

import re
import tomllib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import jsonschema
import numpy as np
import pytest
import shapely
import tomli_w
from conftest import ROOT, building, made
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmsim.core import chance
from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.lattice import Lattice
from swarmsim.core.messages import Delivery
from swarmsim.core.parts import NetworkChannel
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.file import decode, load, table_of
from swarmsim.core.scenario.part import Part
from swarmsim.core.scenario.robots import Robots
from swarmsim.core.scenario.schema import schema
from swarmsim.core.state import State
from swarmsim.core.streams import Streams
from swarmsim.engine.build import build
from swarmsim.network.delays import Bandwidth, Latency, Tdma
from swarmsim.network.losses import Bernoulli, GilbertElliott, PathLoss, walls_between

Z99 = 2.576  # half the width of a 99 % interval, in standard deviations

REQUIRED = {
    "bernoulli": {"loss": 0.3},
    "gilbert-elliott": {"loss": 0.3, "burst": 4.0},
    "range": {"metres": 2.0},
    "path-loss": {"sensitivity": -30.0},
    "latency": {"delay": 3},
    "bandwidth": {"bytes_per_second": 60.0, "queue": 5, "expiry": 6},
    "contention": {"bytes_per_second": 300.0},
    "tdma": {"slots": 4, "slot": 1.0, "expiry": 3.0, "bytes": 50.0},
}
TABLES = [{"use": name, **REQUIRED.get(name, {})} for name in registry.known("channel")] + [
    {"use": "latency", "delay": 2.5, "law": "geometric"},
    {"use": "bandwidth", "bytes_per_second": 15.0},
    {"use": "latency", "delay": 2, "over": {"use": "tdma", "over": {"use": "bernoulli", "loss": 0.2}}},
    {"use": "bandwidth", "bytes_per_second": 60.0, "over": {"use": "latency", "delay": 2}},
]
every_channel = pytest.mark.parametrize("table", TABLES, ids=lambda table: table["use"])


def context(robots: int, seed: int = 1, period: float = 1.0, walls=()) -> BuildContext:
    lattice = Lattice(0.0, 0.0, 0.15, 40, 40)
    return BuildContext.of(Robots(count=robots, spawn="room"), lattice, period, Streams(seed), building(walls))


def opened(table: dict, robots: int, seed: int = 1, period: float = 1.0, walls=()) -> NetworkChannel:
    return Part("channel", table).build(context(robots, seed, period, walls))


def state_of(iteration: int, alive: np.ndarray, places: np.ndarray | None = None) -> State:
    pose = np.zeros((len(alive), 3))
    pose[:, 0] = np.arange(len(alive)) * 0.5
    if places is not None:
        pose[:, :2] = places
    return State(iteration, pose, np.zeros_like(pose), np.zeros((len(alive), 2)), alive)


def links_of(*pairs: tuple[int, int]) -> np.ndarray:
    return np.array(sorted(pairs), np.int32).reshape(-1, 2)


@dataclass
class Turn:
    state: State
    said: set[tuple[int, int, int]]  # receiver, sender, iteration
    delivery: Delivery


def life(channel: NetworkChannel, robots: int, iterations: int, extra: tuple[int, int] | None = None) -> Iterator[Turn]:
    """Random links and messages of random length among robots that move, die and, one of them, come back."""
    stream = np.random.default_rng(7)
    alive = np.ones(robots, bool)
    for t in range(iterations):
        if t % 40 == 39 and alive.sum() > 1:
            alive = alive.copy()
            alive[np.flatnonzero(alive)[0]] = False
        if t == iterations - 20:
            alive = alive | (np.arange(robots) == 0)
        state = state_of(t, alive, stream.uniform(0.0, 4.0, (robots, 2)))
        drawn = stream.random((robots, robots)) < 0.3
        drawn &= alive & alive[:, None] & ~np.eye(robots, dtype=bool)
        sizes = stream.integers(0, 40, robots).astype(np.int32)
        links = np.argwhere(drawn).astype(np.int32)
        if extra is not None:
            links = links[links[:, 1] != extra[1]]
            if extra[0] >= 0 and alive[list(extra)].all():
                links = links_of(*map(tuple, links.tolist()), extra)
        delivery = channel.deliver(state, links, sizes)
        yield Turn(state, {(int(r), int(s), t) for r, s in links}, delivery)


@every_channel
@pytest.mark.parametrize("robots", [1, 2, 7])
def test_every_message_is_heard_or_lost_exactly_once(table: dict, robots: int) -> None:
    said: set = set()
    settled: Counter = Counter()
    for turn in life(opened(table, robots), robots, 300):
        said |= turn.said
        delivery, now = turn.delivery, turn.state.iteration
        for letters in (delivery.heard, *(lost for _, lost in delivery.lost)):
            assert letters.dtype == np.int32
            assert letters.shape[1:] == (4,)
            assert (letters[:, 2] <= now).all()
            settled.update(tuple(letter) for letter in letters[:, :3].tolist())
        assert all(reason and len(lost) for reason, lost in delivery.lost)
        keys = [tuple(letter) for letter in delivery.heard[:, [0, 1, 2]].tolist()]
        assert keys == sorted(keys)
        assert delivery.oldest <= now
        assert turn.state.alive[delivery.heard[:, 0]].all()
        assert set(settled) <= said
        assert all(key[2] >= delivery.oldest for key in said - set(settled))
    assert max(settled.values(), default=1) == 1
    if robots == 7:
        assert len(settled) > 0.9 * len(said) > 500


@every_channel
def test_the_same_seed_gives_the_same_deliveries(table: dict) -> None:
    for one, other in zip(life(opened(table, 6), 6, 120), life(opened(table, 6), 6, 120), strict=True):
        np.testing.assert_array_equal(one.delivery.heard, other.delivery.heard)
        assert one.delivery.oldest == other.delivery.oldest
        for (reason, lost), (again, too) in zip(one.delivery.lost, other.delivery.lost, strict=True):
            assert reason == again
            np.testing.assert_array_equal(lost, too)


@every_channel
def test_without_links_nothing_happens(table: dict) -> None:
    channel, nothing = opened(table, 3), np.empty((0, 2), np.int32)
    for t in range(5):
        delivery = channel.deliver(state_of(t, np.ones(3, bool)), nothing, np.full(3, 21, np.int32))
        assert delivery.heard.shape == (0, 4)
        assert delivery.lost == ()
        assert delivery.oldest == t


@every_channel
def test_one_more_link_changes_no_others_fate(table: dict) -> None:
    def fates(extra: tuple[int, int]) -> list[tuple]:
        found = []
        for turn in life(opened(table, 6), 6, 150, extra):
            for reason, letters in (("heard", turn.delivery.heard), *turn.delivery.lost):
                kept = letters[letters[:, 1] != 5]
                found += [(turn.state.iteration, reason, *letter) for letter in kept.tolist()]
        return sorted(found)

    without = fates((-1, 5))
    assert len(without) > 200
    assert fates((2, 5)) == without


@every_channel
def test_a_scenario_with_any_channel_reads_back_as_itself(table: dict) -> None:
    path = ROOT / "scenarios" / "room.toml"
    given_ = tomllib.loads(path.read_text())
    given_["network"]["channel"] = table
    first = decode(given_, str(path), path.parent)
    assert first.network.channel.table["use"] == table["use"]
    assert decode(tomllib.loads(tomli_w.dumps(table_of(first))), "again") == first


def many(channel: NetworkChannel, links: np.ndarray, robots: int, iterations: int) -> Iterator[tuple[int, Delivery]]:
    alive, sizes = np.ones(robots, bool), np.full(robots, 20, np.int32)
    for t in range(iterations):
        yield t, channel.deliver(state_of(t, alive), links, sizes)


def complete(robots: int) -> np.ndarray:
    return np.argwhere(~np.eye(robots, dtype=bool)).astype(np.int32)


@pytest.mark.parametrize("loss", [0.0, 0.01, 0.3, 0.9, 1.0])
def test_as_many_messages_are_lost_by_chance_as_asked(loss: float) -> None:
    links = complete(32)
    channel = opened({"use": "bernoulli", "loss": loss}, 32)
    heard = sum(len(delivery.heard) for _, delivery in many(channel, links, 32, 102))
    total = 102 * len(links)
    assert total > 100_000
    assert abs(1.0 - heard / total - loss) <= Z99 * np.sqrt(loss * (1.0 - loss) / total)


def test_two_lossy_channels_lose_independently() -> None:
    table = {"use": "bernoulli", "loss": 0.3, "over": {"use": "bernoulli", "loss": 0.3}}
    links = complete(32)
    heard = sum(len(delivery.heard) for _, delivery in many(opened(table, 32), links, 32, 102))
    total, kept = 102 * len(links), 0.7 * 0.7
    assert abs(heard / total - kept) <= Z99 * np.sqrt(kept * (1.0 - kept) / total)


@pytest.mark.parametrize(("loss", "burst"), [(0.2, 5.0), (0.5, 1.0), (0.05, 20.0), (0.6, 2.0)])
def test_bursts_have_the_mean_loss_and_length_asked(loss: float, burst: float) -> None:
    robots, iterations = 101, 1000
    links = links_of(*((i, i + 1) for i in range(100)))
    lost = np.ones((iterations, robots), bool)
    for t, delivery in many(opened({"use": "gilbert-elliott", "loss": loss, "burst": burst}, robots), links, 101, 1000):
        lost[t, delivery.heard[:, 0]] = False
        assert all(reason == "burst" for reason, _ in delivery.lost)
    lost = lost[:, :100]
    recovery = 1.0 / burst
    memory = 1.0 - recovery - loss * recovery / (1.0 - loss)  # of the chain from one iteration to the next
    spread = np.sqrt(loss * (1.0 - loss) / lost.size * (1.0 + memory) / (1.0 - memory))
    assert abs(lost.mean() - loss) <= Z99 * max(spread, 1e-9)
    assert abs(lost[0].mean() - loss) <= Z99 * np.sqrt(loss * (1.0 - loss) / 100)  # from the very start
    starts = lost[1:700] & ~lost[:699]
    lengths = [lost[t + 1 :, i].argmin() for t, i in np.argwhere(starts)]
    assert len(lengths) > 100
    spread = np.sqrt(1.0 - recovery) / recovery / np.sqrt(len(lengths))
    assert abs(np.mean(lengths) - burst) <= Z99 * spread


def test_a_burst_goes_on_while_nobody_listens() -> None:
    table = {"use": "gilbert-elliott", "loss": 0.5, "burst": 6.0}
    always, now_and_then = opened(table, 2), opened(table, 2)
    both, none = links_of((0, 1), (1, 0)), links_of()
    for t in range(200):
        state, sizes = state_of(t, np.ones(2, bool)), np.full(2, 20, np.int32)
        whole = always.deliver(state, both, sizes)
        part = now_and_then.deliver(state, both if t % 3 == 0 else none, sizes)
        if t % 3 == 0:
            np.testing.assert_array_equal(whole.heard, part.heard)


@pytest.mark.parametrize("mean", [0.0, 0.5, 3.0])
def test_random_delays_have_the_mean_and_the_law_asked(mean: float) -> None:
    links, robots = complete(32), 32
    delays: list[np.ndarray] = []
    channel = opened({"use": "latency", "delay": mean, "law": "geometric"}, robots)
    for t, delivery in many(channel, links, robots, 102):
        delays.append(t - delivery.heard[:, 2])
    for t in range(102, 260):
        delivery = channel.deliver(state_of(t, np.ones(robots, bool)), links_of(), np.zeros(robots, np.int32))
        delays.append(t - delivery.heard[:, 2])
    all_ = np.concatenate(delays)
    assert len(all_) == 102 * len(links) > 100_000
    assert abs(all_.mean() - mean) <= Z99 * np.sqrt(mean * (1.0 + mean) / len(all_))
    at_once = 1.0 / (1.0 + mean)
    assert abs((all_ == 0).mean() - at_once) <= Z99 * np.sqrt(at_once * (1.0 - at_once) / len(all_))


def test_a_fixed_delay_is_exact() -> None:
    for t, delivery in many(opened({"use": "latency", "delay": 4}, 3), links_of((0, 1), (2, 1)), 3, 20):
        expected = [[0, 1, t - 4, 20], [2, 1, t - 4, 20]] if t >= 4 else []
        assert delivery.heard.tolist() == expected
        assert delivery.oldest == max(0, t - 3)


@pytest.mark.parametrize("rate", [7.0, 20.0, 33.0, 0.3])
def test_a_saturated_radio_sends_its_bytes_per_second(rate: float) -> None:
    robots, iterations = 12, 800
    sent = np.zeros(robots)
    channel = opened({"use": "bandwidth", "bytes_per_second": rate, "queue": 40}, robots, period=0.5)
    for t, delivery in many(channel, complete(robots), robots, iterations):
        np.add.at(sent, delivery.heard[:, 1], delivery.heard[:, 3])
        allowed = rate * 0.5 * (t + 1)
        assert (sent <= allowed + 1e-6).all()
        assert (sent > allowed - 20.0).all()


def test_a_radio_saves_up_nothing_while_it_has_nothing_to_send() -> None:
    channel = opened({"use": "bandwidth", "bytes_per_second": 20.0}, 3)
    state, sizes = [state_of(t, np.ones(3, bool)) for t in range(12)], np.full(3, 20, np.int32)
    for t in range(10):
        channel.deliver(state[t], links_of(), sizes)
    first = channel.deliver(state[10], links_of((0, 2), (1, 2)), sizes)
    second = channel.deliver(state[11], links_of(), sizes)
    assert first.heard[:, :3].tolist() == [[0, 2, 10]]
    assert second.heard[:, :3].tolist() == [[1, 2, 10]]
    assert first.oldest == 10


def test_a_queue_is_first_in_first_out_and_drops_the_newest_when_full() -> None:
    channel = opened({"use": "bandwidth", "bytes_per_second": 20.0, "queue": 2}, 2)
    heard, lost = [], []
    for t, delivery in many(channel, links_of((0, 1)), 2, 3):
        heard += delivery.heard.tolist()
        assert delivery.lost == ()
        assert t == len(heard) - 1
    alive = np.ones(2, bool)
    for t in range(3, 9):  # twice as long from now on
        delivery = channel.deliver(state_of(t, alive), links_of((0, 1)), np.full(2, 40, np.int32))
        heard += delivery.heard.tolist()
        lost += [(reason, *letter) for reason, letters in delivery.lost for letter in letters.tolist()]
    assert [letter[2] for letter in heard] == [0, 1, 2, 3, 4, 5]
    assert lost == [("queue full", 0, 1, 7, 40)]


def test_what_waits_too_long_expires() -> None:
    channel = opened({"use": "bandwidth", "bytes_per_second": 10.0, "expiry": 2}, 2)
    fates = {}
    for t, delivery in many(channel, links_of((0, 1)), 2, 40):
        for letter in delivery.heard.tolist():
            fates[letter[2]] = ("heard", t - letter[2])
        for reason, letters in delivery.lost:
            for letter in letters.tolist():
                fates[letter[2]] = (reason, t - letter[2])
    settled = [fates[t] for t in range(36)]
    assert {fate for fate, _ in settled} == {"heard", "expired"}
    assert max(age for fate, age in settled if fate == "heard") == 2
    assert {age for fate, age in settled if fate == "expired"} == {3}


def test_robots_take_turns_in_their_slots() -> None:
    robots = 12
    links = links_of(*(((i + 1) % robots, i) for i in range(robots)))
    for t, delivery in many(opened({"use": "tdma", "expiry": 5.0}, robots, period=0.1), links, robots, 100):
        mine = [i for i in range(robots) if i % 10 == t % 10]
        assert sorted(set(delivery.heard[:, 1].tolist())) == mine
        for i in mine:
            sent = delivery.heard[delivery.heard[:, 1] == i, 2]
            assert sent.tolist() == list(range(max(0, t - 9), t + 1))


def test_with_one_frame_an_iteration_turns_delay_nothing() -> None:
    for t, delivery in many(opened({"use": "tdma"}, 12), complete(12), 12, 30):
        assert len(delivery.heard) == 12 * 11
        assert (delivery.heard[:, 2] == t).all()


def test_what_waits_longer_than_a_turns_expiry_is_lost() -> None:
    table = {"use": "tdma", "slots": 20, "slot": 0.1, "expiry": 1.4}
    ages = []
    for t, delivery in many(opened(table, 3, period=0.1), links_of((0, 1)), 3, 200):
        ages += (t - delivery.heard[:, 2]).tolist()
        for reason, letters in delivery.lost:
            assert reason == "expired"
            assert (t - letters[:, 2] == 15).all()
    assert sorted(set(ages)) == list(range(15))


def test_a_message_in_a_dead_robots_radio_is_lost_and_one_on_the_air_arrives() -> None:
    both, sender_gone, receiver_gone = np.ones(2, bool), np.array([True, False]), np.array([False, True])
    sizes, nothing = np.full(2, 20, np.int32), links_of()

    def fate(table: dict, alive: np.ndarray) -> list:
        channel = opened(table, 2)
        first = channel.deliver(state_of(0, both), links_of((0, 1)), sizes)
        assert len(first.heard) == len(first.lost) == 0
        for t in range(1, 9):
            delivery = channel.deliver(state_of(t, alive), nothing, sizes)
            if len(delivery.heard) or delivery.lost:
                return ["heard"] * len(delivery.heard) + [reason for reason, _ in delivery.lost]
        return []

    slow = {"use": "bandwidth", "bytes_per_second": 10.0}
    late = {"use": "latency", "delay": 2}
    turns = {"use": "tdma", "slots": 2, "slot": 1.0, "expiry": 9.0}
    for table in (slow, turns):
        assert fate(table, both) == ["heard"]
        assert fate(table, sender_gone) == ["sender dead"]
        assert fate(table, receiver_gone) == ["receiver dead"]
    assert fate(late, both) == ["heard"]
    assert fate(late, sender_gone) == ["heard"]
    assert fate(late, receiver_gone) == ["receiver dead"]


def test_a_message_passes_the_channel_below_first() -> None:
    def fates(table: dict) -> list[tuple[str, int]]:
        found = []
        for t, delivery in many(opened(table, 2), links_of((0, 1)), 2, 6):
            found += [("heard", t)] * len(delivery.heard) + [(reason, t) for reason, _ in delivery.lost]
        return found[:2]

    lost, late = {"use": "bernoulli", "loss": 1.0}, {"use": "latency", "delay": 3}
    assert fates({**late, "over": lost}) == [("loss", 0), ("loss", 1)]
    assert fates({**lost, "over": late}) == [("loss", 3), ("loss", 4)]


def test_beyond_its_range_nothing_arrives() -> None:
    channel = opened({"use": "range", "metres": 1.0}, 4)  # robots stand 0.5 m apart
    delivery = channel.deliver(state_of(0, np.ones(4, bool)), complete(4), np.full(4, 21, np.int32))
    assert {tuple(letter) for letter in delivery.heard[:, :2].tolist()} == {
        (i, j) for i in range(4) for j in range(4) if 0 < abs(i - j) <= 2
    }
    assert [reason for reason, _ in delivery.lost] == ["range"]


BOX = shapely.box(2.0, -1.0, 2.2, 1.0)


def outlines(*boxes: shapely.Polygon) -> np.ndarray:
    rings = [np.array(box.exterior.coords) for box in boxes]
    return np.concatenate([np.concatenate([ring[:-1], ring[1:]], axis=1) for ring in rings])


@settings(max_examples=200, deadline=None, derandomize=True)
@given(st.integers(0, 10**6))
def test_walls_between_two_robots_are_the_solids_that_the_line_enters(seed: int) -> None:
    stream = np.random.default_rng(seed)
    boxes = []
    for place in stream.permutation(16)[: stream.integers(1, 12)]:
        x, y = 2.0 * (place % 4), 2.0 * (place // 4)
        boxes.append(shapely.box(x, y, x + stream.uniform(0.1, 1.5), y + stream.uniform(0.1, 1.5)))
    points = stream.uniform(-1.0, 8.0, (40, 2))
    outside = points[[not any(box.intersects(shapely.Point(p)) for box in boxes) for p in points]]
    here, there = outside[: len(outside) // 2], outside[len(outside) // 2 :][: len(outside) // 2]
    expected = [
        sum(box.intersects(shapely.LineString([a, b])) for box in boxes) for a, b in zip(here, there, strict=True)
    ]
    np.testing.assert_array_equal(walls_between(here, there, outlines(*boxes)), expected)


def test_a_way_through_corners_crosses_a_solid_once_and_past_one_not_at_all() -> None:
    square = outlines(shapely.box(0.0, 0.0, 1.0, 1.0))
    through = walls_between(np.array([[-1.0, -1.0]]), np.array([[2.0, 2.0]]), square)
    past = walls_between(np.array([[-1.0, 1.0]]), np.array([[1.0, -1.0]]), square)
    assert through.tolist() == [1.0]
    assert past.tolist() in ([0.0], [1.0])


def test_the_power_that_arrives_is_that_of_the_log_distance_model() -> None:
    places = np.array([[0.0, 0.0], [1.5, 0.5], [4.0, 0.0], [9.0, 0.0], [0.3, 0.0]])
    walls = outlines(BOX)
    links = complete(5)
    for sensitivity in (-26.0, -32.0, -38.0, -41.0, -44.0, -50.0):
        table = {"use": "path-loss", "sensitivity": sensitivity, "sigma": 0.0, "wall_loss": 6.0, "exponent": 1.8}
        channel = opened(table, 5, walls=walls)
        delivery = channel.deliver(state_of(0, np.ones(5, bool), places), links, np.full(5, 21, np.int32))
        expected = set()
        for receiver, sender in links.tolist():
            a, b = places[receiver], places[sender]
            crossed = BOX.intersects(shapely.LineString([a, b]))
            loss = 40.0 + 18.0 * np.log10(max(float(np.hypot(*(a - b))), 1.0)) + 6.0 * crossed
            if 15.0 - loss >= sensitivity:
                expected.add((receiver, sender))
        assert {tuple(letter) for letter in delivery.heard[:, :2].tolist()} == expected
        assert all(reason == "weak" for reason, _ in delivery.lost)


def test_shadowing_is_the_same_in_both_directions_and_normal() -> None:
    # 0.5 m apart the mean margin is 1 sigma: a share of 0.8413 arrives.
    channel = opened({"use": "path-loss", "sensitivity": -29.0, "sigma": 4.0}, 400)
    links = links_of(*((i, i + 1) for i in range(0, 400, 2)), *((i + 1, i) for i in range(0, 400, 2)))
    heard = 0
    for _, delivery in many(channel, links, 400, 250):
        pairs = {tuple(letter) for letter in delivery.heard[:, :2].tolist()}
        assert pairs == {(b, a) for a, b in pairs}
        heard += len(pairs)
    share, drawn = 0.841345, 250 * 200
    assert abs(heard / (2 * drawn) - share) <= Z99 * np.sqrt(share * (1.0 - share) / drawn)


def test_a_hashed_number_depends_on_its_own_keys_alone() -> None:
    rows, columns = np.arange(50)[:, None], np.arange(60)
    table = chance.uniform(9, 4, rows, columns)
    assert table.shape == (50, 60)
    assert table[7, 11] == chance.uniform(9, 4, 7, 11)[0]
    assert table[7, 11] != chance.uniform(9, 4, 11, 7)[0]
    assert len(np.unique(table)) == table.size
    assert 0.0 <= table.min() < 0.01
    assert 0.99 < table.max() < 1.0


def test_hashed_numbers_are_uniform_and_normal() -> None:
    drawn = chance.uniform(3, np.arange(300)[:, None], np.arange(400)).reshape(-1)
    counts = np.bincount((drawn * 100).astype(int), minlength=100)
    chi = ((counts - 1200.0) ** 2 / 1200.0).sum()
    assert 61.1 < chi < 149.4  # 0.1 % and 99.9 % of chi-squared with 99 degrees of freedom, rounded outwards
    bell = chance.normal(3, np.arange(120_000))
    assert abs(bell.mean()) < Z99 / np.sqrt(len(bell))
    assert abs(bell.var() - 1.0) < Z99 * np.sqrt(2.0 / len(bell))


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ('{use="bernoulli"}', ["network.channel.loss: required key is missing"]),
        ('{use="bernoulli", loss=1.5}', ["network.channel.loss", "<= 1"]),
        ('{use="bernoulli", loss=0.1, ovr={}}', ["network.channel.ovr: unknown key", "'over'"]),
        ('{use="latency", delay=1, over={use="bernouli", loss=0.1}}', ["network.channel.over.use", "'bernoulli'"]),
        (
            '{use="latency", delay=1, over={use="range", metres=1.0, over={use="bernoulli", loss=-0.5}}}',
            ["network.channel.over.over.loss", ">= 0"],
        ),
        ('{use="range", metres=1.0, over={use="latency", delay=1.5}}', ["network.channel.over.delay", "whole number"]),
        ('{use="range", metres=1.0, over={use="latency", delay=nan}}', ["network.channel.over.delay", "finite"]),
        ('{use="range", metres=1.0, over="perfect"}', ["network.channel.over", "expected `object`"]),
        (
            '{use="latency", delay=1, over={use="gilbert-elliott", loss=0.9, burst=2.0}}',
            ["network.channel.over.burst", "at least", "9"],
        ),
        ('{use="gilbert-elliott", loss=1.0, burst=2.0}', ["network.channel.loss", "< 1"]),
        ('{use="bandwidth", bytes_per_second=0}', ["network.channel.bytes_per_second", "> 0"]),
        ('{use="tdma", slots=0}', ["network.channel.slots", ">= 1"]),
    ],
)
def test_a_channel_that_cannot_work_is_refused_by_the_path_to_the_key(table: str, words: list[str]) -> None:
    with pytest.raises(InputError) as refused:
        made(f"network.channel={table}")
    for word in words:
        assert word in str(refused.value), str(refused.value)


def test_the_channels_below_are_spelled_out_with_their_defaults() -> None:
    over = '{use="latency", delay=1, over={use="tdma", over={use="path-loss", wall_loss=7.0}}}'
    channel = load(ROOT / "scenarios" / "room.toml", [f"network.channel={over}"]).network.channel.table
    assert channel["law"] == "fixed"
    assert channel["over"]["slots"] == 10
    assert channel["over"]["over"]["wall_loss"] == 7.0
    assert channel["over"]["over"]["over"] == {"use": "perfect"}


def test_a_channel_made_in_python_lies_over_the_perfect_one() -> None:
    for layer in (
        Bernoulli(loss=0.1), GilbertElliott(loss=0.1, burst=3.0), Latency(delay=1.0), Bandwidth(bytes_per_second=1.0),
        Tdma(), PathLoss(),
    ):  # fmt: skip
        assert layer.over.table == {"use": "perfect"}


def test_the_schema_takes_channels_over_channels() -> None:
    table = tomllib.loads((ROOT / "scenarios" / "room.toml").read_text())
    validator = jsonschema.Draft202012Validator(schema())
    for channel in TABLES:
        table["network"]["channel"] = channel
        validator.validate(table)
    table["network"]["channel"] = {"use": "latency", "delay": 1, "over": 3}
    assert not validator.is_valid(table)


def test_the_scenario_of_the_page_on_channels_runs(tmp_path) -> None:
    (text,) = re.findall(r"```toml\n(.*?)```", (ROOT / "docs" / "channels.md").read_text(), flags=re.DOTALL)
    path = tmp_path / "radio.toml"
    path.write_text(text.replace("../worlds", str(ROOT / "worlds")))
    simulation = build(load(path, ["stop.iterations=60"]), str(path)).simulation
    simulation.run()
    assert simulation.state.iteration == 60 or simulation.finished


def test_the_page_on_channels_tells_of_every_key() -> None:
    page = (ROOT / "docs" / "channels.md").read_text()
    for seam in ("channel", "sharing"):
        for name, kind in registry.known(seam).items():
            if kind.__module__.startswith("swarmsim."):
                assert f"| `{name}` |" in page, name
                for key in kind.__struct_fields__:
                    assert f"`{key}`" in page, f"{name}.{key}"


def test_a_message_has_the_size_that_its_sender_says() -> None:
    sizes = np.array([10, 20, 30], np.int32)
    delivery = opened({"use": "perfect"}, 3).deliver(state_of(0, np.ones(3, bool)), links_of((0, 1), (2, 0)), sizes)
    assert delivery.heard[:, 3].tolist() == [20, 10]
