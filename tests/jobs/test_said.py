"""What a job in pieces says: how many bytes, in which form, and states of any shape; and what it keeps meanwhile."""

from __future__ import annotations

import numpy as np
import pytest
from networks import Heat, Swarm

from swarmsim.core.messages import HEADER, FrameError
from swarmsim.jobs.alone import alone
from swarmsim.jobs.facts.wire import Fact, FactCodec, Facts, long, short
from swarmsim.jobs.pieces import given
from swarmsim.jobs.reports import REPORT, SHOW, STATE, PieceClaim, Report
from swarmsim.operations.methods.explicit import Explicit
from swarmsim.operations.methods.problem import Problem
from swarmsim.operations.models.diffusion import Diffusion
from swarmsim.operations.models.job import ModelJob
from swarmsim.testing import check_job

LOSSY = {"use": "bernoulli", "loss": 0.3}


@pytest.mark.parametrize("channel", [{"use": "perfect"}, LOSSY])
def test_messages_are_as_long_as_they_say_and_survive_packing(channel: dict) -> None:
    swarm, kinds = Swarm(topology="ring", channel=channel, limit=40), set()
    say = swarm.runtime.say

    def checked(senses):
        said = say(senses)
        for robot, size in enumerate(said.sizes.tolist()):
            facts = said.of(robot)
            data = swarm.runtime.codec.pack(robot, 5, facts) if len(facts) else b""
            assert len(data) == size
            assert not size or swarm.runtime.codec.unpack(data)[2].rows() == facts.rows()
            kinds.update(fact.kind for fact in facts.rows())
        return said

    swarm.runtime.say = checked
    swarm.run()
    assert kinds == {REPORT, SHOW, STATE}


def test_short_numbers_have_seven_bits_a_byte_and_torn_messages_are_refused() -> None:
    numbers = [0, 1, 127, 128, 16383, 16384, 1 << 40]
    assert [len(short([one])) for one in numbers] == [1, 1, 1, 2, 2, 3, 6]
    assert long(short(numbers)) == numbers
    facts = [
        Fact(STATE, 70_000, 1 << 20, 300, b"\0a\0"),
        Fact(SHOW, 0),
        Report(9, {3: PieceClaim(7, 2, 5)}, {4: 5}).fact(2, 1),
    ]
    codec, data = FactCodec(compact=True), FactCodec(compact=True).pack(3, 9, Facts.of(facts))
    assert codec.unpack(data)[2].rows() == facts
    assert len(data) == HEADER.size + sum(map(codec.size, facts))
    assert Report.of(facts[2]) == Report(9, {3: PieceClaim(7, 2, 5)}, {4: 5})
    for torn in (data[:-1], data[:-9], data + b"\x80"):
        with pytest.raises(ValueError, match=r"does not end|up to byte"):
            codec.unpack(torn)


ROWS = short([1, 3]) + bytes(24)
FORGED = {
    "robot or piece 7; expected 0 to 6": Fact(STATE, 7, 5),
    "robot or piece 9; expected 0 to 6": Report(3, {}, {}).fact(9, 1),
    "piece 2: step 21; expected 20 at most": Fact(STATE, 2, 21),
    "piece 2: a state for 1; expected 0": Fact(STATE, 2, 5, 1, ROWS),
    "1 axes of .3., and 23 bytes; expected 24": Fact(STATE, 2, 5, 0, ROWS[:-1]),
    "2 axes of .0, 4398046511104., and 0 bytes": Fact(STATE, 2, 5, 0, short([2, 0, 1 << 42])),
    "40 axes of": Fact(STATE, 2, 5, 0, short([40, *[1] * 40]) + bytes(8)),
    "a report of exchange 2147483648, 1 hops away": Report(1 << 31, {}, {}).fact(2, 1),
    "a report of exchange 3, 255 hops away": Report(3, {}, {}).fact(2, 255),
    "a report of 1 numbers; expected 201, and two": Fact(REPORT, 2, 3, 1, short([50])),
    "robot 2 claims piece 1: .21, 0, 0.; expected": Report(3, {1: PieceClaim(21)}, {}).fact(2, 1),
    "robot 2 claims piece 9": Report(3, {9: PieceClaim(1)}, {}).fact(2, 1),
    "robot 2 claims piece 1: .1, 65536, 0.": Report(3, {1: PieceClaim(1, 1 << 16)}, {}).fact(2, 1),
    "robot 2 claims piece 1: .1, 0, 1099511627776.": Report(3, {1: PieceClaim(1, 0, 1 << 40)}, {}).fact(2, 1),
    "robot 2 keeps step 21 of piece 1": Report(3, {}, {1: 21}).fact(2, 1),
    "a report of pieces out of order": Fact(REPORT, 2, 3, 1, short([0, 4, 5, 1, 5])),
    "a report of pieces .*more than once": Fact(REPORT, 2, 3, 1, short([0, 4, 5, 4, 5])),
    "piece 2: for the readers 0; expected": Fact(SHOW, 2, 5, 0, b""),
    "piece 2: for the readers 10{40}; expected": Fact(SHOW, 2, 5, 1 << 40, b"\1"),
    "piece 2: no hops for each of 1 readers": Fact(SHOW, 2, 5, 1, b"\xff"),
    "piece 2: values of shape .0,.; expected": Fact(SHOW, 2, 5, 1, b"\1" + short([1, 0])),
}


@pytest.mark.parametrize("told", FORGED)
def test_what_no_robot_can_have_said_of_its_pieces_is_refused_in_words(told: str) -> None:
    codec = Swarm().runtime.codec
    with pytest.raises(FrameError, match=told):
        codec.unpack(codec.pack(3, 9, Facts.of([FORGED[told]])))


def test_numbers_longer_than_they_have_to_be_are_refused() -> None:
    for data, told in ((b"\x80\0", "ends in 0 at byte 2"), (b"\xff" * 9 + b"\1", "does not end by byte 9")):
        with pytest.raises(FrameError, match=told):
            long(data)


@pytest.mark.parametrize(("loss", "most"), [(0.0, 6.0), (0.3, 14.0)])
def test_values_are_said_a_few_times_and_not_by_everybody(loss: float, most: float) -> None:
    """On a ring of seven, what a piece shows has to be said at least once, and passed on by those on its way alone."""
    swarm = Swarm(Heat(steps=40, level=20), topology="ring", channel={"use": "bernoulli", "loss": loss})
    said, plan = [0], swarm.runtime._plan
    say = swarm.runtime.say

    def counted(senses):
        found = say(senses)
        said[0] += sum(8 * plan.rows(one.key, one.robot)[0] for one in found.content.rows() if _full(plan, one))
        return found

    swarm.runtime.say = counted
    assert swarm.run().exact
    least = sum(8 * len(one.rim) for one in plan.pieces) * plan.steps
    assert least <= said[0] < most * least


def _full(plan, fact: Fact) -> bool:
    return fact.kind == SHOW and len(fact.value) > len(plan.named(fact.key, fact.robot))


class Growing(Heat):
    """The same, with each state after the first of a level twice, one below the other, and longer in odd pieces."""

    def shows(self, piece, state, step):
        return super().shows(piece, state[: len(piece.cells)], step)

    def step(self, piece, state, around, step):
        found = super().step(piece, state[: len(piece.cells)], around, step)
        return found if (step + 1) % self.level == 0 else np.tile(found, 2 + piece.number % 2)

    def answer(self, piece, state):
        return state[: len(piece.cells)]


def test_states_may_have_another_shape_in_each_piece_and_step() -> None:
    check_job(Growing(rate=0.1), whole=None)
    dead = {13: [1], 40: [4]}
    swarm = Swarm(Growing(level=5, steps=60), topology="ring", channel=LOSSY, deaths=dead, limit=600).run()
    assert swarm.exact
    assert swarm.parcel.counts[:, 2].sum() > 0


def test_mass_is_kept_in_each_level_while_pieces_are_taken_over() -> None:
    swarm = Swarm(limit=900)
    domain = given(swarm.context)
    problem = Problem(Diffusion(diffusivity=0.05).on(domain), lambda cells, begin, end: np.zeros(len(cells)), 0.8)
    job = ModelJob.of(problem, Explicit(level=6), domain, 7, 60)
    sensed = [Bump().value(0.0, domain.lattice.centres(one.cells)) for one in job.cut]
    masses = {(piece, 0): float(values.sum()) for piece, values in enumerate(sensed)}

    def strike(now: int, same: Swarm) -> list[int]:
        for states in same.parcel.states if now else ():
            for piece, (step, state) in states.items():
                assert masses.setdefault((piece, step), float(state.sum())) == float(state.sum())
        return {15: [2], 60: [5], 110: [0, 3]}.get(now, [])

    swarm = Swarm(job, topology="ring", channel=LOSSY, strike=strike, field_=Bump(), keys={"value": 8}, limit=900).run()
    for piece, state in enumerate(alone(job, job.cut, sensed)):
        assert swarm.parcel.answers(swarm.alive)[piece].tobytes() == job.answer(job.cut[piece], state).tobytes()
    assert swarm.parcel.counts[:, 2].sum() >= 4
    masses |= {(piece, 60): float(state.sum()) for piece, state in swarm.parcel.answers(swarm.alive).items()}
    levels = np.array([[masses[piece, step] for piece in range(7)] for step in range(0, 61, 6)])
    total = levels.sum(axis=1)
    assert np.abs(total / total[0] - 1.0).max() < 1e-12
    assert np.abs(levels[-1] - levels[0]).max() > 1e-2 * total[0]  # and it moves from piece to piece


class Bump:
    def value(self, time, points):
        return np.exp(-((points - (2.0, 2.5)) ** 2).sum(axis=1))
