"""Rules of exploration: what each chooses by hand-made options, and whole runs by each."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import ROOT, made, seen_as, setting_of
from numpy.typing import NDArray

from swarmsim.core.errors import InputError
from swarmsim.core.messages import Inbox
from swarmsim.core.readings import Tiles
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.file import load
from swarmsim.core.scenario.part import Part
from swarmsim.engine.build import build
from swarmsim.engine.simulation import Simulation
from swarmsim.operations.mapping.exploration.rules import (
    NO_WAY,
    AssignedFrontier,
    CoordinatedFrontier,
    DispersedFrontier,
    LargestFrontier,
    Market,
    MinPos,
    PotentialField,
    RandomFrontier,
    ReservedFrontier,
    SharedFrontier,
    UtilityFrontier,
    shared_out,
)
from swarmsim.operations.mapping.exploration.strategy import Candidates, Exploring, Others, latest_tiles
from swarmsim.operations.mapping.maps import PlainTiles
from swarmsim.operations.mapping.sharing.codecs import GOAL
from swarmsim.operations.mapping.sharing.gossip import GossipCodec, piece_bytes

FAR = math.inf


def candidates(
    ways, goals=None, sizes=None, unknown=None, present=-1, announced=None, left=None, descend=None
) -> Candidates:
    """Pieces at these ways (1 + h, p), along one row unless `goals` says otherwise."""
    ways = np.array(ways, float).reshape(-1, np.shape(ways)[-1])
    count = ways.shape[1]
    told = None if announced is None else np.array(announced, np.int32).reshape(-1, 2)
    return Candidates(
        id=0,
        goals=np.array([(0, 10 * p) for p in range(count)] if goals is None else goals, np.int32),
        ways=ways,
        sizes=np.array([1] * count if sizes is None else sizes, np.int32),
        unknown=np.array([0.5] * count if unknown is None else unknown, float),
        present=present,
        others=Others(np.arange(1, len(ways), dtype=np.int32), told, None if left is None else np.array(left, float)),
        random=np.random.default_rng(1),
        descend=descend or (lambda reach: 0),
    )


def test_random_takes_every_frontier_equally_often() -> None:
    three = candidates([1, 2, 3])
    drawn = [RandomFrontier().choose(three) for _ in range(3000)]
    assert np.abs(np.bincount(drawn, minlength=3) / 3000 - 1 / 3).max() < 0.04


def test_random_keeps_what_it_has_drawn() -> None:
    """Its piece, then what is near; it draws among all only if nothing is."""
    rule = RandomFrontier(keeps=True, near=7.0)
    assert {rule.choose(candidates([9, 20, 30], present=2)) for _ in range(20)} == {2}
    assert {rule.choose(candidates([7, 20, 30])) for _ in range(20)} == {0}
    far = candidates([8, 20, 30])
    assert {rule.choose(far) for _ in range(50)} == {0, 1, 2}


def test_random_that_keeps_does_not_turn_on_its_way() -> None:
    """Only walls that it did not know of, and robots, make it choose another way."""
    turns = []
    for keeps in ("false", "true"):
        simulation = made("robots.count=3", f'mind.strategy={{use="random-frontier", keeps={keeps}}}').simulation
        plans = simulation.parts.strategy._plans
        turns.append(0)
        for _ in range(60):
            left = plans.steps - plans.cursor
            simulation.tick()
            turns[-1] += int((plans.planned & (left > 2)).sum())  # a new way with more than a step left of the old one
    assert turns[1] < turns[0] / 4, turns


def test_largest_takes_the_largest_and_of_equals_the_nearest() -> None:
    assert LargestFrontier().choose(candidates([1, 2, 3], sizes=[4, 9, 9])) == 1


def test_utility_weighs_what_there_is_to_see_against_the_way() -> None:
    """U - weight L / Lmax: 0.2 - 0.1 w against 0.6 - 1.0 w cross at w = 4/9."""
    two = candidates([10, 100], unknown=[0.2, 0.6])
    assert UtilityFrontier(weight=0.44).choose(two) == 1
    assert UtilityFrontier(weight=0.45).choose(two) == 0


def test_coordinated_leaves_to_others_what_is_theirs() -> None:
    """The other one is nearer to the first piece and takes it; the second piece, beside it, is worth less for that."""
    goals = [(0, 0), (0, 3), (0, 40)]
    ours, theirs = [10, 12, 30], [2, 5, 42]
    rule = CoordinatedFrontier(weight=0.02, reach=7.0)
    assert rule.choose(candidates([ours], goals)) == 0
    # 1 - (1 - 3/7) - 0.24 = 0.19 against 1 - 0.60 = 0.40
    assert rule.choose(candidates([ours, theirs], goals)) == 2
    # with shorter sight the second piece is not seen from the first: 0.76
    assert CoordinatedFrontier(weight=0.02, reach=2.0).choose(candidates([ours, theirs], goals)) == 1


def test_min_pos_goes_where_the_fewest_are_nearer() -> None:
    assert MinPos().choose(candidates([[5, 6, 20], [1, 2, 30], [9, 3, 30]])) == 2
    assert MinPos().choose(candidates([[5, 6, 20]])) == 0
    assert MinPos().choose(candidates([[5, 6], [5, FAR]])) == 0  # as near is not nearer; no way is no rank


def test_assigned_shares_the_pieces_out() -> None:
    """Alone the robot would take the first; both together walk least if the other one does: 1 + 4 against 3 + 20."""
    assert AssignedFrontier().choose(candidates([[3, 4], [1, 20]])) == 1
    assert AssignedFrontier().choose(candidates([[3], [1]])) == 0  # none is left for it


def test_potential_field_goes_where_the_walk_ends() -> None:
    asked = []
    walk = candidates([1, 2, 3], descend=lambda reach: asked.append(reach) or 2)
    assert PotentialField(reach=20.0).choose(walk) == 2
    assert asked == [20.0]


def test_market_gives_way_to_lower_prices_only() -> None:
    goals, near = [(0, 0), (0, 20)], [(0, 1)]
    assert Market(revenue=0.0).choose(candidates([[5, 9], [1, 1]], goals, announced=near, left=[4])) == 1
    assert Market(revenue=0.0).choose(candidates([[5, 9], [1, 1]], goals, announced=near, left=[6])) == 0
    assert Market(revenue=10.0).choose(candidates([[5, 9]], goals, [1, 1], [0.0, 0.5], announced=[], left=[])) == 1
    assert Market().choose(candidates([[5], [1]], [(0, 0)], announced=near, left=[1])) == 0  # all are taken


def test_reserved_keeps_off_and_keeps_its_mind() -> None:
    goals = [(0, 0), (0, 5), (0, 40)]
    rule = ReservedFrontier(reach=7.0, stays=5.0)
    assert rule.choose(candidates([[3, 4, 8]], goals, announced=[], left=[])) == 0
    assert rule.choose(candidates([[3, 4, 8], [0, 0, 0]], goals, announced=[(0, 2)], left=[1])) == 2
    assert rule.choose(candidates([[3, 4, 8], [0, 0, 0]], goals, announced=[(-1, -1)], left=[0])) == 0
    assert rule.choose(candidates([[3, 4, 7]], goals, present=2, announced=[], left=[])) == 2
    assert rule.choose(candidates([[3, 4, 9]], goals, present=2, announced=[], left=[])) == 0


def test_dispersed_goes_where_others_are_not() -> None:
    """With weight 10 and reach 10: 5 + 10 exp(-0.1) = 14.0 against 12 + 10 exp(-3) = 12.5."""
    two = [[5, 12], [1, 30]]
    assert DispersedFrontier(weight=10.0, reach=10.0).choose(candidates(two)) == 1
    assert DispersedFrontier(weight=5.0, reach=10.0).choose(candidates(two)) == 0
    assert DispersedFrontier(weight=10.0, reach=10.0, stays=2.0).choose(candidates(two, present=0)) == 0
    assert DispersedFrontier().choose(candidates([[5, 12]])) == 0
    assert DispersedFrontier().choose(candidates([[5, 12], [FAR, FAR]])) == 0


def test_dispersed_heeds_those_nearest_to_a_piece() -> None:
    """Beside the second piece are ten robots at 30 cells, beside the first one at 20: who is nearest decides alone."""
    crowd = [[5, 6], [20, FAR], *[[FAR, 30]] * 10]
    assert DispersedFrontier(weight=10.0, reach=10.0).choose(candidates(crowd)) == 0
    assert DispersedFrontier(weight=100.0, reach=10.0, heeds=1).choose(candidates(crowd)) == 1
    for heeds in (99, None):
        assert DispersedFrontier(weight=100.0, reach=10.0, heeds=heeds).choose(candidates(crowd)) == 0
    assert DispersedFrontier(heeds=1).choose(candidates([[5, 12]])) == 0  # nobody is heard


def test_pieces_are_shared_out_at_the_least_price_of_all() -> None:
    """Alone both would take the first; the one that gives way is the one that loses less by it."""
    ways = np.array([[3.0, 4.0, 50.0], [2.0, 30.0, 50.0]])
    assert shared_out(ways, 0.0, 15.0).tolist() == [1, 0]
    assert shared_out(ways[:, :1], 0.0, 15.0).tolist() == [0, 0]  # one is left over, and follows
    assert shared_out(np.array([[3.0, NO_WAY], [2.0, NO_WAY]]), 20.0, 15.0).tolist() == [0, 0]
    alone = np.array([[5.0, 12.0], [1.0, 30.0]])  # 5 + 10 exp(-0.1) against 12 + 10 exp(-3), as above
    assert shared_out(alone, 10.0, 10.0).tolist() == [1, 0]
    assert shared_out(alone[:1], 10.0, 10.0).tolist() == [0]


def test_shared_takes_its_part_of_the_plan_and_keeps_its_mind() -> None:
    rule = SharedFrontier(weight=0.0)
    assert rule.choose(candidates([[3, 4, 50], [2, 30, 50]])) == 1
    assert rule.choose(candidates([[2, 30, 50], [3, 4, 50]])) == 0
    assert rule.choose(candidates([[3, FAR], [1, FAR]])) == 0  # there is no other piece for it
    assert rule.choose(candidates([[5, 7]])) == 0
    assert rule.choose(candidates([[5, 7]], present=1)) == 1


def test_shared_pays_for_the_view() -> None:
    """Two cells farther, but with 0.3 more of the view unknown: worth it from a revenue of 2 / 0.3 = 6.7 on."""
    two = candidates([[5, 7]], unknown=[0.2, 0.5])
    assert [SharedFrontier(revenue=revenue).choose(two) for revenue in (None, 6.0, 7.0)] == [0, 0, 1]
    both = candidates([[5, 7, 8], [1, 9, 30]], unknown=[0.2, 0.2, 0.9])  # the first is the other's anyway
    assert [SharedFrontier(weight=0.0, revenue=revenue).choose(both) for revenue in (0.0, 10.0)] == [1, 2]


@pytest.mark.parametrize("use", ["market", "reserved-frontier", "oracle-frontier"])
def test_rules_that_need_goals_say_so(use: str) -> None:
    with pytest.raises(InputError, match=r"expected mind\.computation\.sharing\.use = 'tile-and-goal'"):
        made(f'mind.strategy={{use="{use}"}}').simulation.run()


RULES = [name for name, kind in registry.known("strategy").items() if issubclass(kind, Exploring)]


@pytest.mark.parametrize("use", RULES)
def test_every_rule_maps_the_room(use: str) -> None:
    assert made(f'mind={{strategy={{use="{use}"}}, computation={{sharing={{use="tile-and-goal"}}}}}}').simulation.run()


@pytest.mark.parametrize("replan", ["on-arrival", "every-iteration"])
@pytest.mark.parametrize("use", RULES)
def test_every_rule_runs_by_the_same_means(use: str, replan: str) -> None:
    """Gossip with goals holds all that any rule needs; 6 bytes more than gossip, told and charged."""
    simulation = made(
        f'mind={{strategy={{use="{use}", replan="{replan}"}}, computation={{sharing={{use="gossip", goals=true}}}}}}'
    ).simulation
    assert {int(size) for _ in range(12) for size in sizes(simulation)} <= {21 + 6, 21 + 6 + 15}


def sizes(simulation: Simulation) -> NDArray[np.int32]:
    """The bytes that each robot's message takes in the next iteration."""
    said: list = []
    say = simulation.parts.computation.say
    simulation.parts.computation.say = lambda senses: said.append(say(senses)) or said[-1]
    simulation.tick()
    simulation.parts.computation.say = say
    return said[0].sizes


def test_rules_count_their_bytes() -> None:
    """The recommended way takes 15 bytes more than the tile alone, goals take 6."""
    assert piece_bytes(6, 7) == 15
    assert GOAL.size == 6
    tile = PlainTiles(np.ones((1, 6, 7), np.uint8), np.zeros((1, 2), np.int32), np.array([3]), np.array([9]))
    assert len(GossipCodec((6, 7)).pack(3, 9, tile)) == 21  # nothing of the map yet


def test_of_several_tiles_of_one_robot_the_latest_counts() -> None:
    origins = np.arange(8, dtype=np.int32).reshape(4, 2)
    sources, sensed = np.array([1, -1, 1, 0], np.int32), np.array([4, 4, 5, 5], np.int32)
    tiles = PlainTiles(np.zeros((4, 2, 2), np.uint8), origins, sources, sensed)
    heard = Inbox(np.array([0, 0, 0, 1]), np.array([1, 2, 1, 0]), sensed, tiles)
    latest = latest_tiles(heard)
    assert latest.receivers.tolist() == [0, 1]
    assert latest.content.origins.tolist() == [[4, 5], [6, 7]]
    assert len(latest_tiles(heard.take(np.zeros(0, int)))) == 0


def test_gossip_tells_what_waited_longest_and_never_what_it_does_not_know() -> None:
    """Two pieces change one after the other; they are told in that order, then over and over."""
    context = setting_of(1, (12, 21))
    policy = Part("sharing", {"use": "gossip"}).build(context)

    observed, log_odds = np.zeros((1, 12, 21), bool), np.zeros((1, 12, 21), np.float32)
    tiles, alive = Tiles(np.ones((1, 6, 7), np.uint8), np.zeros((1, 2), np.int32)), np.ones(1, bool)
    told = []
    for t in range(8):
        changes = np.empty((0, 3), np.int32)
        if t in (1, 2):
            row, column = ((7, 15), (0, 8))[t - 1]
            observed[0, row, column], log_odds[0, row, column] = True, 1.0 if t == 1 else -1.0
            changes = np.array([[0, row * 21 + column, 2 if t == 1 else 1]], np.int32)
        maps = SimpleNamespace(observed=observed, log_odds=log_odds, changes=changes)
        said = policy.say(seen_as(t, np.zeros((1, 3)), alive, tiles), maps)
        assert said.content.sources.tolist() == [0, -1][: len(said.content)]
        told.append(said.content.origins[1:].tolist())
        if t == 1:
            assert np.argwhere(said.content.values[1]).tolist() == [[1, 1]]
            assert said.content.values[1].max() == 2
    assert told == [[], [[6, 14]], [[0, 7]], [[6, 14]], [[0, 7]], [[6, 14]], [[0, 7]], [[6, 14]]]


@pytest.mark.thorough
def test_the_recommended_way_is_faster_than_the_papers_rule() -> None:
    path, took = ROOT / "scenarios" / "exploring.toml", []
    for keys in ((), ('mind.strategy={use="nearest-frontier"}', 'mind.computation.sharing={use="current-tile"}')):
        runs = [build(load(path, [*keys, f"seed={seed}"]), str(path)).simulation for seed in range(1, 7)]
        assert all(run.run() for run in runs)
        took.append(np.mean([run.finished_after for run in runs]))
    assert took[0] < 0.9 * took[1]


@pytest.mark.thorough
def test_one_planner_that_hears_everything_is_faster_than_the_nearest_frontier() -> None:
    """By a third in these two buildings, where robots that walk to the nearest frontier hear everything too."""
    took = {}
    for use in ("oracle-frontier", "nearest-frontier"):
        keys = [
            f'mind={{strategy={{use="{use}"}}, computation={{sharing={{use="tile-and-goal"}}}}}}',
            'network.topology={use="full"}',
            "robots.count=4",
        ]
        path = ROOT / "scenarios" / "exploring.toml"
        runs = [build(load(path, [*keys, f"world.seed={seed}"]), str(path)).simulation for seed in (9000, 9001)]
        assert all(run.run() for run in runs)
        took[use] = sum(run.finished_after for run in runs)
    assert took["oracle-frontier"] < 0.8 * took["nearest-frontier"]
