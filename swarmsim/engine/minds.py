"""The minds of a run, guarded where they are third-party ones."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

from swarmsim.core import assembly
from swarmsim.core.assembly import BuiltMind
from swarmsim.core.context import BuildContext
from swarmsim.core.parts import AnyComputation, AnyStrategy
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.file import Scenario
from swarmsim.engine.foreign import make
from swarmsim.engine.guard import Clock, held

P = TypeVar("P")


def built_for(scenario: Scenario, context: BuildContext) -> list[BuiltMind]:
    """The minds of a setting's robots; minds without any of these robots are left out. Raises InputError."""
    return assembly.built_for(scenario, context, make)


def together(
    found: Sequence[BuiltMind], scenario: Scenario, clock: Clock | None = None, strict: bool = False
) -> tuple[AnyComputation, AnyStrategy]:
    """The computation and the strategy of all robots of these minds.

    With a clock, third-party halves are guarded, or all if `strict`. Raises InputError for too many kinds of messages.
    """

    def hold(seam: str, part: P, one: BuiltMind) -> P:
        ours = registry.is_ours(part)
        if clock is None or (ours and not strict):
            return part
        found: P = held(seam, part, one.context, clock, not ours, f" of group {one.names[0]!r}")
        return found

    return assembly.together(found, scenario, hold)
