"""Bounds against closed forms, against every way there is in tiny buildings, and against tours that were driven."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from itertools import pairwise, product

import msgspec
import numpy as np
import pytest
from conftest import made
from exhausted import Tiny
from known_maps import CELL, built_from

from swarmsim.core.errors import InputError
from swarmsim.core.state import State
from swarmsim.kernels.occupancy import note_observed
from swarmsim.recording.reader import Recording
from swarmsim.studies.benchmark import solver
from swarmsim.studies.benchmark.bounds import bounds_of, needed_cells
from swarmsim.studies.benchmark.first_sight import distances
from swarmsim.studies.benchmark.places import places_of
from swarmsim.studies.benchmark.reference import reference, replayed
from swarmsim.studies.benchmark.replay import cells_of, way_of
from swarmsim.studies.benchmark.tours import Effort
from swarmsim.studies.benchmark.views import ground_of, sight_of

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
    start = places.starts[0] / 2
    low = -places.lattice.y0 / CELL  # rows and columns below the page
    left = -places.lattice.x0 / CELL
    clear = 0.9 * 0.055 / CELL
    ends = np.array([[low + 4 - clear, left + 10], [low + 4 - clear, left + 12]])  # below the wall's lower corners
    goal = np.array([low + 10.5, left + 16.5])
    taut = sum(np.hypot(*(b - a)) for a, b in zip([start, *ends], [*ends, goal], strict=True))
    value = found[tuple(np.floor(2 * goal).astype(int))]
    assert 0.93 * taut - 1.0 <= value <= taut


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


def drawn(seed: int) -> tuple[np.ndarray, list[str]]:
    """Walls of a tiny building, row 0 at the bottom, and its drawing."""
    walls = np.ones((6, 7), np.bool_)
    walls[1:-1, 1:-1] = np.random.default_rng(seed).random((4, 5)) < 0.25
    walls[2, 3:5] = False
    lines = ["".join("#" if wall else "." for wall in row) for row in walls[::-1]]
    lines[3] = lines[3][:3] + "ss" + lines[3][5:]
    return walls, lines


@pytest.mark.parametrize("tile", [(3, 3), (4, 3)])
@pytest.mark.parametrize("seed", range(10))
def test_best_of_all_ways_lies_between_bound_and_tour(seed, tile, tmp_path):
    walls, lines = drawn(seed)
    built = built_from(lines, tmp_path, 2, tile)
    found = reference(built, QUICK)
    ground, lattice = ground_of(built), built.arena.lattice
    corner = np.rint(np.array([-lattice.y0, -lattice.x0]) / CELL).astype(int)  # of the drawing, on the lattice
    tiny = Tiny(walls, tile)
    domain = {(int(row), int(column)) for row, column in np.argwhere(built.explorable) - corner}
    starts = [(int(row), int(column)) for row, column in ground.cells[ground.starts] - corner]
    ways = [[tiny.point((int(row), int(column))) for row, column in cells_of(way) - corner] for way in found.ways]
    driven = [[(row + 0.5, column + 0.5), *way[1:]] for (row, column), way in zip(starts, ways, strict=True)]
    assert domain <= set().union(*(tiny.view(point) for way in (*driven, *ways) for point in way))
    tour = max(sum(math.dist(*pair) for pair in pairwise(way)) for way in driven)
    best = tiny.best(starts, domain, tour)
    assert found.bounds.t100 <= math.ceil(1.0 + best)
    assert best <= tour <= 1.35 * best
    assert found.bounds.t100 <= found.replay.t100
    assert found.covered == 1.0
    assert found.pace <= 1.0


def test_views_are_those_that_straight_lines_allow(tmp_path):
    shown = possible = 0
    for seed, tile in enumerate([(3, 3), (4, 3), (3, 4), (6, 7)]):
        walls, lines = drawn(seed)
        built = built_from(lines, tmp_path, 1, tile)
        lattice = built.arena.lattice
        corner = np.rint(np.array([-lattice.y0, -lattice.x0]) / CELL).astype(int)
        ground, tiny = ground_of(built), Tiny(walls, tile)
        seen = sight_of(built, ground.points).seen
        for place, cell in enumerate(ground.cells - corner):
            point = tiny.point((int(cell[0]), int(cell[1])))
            np.testing.assert_allclose((ground.points[place] - (lattice.x0, lattice.y0))[::-1] / CELL - corner, point)
            cells = np.stack(np.divmod(seen[[place]].indices, lattice.columns), axis=1) - corner
            allowed = tiny.view(point)
            assert {(int(row), int(column)) for row, column in cells} <= allowed
            shown, possible = shown + len(cells), possible + len(allowed)
    assert 0.8 * possible <= shown < possible  # lines are thinner than beams, and pass between touching corners


AGAIN = """
import json, sys
from pathlib import Path
from swarmsim.core.scenario.file import load
from swarmsim.engine.build import build
from swarmsim.studies.benchmark.reference import replayed
folder, ways = Path(sys.argv[1]), tuple(json.loads(sys.argv[2]))
times, covered, digest = replayed(build(load(folder / "scenario.toml"), "scenario.toml"), ways, folder / "again.h5")
print(json.dumps([times.t50, times.t90, times.t99, times.t100, covered, digest]))
"""


def test_coverage_of_a_tour_is_found_again_from_what_another_process_recorded(tmp_path):
    """By the sensor at recorded poses, and by straight lines from them, which know neither sensor nor tour."""
    walls, lines = drawn(3)
    built = built_from(lines, tmp_path, 2, (4, 3))
    found = reference(built, QUICK)
    asked = [sys.executable, "-c", AGAIN, str(tmp_path), json.dumps(found.ways)]
    told = json.loads(subprocess.run(asked, check=True, capture_output=True, text=True).stdout)
    replay = found.replay
    assert told == [replay.t50, replay.t90, replay.t99, replay.t100, found.covered, found.digest]
    pose = Recording(tmp_path / "again.h5")["pose"]
    lattice, domain = built.arena.lattice, built.explorable
    corner = np.rint(np.array([-lattice.y0, -lattice.x0]) / CELL).astype(int)
    seen, straight, shares = np.zeros(domain.shape, np.bool_), set(), []
    for poses in pose:
        velocity, alive = np.zeros_like(poses), np.ones(len(poses), np.bool_)
        tiles = built.simulation.parts.sensor.sense(State(0, poses, velocity, velocity[:, :2], alive)).tiled
        note_observed(tiles.values, tiles.origins, seen)
        shares.append(np.count_nonzero(seen & domain) / np.count_nonzero(domain))
        places = (poses[:, 1::-1] - (lattice.y0, lattice.x0)) / CELL - corner
        straight |= set().union(*(Tiny(walls, (4, 3)).view((float(row), float(column))) for row, column in places))
    times = [1 + int(np.argmax(np.array(shares) >= share)) for share in (0.5, 0.9, 0.99, 1.0)]
    assert [*times, shares[-1]] == told[:5]
    assert {(int(row), int(column)) for row, column in np.argwhere(domain) - corner} <= straight


def test_same_reference_is_found_again_and_survives_a_file(tmp_path):
    built = built_from(drawn(1)[1], tmp_path, 2, (4, 3))
    found = reference(built, QUICK)
    assert found == reference(built, QUICK)
    assert msgspec.toml.decode(msgspec.toml.encode(found), type=type(found)) == found


def test_robots_that_block_each_other_swap_the_rest_of_their_ways(tmp_path):
    """In a corridor one cell wide each has to get past the other."""
    built = built_from(["#" * 20, "#" + "." * 8 + "ss" + "." * 8 + "#", "#" * 20], tmp_path, 2)
    ground = ground_of(built)
    cells, starts = ground.cells, ground.starts
    left, right = cells[:, 1].min(), cells[:, 1].max()
    ways = []
    for start in cells[starts]:
        at, other = int(start[1]), int(cells[starts, 1].sum() - start[1])
        steps = f"{right - at}e" if other > at else f"{at - left}w"
        ways.append(f"{start[0]},{at} {steps}")
    times, covered, _ = replayed(built, tuple(ways))
    assert covered == 1.0
    assert times.t100 is not None


@pytest.mark.slow
def test_basilica_is_toured_in_little_more_than_the_bound():
    found = reference(made(scenario="basilica"))
    assert 140 <= found.bounds.t100 <= 151
    assert found.tour <= 178
    assert found.replay.t99 is not None
    assert found.replay.t99 <= 189
    assert found.bounds.t100 <= found.tour
    assert found.covered >= 0.999
    assert found.pace <= 1.0
