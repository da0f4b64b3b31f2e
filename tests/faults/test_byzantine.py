"""Robots that lie: what is heard of them, under which name, and what trusting less makes of it."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import ROOT, made, moments_of, seen_as, setting_of, worded_of
from mappers import Grids
from numpy.testing import assert_array_equal

from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.lattice import Lattice
from swarmsim.core.messages import Broadcast, Delivery, Inbox, MessageBuffer
from swarmsim.core.parts import Parts
from swarmsim.core.readings import Tiles
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.part import Part
from swarmsim.core.state import FREE, OCCUPIED, UNKNOWN, Moment, Senses
from swarmsim.engine import contracts
from swarmsim.faults.byzantine import Byzantine, LyingComputation
from swarmsim.network.channel import letters
from swarmsim.operations.mapping.lies import LIES as OF_TILES
from swarmsim.operations.mapping.maps import Maps
from swarmsim.operations.mapping.replay import MapReplay
from swarmsim.recording.reader import Recording
from swarmsim.testing import check_strictly

LATTICE = Lattice(0.0, 0.0, 0.15, 20, 24)
TILE = (6, 7)
SWARM, LIAR = 5, 2
LIES = [
    {"failure": "inverted"},
    {"failure": "free"},
    {"failure": "occupied"},
    {"failure": "origin", "offset": (3, -4)},
    {"failure": "replay", "age": 2},
]
SPOOFS = [{"failure": "spoof"}, {"failure": "spoof", "id": 4}]
POLICIES = sorted(registry.known("sharing").keys() - {"merge"})  # with that, robots believe no stranger anything


def named(table: dict) -> str:
    return "-".join(str(value) for value in table.values())


def context(robots: int = SWARM) -> BuildContext:
    return setting_of(robots, LATTICE.shape, 1)


def grids(robots: int = SWARM) -> Grids:
    return Grids(robots, LATTICE, 0.9, 0.4, 0.12, 0.97)


class Ears:
    """A computation that maps what it senses alone, and keeps what its policy takes in."""

    knowledge_type, lies = Maps, OF_TILES

    def __init__(self, policy: str) -> None:
        self.policy = Part("sharing", {"use": policy}).build(context())
        self.codec, self.grids = self.policy.codec, grids()

    def say(self, senses: Senses) -> Broadcast:
        return self.policy.say(senses, self.grids)

    def hear(self, senses: Senses, inbox: Inbox) -> Inbox:
        taken = self.policy.accepted(senses, inbox)
        self.grids.update(senses.alive, senses.readings.tiles, taken.take(np.zeros(len(taken), bool)))
        return taken


class Talk:
    """A swarm that senses and links at random, and hears at once; with a liar if `lie` is given."""

    def __init__(self, policy: str, lie: dict | None, seed: int) -> None:
        self.ears = self.computation = Ears(policy)
        self.active = np.zeros(SWARM, np.bool_)
        self.lies = lie is not None
        if lie is not None:
            effect = Byzantine(at=0, **lie).build(context()).effect
            parts = Parts(None, None, None, self.computation, *[None] * 9)
            self.computation = effect.wrap(parts, self.active).computation
            assert isinstance(self.computation, LyingComputation)
        self.post, self.chance = MessageBuffer(), np.random.default_rng(seed)

    def hear(self, iteration: int, lying: bool) -> SimpleNamespace:
        self.active[LIAR] = lying
        chance = self.chance
        alive = chance.random(SWARM) < 0.9
        values = (chance.integers(0, 3, (SWARM, *TILE)) * alive[:, None, None]).astype(np.uint8)
        tiles = Tiles(values, chance.integers(0, 14, (SWARM, 2)).astype(np.int32))
        before = values.copy(), tiles.origins.copy()
        observed = seen_as(iteration, np.zeros((SWARM, 3)), alive, tiles)
        said = self.computation.say(observed)
        if self.lies:
            assert contracts.message_sizes(said, self.ears.codec, iteration) is None
        self.post.post(iteration, said)
        linked = (chance.random((SWARM, SWARM)) < 0.6) & alive & alive[:, None] & ~np.eye(SWARM, dtype=bool)
        new = letters(iteration, np.argwhere(linked).astype(np.int32), said.sizes)
        inbox = self.post.open(iteration, Delivery(new, (), iteration))
        taken = self.computation.hear(observed, inbox)
        assert_array_equal(values, before[0])  # what a liar maps itself stays right
        assert_array_equal(tiles.origins, before[1])
        content = taken.content
        return SimpleNamespace(
            receivers=taken.receivers, senders=taken.senders, values=content.values, origins=content.origins,
            sources=content.sources, sensed=content.sensed,
        )  # fmt: skip


def as_said(lie: dict, inbox: Inbox, row: int, past: dict) -> tuple[np.ndarray, np.ndarray]:
    """What a liar makes of the tile that an honest robot would have said."""
    values, origin = inbox.values[row], inbox.origins[row]
    if lie["failure"] == "inverted":
        return np.where(values == FREE, OCCUPIED, np.where(values == OCCUPIED, FREE, UNKNOWN)), origin
    if lie["failure"] in ("free", "occupied"):
        return np.full_like(values, FREE if lie["failure"] == "free" else OCCUPIED), origin
    return values, origin + np.array(lie["offset"])


@pytest.mark.parametrize("policy", sorted({*POLICIES} - {"map"}))
@pytest.mark.parametrize("lie", LIES[:4], ids=named)
def test_a_lie_is_told_in_every_tile_of_a_liars_message_while_it_lies_and_in_no_other(policy, lie) -> None:
    honest, lying = Talk(policy, None, 3), Talk(policy, lie, 3)
    told = 0
    for iteration in range(14):
        now = 4 <= iteration < 9
        truth, heard = honest.hear(iteration, lying=False), lying.hear(iteration, lying=now)
        assert_array_equal(heard.receivers, truth.receivers)
        assert_array_equal(heard.senders, truth.senders)
        assert_array_equal(heard.sources, truth.sources)
        assert_array_equal(heard.sensed, truth.sensed)
        for row, (sender, source) in enumerate(zip(heard.senders, heard.sources, strict=True)):
            if source >= 0 and source != sender:
                continue  # somebody relays it, as it was told
            values, origin = truth.values[row], truth.origins[row]
            if sender == LIAR and now:
                values, origin = as_said(lie, truth, row, {})
                told += 1
            assert_array_equal(heard.values[row], values)
            assert_array_equal(heard.origins[row], origin)
    assert told >= 5


BEYOND = {"failure": "origin", "offset": (-500, 0)}  # a map that lies wholly outside of the grid


@pytest.mark.parametrize("lie", [*LIES[:4], BEYOND], ids=named)
def test_a_liar_tells_a_false_map_as_far_as_the_grid_holds_it(lie) -> None:
    honest, lying = Talk("map", None, 3), Talk("map", lie, 3)
    for iteration in range(8):
        truth, heard = honest.hear(iteration, lying=False), lying.hear(iteration, lying=True)
        false = SimpleNamespace(values=truth.values.copy(), origins=truth.origins.copy())
        for row in np.flatnonzero(truth.senders == LIAR):
            false.values[row], false.origins[row] = as_said(lie, truth, row, {})
        for receiver in range(SWARM):
            for sender in range(SWARM):
                assert_array_equal(*(
                    painted(tiles, (of.receivers == receiver) & (of.senders == sender))
                    for tiles, of in ((heard, heard), (false, truth))
                ))  # fmt: skip


def painted(tiles: SimpleNamespace, rows: np.ndarray) -> np.ndarray:
    """The cells of the grid that tiles show, one by one."""
    cells = np.full(LATTICE.shape, UNKNOWN, np.uint8)
    for (row, column), tile in zip(tiles.origins[rows], tiles.values[rows], strict=True):
        for at, value in np.ndenumerate(tile):
            place = row + at[0], column + at[1]
            if all(0 <= index < side for index, side in zip(place, LATTICE.shape, strict=True)):
                cells[place] = value
    return cells


def test_a_relay_passes_a_lie_on_as_it_was_told() -> None:
    lying = Talk("relay", {"failure": "occupied"}, 3)
    passed = [
        tile
        for iteration in range(14)
        for inbox in [lying.hear(iteration, lying=True)]
        for tile in inbox.values[(inbox.sources == LIAR) & (inbox.senders != LIAR)]
    ]
    assert passed
    assert all((tile == OCCUPIED).all() for tile in passed)


def test_a_replayed_tile_is_the_one_of_so_many_iterations_ago_or_the_oldest() -> None:
    for age in (1, 3):
        honest, lying = Talk("current-tile", None, 8), Talk("current-tile", {"failure": "replay", "age": age}, 8)
        sensed: list[tuple] = []
        for iteration in range(12):
            sensed.append(own_tile(8, iteration))
            truth, heard = honest.hear(iteration, lying=False), lying.hear(iteration, lying=iteration >= 2)
            assert_array_equal(heard.sensed, truth.sensed)
            for row in np.flatnonzero(heard.senders != LIAR):
                assert_array_equal(heard.values[row], truth.values[row])
            for row in np.flatnonzero(heard.senders == LIAR):
                values, origin = sensed[max(0, iteration - age) if iteration >= 2 else iteration]
                assert_array_equal(heard.values[row], values)
                assert_array_equal(heard.origins[row], origin)


def own_tile(seed: int, iteration: int) -> tuple[np.ndarray, np.ndarray]:
    """The liar's tile and its origin in an iteration of `Talk`."""
    talk, kept = Talk("current-tile", None, seed), []
    say = talk.ears.say
    talk.ears.say = lambda seen: kept.append(seen.readings.tiles) or say(seen)
    for t in range(iteration + 1):
        talk.hear(t, lying=False)
    return kept[-1].values[LIAR], kept[-1].origins[LIAR]


def test_a_replayed_map_says_nothing_beyond_the_tiles_that_the_old_one_had() -> None:
    honest, lying = Talk("map", None, 5), Talk("map", {"failure": "replay", "age": 4}, 5)
    past, compared = [], 0
    for iteration in range(10):
        truth, heard = honest.hear(iteration, lying=False), lying.hear(iteration, lying=True)
        first = truth.receivers[truth.senders == LIAR][:1]
        mine = (truth.senders == LIAR) & (truth.receivers == first) if len(first) else np.zeros(0, bool)
        past.append((truth.values[mine], truth.origins[mine]) if len(first) else None)
        if iteration < 4 or past[-1] is None or past[-5] is None:
            continue
        values, origins = (column[: np.count_nonzero(mine)] for column in past[-5])
        mine = (heard.senders == LIAR) & (heard.receivers == first)
        assert_array_equal(heard.values[mine], values)
        assert_array_equal(heard.origins[mine], origins)
        compared += len(values)
    assert compared > 0


@pytest.mark.parametrize("policy", [policy for policy in POLICIES if policy != "relay"])
@pytest.mark.parametrize("lie", SPOOFS, ids=named)
def test_a_spoofer_is_heard_under_another_name_and_nobody_else_is(policy, lie) -> None:
    honest, lying = Talk(policy, None, 6), Talk(policy, lie, 6)
    names = set()
    for iteration in range(60):
        now = 4 <= iteration < 56
        truth, heard = honest.hear(iteration, lying=False), lying.hear(iteration, lying=now)
        assert (np.diff(heard.receivers.astype(int) * SWARM + heard.senders) >= 0).all()
        believed, sources = truth.senders.copy(), truth.sources.copy()
        if now and (truth.senders == LIAR).any():
            assert not (heard.senders == LIAR).any()
            extra = np.bincount(heard.senders, minlength=SWARM) - np.bincount(truth.senders, minlength=SWARM)
            gained = np.flatnonzero(extra > 0)
            assert len(gained) == 1  # one message has one name, whoever hears it
            names.add(int(gained[0]))
            sources[(sources == LIAR) & (believed == LIAR)] = gained[0]
            believed[believed == LIAR] = gained[0]
        order = np.lexsort([believed, truth.receivers])
        assert_array_equal(heard.senders, believed[order])
        assert_array_equal(heard.values, truth.values[order])
        assert_array_equal(heard.sources, sources[order])
    assert names == ({4} if "id" in lie else {0, 1, 3, 4})


# --- in a run ------------------------------------------------------------------------------------


def watch(*overrides: str, iterations: int = 25) -> tuple[list[Moment], object]:
    run = made(f"stop.iterations={iterations}", *overrides, scenario="basilica")
    return moments_of(run), run


LATE = 'network.channel={use="latency", delay=3}'


@pytest.mark.parametrize("channel", ["network.channel={}", LATE], ids=["at once", "late"])
@pytest.mark.parametrize("lie", ['failure="inverted"', 'failure="spoof"'])
def test_lies_are_those_said_from_the_onset_to_the_end_whenever_they_arrive(lie, channel) -> None:
    moments, run = watch(f'faults=[{{use="byzantine", {lie}, at=10, duration=5, robots=[7]}}]', channel)
    plain, _ = watch(channel, iterations=10)
    told = 0
    for moment, before in zip(moments, plain, strict=False):
        assert_array_equal(moment.state.pose, before.state.pose)
        assert_array_equal(moment.knowledge.accepted.content.values, before.inbox.content.values)
        assert_array_equal(moment.knowledge.accepted.senders, before.inbox.senders)
    for moment in moments:
        inbox, heard = moment.knowledge.accepted, moment.delivery.heard
        lied = (heard[:, 1] == 7) & (heard[:, 2] >= 10) & (heard[:, 2] < 15)
        told += lied.sum()
        if "spoof" in lie:
            assert (inbox.senders == 7).sum() == ((heard[:, 1] == 7) & ~lied).sum()
            continue
        for row, (_, sender, sent, _) in enumerate(heard):
            truth = moments[sent].readings.tiles.values[sender]
            expected = np.array([UNKNOWN, OCCUPIED, FREE])[truth] if lied[row] else truth
            assert_array_equal(inbox.content.values[row], expected)
    assert told > 3
    events = [(event.iteration, event.robot, event.kind) for event in worded_of(moments, run)]
    word = "byzantine " + lie.split('"')[1]
    assert events[:2] == [(10, 7, word), (15, 7, f"{word} over")]


def test_a_relay_passes_a_false_name_on() -> None:
    honest, lying = Talk("relay", None, 6), Talk("relay", SPOOFS[1], 6)
    named_truly = 0
    for iteration in range(30):
        truth, heard = honest.hear(iteration, lying=False), lying.hear(iteration, lying=True)
        named_truly += int(((truth.sources == LIAR) & (truth.senders != LIAR)).sum())
        assert not (heard.sources == LIAR).any()
    assert named_truly > 10


@pytest.mark.parametrize("lie", [*LIES, *SPOOFS], ids=named)
def test_liars_that_nobody_hears_change_nothing_at_all(lie) -> None:
    keys = ", ".join(f'{key}="{v}"' if isinstance(v, str) else f"{key}={v}" for key, v in lie.items())
    keys = keys.replace("(", "[").replace(")", "]")
    alone = 'network.topology={use="none"}'
    lying, run = watch(f'faults=[{{use="byzantine", {keys}, at=3, count=9}}]', alone)
    plain, other = watch(alone)
    for ours, theirs in zip(lying, plain, strict=True):
        assert_array_equal(ours.state.pose, theirs.state.pose)
        assert_array_equal(ours.readings.tiles.values, theirs.readings.tiles.values)
    ours, theirs = run.simulation.parts.computation.maps, other.simulation.parts.computation.maps
    assert_array_equal(ours.log_odds, theirs.log_odds)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ("", "failure: required key is missing"),
        ('failure="gossip", ', "failure: these robots know no lie called 'gossip'; known: free, inverted, .*, spoof"),
        ('failure="ocupied", ', "failure: these robots know no lie called 'ocupied'; did you mean 'occupied'"),
        ('failure="origin", ', r"offset: required key is missing; expected \[rows, columns\]"),
        ('failure="replay", ', "age: required key is missing; expected iterations"),
        ('failure="replay", age=0, ', "age: .*>= 1"),
        ('failure="free", age=2, ', "age: a lie of kind 'free' has none; expected failure = 'replay'"),
        ('failure="spoof", offset=[1, 1], ', "offset: a lie of kind 'spoof' has none; expected it left out"),
        ('failure="free", offset=[1, 1], ', "offset: a lie of kind 'free' has none; expected failure = 'origin'"),
        ('failure="inverted", id=1, ', "id: a lie of kind 'inverted' has none; expected failure = 'spoof'"),
        ('failure="spoof", id=15, ', "id: there is no robot 15; expected one from 0 to 14"),
    ],
)
def test_a_lie_that_cannot_be_told_is_refused(keys: str, words: str) -> None:
    with pytest.raises(InputError, match=rf"faults\[0\]\.{words}"):
        made(f'faults=[{{use="byzantine", {keys}at=1}}]', scenario="basilica")


@pytest.mark.parametrize("sharing", ["map", "merge"])
def test_messages_with_maps_outside_of_the_grid_fit_into_envelopes_beside_jobs(sharing: str) -> None:
    lies = 'faults=[{use="byzantine", failure="origin", at=1, robots=[0, 1], offset=[-500, 0]}]'
    keys = f'mind.computation.sharing={{use="{sharing}"}}', lies
    check_strictly(ROOT / "scenarios" / "computing" / "heat.toml", keys, iterations=3)


def test_a_robot_alone_cannot_pass_itself_off_as_another() -> None:
    with pytest.raises(InputError, match="failure: a single robot has no other"):
        Byzantine(at=0, failure="spoof", min_alive=0).build(context(1))


def test_a_recording_holds_the_maps_of_those_who_were_told_of_places_outside_of_the_building(tmp_path: Path) -> None:
    lies = [
        f'{{use="byzantine", failure="origin", at=0, robots=[{robot}], offset={offset}}}'
        for robot, offset in enumerate(["[2, 3]", "[-10000, 10000]", "[0, -25]", "[40, 0]"])
    ]
    run = made("stop.iterations=30", f"faults=[{', '.join(lies)}]", scenario="basilica")
    with run.recorder(tmp_path / "recording.h5") as recorder:
        run.simulation.run([recorder])
    replay, mind = MapReplay(Recording(tmp_path / "recording.h5")), run.simulation.parts.computation.maps
    replay.advance(29)
    assert_array_equal(replay.maps, np.where(mind.observed, 1 + (mind.log_odds > 0.0), 0))
