"""Bounds against closed forms, against every way there is in tiny buildings, and against tours that were driven."""

from __future__ import annotations

import math
import sys
from itertools import product

import numpy as np
import pytest
from conftest import made
from known_maps import CELL, built_from

from swarmsim.core.errors import InputError
from swarmsim.studies.benchmark import solver
from swarmsim.studies.benchmark.bounds import bounds_of, needed_cells
from swarmsim.studies.benchmark.first_sight import distances
from swarmsim.studies.benchmark.places import places_of
from swarmsim.studies.benchmark.reference import reference, replayed
from swarmsim.studies.benchmark.replay import cells_of, way_of
from swarmsim.studies.benchmark.tours import Effort
from swarmsim.studies.benchmark.views import ground_of

QUICK = Effort(searches=1, looks=2000, rounds=10)
ROOM = ["#" * 22, *["#" + "." * 20 + "#"] * 3, "#ss" + "." * 18 + "#", *["#" + "." * 20 + "#"] * 3, "#" * 22]
CORRIDOR = ["#" * 42, "#s" + "." * 39 + "#", "#" * 42]


def test_corridor_takes_the_way_until_its_end_is_seen(tmp_path):
    built = built_from(CORRIDOR, tmp_path)
    # The wall in column 41 comes into a tile of 7 columns at 38 cells, 36.5 from the start in the middle of cell 1.
    exact = 1 + math.ceil(36.5)
    found = bounds_of(built)
    assert exact - 2 <= found.first_sight[-1] <= exact
    assert found.best[-1] <= exact <= reference(built, QUICK).replay.t100 <= exact + 3


def test_room_takes_the_way_until_its_far_wall_is_seen(tmp_path):
    built = built_from(ROOM, tmp_path, robots=2)
    nearest = built.context.start[:, 0].max() / CELL
    exact = 1 + math.ceil(18.0 - nearest)
    found = bounds_of(built)
    assert found.first_sight[-1] >= found.covering[-1]
    assert exact - 2 <= found.first_sight[-1] <= exact


@pytest.mark.parametrize(("robots", "what"), [(4, "covering"), (30, "first_sight")])
def test_few_robots_are_bound_by_the_area_and_many_by_the_farthest_cell(robots, what):
    found = bounds_of(made(f"robots.count={robots}", "network.topology.k=2", scenario="exploring"))
    assert getattr(found, what)[-1] == found.best[-1]
    assert found.covering[-1] != found.first_sight[-1]
    assert list(found.best) == sorted(found.best)


def test_distances_are_those_of_taut_strings(tmp_path):
    """Round the end of a wall two cells thick: the robot's middle stays clear of it by nine tenths of its radius."""
    gap = ["#" * 21, *["#" + "." * 9 + "##" + "." * 8 + "#"] * 9, *["#" + "." * 19 + "#"] * 3, "#" * 21]
    gap[3] = gap[3][:3] + "s" + gap[3][4:]
    places = places_of(built_from(gap, tmp_path))
    found = distances(places)
    corner, start = places.lattice, places.starts[0] / 2
    low = -places.lattice.y0 / CELL  # rows and columns below the page
    left = -places.lattice.x0 / CELL
    clear = 0.9 * 0.055 / CELL
    ends = np.array([[low + 4 - clear, left + 10], [low + 4 - clear, left + 12]])  # below the wall's lower corners
    goal = np.array([low + 10.5, left + 16.5])
    taut = sum(np.hypot(*(b - a)) for a, b in zip([start, *ends], [*ends, goal], strict=True))
    value = found[tuple(np.floor(2 * goal).astype(int))]
    assert 0.93 * taut - 1.0 <= value <= taut, (value, taut, corner)


def test_needed_cells_are_counted_as_the_task_does():
    for share, cells in product((0.5, 0.9, 0.99, 1.0), range(1, 400)):
        count = needed_cells(share, cells)
        assert count / cells >= share > (count - 1) / cells


def test_way_is_told_in_a_text():
    cells = np.array([[5, 5], [6, 5], [7, 5], [8, 7], [8, 6], [6, 5]])
    assert way_of(cells) == "5,5 2n1ene1w1ssw"
    np.testing.assert_array_equal(cells_of(way_of(cells)), cells)
    np.testing.assert_array_equal(cells_of(way_of(cells[:1])), cells[:1])
    with pytest.raises(InputError, match="expected a first cell and steps"):
        cells_of("5,5 2q")


def test_ways_that_do_not_fit_are_refused(tmp_path):
    built = built_from(CORRIDOR, tmp_path)
    first = ground_of(built).cells[ground_of(built).starts[0]]
    with pytest.raises(InputError, match="a way for each"):
        replayed(built, ())
    for wrong in (f"{first[0]},{first[1] + 1} 3e", f"{first[0]},{first[1]} 3n", "900,900 "):
        with pytest.raises(InputError, match="way of robot 0: starts elsewhere, or leaves"):
            replayed(built, (wrong,))


def test_missing_ortools_is_told_with_the_command_that_installs_it(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "ortools.pdlp.python", None)
    monkeypatch.setitem(sys.modules, "ortools.pdlp.python.pdlp", None)
    with pytest.raises(InputError, match=r"pip install 'swarmsim-lab\[benchmark\]'"):
        solver.worthiest(np.ones(1), None, np.ones(1))
