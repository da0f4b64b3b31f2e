"""What a fault needs of a computation besides its seam's verbs is asked for, whatever stands around the computation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
from conftest import made, setting_of
from numpy.typing import NDArray

from swarmsim.core.capabilities import CHARTED, FALSIFIABLE, QUANTIFIED, LackingError, Lie
from swarmsim.core.errors import InputError
from swarmsim.core.messages import Broadcast, MessageBatch
from swarmsim.core.scenario.registry import own_code
from swarmsim.core.state import Estimates
from swarmsim.engine.guard import Clock, held
from swarmsim.faults.byzantine import Replayed
from swarmsim.faults.delegate import ComputationDelegate

POSITIONS = 'mind={computation={use="positions"}, strategy={use="wander"}}'


@dataclass(frozen=True, slots=True, eq=False)
class Numbers(MessageBatch):
    """Numbers, with who said them first."""

    PROVENANCE: ClassVar[tuple[str, ...]] = ("said_by",)
    SOURCE: ClassVar[str] = "said_by"
    SILENT: ClassVar[Mapping[str, int]] = {"number": -1}

    number: NDArray[np.float64]  # (t,)
    said_by: NDArray[np.int32]  # (t,)


class Telling:
    """A computation that nothing but its capabilities is known of."""

    knowledge_type = Estimates
    lies: ClassVar = {"larger": Lie(lambda items, rows, offset: items)}

    def amounts(self) -> NDArray[np.int64]:
        return np.array([3, 1])

    def say(self, senses: object) -> None: ...

    def hear(self, senses: object, inbox: object) -> None: ...

    def reset(self, robots: object) -> None: ...

    def copy_from(self, robots: object, source: object) -> None: ...


@pytest.mark.parametrize(
    "around",
    [lambda one: one, ComputationDelegate, lambda one: held("computation", one, setting_of(2), Clock())],
    ids=["itself", "wrapped", "held to its contract"],
)
def test_a_capability_is_found_through_whatever_wraps_a_computation(around) -> None:
    part = around(Telling())
    assert QUANTIFIED.needed(part, "x").amounts().tolist() == [3, 1]
    assert list(FALSIFIABLE.needed(part, "x").lies) == ["larger"]
    assert CHARTED.of(part) is None


def test_what_lacks_a_capability_is_told_with_what_it_would_need_to_have() -> None:
    with pytest.raises(LackingError, match=r"^map: 'copied' needs a computation that tells how much .*no 'amounts'$"):
        QUANTIFIED.needed(object(), "map: 'copied'")


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ('use="join", at=3, map="copied"', r"map: 'copied' needs .*; 'positions' does not: it has no 'amounts'$"),
        ('use="mind", at=3, failure="random-walk"', r"failure: 'random-walk' .*'positions' .* no 'terrain'$"),
        (
            'use="byzantine", at=3, failure="free"',
            r"failure: 'free' .*'positions' .*'lies'; expected 'replay' or 'spoof'$",
        ),
    ],
)
def test_a_fault_that_needs_what_a_computation_lacks_is_refused_when_the_run_is_built(fault: str, words: str) -> None:
    with pytest.raises(InputError, match=rf"wandering\.toml: faults\[0\]\.{words}"):
        made(POSITIONS, f"faults=[{{{fault}}}]", scenario="operations/wandering")


MEGAPHONE = """
from dataclasses import replace

import numpy as np
from msgspec import Struct
from swarmsim.core.capabilities import Lie
from swarmsim.operations.placement.positions import TellPositions


def farther(items, rows, offset):
    return replace(items, x=items.x + np.where(rows, float(offset[0]), 0.0))


class Megaphone(Struct, frozen=True):
    def build(self, context):
        return Voice(TellPositions().build(context))


class Voice:
    lies = {"farther": Lie(farther, "[metres, 0]")}

    def __init__(self, inner):
        self.inner, self.knowledge_type, self.codec = inner, inner.knowledge_type, inner.codec
        self.say, self.hear, self.reset, self.copy_from = inner.say, inner.hear, inner.reset, inner.copy_from
"""


def test_a_computation_of_ones_own_can_have_lies_of_its_own(tmp_path: Path) -> None:
    (tmp_path / "voice.py").write_text(MEGAPHONE)
    mind = f'mind={{computation={{use="{tmp_path}/voice.py:Megaphone"}}, strategy={{use="wander"}}}}'
    lie = 'faults=[{use="byzantine", failure="farther", %sat=0, robots=[1]}]'
    with own_code(True):
        run = made(mind, lie % "offset=[7, 0], ", 'network.topology={use="full"}', scenario="operations/wandering")
        with pytest.raises(InputError, match=r"offset: required key is missing; expected \[metres, 0\] for failure"):
            made(mind, lie % "", scenario="operations/wandering")
    moment = run.simulation.tick()
    inbox, pose = moment.inbox, moment.state.pose
    assert set(inbox.senders) > {1}
    np.testing.assert_allclose(inbox.content.x, pose[inbox.senders, 0] + 7.0 * (inbox.senders == 1))


def test_a_replay_keeps_where_items_come_from_and_says_no_more_than_there_was() -> None:
    def said(numbers: list[float], by: int) -> Broadcast[Numbers]:
        items = Numbers(np.array(numbers), np.full(len(numbers), by, np.int32))
        return Broadcast(items, np.array([len(numbers)]), np.array([9], np.int32))

    replayed = Replayed(1)
    replayed(said([1.0, 2.0], 5), np.zeros(2, np.bool_))
    message = replayed(said([3.0, 4.0, 6.0], 8), np.ones(3, np.bool_))
    assert message.content.number.tolist() == [1.0, 2.0]
    assert message.content.said_by.tolist() == [8, 8]
