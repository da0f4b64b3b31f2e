"""What was truly seen is what counts where maps can be put wrong, and nothing is finished below it."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from conftest import called, made, moments_of

from swarmsim.core.lattice import Lattice
from swarmsim.core.state import FREE, OCCUPIED, UNKNOWN
from swarmsim.operations.mapping.measures.sightings import Sightings
from swarmsim.operations.mapping.replay import MapReplay
from swarmsim.recording.reader import Recording

ROOMS, SIDE, CORRIDOR, WALL, DOOR = 9, 0.9, 0.75, 0.1, 0.45  # m, but for the number on each side


def equal_rooms() -> str:
    """A corridor with equal rooms along both of its sides, as GeoJSON: nothing tells one place from another."""
    width, depth = ROOMS * (SIDE + WALL) + WALL, 2 * SIDE + CORRIDOR + 4 * WALL
    sides = ((SIDE + WALL, SIDE + 2 * WALL), (SIDE + 2 * WALL + CORRIDOR, SIDE + 3 * WALL + CORRIDOR))
    boxes = [(0.0, 0.0, width, WALL), (0.0, depth - WALL, width, depth)]
    boxes += [(0.0, 0.0, WALL, depth), (width - WALL, 0.0, width, depth)]
    for left in WALL + np.arange(ROOMS) * (SIDE + WALL):
        boxes += [(left - WALL, 0.0, left, sides[0][0]), (left - WALL, sides[1][1], left, depth)]
        for low, high in sides:  # a door in the middle of each
            boxes.append((left - WALL, low, left + (SIDE - DOOR) / 2, high))
            boxes.append((left + (SIDE + DOOR) / 2, low, left + SIDE + WALL, high))
    features = [
        {
            "type": "Feature",
            "properties": {"layer": "walls"},
            "geometry": {"type": "Polygon", "coordinates": [[(a, b), (c, b), (c, d), (a, d), (a, b)]]},
        }
        for a, b, c, d in boxes
    ]
    return json.dumps({"type": "FeatureCollection", "features": features})


SCENARIO = f"""
world = {{file = "rooms.geojson", spawn = [{WALL}, {SIDE + 2 * WALL}, {ROOMS * (SIDE + WALL) - WALL}, {CORRIDOR}]}}
seed = 2
robots.count = 8
network.topology.use = "full"
stop.iterations = 120
[mind]
computation = {{use = "occupancy-grid", trust = "own", sharing = {{use = "merge"}}}}
strategy.use = "dispersed-frontier"
"""


def truly_seen(recording: Recording) -> Iterator[dict[tuple[int, int], set[int]]]:
    """What has been seen of each cell after each iteration, by the tiles of robots that know where they are."""
    seen: dict[tuple[int, int], set[int]] = {}
    for tiles, origins in zip(recording["tiles"], recording["origins"], strict=True):
        for robot, row, column in np.argwhere(tiles != UNKNOWN).tolist():
            cell = (int(origins[robot, 0]) + row, int(origins[robot, 1]) + column)
            seen.setdefault(cell, set()).add(int(tiles[robot, row, column]))
        yield seen


@pytest.mark.thorough
def test_merged_maps_of_equal_rooms_count_as_far_as_they_were_seen(tmp_path: Path) -> None:
    """Robots that cannot tell equal rooms apart take none for another, and what each has seen counts where it is."""
    (tmp_path / "rooms.geojson").write_text(equal_rooms())
    (tmp_path / "rooms.toml").write_text(SCENARIO)
    done = called("run", tmp_path / "rooms.toml", "--out", tmp_path / "run", "--quiet")
    assert done.returncode == 1, done.stderr  # not finished
    recording = Recording(tmp_path / "run")
    domain, replay = recording["domain"], MapReplay(recording)
    for t, seen in enumerate(truly_seen(recording)):
        assert recording["coverage"][t] == recording["covered"][t].max()  # nobody can put two maps together
        assert recording["coverage"][t] <= sum(bool(domain[cell]) for cell in seen) / domain.sum()
        if t % 40 and t + 1 < recording.iterations:
            continue
        replay.advance(t)
        maps, union = replay.maps, replay.collective()
        right = {cell for cell in zip(*np.nonzero(union), strict=True) if union[cell] in seen.get(cell, ())}
        assert recording["correct"][t] == len(right) / np.count_nonzero(union)
        for robot, held in enumerate(maps):
            known = zip(*np.nonzero((held != UNKNOWN) & domain), strict=True)
            assert (
                recording["covered"][t, robot] == sum(held[cell] in seen.get(cell, ()) for cell in known) / domain.sum()
            )
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert summary["status"] == "not finished"
    assert summary["measures"]["coverage"] < 0.98
    assert summary["measures"]["correct"] == 1.0
    assert summary["reached"]["100 %"] is None


def test_what_robots_see_counts_where_it_is_and_not_where_they_believe_to_be() -> None:
    lost = made("stop.iterations=12", 'localisation={use="noisy", sigma=0.4, sigma_yaw=0.0}')
    sightings, lattice = Sightings(lost.arena.lattice), lost.arena.lattice
    seen, put = (np.zeros(lattice.shape, np.bool_) for _ in range(2))
    for moment in moments_of(lost):
        sightings.add(moment)
        for tiles, onto in (
            (lost.simulation.parts.sensor.sense(moment.state).tiles, seen),
            (moment.readings.tiles, put),
        ):
            for robot, row, column in np.argwhere(tiles.values != UNKNOWN).tolist():
                cell = tiles.origins[robot] + (row, column)
                if (cell >= 0).all() and (cell < lattice.shape).all():
                    onto[tuple(cell)] = True
    np.testing.assert_array_equal(sightings.seen, seen)
    assert (seen != put).any()


def test_a_map_agrees_with_whatever_was_seen_of_a_cell() -> None:
    sightings = Sightings(Lattice(0.0, 0.0, 0.15, 1, 8))
    sightings._shown[0, 0, :3] = True
    sightings._shown[1, 0, 2:5] = True
    cells = np.array([[FREE, OCCUPIED, FREE, OCCUPIED, FREE, UNKNOWN, FREE, OCCUPIED]], np.uint8)
    assert sightings.agree(cells)[0].tolist() == [True, False, True, True, False, False, False, False]
    assert sightings.share(cells) == 3 / 7
    assert sightings.share(np.zeros_like(cells)) is None
