"""What a robot in a process of its own reports of its knowledge, and how the reports of all become a swarm's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import Any, Final, Protocol

import numpy as np

from swarmsim.core.adapters.minds import OwnMinds
from swarmsim.core.capabilities import Capability
from swarmsim.core.errors import InputError
from swarmsim.core.messages import FrameError, Inbox, MessageBatch
from swarmsim.core.parts import AnyComputation
from swarmsim.core.readings import Column
from swarmsim.core.state import Estimates, Knowledge

Report = tuple[Column, ...]  # of one robot, in one iteration


class Reporting(Protocol):
    """A computation whose knowledge is more than a few numbers for each robot."""

    def report(self, knowledge: Any) -> Report:  # noqa: ANN401 - the computation's own type
        """What the only robot that it serves has learned in this iteration, from what `hear` gave."""
        ...

    def adopt(self, reports: Sequence[Report], inbox: Inbox[Any]) -> Knowledge:
        """The knowledge of all robots that it serves, in row order, from what each has reported and heard.

        Raises FrameError for what cannot have been reported.
        """
        ...


class Combining(Protocol):
    """A computation whose reports tell what is new: several have to be combined, and none is not the last one again."""

    def combined(self, row: int, before: Report, came: Sequence[Report]) -> Report:
        """Join the reports of a robot that `came` in an iteration into one; there may be none.

        `before` is what it reported last before these; `row` is the robot's.
        """
        ...


REPORTING: Final[Capability[Reporting]] = Capability(Reporting, "reports what a robot has learned")

COMBINING: Final[Capability[Combining]] = Capability(
    Combining, "combines what a robot has learned in several iterations"
)


def check_reports(computation: AnyComputation) -> None:
    """Raise InputError for a computation whose knowledge cannot be reported."""
    kind = computation.knowledge_type
    if REPORTING.of(computation) is None and not _is_plain(kind):
        raise InputError(
            f"mind.computation: nobody can report {kind.__name__}; expected Estimates, or a computation with 'report' "
            "and 'adopt'"
        )


def _is_plain(kind: type[Knowledge]) -> bool:
    return issubclass(kind, Estimates | OwnMinds)


def report(computation: AnyComputation, knowledge: Knowledge) -> Report:
    """What the one robot that a computation serves has learned; numbers by robot are reported as they are."""
    own = REPORTING.of(computation)
    return own.report(knowledge) if own is not None else knowledge.arrays()


def adopt(computation: AnyComputation, reports: Sequence[Report], inbox: Inbox[MessageBatch]) -> Knowledge:
    """What all robots know, put together from their reports. The computation itself hears nothing here.

    Minds of one's own stay where they are: only what they show is known here. Raises FrameError.
    """
    own = REPORTING.of(computation)
    try:
        if own is not None:
            adopted: Knowledge = own.adopt(reports, inbox)
            return adopted
        columns = [np.concatenate(column) for column in zip(*reports, strict=True)]
        kind: Any = computation.knowledge_type
        if issubclass(kind, OwnMinds):
            names = getattr(computation, "recorded", ())
            shown: Knowledge = kind((), dict(zip(names, columns, strict=True)))
            return shown
        if len(columns) != len(fields(kind)) or any(len(one) != len(reports) for one in columns):
            raise ValueError("other columns")
        found: Knowledge = kind(*columns)
    except (ValueError, IndexError, TypeError) as problem:
        raise FrameError(f"a report of what {computation.knowledge_type.__name__} cannot be: {problem}") from problem
    return found


def combined(computation: AnyComputation, row: int, before: Report, came: Sequence[Report]) -> Report:
    """One report for those of a robot that `came` in an iteration: by default the last one that there is.

    Raises FrameError for what cannot have been reported.
    """
    own = COMBINING.of(computation)
    try:
        return (came[-1] if came else before) if own is None else own.combined(row, before, came)
    except (ValueError, IndexError, TypeError) as problem:
        raise FrameError(f"a report of what {computation.knowledge_type.__name__} cannot be: {problem}") from problem
