"""The minds of a swarm, or of some of its robots: one for all, or one for each kind of group, combined."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.groups import Band, GroupComputation, Groups, GroupStrategy
from swarmsim.core.kinds import MOST, Roster
from swarmsim.core.parts import AnyComputation, AnyStrategy
from swarmsim.core.scenario.file import Manned, Minded, minds_of
from swarmsim.core.scenario.part import Part

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


class Make(Protocol):
    """Builds a part; a problem is told with the part's place in the scenario."""

    def __call__(self, part: Part[P], context: BuildContext, place: str) -> P: ...


class Hold(Protocol):
    """Gives a half of a mind, guarded or as it is."""

    def __call__(self, seam: str, part: P, one: BuiltMind) -> P: ...


def unguarded(seam: str, part: P, one: BuiltMind) -> P:
    """The half itself."""
    return part


def as_it_is(part: Part[P], context: BuildContext, place: str) -> P:
    """A part built without guards. Raises InputError that starts with its place in the scenario."""
    try:
        return part.build(context)
    except InputError as problem:
        raise problem.inside(place) from problem


def built_for(swarm: Manned, context: BuildContext, make: Make = as_it_is) -> list[BuiltMind]:
    """The minds of a context's robots; minds without any of these robots are left out. Raises InputError."""
    found = minds_of(swarm)
    if len(found) == 1:
        everybody, columns = np.arange(len(context.ids)), tuple(range(len(context.channels)))
        return [_built(found[0], (), everybody, columns, context, make)]
    made = []
    for one in found:
        everybody = np.flatnonzero(np.isin(_groups(swarm), one.groups))
        rows = np.flatnonzero(np.isin(context.ids, everybody))
        if len(rows):
            channels, columns = context.channels.of(everybody)
            own = replace(context, robots=context.robots.of(rows), ids=context.ids[rows], channels=channels)
            names = tuple(context.robots.names[number] for number in one.groups)
            made.append(_built(one, names, rows, columns, own, make))
    return made


def _groups(swarm: Manned) -> NDArray[np.int64]:
    """Each robot's group number (N,)."""
    groups = swarm.robots.groups
    return np.repeat(np.arange(len(groups)), [group.count for group in groups])


def _built(
    minded: Minded, names: tuple[str, ...], rows: NDArray[np.int64], columns: tuple[int, ...], context: BuildContext,
    make: Make,
) -> BuiltMind:  # fmt: skip
    mind, places = minded.mind, minded.places
    return BuiltMind(
        minded, names, rows, columns, context,
        make(mind.computation, context, places["computation"]), make(mind.strategy, context, places["strategy"]),
    )  # fmt: skip


def together(found: Sequence[BuiltMind], swarm: Manned, hold: Hold = unguarded) -> tuple[AnyComputation, AnyStrategy]:
    """The computation and the strategy of all robots of these minds; `hold` is asked for the halves of several.

    Raises InputError for too many kinds of messages.
    """
    minds = minds_of(swarm)
    if len(minds) == 1:
        return found[0].computation, found[0].strategy
    kinds = {part: kind for kind, part in enumerate(dict.fromkeys(one.mind.computation for one in minds))}
    if len(kinds) > MOST:
        raise InputError(f"robots: groups say messages of {len(kinds)} kinds; expected {MOST} at most")
    of_groups = {group: kinds[one.mind.computation] for one in minds for group in one.groups}
    roster = Roster.of(swarm.robots.names, _groups(swarm), [of_groups[group] for group in sorted(of_groups)])
    bands = [
        Band(
            one.names, one.rows, kinds[one.minded.mind.computation], one.context.channels, one.places,
            hold("computation", one.computation, one), hold("strategy", one.strategy, one),
        )
        for one in found
    ]  # fmt: skip
    groups = Groups(bands, roster, found[0].context.actuators)
    return GroupComputation(groups), GroupStrategy(groups)
