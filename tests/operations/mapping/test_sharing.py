from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from conftest import made, seen_as, setting_of
from hypothesis import given, settings
from hypothesis import strategies as st
from mappers import Grids, items

from swarmsim.core.context import BuildContext
from swarmsim.core.lattice import Lattice
from swarmsim.core.messages import Broadcast, Delivery, Inbox, MessageBuffer
from swarmsim.core.readings import Tiles
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.part import Part
from swarmsim.core.state import State
from swarmsim.engine import contracts
from swarmsim.network.channel import letters
from swarmsim.operations.mapping.maps import Maps
from swarmsim.operations.mapping.replay import MapReplay
from swarmsim.operations.mapping.sharing.policies import pieces
from swarmsim.recording.digests import DIGESTED, Digests
from swarmsim.recording.reader import Recording

LATTICE = Lattice(0.0, 0.0, 0.15, 20, 24)
TILE = (6, 7)
POLICIES = [{"use": name} for name in registry.known("sharing")]
POLICIES += [{"use": "relay", "hops": 4}, {"use": "gossip", "goals": True}]
every_policy = pytest.mark.parametrize("table", POLICIES, ids=lambda table: "-".join(map(str, table.values())))


def grids(robots: int) -> Grids:
    return Grids(robots, LATTICE, 0.9, 0.4, 0.12, 0.97)


def context(robots: int) -> BuildContext:
    return setting_of(robots, LATTICE.shape, 1, tile=TILE)


class Policy:
    """A sharing policy of robots that stand still, with its post office."""

    def __init__(self, table: dict, robots: int, maps: Grids) -> None:
        self.inner, self.maps, self.post = Part("sharing", table).build(context(robots)), maps, MessageBuffer()

    def say(self, state: State, tiles: Tiles) -> Broadcast:
        self.observed = seen_as(state.iteration, state.pose, state.alive, tiles)
        held = self.maps
        known = Maps(held.observed, held.log_odds, held.changes, np.zeros(len(held.observed), np.int32), None)
        said = self.inner.say(self.observed, known)
        self.post.post(state.iteration, said)
        return said

    def hear(self, delivery: Delivery) -> Inbox:
        inbox = self.post.open(self.observed.iteration, delivery)
        return self.inner.accepted(self.observed, inbox)


def opened(table: dict, robots: int, maps: Grids | None = None) -> Policy:
    return Policy(table, robots, maps if maps is not None else grids(robots))


def state_of(iteration: int, alive: np.ndarray) -> State:
    robots = len(alive)
    return State(iteration, np.zeros((robots, 3)), np.zeros((robots, 3)), np.zeros((robots, 2)), alive)


def tiles_of(stream: np.random.Generator, alive: np.ndarray) -> Tiles:
    robots = len(alive)
    values = stream.integers(0, 3, (robots, *TILE)).astype(np.uint8) * alive[:, None, None].astype(np.uint8)
    return Tiles(values, stream.integers(0, 14, (robots, 2)).astype(np.int32))


def chain(robots: int) -> np.ndarray:
    return np.array([(i, j) for i in range(robots) for j in (i - 1, i + 1) if 0 <= j < robots], np.int32)


def at_once(iteration: int, links: np.ndarray, said: Broadcast) -> Delivery:
    return Delivery(letters(iteration, links, said.sizes), (), iteration)


def nobody(robots: int) -> Inbox:
    none = np.empty(0, np.int32)
    return items(none, none, np.empty((0, *TILE), np.uint8), np.empty((0, 2), np.int32), none, none)


@every_policy
@pytest.mark.parametrize("robots", [1, 2, 6])
def test_what_is_said_and_heard_has_the_shapes_of_the_seam(table: dict, robots: int) -> None:
    stream, maps = np.random.default_rng(3), grids(robots)
    policy, alive = opened(table, robots, maps), np.ones(robots, bool)
    for t in range(12):
        alive = alive & ~((np.arange(robots) == 1) & (t >= 6))
        state, tiles = state_of(t, alive), tiles_of(stream, alive)
        said = policy.say(state, tiles)
        assert said.content.values.shape[1:] == TILE
        assert said.content.values.dtype == np.uint8
        assert said.content.origins.shape == (len(said.content.values), 2)
        assert len(said.content.sources) == len(said.content.sensed) == len(said.content.values) == said.ends[-1]
        assert said.ends.shape == said.sizes.shape == (robots,)
        assert said.sizes.dtype == np.int32
        assert (np.diff(said.ends, prepend=0) >= 0).all()
        assert (said.content.sensed <= t).all()
        told = np.diff(said.ends, prepend=0)
        assert not said.content.values[np.repeat(~alive, told)].any()  # the dead tell nothing
        links = chain(robots).reshape(-1, 2)
        inbox = policy.hear(at_once(t, links[alive[links].all(axis=1)], said))
        keys = list(zip(inbox.receivers.tolist(), inbox.senders.tolist(), strict=True))
        assert keys == sorted(keys)
        assert alive[inbox.receivers].all()
        assert (inbox.receivers != inbox.content.sources).all()
        for column in (*inbox.arrays()[:3], *inbox.content.arrays()):
            assert len(column) == len(inbox.receivers)
        assert inbox.content.values.dtype == np.uint8
        for column in (*inbox.arrays()[:3], inbox.content.origins, inbox.content.sources, inbox.content.sensed):
            assert column.dtype == np.int32
        maps.update(alive, tiles, inbox)


@every_policy
def test_a_message_is_charged_with_the_bytes_that_it_packs_to(table: dict) -> None:
    robots, stream, maps = 6, np.random.default_rng(4), grids(6)
    policy, alive = opened(table, robots, maps), np.ones(6, bool)
    lengths = set()
    for t in range(8):
        state, tiles = state_of(t, alive), tiles_of(stream, alive)
        said = policy.say(state, tiles)
        for sender in range(robots):
            assert contracts.message_sizes(said, policy.inner.codec, t) is None
            lengths.add(int(said.sizes[sender]))
        maps.update(alive, tiles, policy.hear(at_once(t, chain(robots), said)))
    assert len(lengths) == 1 if table["use"] in ("current-tile", "tile-and-goal") else len(lengths) > 1


@every_policy
def test_a_policy_forgets_what_has_arrived(table: dict) -> None:
    robots, stream = 5, np.random.default_rng(4)
    policy, alive = opened(table, robots), np.ones(5, bool)
    for t in range(60):
        said = policy.say(state_of(t, alive), tiles_of(stream, alive))
        policy.hear(at_once(t, chain(robots), said))
        assert len(policy.post._said) <= 2
    if table["use"] == "relay":
        assert len(policy.inner._known._keys) <= robots * robots * 5


@pytest.mark.parametrize("hops", [1, 2, 3, 7])
def test_a_reading_reaches_exactly_the_robots_within_its_hops_one_link_an_iteration(hops: int) -> None:
    robots, alive, stream = 8, np.ones(8, bool), np.random.default_rng(5)
    policy = opened({"use": "relay", "hops": hops}, robots)
    told = []
    for t in range(20):
        tiles = tiles_of(stream, alive)
        told.append(tiles)
        said = policy.say(state_of(t, alive), tiles)
        inbox = policy.hear(at_once(t, chain(robots), said))
        found = sorted(
            zip(
                *(column.tolist() for column in (inbox.receivers, inbox.content.sources, inbox.content.sensed)),
                strict=True,
            )
        )
        expected = sorted(
            (i, j, t - abs(i - j) + 1)
            for i in range(robots)
            for j in range(robots)
            if 0 < abs(i - j) <= hops and t >= abs(i - j) - 1
        )
        assert found == expected
        for row, (source, sensed) in enumerate(zip(inbox.content.sources, inbox.content.sensed, strict=True)):
            np.testing.assert_array_equal(inbox.content.values[row], told[sensed].values[source])
            np.testing.assert_array_equal(inbox.content.origins[row], told[sensed].origins[source])


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.integers(0, 10**6), st.integers(1, 4), st.integers(1, 7))
def test_no_reading_is_taken_in_twice_whatever_the_network_and_its_delays(seed: int, hops: int, robots: int) -> None:
    stream = np.random.default_rng(seed)
    policy, alive = opened({"use": "relay", "hops": hops}, robots), np.ones(robots, bool)
    under_way, accepted = [], set()
    heard_of = {(i, i, t): 0 for i in range(robots) for t in range(25)}  # owner, source, sensed: links
    for t in range(25):
        alive = alive & (stream.random(robots) > 0.02)
        said = policy.say(state_of(t, alive), tiles_of(stream, alive))
        starts = [0, *said.ends[:-1].tolist()]
        linked = np.argwhere(stream.random((robots, robots)) < 0.4)
        for receiver, sender in linked[(linked[:, 0] != linked[:, 1]) & alive[linked].all(axis=1)].tolist():
            rows = range(starts[sender], said.ends[sender])
            content = [(int(said.content.sources[r]), int(said.content.sensed[r])) for r in rows]
            under_way.append((t + int(stream.geometric(0.5)) - 1, receiver, sender, t, content))
        now = sorted(m for m in under_way if m[0] <= t and alive[m[1]])
        under_way = [m for m in under_way if m[0] > t]
        heard = np.array(sorted([m[1], m[2], m[3], 0] for m in now), np.int32).reshape(-1, 4)
        inbox = policy.hear(Delivery(heard, (), min([m[3] for m in under_way], default=t)))
        expected = {}
        for _, receiver, sender, _, content in now:
            for reading in content:
                if reading[0] != receiver and (receiver, *reading) not in heard_of:
                    links = heard_of[(sender, *reading)] + 1
                    assert links <= hops
                    expected[(receiver, *reading)] = min(links, expected.get((receiver, *reading), links))
        heard_of.update(expected)
        found = list(
            zip(
                *(column.tolist() for column in (inbox.receivers, inbox.content.sources, inbox.content.sensed)),
                strict=True,
            )
        )
        assert sorted(found) == sorted(expected)
        assert not accepted & set(found)
        accepted |= set(found)


def test_the_pieces_of_a_map_put_together_are_the_map() -> None:
    stream = np.random.default_rng(8)
    maps = stream.integers(0, 3, (4, 20, 24)).astype(np.uint8) * (stream.random((4, 20, 24)) < 0.02)
    maps[2] = 0
    owners, origins, values = pieces(maps.astype(np.uint8), TILE)
    assert (np.diff(owners) >= 0).all()
    assert values.any(axis=(1, 2)).all()
    whole = np.zeros((4, 24, 28), np.uint8)
    for owner, (row, column), value in zip(owners, origins, values, strict=True):
        whole[owner, row : row + 6, column : column + 7] = value
    np.testing.assert_array_equal(whole[:, :20, :24], maps)
    assert not whole[:, 20:].any()
    assert not whole[:, :, 24:].any()


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.integers(0, 10**6))
def test_two_robots_that_tell_each_other_their_maps_then_know_the_same(seed: int) -> None:
    stream, maps, alive = np.random.default_rng(seed), grids(2), np.ones(2, bool)
    for _ in range(6):
        maps.update(alive, tiles_of(stream, alive), nobody(2))
    policy = opened({"use": "map"}, 2, maps)
    before, beliefs = maps.observed.copy(), maps.log_odds.copy()
    said = policy.say(state_of(0, alive), Tiles(np.zeros((2, *TILE), np.uint8), np.zeros((2, 2), np.int32)))
    inbox = policy.hear(at_once(0, chain(2), said))
    fresh = maps.update(alive, Tiles(np.zeros((2, *TILE), np.uint8), np.zeros((2, 2), np.int32)), inbox)
    np.testing.assert_array_equal(maps.observed[0], maps.observed[1])
    np.testing.assert_array_equal(maps.observed[0], before[0] | before[1])
    np.testing.assert_array_equal(maps.log_odds[before], beliefs[before])  # what was known is not counted twice
    filled = maps.observed & ~before
    np.testing.assert_array_equal((maps.log_odds > 0.0)[filled], (beliefs > 0.0)[::-1][filled])
    for robot in range(2):
        assert fresh[2:][inbox.receivers == robot].sum() == filled[robot].sum()


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.integers(0, 10**6))
def test_readings_are_counted_and_pieces_of_maps_fill_what_is_left(seed: int) -> None:
    stream, robots = np.random.default_rng(seed), 3
    maps, alive = grids(robots), np.array([True, False, True])
    maps.update(np.ones(robots, bool), tiles_of(stream, np.ones(robots, bool)), nobody(robots))
    count = int(stream.integers(1, 9))
    receivers = np.sort(stream.integers(0, robots, count)).astype(np.int32)
    sources = stream.integers(-1, robots, count).astype(np.int32)
    values = stream.integers(0, 3, (count, *TILE)).astype(np.uint8)
    origins = stream.integers(-8, 26, (count, 2)).astype(np.int32)
    inbox = items(receivers, np.zeros(count, np.int32), values, origins, sources, np.zeros(count, np.int32))
    tiles = tiles_of(stream, alive)

    hit, miss, low, high = (np.float32(np.log(p / (1.0 - p))) for p in (0.9, 0.4, 0.12, 0.97))
    log_odds, observed = maps.log_odds.copy(), maps.observed.copy()
    expected = np.zeros(robots + count, int)
    own = [(i, tiles.values[i], tiles.origins[i], i, i) for i in range(robots) if alive[i]]
    heard = [(receivers[m], values[m], origins[m], sources[m], robots + m) for m in range(count)]
    readings = [one for one in heard if one[3] >= 0]
    for robot, tile, origin, source, place in (*own, *readings, *(one for one in heard if one[3] < 0)):
        for (r, c), cell in np.ndenumerate(tile):
            where = (robot, origin[0] + r, origin[1] + c)
            if cell == 0 or not (0 <= where[1] < 20 and 0 <= where[2] < 24) or (source < 0 and observed[where]):
                continue
            expected[place] += not observed[where]
            observed[where] = True
            log_odds[where] = min(max(log_odds[where] + (hit if cell == 2 else miss), low), high)

    fresh = maps.update(alive, tiles, inbox)
    np.testing.assert_array_equal(maps.observed, observed)
    np.testing.assert_array_equal(maps.log_odds, log_odds)
    np.testing.assert_array_equal(fresh, expected)


def test_linked_robots_that_share_maps_know_all_that_the_other_knew_an_iteration_ago() -> None:
    run = made(
        'network.topology={use="chain"}', 'mind.computation.sharing={use="map"}', "robots.count=2", "stop.iterations=60"
    )
    simulation, behaviour = run.simulation, run.simulation.parts.computation.maps
    before = behaviour.observed.copy()
    grown = 0
    while not simulation.over:
        simulation.tick()
        assert not (before[::-1] & ~behaviour.observed).any()
        grown += int((behaviour.observed & ~before).sum())
        before = behaviour.observed.copy()
    assert grown > 500


LATE = 'network.channel={use="latency", delay=2, law="geometric", over={use="bernoulli", loss=0.2}}'


@pytest.mark.parametrize("table", ['{use="relay", hops=3}', '{use="map"}', '{use="current-tile"}'])
def test_maps_replayed_from_a_recording_are_the_behaviours(table: str, tmp_path) -> None:
    run = made(
        f"mind.computation.sharing={table}", LATE, "robots.count=5", "network.topology.k=2", "stop.iterations=120"
    )
    path = tmp_path / "recording.h5"
    behaviour = run.simulation.parts.computation.maps
    kept = []
    delays = set()

    def sample(moment) -> None:
        kept.append((1 + (behaviour.log_odds > 0.0)) * behaviour.observed)
        delays.update((moment.state.iteration - moment.delivery.heard[:, 2]).tolist())

    with run.recorder(path) as recorder:
        run.simulation.run([recorder, SimpleNamespace(sample=sample)])
    recording = Recording(path)
    replay = MapReplay(recording)
    for t, expected in enumerate(kept):
        replay.advance(t)
        np.testing.assert_array_equal(replay.maps, expected)
    assert len(kept) > 30
    assert delays > {0, 1, 2, 3}
    assert "loss" in recording.summary()["lost"]
    digests = Digests()
    made(
        f"mind.computation.sharing={table}", LATE, "robots.count=5", "network.topology.k=2", "stop.iterations=120"
    ).simulation.run([digests])
    assert digests.total() == recording.digest()


def test_with_one_hop_relaying_is_sharing_the_current_tile() -> None:
    def digest(table: str) -> bytes:
        digests = Digests()
        made(f"mind.computation.sharing={table}", "robots.count=6", "network.topology.k=3").simulation.run([digests])
        heard = DIGESTED.index("heard")  # which tells the hops as well
        return b"".join(row[: 8 * heard] + row[8 * heard + 8 :] for row in digests.rows)

    assert digest('{use="relay", hops=1}') == digest('{use="current-tile"}')
    assert digest('{use="relay", hops=2}') != digest('{use="current-tile"}')


def test_a_relay_says_each_reading_of_another_robot_one_time() -> None:
    robots, alive, stream = 6, np.ones(6, bool), np.random.default_rng(6)
    policy, told = opened({"use": "relay", "hops": 5}, robots), set()
    for t in range(15):
        said = policy.say(state_of(t, alive), tiles_of(stream, alive))
        speakers = np.repeat(np.arange(robots), np.diff(said.ends, prepend=0))
        content = list(zip(speakers.tolist(), said.content.sources.tolist(), said.content.sensed.tolist(), strict=True))
        assert len(set(content)) == len(content)
        assert not told & set(content)
        told |= set(content)
        policy.hear(at_once(t, chain(robots), said))
