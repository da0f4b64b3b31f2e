"""A table, data items and independent work that a swarm shares: over networks, deaths and joins."""

from __future__ import annotations

from itertools import pairwise
from random import Random

import numpy as np
import pytest
from networks import Heat, context_of
from telling import LATE, LOSSY, Telling

from swarmsim.core.errors import InputError
from swarmsim.jobs.alone import alone
from swarmsim.jobs.facts.bag import Carried, Independent, bag
from swarmsim.jobs.facts.board import FactBoard
from swarmsim.jobs.facts.wire import ENTRY, Fact, FactCodec, Facts
from swarmsim.jobs.pieces import given
from swarmsim.operations.facts.percolation import Percolation, Spanning
from swarmsim.operations.facts.stigmergy import VALUE, Stigmergy
from swarmsim.operations.facts.storage import Storage

# --- the table


def test_the_newest_entries_win_in_any_order_and_however_often_they_come() -> None:
    dice = Random(3)
    facts = [Fact(ENTRY, dice.randrange(5), dice.randrange(4), dice.randrange(3), dice.randbytes(2)) for _ in range(60)]
    boards = []
    for _ in range(20):
        board = FactBoard(0, 10)
        for fact in dice.sample(facts, 60) + dice.choices(facts, k=30):
            board.hear([fact])
        boards.append(board)
    best = {key: max((fact for fact in facts if fact.key == key), key=lambda one: one[2:]) for key in range(5)}
    assert all(board.entries == best for board in boards)
    assert len({board.wanted(0)[0].version for board in boards}) == 1  # equal tables have equal checksums


def test_a_write_is_newer_than_all_that_was_heard() -> None:
    board = FactBoard(1, 10)
    board.hear([Fact(ENTRY, 4, 7, 9, b"there")])
    board.write(4, b"here")
    assert board.entries[4] == Fact(ENTRY, 4, 8, 1, b"here")


def test_an_older_entry_is_answered_and_equal_tables_fall_silent() -> None:
    board, other = FactBoard(0, 10), FactBoard(1, 10)
    board.write(2, b"new")
    told = board.wanted(0)
    board.told(told, 0)
    other.hear(told)
    other.told(other.wanted(0), 0)
    board.hear(other.wanted(1))
    assert len(board.wanted(5)) == len(other.wanted(5)) == 1  # the checksum alone
    assert len(board.wanted(10)) == 2  # but for those who hear without being heard
    board.hear([Fact(ENTRY, 2, 0, 5, b"old")])
    assert board.wanted(5)[1].value == b"new"


@pytest.mark.parametrize(("topology", "diameter"), [("full", 1), ("ring", 4), ("line", 7)])
def test_tables_are_equal_within_the_diameter_without_loss(topology: str, diameter: int) -> None:
    for seed in range(5):
        swarm = Telling(Stigmergy(writes=1, during=1), 8, topology=topology, seed=seed).run()
        assert swarm.ended is not None
        assert swarm.ended <= diameter
    last = max(write[0] for part in Telling(Stigmergy(), 8).job._parts for write in part.writes)
    assert Telling(Stigmergy(), 8, topology=topology).run().ended <= last + diameter
    assert Telling(Stigmergy(writes=1, during=1), 8, topology=topology, rounds=diameter).run().ended == 1


HARD = {
    "loss": {"channel": LOSSY},
    "loss on a line": {"channel": LOSSY, "topology": "line"},
    "delays and loss": {"channel": LATE, "topology": "ring"},
    "exchanges": {"channel": LOSSY, "topology": "ring", "rounds": 3},
    "late": {"comes": {20: [0, 1]}},
    "late in another order": {"comes": {5: [1], 45: [0]}, "channel": LOSSY},
    "late to a line": {"comes": {60: [1, 0]}, "topology": "line", "channel": LATE},
}


def writes_once(robots: int = 7) -> Stigmergy:
    """Everybody writes in the first iteration, so that no table depends on what was heard before."""
    return Stigmergy(keys=3, writes=4 * robots, during=1)


@pytest.mark.parametrize("network", HARD)
def test_tables_end_equal_and_the_same_on_every_network(network: str) -> None:
    keys = dict(HARD[network])
    late = [robot for robots in keys.get("comes", {}).values() for robot in robots]
    swarm = Telling(writes_once(), **keys).run()
    first = Telling(writes_once(), strike=lambda now, one: one.job.reset(np.array(late))).run() if late else None
    want = (first or Telling(writes_once()).run()).standing
    assert swarm.ended is not None
    if late:  # who comes late writes nothing, and hears everything
        writers = set(swarm.standing.robot.ravel().tolist())
        assert writers.isdisjoint(late)
        assert swarm.standing.newest(swarm.alive).all()
    else:
        assert np.array_equal(swarm.standing.value, want.value)


@pytest.mark.parametrize("network", HARD)
def test_tables_end_equal_while_anybody_writes_at_any_time(network: str) -> None:
    swarm = Telling(Stigmergy(during=60), **HARD[network]).run()
    assert swarm.ended is not None
    assert np.unique(swarm.standing.value, axis=0).shape == (1, 8)


def test_robots_that_hear_nobody_do_not_pretend_to_agree() -> None:
    swarm = Telling(Stigmergy(during=20), topology="none", limit=60).run()
    assert swarm.ended is None
    assert swarm.numbers()["equal_share"] < 1.0


def test_a_budget_is_kept_and_delays() -> None:
    wide = Telling(Stigmergy(keys=60, writes=200, during=2), topology="line").run()
    narrow = Telling(Stigmergy(keys=60, writes=200, during=2, budget=100), topology="line").run()
    assert wide.ended < narrow.ended
    assert narrow.largest <= 100 < wide.largest
    assert np.array_equal(np.unique(narrow.standing.value, axis=0), narrow.standing.value[:1])


# --- storage


@pytest.mark.parametrize("network", [{}, {"channel": LOSSY}, {"topology": "ring"}, {"rounds": 3, "channel": LATE}])
def test_items_get_their_copies_and_no_more(network: dict) -> None:
    swarm = Telling(Storage(during=40), **network, limit=140, on=True).run()
    assert swarm.ended is not None
    assert swarm.standing.held.sum(axis=0).tolist() == [3] * 40
    goods = swarm.standing.goods
    for part in swarm.job._parts:
        assert all(data == goods.data(item) for item, data in part.held.items())


def kept(seed: int, copies: int, spacing: int) -> tuple[float, int]:
    """The share of items kept when 5 of 20 die, and how many were theirs."""
    dead = np.random.default_rng(seed).permutation(20)[:5].tolist()
    deaths = {60 + spacing * number: [robot] for number, robot in enumerate(dead)} if spacing else {60: dead}
    swarm = Telling(Storage(during=40, copies=copies), 20, LOSSY, "ring", deaths, seed=seed, limit=60 + 6 * spacing + 9)
    swarm.on = True
    swarm.run()
    return swarm.numbers()["kept_share"], int(np.isin(swarm.standing.goods.maker, dead).sum())


@pytest.mark.parametrize("seed", range(3))
def test_two_copies_keep_everything_when_a_quarter_dies_one_by_one(seed: int) -> None:
    assert kept(seed, 2, 24)[0] == 1.0


@pytest.mark.slow
def test_two_copies_keep_99_percent_when_a_quarter_dies() -> None:
    apart, at_once = ([kept(seed, 2, spacing)[0] for seed in range(20)] for spacing in (24, 0))
    assert np.mean(apart) >= 0.99
    lost = 1.0 - np.array(at_once)
    wanted = 136 / 15504  # C(17, 2) / C(20, 5): all three holders among the five
    assert abs(lost.mean() - wanted) <= 3.0 * lost.std(ddof=1) / np.sqrt(20), lost


def test_without_copies_what_the_dead_made_is_lost() -> None:
    share, theirs = kept(1, 0, 0)
    assert theirs > 0
    assert share == pytest.approx(1.0 - theirs / 40)


def test_repair_after_silence_makes_the_copies_anew() -> None:
    swarm = Telling(Storage(during=20), deaths={40: [0, 1]}, limit=40 + 12 + 20, on=True).run()
    assert swarm.standing.held[swarm.alive].sum(axis=0).min() == 3


def test_capacity_holds_and_what_finds_no_room_is_told() -> None:
    part = Storage(during=20, capacity=512, smallest=100, largest=200)
    swarm = Telling(part, limit=60, on=True).run()
    assert swarm.numbers()["used_bytes_most"] <= 512
    assert swarm.numbers()["items_refused"] > 0
    assert swarm.numbers()["holders"] < 3.0
    assert swarm.ended is None
    assert swarm.numbers()["items"] == 40


def test_what_a_robot_made_is_not_forgotten_when_it_loses_everything() -> None:
    def strike(now: int, swarm: Telling) -> None:
        if now == 30:
            swarm.job.reset(np.array([3]))

    swarm = Telling(Storage(during=20, copies=0), strike=strike, limit=60, on=True).run()
    theirs = int((swarm.standing.goods.maker == 3).sum())
    assert swarm.numbers()["items"] == 40
    assert swarm.numbers()["kept_share"] == pytest.approx(1.0 - theirs / 40)


@pytest.mark.parametrize(
    ("keys", "told"),
    [
        ({"smallest": 300}, r"smallest: 300 bytes, more than 'largest' 256"),
        ({"capacity": 200}, r"capacity: 200 bytes; expected 256 or more"),
        ({"copies": 7}, r"copies: 7 for 7 robots; expected 6 or less"),
        ({"budget": 100}, r"budget: 100 bytes a message; .* take (\d+); expected \1 or more"),
    ],
)
def test_storage_that_cannot_be_is_refused(keys: dict, told: str) -> None:
    with pytest.raises(InputError, match=told):
        Storage(**keys).build(context_of(7))


# --- the bag

BAG = {"lattices": 2, "rate": 8000.0, "items": 40}
SHARED = {
    "1 robot": {"robots": 1},
    "2 robots": {"robots": 2, "channel": LOSSY},
    "7 robots": {},
    "loss": {"channel": LOSSY, "topology": "ring"},
    "delays": {"channel": LATE},
    "deaths": {"deaths": {4: [1, 2], 11: [5]}, "channel": LOSSY},
    "joins": {"comes": {9: [0, 3]}},
    "exchanges": {"rounds": 4, "topology": "line"},
}


@pytest.mark.parametrize("network", SHARED)
def test_the_bag_has_the_bits_of_one_computer(network: str) -> None:
    part = Percolation(**BAG)
    swarm = Telling(part, **SHARED[network]).run()
    assert swarm.ended is not None
    work = Spanning(part, swarm.context.streams)
    want = np.array([work.result(item) for item in range(work.items)])
    assert swarm.standing.found(swarm.alive).tobytes() == want.tobytes()
    assert swarm.standing.answer(swarm.alive) == work.answer(want)
    assert swarm.numbers()["items_done"] == 40


def test_more_robots_are_faster_and_steal_from_the_dead_and_the_late() -> None:
    ended = [Telling(Percolation(**BAG), robots).run().ended for robots in (1, 2, 7)]
    assert [later < 0.6 * sooner for sooner, later in pairwise(ended)] == [True, True]
    died = Telling(Percolation(**BAG), deaths={4: [1, 2]}).run()
    assert died.numbers()["items_stolen"] >= 10
    assert ended[2] < died.ended < ended[1]


def test_who_hears_nobody_does_all_items_again() -> None:
    swarm = Telling(Percolation(**BAG), 3, topology="none").run()
    assert swarm.ended is not None  # each is a swarm of one
    assert swarm.numbers()["items_again"] > 40


def test_a_claim_lapses_only_after_silence() -> None:
    slow = {**BAG, "items": 2, "rate": 100.0, "patience": 6}  # 205 exchanges an item
    assert Telling(Percolation(**slow), 3).run().numbers()["items_again"] == 0

    def strike(now: int, swarm: Telling) -> None:
        if now == 100:
            swarm.alive[swarm.job._parts[0].board.entries[0].robot] = False

    died = Telling(Percolation(**slow), 3, strike=strike).run()
    assert 205 + 100 + 6 <= died.ended <= 205 + 100 + 6 + 5
    assert died.numbers()["items_again"] == 0  # the dead one had not done it


def test_pieces_without_halos_are_a_bag() -> None:
    class Apart(Heat):
        halo = 0

    context = context_of(4)
    job, pieces = Apart(parts=9), Apart(parts=9).pieces(given(context))

    class Part:
        def build(self, context):
            return bag(Independent(job, pieces), Carried(name="apart"), context)

    swarm = Telling(Part(), 4, LOSSY).run()
    for found, state in zip(swarm.standing.found(swarm.alive), alone(job, pieces), strict=True):
        assert found[: len(state)].tobytes() == state.tobytes()
    with pytest.raises(InputError, match="halo: piece 0 reads"):
        Independent(Heat(), Heat().pieces(given(context)))


class Odd:
    """A bag whose second result is not what it should be."""

    items, length = 3, 1

    def __init__(self, found: object) -> None:
        self._found = found

    def work(self, item):
        return 1.0

    def result(self, item):
        return np.asarray(self._found if item == 1 else [1.0])

    def answer(self, results):
        return {}


@pytest.mark.parametrize(
    ("found", "kind", "told"),
    [
        ([np.nan], InputError, r"jobs: 'odd': the result of item 1 is not finite; expected numbers"),
        ([1.0, 2.0], ValueError, r"result: item 1 gives shape \(2,\); expected \(1,\)"),
    ],
)
def test_a_wrong_result_ends_the_run_by_name(found: object, kind: type[Exception], told: str) -> None:
    job = bag(Odd(found), Carried(name="odd"), context_of(1))
    assert job.written_by is Odd
    with pytest.raises(kind, match=told):
        Telling(type("Part", (), {"build": lambda self, context: job})(), 1).run()


def test_a_bag_that_fits_no_message_is_refused() -> None:
    wide = Odd([1.0])
    wide.length = 8192
    with pytest.raises(InputError, match=r"results of 65536 bytes; expected 1 to 8191 numbers"):
        bag(wide, Carried(name="odd"), context_of(1))
    with pytest.raises(InputError, match=r"budget: 30 bytes a message; a checksum and a result take 40; expected 40"):
        Percolation(budget=30).build(context_of(1))


@pytest.mark.parametrize(("chance", "open_"), [(0.0, 0.3), (1.0, 0.9)])
def test_lattices_span_only_above_the_threshold(chance: float, open_: float) -> None:
    work = Spanning(Percolation(open=open_, items=2), context_of(1).streams)
    assert work.answer(np.array([work.result(0), work.result(1)]))["spanning_share"] == chance


# --- on the wire


def test_facts_survive_packing_and_torn_messages_are_refused() -> None:
    facts = [Fact(ENTRY, 70_000, 1 << 31, 65_535, b"\0a\0"), Fact(ENTRY, 0), Fact(ENTRY, 1, 1, 1, VALUE.pack(0.5))]
    codec, packed = FactCodec(), FactCodec().pack(3, 9, Facts.of(facts))
    assert codec.unpack(packed)[:2] == (3, 9)
    assert codec.unpack(packed)[2].rows() == facts
    for torn in (packed[:-1], packed[:-9]):
        with pytest.raises(ValueError, match=r"bytes at the end|up to byte"):
            codec.unpack(torn)
