"""The minds of a run: one for all robots, or one for each kind of group, combined."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.groups import Band, GroupComputation, Groups, GroupStrategy
from swarmsim.core.kinds import MOST, Roster
from swarmsim.core.parts import AnyComputation, AnyStrategy
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.file import Minded, Scenario, minds_of
from swarmsim.engine.foreign import make
from swarmsim.engine.guard import Clock, held

P = TypeVar("P")


@dataclass(frozen=True, slots=True, eq=False)
class BuiltMind:
    """One mind, built for the robots present."""

    minded: Minded
    names: tuple[str, ...]  # of its robots' groups; empty: all robots
    rows: NDArray[np.int64]  # (r,): its robots' rows among all
    places: tuple[int, ...]  # its robots' columns among all readings
    context: BuildContext
    computation: AnyComputation
    strategy: AnyStrategy


def built_for(scenario: Scenario, context: BuildContext) -> list[BuiltMind]:
    """The minds of a setting's robots; minds without any of these robots are left out. Raises InputError."""
    found = minds_of(scenario)
    if len(found) == 1:
        everybody, columns = np.arange(len(context.ids)), tuple(range(len(context.channels)))
        return [_built(found[0], (), everybody, columns, context)]
    made = []
    for one in found:
        everybody = np.flatnonzero(np.isin(_groups(scenario), one.groups))
        rows = np.flatnonzero(np.isin(context.ids, everybody))
        if len(rows):
            channels, columns = context.channels.of(everybody)
            own = replace(context, robots=context.robots.of(rows), ids=context.ids[rows], channels=channels)
            names = tuple(context.robots.names[number] for number in one.groups)
            made.append(_built(one, names, rows, columns, own))
    return made


def _groups(scenario: Scenario) -> NDArray[np.int64]:
    """Each robot's group number (N,)."""
    groups = scenario.robots.groups
    return np.repeat(np.arange(len(groups)), [group.count for group in groups])


def _built(
    minded: Minded, names: tuple[str, ...], rows: NDArray[np.int64], columns: tuple[int, ...], context: BuildContext
) -> BuiltMind:
    mind, places = minded.mind, minded.places
    return BuiltMind(
        minded, names, rows, columns, context,
        make(mind.computation, context, places["computation"]), make(mind.strategy, context, places["strategy"]),
    )  # fmt: skip


def together(
    found: Sequence[BuiltMind], scenario: Scenario, clock: Clock | None = None, strict: bool = False
) -> tuple[AnyComputation, AnyStrategy]:
    """The computation and the strategy of all robots of these minds.

    With a clock, third-party halves are guarded, or all if `strict`. Raises InputError for too many kinds of messages.
    """
    minds = minds_of(scenario)
    if len(minds) == 1:
        return found[0].computation, found[0].strategy
    kinds = {part: kind for kind, part in enumerate(dict.fromkeys(one.mind.computation for one in minds))}
    if len(kinds) > MOST:
        raise InputError(f"robots: groups say messages of {len(kinds)} kinds; expected {MOST} at most")
    of_groups = {group: kinds[one.mind.computation] for one in minds for group in one.groups}
    roster = Roster.of(scenario.robots.names, _groups(scenario), [of_groups[group] for group in sorted(of_groups)])
    bands = [_band(one, kinds[one.minded.mind.computation], clock, strict) for one in found]
    groups = Groups(bands, roster, found[0].context.actuators)
    return GroupComputation(groups), GroupStrategy(groups)


def _band(one: BuiltMind, kind: int, clock: Clock | None, strict: bool) -> Band:
    """The robots of one mind, with its halves guarded where needed."""
    computation, strategy = one.computation, one.strategy
    if clock is not None and (strict or not registry.is_ours(computation)):
        computation = _held("computation", computation, one, clock)
    if clock is not None and (strict or not registry.is_ours(strategy)):
        strategy = _held("strategy", strategy, one, clock)
    return Band(one.names, one.rows, kind, one.context.channels, one.places, computation, strategy)


def _held(seam: str, part: P, one: BuiltMind, clock: Clock) -> P:
    found: P = held(seam, part, one.context, clock, not registry.is_ours(part), f" of group {one.names[0]!r}")
    return found
