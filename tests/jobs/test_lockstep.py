"""Jobs in pieces give the same bits on every network, and survive deaths as far as copies reach."""

from __future__ import annotations

from dataclasses import replace as replaced

import numpy as np
import pytest
from networks import CELL, FREE, Heat, Swarm, context_of

from swarmsim.core.errors import InputError
from swarmsim.core.jobs import Shared
from swarmsim.core.messages import Broadcast, Delivery, MessageBuffer
from swarmsim.core.readings import Readings
from swarmsim.core.state import Senses
from swarmsim.jobs.alone import alone
from swarmsim.jobs.facts.wire import Facts
from swarmsim.jobs.reports import Hearsay, PieceClaim, Report
from swarmsim.jobs.runtime import Lockstep
from swarmsim.network.channel import letters

LOSSY = {"use": "bernoulli", "loss": 0.3}
LONG = {"level": 5, "steps": 60}
NETWORKS = {
    "perfect": {},
    "ring": {"topology": "ring"},
    "loss": {"channel": LOSSY},
    "loss, another seed": {"channel": LOSSY, "seed": 8},
    "ring with loss": {"topology": "ring", "channel": LOSSY},
    "delay": {"channel": {"use": "latency", "delay": 5}},
    "delay and loss": {"channel": {"use": "latency", "delay": 2, "law": "geometric", "over": LOSSY}},
    "exchanges": {"rounds": 4, "channel": LOSSY},
    "late robots": {"comes": {3: [6], 9: [0, 2]}},
    "late in another order": {"comes": {4: [0], 11: [6, 1]}},
    "alone": {"robots": 1},
    "two": {"robots": 2, "channel": LOSSY},
    "migrating": {"keys": {"migrate": 0.5, "copies": "all"}, "channel": LOSSY},
    "budget": {"keys": {"budget": 400}, "channel": LOSSY},
    "short numbers": {"keys": {"value": 4}},
}


@pytest.mark.parametrize("network", NETWORKS)
def test_the_answer_has_the_same_bits_on_every_network(network: str) -> None:
    swarm = Swarm(**NETWORKS[network]).run()
    assert swarm.ended is not None
    assert swarm.exact


@pytest.mark.slow
def test_the_answer_of_fifty_robots_has_the_same_bits() -> None:
    assert Swarm(Heat(parts=50), robots=50, topology="wide ring", channel=LOSSY).run().exact


def test_short_numbers_are_other_numbers() -> None:
    pieces = Heat().pieces(Lockstep(Heat(), Shared(name="heat"), context_of(1))._plan and _domain())
    assert any((a != b).any() for a, b in zip(alone(Heat(), pieces), alone(Heat(), pieces, value=4), strict=True))


def _domain():
    from swarmsim.jobs.pieces import given

    return given(context_of(1))


def test_loss_and_distance_cost_iterations() -> None:
    ended = [Swarm(topology="ring", channel={"use": "bernoulli", "loss": loss}).run().ended for loss in (0.0, 0.2, 0.4)]
    assert 20 < ended[0] < ended[1] < ended[2]
    assert Swarm().run().ended == 20  # a step an exchange where everybody hears everybody
    assert Swarm(rounds=5).run().ended == 4
    assert Swarm(channel={"use": "latency", "delay": 5}).run().ended == 20 * 6


def test_robots_that_hear_nobody_never_end_and_say_so() -> None:
    swarm = Swarm(topology=lambda now, alive: np.zeros((7, 7), bool), limit=50).run()
    assert swarm.ended is None
    assert swarm.lost == []
    assert (swarm.parcel.silent == 49).all()
    assert swarm.parcel.counts[:, 0].sum() == 0  # no step is made up
    assert swarm.parcel.progress(swarm.alive).tolist() == [0] * 7


def one_by_one(robots: int, dead: int, spacing: int, seed: int) -> dict[int, list[int]]:
    order = np.random.default_rng(seed).permutation(robots)[:dead]
    return {6 + spacing * number: [int(robot)] for number, robot in enumerate(order)}


@pytest.mark.parametrize("seed", [1, 2])
def test_two_copies_survive_deaths_one_by_one(seed: int) -> None:
    swarm = Swarm(Heat(**LONG), topology="ring", deaths=one_by_one(7, 5, 24, seed), seed=seed).run()
    assert swarm.alive.sum() == 2
    assert swarm.exact
    assert swarm.parcel.counts[:, 3].sum() > 0


@pytest.mark.slow
def test_fifteen_of_twenty_die_one_by_one_and_the_answer_is_exact_in_twenty_of_twenty() -> None:
    keys = {"parts": 20, "level": 10, "steps": 200}
    for seed in range(20):
        deaths = one_by_one(20, 15, 24, seed)
        swarm = Swarm(Heat(**keys), 20, topology="wide ring", channel=LOSSY, deaths=deaths, seed=seed, limit=1500).run()
        assert swarm.alive.sum() == 5
        assert swarm.exact, seed


def test_pieces_migrate_to_robots_that_are_nearer_by_more_than_asked_for_and_come_to_rest() -> None:
    """Everybody keeps copies of everything and hears everybody; robots stand."""
    far: dict[float | None, float] = {}
    for migrate in (None, 2.0, 0.5):
        held: list[list[list[int]]] = []

        def look(swarm: Swarm, held: list[list[list[int]]] = held) -> bool:
            held.append([swarm.holders(piece) for piece in range(7)])
            return False

        swarm = Swarm(keys={"copies": "all", "migrate": migrate}, until=look).run()
        assert swarm.exact
        assert held[9:-1] == [held[9]] * len(held[9:-1])  # nothing moves to and fro
        assert all(len(robots) == 1 for robots in held[9])
        away = np.hypot(*(swarm.runtime.plan.centres[:, None] - swarm.places[:, :2]).transpose(2, 0, 1))
        far[migrate] = max(away[piece, robots[0]] - away[piece].min() for piece, robots in enumerate(held[9]))
    assert far[None] > 4.0
    assert 1.0 < far[2.0] <= 2.0 + CELL  # robots tell their distances in whole cells
    assert far[0.5] <= 0.5 + CELL


def test_pieces_migrate_and_survive_deaths_among_robots_that_move() -> None:
    def moved(swarm: Swarm) -> bool:
        middle = np.array([4.0, 3.5])
        swarm.places[:, :2] = middle + (swarm.places[:, :2] - middle) @ np.array([[0.98, -0.2], [0.2, 0.98]])
        return False

    keys, deaths = {"migrate": 0.5}, one_by_one(7, 5, 24, 3)
    swarm = Swarm(Heat(**LONG), topology="ring", channel=LOSSY, keys=keys, deaths=deaths, until=moved).run()
    assert swarm.exact
    assert swarm.alive.sum() == 2
    assert swarm.parcel.counts[:, 2].sum() > 5  # more than the pieces of the dead


def test_pieces_do_not_migrate_with_a_clock() -> None:
    with pytest.raises(InputError, match=r'migrate: with a clock pieces stay .* expected fence = "data"'):
        Swarm(keys={"migrate": 1.0, "fence": "clock"})


def test_without_copies_the_pieces_of_the_dead_are_lost_and_told() -> None:
    swarm = Swarm(keys={"copies": 0}, deaths={5: [2, 4]}, limit=60).run()
    assert swarm.lost == [2, 4]
    assert swarm.ended is None
    assert not swarm.exact
    assert set(swarm.parcel.answers(swarm.alive)) == set()  # the others wait for ever, and claim nothing


def test_what_is_lost_at_once_are_the_pieces_whose_holder_and_keepers_died() -> None:
    kept: dict[int, set[int]] = {}

    def strike(now: int, swarm: Swarm) -> list[int]:
        if now != 8:
            return []
        kept.update({piece: {*swarm.holders(piece), *swarm.keepers(piece)} for piece in range(7)})
        return [0, 1, 2, 3, 4]

    swarm = Swarm(strike=strike, limit=120).run()
    assert all(len(robots) == 3 for robots in kept.values())  # the holder and two copies
    assert swarm.lost == [piece for piece, robots in kept.items() if robots <= {0, 1, 2, 3, 4}]
    assert len(swarm.lost) > 0
    assert swarm.ended is None


def test_copies_with_all_hearers_keep_what_can_be_kept() -> None:
    assert Swarm(keys={"copies": "all"}, deaths={8: [0, 1, 2, 3, 4]}).run().exact


@pytest.mark.slow
def test_the_share_lost_at_once_is_that_of_chance() -> None:
    """C(17, 12) / C(20, 15) of the pieces: the holder and both copies among the 15 of 20."""
    lost = []
    for seed in range(30):
        dead = np.random.default_rng(seed).permutation(20)[:15].tolist()
        lost.append(len(Swarm(Heat(parts=20), 20, deaths={8: dead}, seed=seed, limit=10).run().lost))
    wanted, error = 20 * 6188 / 15504, np.std(lost, ddof=1) / np.sqrt(len(lost))
    assert abs(np.mean(lost) - wanted) < 3.0 * error, (np.mean(lost), error)


def test_the_taker_dies_too() -> None:
    struck: list[int] = []

    def strike(now: int, swarm: Swarm) -> list[int]:
        if now == 7:
            struck.extend(swarm.holders(3))
            return list(struck)
        takers = [one for one in swarm.holders(3) if one not in struck] if now > 7 else []
        if len(struck) == 1 and takers:  # in the iteration after it has taken over
            struck.extend(takers)
            return takers
        return []

    swarm = Swarm(Heat(**LONG), strike=strike).run()
    assert len(struck) == 2
    assert swarm.exact


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_two_holders_of_neighbouring_pieces_die_together(seed: int) -> None:
    dead = np.random.default_rng(seed).permutation(7)[:2].tolist()
    assert Swarm(Heat(**LONG), topology="ring", deaths={23: dead}, channel=LOSSY, seed=seed).run().exact


def test_a_holder_dies_at_the_very_change_of_a_level() -> None:
    struck: list[int] = []

    def strike(now: int, swarm: Swarm) -> list[int]:
        if now and not struck and swarm.parcel.step[:, 2].max() == 10:  # it has just begun a level, and told nobody
            struck.extend(swarm.holders(2))
            return list(struck)
        return []

    swarm = Swarm(Heat(**LONG), topology="ring", strike=strike).run()
    assert len(struck) == 1
    assert swarm.exact


def test_both_halves_of_a_swarm_go_on_until_they_find_together_again() -> None:
    half = np.arange(8) < 4

    def parted(now: int, alive: np.ndarray) -> np.ndarray:
        return np.equal.outer(half, half) if 12 <= now < 72 else np.ones((8, 8), bool)

    taken = Swarm(Heat(**LONG), 8, topology=parted, deaths={11: [3]}).run()
    assert taken.exact
    assert taken.parcel.counts[:, 2].sum() > 1  # pieces were taken over in both halves


@pytest.mark.parametrize("seed", [1, 2, 5])
def test_after_a_death_no_more_is_done_again_than_since_the_last_copy(seed: int) -> None:
    channel = {"use": "bernoulli", "loss": 0.1}
    job, deaths = Heat(parts=6, level=10, steps=100), {48: [0]}
    swarm = Swarm(job, 6, topology="wide ring", channel=channel, deaths=deaths, seed=seed).run()
    steps, redone = swarm.parcel.counts[:, 0].sum() - 6 * job.steps, swarm.parcel.counts[:, 3].sum()
    assert swarm.exact
    assert 0 < redone <= steps <= 2 * job.level  # two robots at most go on with the piece before they hear each other


def test_who_has_the_newest_copy_computes_again_what_others_lack() -> None:
    """Robot 1 lacks what piece 0, of which robot 0 is at step 18, shows to step 17; robots 2 and 3 keep copies."""
    begun = {}
    for robot, own, other in ((2, 10, 15), (3, 15, 10)):
        runtime = Swarm(Heat(parts=4, **LONG), 4).runtime
        peer, state = runtime._parts[robot], runtime._start(0)
        for step in (own - 5, own):
            peer.worker.copies.put(0, step, state)
        for now in range(60):
            reports = {0: Report(now, {0: PieceClaim(18)}, {}), 1: Report(now, {1: PieceClaim(17)}, {})}
            reports[5 - robot] = Report(now, {}, {0: other})
            peer.hear([report.fact(who, 1) for who, report in reports.items()], now, now)
            if 0 in peer.worker.again:
                begun[robot] = now, peer.worker.again[0].step
                break
    assert begun[3][1] == 15
    assert begun[2][0] >= begun[3][0] + 6  # a patience later, should the other one not come to it


def test_news_gets_over_twenty_hops_though_a_third_of_the_messages_are_lost() -> None:
    line, rng, known = [Hearsay(12) for _ in range(21)], np.random.default_rng(3), 0
    for now in range(400):
        line[0].note(0, Report(now, {0: PieceClaim(0)}, {}), 0, now)
        told = []
        for robot in line:
            told.append(list(robot.due(now, now, 3)))
            for _, news in told[-1]:
                news.said, news.when = news.report, now
        for at, robot in enumerate(line):
            for near in (at - 1, at + 1):
                for who, news in told[near] if 0 <= near <= 20 and rng.random() > 1 / 3 else []:
                    robot.note(who, news.report, news.hops + 1, now)
        known += bool(list(line[-1].of(0, now)))
    assert known > 100  # said once by each, it got there in none of the 400 exchanges


def test_a_robot_that_starts_again_from_nothing_brings_nothing_back() -> None:
    swarm = Swarm(Heat(**LONG), keys={"copies": 0}, limit=40)

    def strike(now: int, same: Swarm) -> list[int]:
        if now == 5:
            same.runtime.reset(np.array([2]))
        return []

    swarm.strike = strike
    assert swarm.run().lost == [2]


class Poison:
    """A truth that is only to be had at some cells: NaN elsewhere."""

    def __init__(self, cells=None) -> None:
        self.cells = cells

    def value(self, time, points):
        found = 0.3 * points[:, 0] - 0.1 * points[:, 1]
        rows, columns = np.floor(points[:, 1] / 0.5).astype(int), np.floor(points[:, 0] / 0.5).astype(int)
        known = np.ones(FREE.shape, bool) if self.cells is None else np.zeros(FREE.shape, bool)
        if self.cells is not None:
            known[tuple(self.cells.T)] = True
        return np.where(known[rows, columns], found, np.nan)


class Peeking(Lockstep):
    """Looks at what is true one cell beyond its own."""

    def _start(self, piece):
        beyond = self._context.lattice.centres(self._plan.pieces[piece].halo)
        return super()._start(piece) + 1e-9 * self._context.scalar_field.value(0.0, beyond).mean()


def test_robots_apart_agree_though_each_is_told_its_own_cells_alone_and_hears_bytes_alone() -> None:
    whole = Swarm(Heat(), field_=Poison()).run()
    pieces = whole.runtime._plan.pieces
    want = alone(Heat(), pieces, [Poison().value(0.0, whole.context.lattice.centres(one.cells)) for one in pieces])
    for robot, mind in enumerate(apart(Lockstep, pieces)):
        assert mind._parts[0].worker.threads[robot].state.tobytes() == want[robot].tobytes()
    with pytest.raises(InputError, match="jobs: 'heat' is not finite in piece 0 after step 0"):
        apart(Peeking, pieces)


def apart(runtime, pieces) -> list[Lockstep]:
    """Seven runtimes of one robot each, after a job: what crosses are packed messages, so no one can peek."""
    count, minds = len(pieces), []
    for robot in range(count):
        context = context_of(count, field=Poison(pieces[robot].cells))
        minds.append(runtime(Heat(), Shared(name="heat"), context.serving(np.array([robot]))))
    still, told = np.zeros((1, 3)), list[bytes]()
    for now in range(20):
        senses = Senses(now, still, still, np.ones(1, bool), Readings())
        said = [mind.say(senses) for mind in minds]
        told = [minds[robot].codec.pack(robot, now, one.of(0)) for robot, one in enumerate(said)]
        assert [len(one) for one in told] == [int(one.sizes[0]) for one in said]
        for robot, mind in enumerate(minds):
            heard = [mind.codec.unpack(one)[2] for sender, one in enumerate(told) if sender != robot]
            post = MessageBuffer()
            ends = np.cumsum([0, *(len(one) for one in heard)])[1:]
            post.post(now, Broadcast(Facts.joined(heard), ends, np.ones(count - 1, np.int32)))
            links = np.stack([np.zeros(count - 1), np.arange(count - 1)], axis=1).astype(np.int32)
            mine = Delivery(letters(now, links, np.ones(count - 1, np.int32)), (), now)
            found = mind.hear(senses, post.open(now, mine))
            assert all(np.isfinite(state).all() for _, state in found.states[0].values())
    return minds


def test_no_fewer_bytes_are_said_than_pieces_show() -> None:
    swarm = Swarm().run()
    plan = swarm.runtime._plan
    assert swarm.sent >= sum(8 * len(one.rim) for one in plan.pieces) * plan.steps
    said = swarm.runtime.say(_still(7, swarm.ended))
    assert [len(swarm.runtime.codec.pack(one, swarm.ended, said.of(one))) for one in range(7)] == said.sizes.tolist()


def _still(count: int, now: int) -> Senses:
    return Senses(now, np.zeros((count, 3)), np.zeros((count, 3)), np.ones(count, bool), Readings())


def test_every_message_keeps_to_its_budget_and_a_budget_too_small_is_refused() -> None:
    sizes: list[int] = []

    class Watched(Lockstep):
        def say(self, senses):
            said = super().say(senses)
            sizes.append(int(said.sizes.max()))
            return said

    swarm = Swarm(keys={"budget": 400})
    swarm.runtime = Watched(swarm.job, swarm.runtime._plan.keys, swarm.context)
    assert swarm.run().exact
    assert 350 < max(sizes) <= 400
    with pytest.raises(
        InputError, match=r"budget: 100 bytes a message; .*what piece \d says \d+; expected \d+ or more"
    ):
        Swarm(keys={"budget": 100})


def test_with_a_clock_the_answer_so_far_is_there_in_time_and_is_another_one_under_loss() -> None:
    clock = {"fence": "clock"}
    assert Swarm(keys=clock).run().exact  # all halos come in time
    late = Swarm(keys=clock, channel={"use": "bernoulli", "loss": 0.5}).run()
    assert late.ended == 20
    assert not late.exact
    apart = Swarm(keys=clock, topology=lambda now, alive: np.zeros((7, 7), bool)).run()
    assert (apart.ended, apart.exact) == (20, False)


class Growing(Heat):
    def step(self, piece, state, around, step):
        return state * 1e30


def test_a_job_that_diverges_ends_by_name() -> None:
    with pytest.raises(InputError, match=r"jobs: 'heat' is not finite in piece \d after step 1\d; expected a stable"):
        Swarm(Growing(steps=20, level=5)).run()


def test_levels_that_do_not_divide_the_steps_are_refused() -> None:
    with pytest.raises(InputError, match="steps: 20 in levels of 7; expected a whole number of levels"):
        Swarm(Heat(level=7))
    assert replaced(Swarm(), robots=2).run().exact
