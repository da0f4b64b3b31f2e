"""Robots that do not believe all that they hear, against a slow and obvious oracle and against liars."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import made, setting_of
from hypothesis import given, settings
from hypothesis import strategies as st
from mappers import Mapper, inbox_of, items
from numpy.testing import assert_allclose, assert_array_equal

from swarmsim.core.errors import InputError
from swarmsim.core.lattice import Lattice
from swarmsim.core.readings import Tiles
from swarmsim.core.state import FREE, OCCUPIED, UNKNOWN
from swarmsim.operations.mapping.grids import OccupancyGrids, QuorumGrids

SHAPE, TILE, SWARM = (5, 8), (2, 3), 4
HIT, MISS, LOW, HIGH = (np.float32(np.log(p / (1.0 - p))) for p in (0.9, 0.4, 0.12, 0.97))


def grids(robots: int = SWARM) -> OccupancyGrids:
    return OccupancyGrids(robots, Lattice(0.0, 0.0, 0.15, *SHAPE), 0.9, 0.4, 0.12, 0.97)


class Believer:
    """One robot's map of plain dictionaries: what it senses, then what enough others say of the rest."""

    def __init__(self, quorum: int) -> None:
        self.quorum = quorum
        self.log_odds: dict = {}
        self.own: set = set()
        self.said: dict = {}

    def reset(self, cells) -> None:
        """Cells that fade from its map; nothing of what it knew about them stays."""
        for cell in cells:
            known = cell in self.log_odds
            self.log_odds.pop(cell, None)
            self.own.discard(cell)
            if known:
                self.said.pop((cell, FREE), None)
                self.said.pop((cell, OCCUPIED), None)

    def add(self, cell, value) -> None:
        changed = np.float32(self.log_odds.get(cell, np.float32(0.0)) + (HIT if value == OCCUPIED else MISS))
        self.log_odds[cell] = min(max(changed, LOW), HIGH)

    def sense(self, cells) -> int:
        fresh = sum(cell not in self.log_odds for cell, _ in cells)
        for cell, value in cells:
            if cell not in self.own:
                self.log_odds.pop(cell, None)
            self.own.add(cell)
            self.add(cell, value)
        return fresh

    def hear(self, sender, belief, cells) -> int:
        fresh = 0
        for cell, value in cells:
            if cell in self.own:
                continue
            sayers = self.said.setdefault((cell, value), set())
            sayers.add(sender)
            if len(sayers) >= self.quorum and not (belief and cell in self.log_odds):
                fresh += cell not in self.log_odds
                self.add(cell, value)
        return fresh


def cells_of(tile, origin):
    """The cells of a tile that are on the map, with what it shows."""
    for (r, c), value in np.ndenumerate(tile):
        cell = (r + int(origin[0]), c + int(origin[1]))
        if value != UNKNOWN and 0 <= cell[0] < SHAPE[0] and 0 <= cell[1] < SHAPE[1]:
            yield cell, int(value)


@settings(derandomize=True, deadline=None, max_examples=25)
@given(st.integers(0, 2**32 - 1), st.integers(1, 3), st.booleans())
def test_wary_grids_are_those_of_a_plain_believer(seed, quorum, fades) -> None:
    chance = np.random.default_rng(seed)
    ours, plain = QuorumGrids(grids(), quorum), [Believer(quorum) for _ in range(SWARM)]
    for _ in range(18):
        alive = chance.random(SWARM) < 0.8
        tiles = Tiles(
            chance.integers(0, 3, (SWARM, *TILE)).astype(np.uint8),
            chance.integers(-2, 8, (SWARM, 2)).astype(np.int32),
        )
        heard = int(chance.integers(0, 10))
        receivers = np.sort(chance.integers(0, SWARM, heard)).astype(np.int32)
        inbox = items(
            receivers,
            chance.integers(0, 64, heard).astype(np.int32) % 7,
            chance.integers(0, 3, (heard, *TILE)).astype(np.uint8),
            chance.integers(-2, 8, (heard, 2)).astype(np.int32),
            chance.integers(-1, 2, heard).astype(np.int32),
            np.zeros(heard, np.int32),
        )
        fresh = ours.update(alive, tiles, inbox)
        expected = np.zeros(SWARM + heard, int)
        for robot in np.flatnonzero(alive):
            expected[robot] = plain[robot].sense(list(cells_of(tiles.values[robot], tiles.origins[robot])))
        for row in np.argsort(inbox.content.sources < 0, kind="stable"):
            cells = list(cells_of(inbox.content.values[row], inbox.content.origins[row]))
            believer = plain[inbox.receivers[row]]
            expected[SWARM + row] = believer.hear(int(inbox.senders[row]), inbox.content.sources[row] < 0, cells)
        assert_array_equal(fresh, expected)
        for robot, believer in enumerate(plain):
            known = {tuple(cell) for cell in np.argwhere(ours.observed[robot]).tolist()}
            assert known == set(believer.log_odds)
            for cell, log_odds in believer.log_odds.items():
                assert_allclose(ours.log_odds[robot][cell], log_odds, rtol=1e-6)
            if fades:
                gone = chance.random(SHAPE) < 0.05
                ours.observed[robot][gone] = False
                ours.log_odds[robot][gone] = 0.0
                believer.reset([tuple(cell) for cell in np.argwhere(gone).tolist()])


def told(quorum: int, *messages: tuple[int, int], own: int = UNKNOWN, swarm: int = 200) -> float:
    """The log-odds of one cell after its robot was told so (sender, value), one a iteration, then sensed it."""
    wary = QuorumGrids(OccupancyGrids(swarm, Lattice(0.0, 0.0, 0.15, 1, 8), 0.9, 0.4, 0.12, 0.97), quorum)
    alive = np.arange(swarm) == 0
    tiles, origins = np.zeros((swarm, 1, 1), np.uint8), np.zeros((swarm, 2), np.int32)
    for sender, value in messages:
        inbox = inbox_of(np.zeros(1, np.int32), [sender], np.full((1, 1, 1), value, np.uint8), origins[:1])
        wary.update(alive, Tiles(tiles, origins), inbox)
    tiles[0] = own
    nobody = np.empty(0, np.int32)
    wary.update(alive, Tiles(tiles, origins), inbox_of(nobody, nobody, tiles[:0], origins[:0]))
    return float(wary.log_odds[0, 0, 0])


def test_one_voice_however_loud_is_no_quorum() -> None:
    assert told(2, *[(5, OCCUPIED)] * 10) == 0.0
    assert told(2, (5, OCCUPIED), (6, FREE), (5, OCCUPIED)) == 0.0
    assert told(2, (5, OCCUPIED), (6, OCCUPIED)) == pytest.approx(HIT)
    assert told(3, (5, OCCUPIED), (6, OCCUPIED)) == 0.0
    assert told(3, (5, FREE), (6, FREE), (9, OCCUPIED), (7, FREE)) == pytest.approx(MISS)


def test_senders_who_differ_by_64_count_as_one() -> None:
    assert told(2, (5, FREE), (69, FREE), (133, FREE)) == 0.0
    assert told(2, (5, FREE), (69, FREE), (70, FREE)) == pytest.approx(MISS)
    assert told(64, *[(sender, FREE) for sender in range(1, 65)]) == pytest.approx(MISS)
    assert told(64, *[(sender, FREE) for sender in range(1, 64)]) == 0.0


@pytest.mark.parametrize("quorum", [1, 2])
def test_what_a_robot_senses_voids_all_that_it_was_told(quorum) -> None:
    assert told(quorum, *[(sender, OCCUPIED) for sender in range(1, 9)]) > 2.0
    assert told(quorum, *[(sender, OCCUPIED) for sender in range(1, 9)], own=FREE) == pytest.approx(MISS)


def test_a_robot_that_loses_its_map_loses_what_it_was_told() -> None:
    wary = QuorumGrids(grids(2), 2)
    alive, origins = np.ones(2, bool), np.array([[0, 0], [3, 4]], np.int32)
    tiles = Tiles(np.full((2, *TILE), FREE, np.uint8), origins)

    def hear(sender: int) -> None:
        wary.update(
            alive, tiles, inbox_of(np.zeros(1, np.int32), [sender], tiles.values[:1], np.array([[0, 5]], np.int32))
        )

    hear(1)
    wary.reset(np.array([0]))
    hear(2)
    assert wary.observed[0].sum() == 6
    hear(1)
    assert wary.observed[0].sum() == 12


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"quorum": 2}, "quorum: robots with trust 'all' need none; expected trust = 'quorum'"),
        ({"trust": "own", "quorum": 2}, "quorum: robots with trust 'own' need none"),
        ({"trust": "quorum", "quorum": 3}, "quorum: 3 of 2 others never agree; expected 2 at most"),
    ],
)
def test_a_quorum_that_means_nothing_is_refused(keys, words) -> None:
    place = setting_of(3, SHAPE, 1)
    with pytest.raises(InputError, match=words):
        Mapper(**keys).build(place)


# --- against liars -------------------------------------------------------------------------------


def deceived(trust: str, *, liars: int = 1, failure: str = "occupied", seed: int = 1) -> float:
    """The share of the cells on honest robots' maps that they take for walls and that are none."""
    fault = f'{{use="byzantine", failure="{failure}", at=0, robots={list(range(liars))}}}'
    run = made(
        f"seed={seed}", f"faults=[{fault}]", f"mind.computation={trust}", "stop.iterations=80", scenario="basilica"
    )
    run.simulation.run()
    parts = run.simulation.parts
    known = parts.computation.maps.observed[liars:] & parts.building.explorable
    false = known & (parts.computation.maps.log_odds[liars:] > 0.0) & ~parts.building.occupied
    return float(false.sum() / known.sum())


def test_a_quorum_withstands_one_liar_and_ones_own_eyes_soften_it() -> None:
    everybody, own, quorum = (
        np.mean([deceived(f'{{trust="{trust}"}}', seed=seed) for seed in (1, 2)]) for trust in ("all", "own", "quorum")
    )
    assert everybody > 0.02
    assert own < everybody
    assert quorum == 0.0


def test_liars_who_are_as_many_as_the_quorum_are_believed_and_one_more_witness_stops_them() -> None:
    assert deceived('{trust="quorum", quorum=2}', liars=2) > 0.0
    assert deceived('{trust="quorum", quorum=3}', liars=2) == 0.0


def test_a_quorum_of_names_is_no_defence_against_one_robot_that_invents_them() -> None:
    """Every false name counts as a sender: the limit that QuorumGrids states."""
    faults = (
        '{use="byzantine", failure="occupied", at=0, robots=[0]}, {use="byzantine", failure="spoof", at=0, robots=[0]}'
    )
    run = made(f"faults=[{faults}]", 'mind.computation.trust="quorum"', "stop.iterations=80", scenario="basilica")
    run.simulation.run()
    parts = run.simulation.parts
    false = parts.computation.maps.observed[1:] & (parts.computation.maps.log_odds[1:] > 0.0) & ~parts.building.occupied
    assert (false & parts.building.explorable).any()
