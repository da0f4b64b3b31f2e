"""Pieces of a domain: connected, about equal, and each cell in one; and what check_job finds in jobs."""

from __future__ import annotations

import numpy as np
import pytest
from networks import FREE, Heat
from scipy import ndimage

from swarmsim.core.errors import InputError
from swarmsim.core.jobs import Domain
from swarmsim.core.lattice import Lattice
from swarmsim.jobs.pieces import bisected, joined, joints
from swarmsim.testing import BrokenError, check_job

LATTICE = Lattice(0.0, 0.0, 0.5, *FREE.shape)


@pytest.mark.parametrize("count", [1, 2, 7, 20])
@pytest.mark.parametrize("halo", [0, 1, 3])
def test_pieces_are_connected_and_about_equal_and_halos_are_what_a_walk_reaches(count: int, halo: int) -> None:
    pieces = bisected(Domain(LATTICE, FREE), count, halo)
    of = np.full(FREE.shape, -1)
    for one in pieces:
        assert (of[tuple(one.cells.T)] == -1).all()
        of[tuple(one.cells.T)] = one.number
        assert ndimage.label(of == one.number)[1] == 1
    assert ((of >= 0) == FREE).all()
    sizes = [len(one.cells) for one in pieces]
    assert max(sizes) <= 1.6 * FREE.sum() / count
    for one in pieces:
        near = of == one.number
        for _ in range(halo):
            grown = near.copy()
            grown[1:] |= near[:-1]
            grown[:-1] |= near[1:]
            grown[:, 1:] |= near[:, :-1]
            grown[:, :-1] |= near[:, 1:]
            near = grown & FREE
        assert {*map(tuple, one.halo.tolist())} == {*map(tuple, np.argwhere(near & (of != one.number)).tolist())}
        assert (of[tuple(one.halo.T)] == one.owners).all()


def test_joints_bring_each_value_to_its_cell() -> None:
    pieces = bisected(Domain(LATTICE, FREE), 7, 2)
    place = [one.cells[:, 0] * 100.0 + one.cells[:, 1] for one in pieces]
    for one, mine in zip(pieces, joints(pieces), strict=True):
        shown = [place[joint.piece][pieces[joint.piece].rim] for joint in mine]
        assert joined(one, mine, shown).tolist() == (one.halo[:, 0] * 100.0 + one.halo[:, 1]).tolist()


def test_a_domain_in_two_parts_is_cut_between_them_first() -> None:
    free = FREE.copy()
    free[6] = False
    assert all(ndimage.label(_mask(one))[1] == 1 for one in bisected(Domain(LATTICE, free), 6, 1))


def _mask(piece):
    mask = np.zeros(FREE.shape, bool)
    mask[tuple(piece.cells.T)] = True
    return mask


def test_more_pieces_than_cells_are_refused() -> None:
    with pytest.raises(InputError, match=r"pieces: 999 of \d+ free cells; expected 1 to"):
        bisected(Domain(LATTICE, FREE), 999, 1)


class Counting(Heat):
    def step(self, piece, state, around, step):
        self.rate *= 0.5
        return super().step(piece, state, around, step)


class Peeking(Heat):
    def start(self, piece, sensed):
        self.seen = getattr(self, "seen", 0.0) + sensed[0]
        return super().start(piece, sensed)

    def step(self, piece, state, around, step):
        return super().step(piece, state, around, step) + self.seen


class Writing(Heat):
    def step(self, piece, state, around, step):
        state += 1.0
        return state


class Halves(Heat):
    def start(self, piece, sensed):
        return super().start(piece, sensed).astype(np.float32)


class Alone(Heat):
    def step(self, piece, state, around, step):
        return super().step(piece, state, around * 0.0, step)


class Twice(Heat):
    def pieces(self, domain):
        return (*super().pieces(domain)[:-1], super().pieces(domain)[0])


class Plain(Heat):
    def start(self, piece, sensed):
        return sensed + 0.01 * piece.cells[:, 0] ** 2


def test_a_job_that_keeps_to_its_verbs_passes() -> None:
    check_job(Plain(), FREE)


@pytest.mark.parametrize(
    ("job", "told"),
    [
        (Counting, "step: piece 0 gives other bits the second time"),
        (Peeking, r"start|step: piece \d"),
        (Writing, "it may not change what it is given"),
        (Halves, "start: float32; expected float64"),
        (Alone, r"7 pieces and one differ by"),
        (Twice, "pieces: number 0 at place 6"),
    ],
)
def test_a_job_that_cheats_is_found(job: type, told: str) -> None:
    with pytest.raises(BrokenError, match=told):
        check_job(job(), FREE)
