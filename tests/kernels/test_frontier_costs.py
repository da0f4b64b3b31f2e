"""Surveys of frontiers against scipy's Dijkstra and labels."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage
from test_search import NOW, ONE_CELL, PLUS, distances, frontiers, maps, random_map, rules, standable

from swarmsim.kernels import frontier_costs


def surveyed(wall, observed, here, others, before=-1, grain=7, neighbours=8, footprint=ONE_CELL):
    known = maps(wall, observed)
    return frontier_costs.survey(
        known, 0, NOW, rules(neighbours, footprint), here, np.asarray(others, np.int32), before, grain, 3,
        np.uint64(77), frontier_costs.ground(*wall.shape),
    )  # fmt: skip


def pieces_of(frontier: np.ndarray, grain: int) -> set[frozenset[int]]:
    """The cells of each piece: labels within each square of the grid."""
    found = set()
    for row in range(0, frontier.shape[0], grain):
        for column in range(0, frontier.shape[1], grain):
            part = np.zeros_like(frontier)
            square = (slice(row, row + grain), slice(column, column + grain))
            part[square] = frontier[square]
            labels, count = ndimage.label(part, np.ones((3, 3)))
            found |= {frozenset(np.flatnonzero(labels == label).tolist()) for label in range(1, count + 1)}
    return found


@pytest.mark.parametrize("neighbours", [4, 8])
@pytest.mark.parametrize("footprint", [ONE_CELL, PLUS], ids=["cell", "plus"])
@pytest.mark.parametrize("grain", [4, 100])
def test_pieces_ways_and_sizes_are_right_on_random_maps(neighbours, footprint, grain) -> None:
    rng = np.random.default_rng(grain + neighbours)
    seen = 0
    for _ in range(120):
        wall, observed = random_map(rng, 0.75)
        standing = standable(wall, observed, footprint)
        if np.count_nonzero(standing) < 3:
            continue
        here, *others = rng.choice(np.flatnonzero(standing), 3, replace=False)
        found = surveyed(wall, observed, here, others, -1, grain, neighbours, footprint)
        ways = [distances(standing, start, neighbours, 5.0, 7.0) for start in (here, *others)]
        frontier = frontiers(wall, observed)
        wanted = pieces_of(frontier, grain)
        for goal, stand, size, unknown, cost in zip(
            found.goals, found.stands, found.sizes, found.unknown, found.costs.T, strict=True
        ):
            (piece,) = [cells for cells in wanted if goal in cells]
            assert size == len(piece)
            assert [w.flat[stand] if np.isfinite(w.flat[stand]) else frontier_costs.FAR for w in ways] == cost.tolist()
            if len(footprint) == 1:
                assert stand == goal
                assert cost[0] == min(ways[0].flat[cell] for cell in piece)
            row, column = np.divmod(goal, wall.shape[1])
            rows, columns = np.indices(wall.shape)
            assert unknown == np.count_nonzero(~observed & (np.hypot(rows - row, columns - column) <= 3))
            seen += 1
        assert (np.diff(found.costs[0]) >= 0).all()
        if len(footprint) == 1:
            reachable = {cells for cells in wanted if any(np.isfinite(ways[0].flat[cell]) for cell in cells)}
            assert len(found.goals) == len(reachable)
    assert seen > 100


def test_the_present_goal_is_found_again_in_its_piece() -> None:
    wall, observed = np.zeros((9, 30), bool), np.zeros((9, 30), bool)
    observed[:, 5:25] = True
    west, east = 4 * 30 + 5, 4 * 30 + 24
    for before, column in ((west, 5), (east, 24)):
        found = surveyed(wall, observed, 4 * 30 + 12, [], before, 100)
        assert found.goals[found.present] % 30 == column
    assert surveyed(wall, observed, 4 * 30 + 12, [], 4 * 30 + 12, 100).present == -1
    assert surveyed(wall, observed, 4 * 30 + 12, []).present == -1


def test_a_walk_down_the_potential_goes_to_the_larger_frontier_and_away_from_others() -> None:
    wall, observed = np.zeros((9, 31), bool), np.zeros((9, 31), bool)
    observed[:, 5:26] = True
    wall[:, 25], wall[4, 25] = True, False  # in the east there is one cell of frontier, in the west nine
    middle = 4 * 31 + 15

    def end(others, reach=50.0):
        ground = frontier_costs.ground(*wall.shape)
        at = (maps(wall, observed), 0, NOW, rules(), middle)
        others = np.asarray(others, np.int32)
        found = frontier_costs.survey(*at, others, -1, 100, 3, np.uint64(7), ground)
        return found.goals[frontier_costs.descend(*at, others, found, reach, ground)] % 31

    assert end([]) == 5
    assert end([4 * 31 + 10]) == 25
    assert end([4 * 31 + 10], reach=3.0) == 5
