"""Checks third-party parts against their interfaces; a violation ends the run, naming part and iteration."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable, Collection
from dataclasses import replace
from pathlib import Path
from types import FunctionType
from typing import Any, Final, TypeVar

from swarmsim.core.adapters.minds import MindComputation, MindStrategy
from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError, PartError
from swarmsim.core.lending import Lender, copied, frozen
from swarmsim.core.own import is_failure, line_of, told
from swarmsim.core.parts import EventSource, Parts
from swarmsim.core.scenario import registry
from swarmsim.core.seams import SEAMS
from swarmsim.core.state import Knowledge
from swarmsim.engine import promises
from swarmsim.engine.promises import Check, Checks

P = TypeVar("P")
Change = Callable[[object], object]

#: The seams whose parts the tick calls by name.
HELD: Final = tuple(seam for seam in promises.CHECKS if seam in Parts.__slots__)


#: The verbs called in every sub-step.
OFTEN: Final = ("command", "approach", "forces")

#: The class or function blamed for a part's failures.
Author = type | FunctionType


class Clock:
    """The current iteration, as the tick sets it, and the values lent in it."""

    def __init__(self) -> None:
        #: What failures are blamed on.
        self.iteration = 0
        self.lender = Lender()

    def turn(self, iteration: int) -> None:
        self.iteration = iteration
        self.lender.clear()


class Guard:
    """A part that raises PartError if its verbs raise, or return what breaks its contract.

    All other attributes are the part's own.
    """

    def __init__(
        self,
        seam: str,
        part: object,
        author: Author,
        checks: Checks,
        clock: Clock,
        is_foreign: bool,
        lends: bool = True,
        of: str = "",
    ) -> None:
        """The `checks` are by verb. The `author` is the class or function to blame; `of` tells whose part it is.

        A part that `is_foreign` cannot write to its arguments, nor to its results. Ours never do, and read-only arrays
        would recompile kernels: that is checked in strict runs only, and never without lending.
        """
        file = getattr(sys.modules[author.__module__], "__file__", None) if registry.is_own(author) else None
        place = f"{Path(file).name}:" if file else f"{author.__module__}."
        self._seam, self._part, self._author, self._clock = seam, part, author, clock
        self._name = f"{seam} {place}{author.__qualname__}{of}"
        lends = lends and not isinstance(part, MindComputation | MindStrategy)  # they show minds read-only views
        for verb, check in checks.items():
            given: Change = copied if verb in ("follow", *OFTEN) else clock.lender.lent
            taken: Change = frozen
            if verb in (*OFTEN, "summaries"):  # arrays reused and used at once; and guards
                taken = _same
            elif is_foreign:
                taken = self._known if verb == "hear" else clock.lender.taken
            setattr(self, verb, self._held(verb, check, given if lends else _same, taken if lends else _same))

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - any attribute of the part
        if name.startswith("_"):
            raise AttributeError(name)
        return getattr(self._part, name)

    def _held(self, verb: str, check: Check, given: Change, taken: Change) -> Callable[..., object]:
        asked = getattr(self._part, verb)

        def ask(*arguments: object) -> object:
            try:
                found = asked(*[given(one) for one in arguments])
            except InputError:
                raise
            except BaseException as problem:  # a part must not end the process, least of all with success
                if not is_failure(problem):
                    raise
                raise self._failed(told(problem, line_of(self._author, verb))) from problem
            wrong = check(found, *arguments)
            if wrong is not None:
                raise self._failed(wrong + ("" if registry.is_ours(self._author) else line_of(self._author, verb)))
            return taken(found)

        return ask

    def _failed(self, why: str) -> PartError:
        return PartError(f"{self._name}, iteration {self._clock.iteration}: {why}", self._seam)

    def _known(self, found: object) -> object:
        """The knowledge, with the part's own read-only views kept, unless they are digested."""
        digested = {id(array) for array in found.arrays()} if isinstance(found, Knowledge) else set()
        return self._clock.lender.taken(found, lambda array: not array.flags.writeable and id(array) not in digested)


def _same(value: object) -> object:
    return value


def held(seam: str, part: P, context: BuildContext, clock: Clock, is_foreign: bool = True, of: str = "") -> P:
    """A guarded part; `of` tells whose it is, where robots have different ones."""
    author, checks = registry.author_of(part), promises.CHECKS[seam](part, context)
    guard: Any = Guard(seam, part, author, checks, clock, is_foreign, of=of)
    if seam == "task":
        summaries = vars(guard)["summaries"]
        judged = promises.of_summaries(guard.curve, context)
        vars(guard)["summaries"] = lambda: [
            Guard("task", one, registry.author_of(one), judged, clock, is_foreign) for one in summaries()
        ]
    found: P = guard
    return found


def guarded(
    parts: Parts, context: BuildContext, seams: Collection[str], theirs: Collection[str], clock: Clock
) -> Parts:
    """The same parts, those of some seams guarded; those of `theirs` contain third-party code."""
    changed = {seam: held(seam, getattr(parts, seam), context, clock, seam in theirs) for seam in HELD if seam in seams}
    return replace(parts, **changed)


def with_fault(fault: object, parts: Parts, install: Callable[[Parts], Parts], clock: Clock) -> Parts:
    """The parts with a fault installed; what a third-party fault adds gets read-only arguments as well."""
    if registry.is_ours(fault):
        return install(parts)
    author = registry.author_of(fault)

    def held(happening: EventSource) -> EventSource:
        """Events of a third-party fault, which gets read-only arguments."""
        return Guard("fault", happening, author, {"advance": promises.nothing}, clock, is_foreign=True)

    found = install(replace(parts, schedule=parts.schedule.holding(held)))
    changed: dict[str, Any] = {"schedule": parts.schedule}
    for seam in HELD:
        part = getattr(found, seam)
        if part is not getattr(parts, seam):
            protocol = SEAMS[seam].protocol
            verbs = [verb for verb in SEAMS[seam].verbs if inspect.isfunction(getattr(protocol, verb, None))]
            changed[seam] = Guard("fault", part, author, dict.fromkeys(verbs, promises.nothing), clock, True)
    return replace(found, **changed)
