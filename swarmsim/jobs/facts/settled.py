"""The task of a swarm with jobs of facts: that all of them have settled."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from msgspec import Struct

from swarmsim.core.context import BuildContext
from swarmsim.core.parts import Curve, Summary
from swarmsim.core.state import Done, Knowledge, Measured, Moment
from swarmsim.jobs.facts.tellers import JobStanding

SETTLED: Final = "settled_share"


class Settled(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """All jobs of facts have settled: tables are equal, data items have their copies, some robot has all results.

    What no living robot has is lost. While anything is, the task is not finished.
    """

    @property
    def needs_jobs(self) -> bool:
        """Whether it measures jobs, which a scenario then has to have."""
        return True

    def build(self, context: BuildContext) -> SettledTask:
        return SettledTask()


class SettledTask:
    """Measures how far jobs of facts are, and what each tells of itself, under the job's name."""

    requires_knowledge: type[Knowledge] = Knowledge  # type: ignore[type-abstract]  # any kind will do
    curve: Final = Curve(SETTLED, "settled (%)", 100.0, 0.0, 100.0, format=".1f")

    def measure(self, done: Done[Knowledge]) -> Measured:
        """The mean over jobs of the share that is settled."""
        alive, values, shares, ended = done.state.alive, dict[str, float](), list[float](), list[bool]()
        for one in done.jobs:
            if isinstance(one.knowledge, JobStanding):
                shares.append(one.knowledge.share(alive))
                ended.append(one.knowledge.ended(alive))
                values |= {f"{one.name}_{name}": value for name, value in one.knowledge.numbers(alive).items()}
        share = sum(shares) / len(shares) if shares else 0.0
        finished = bool(shares) and bool(alive.any()) and all(ended)
        return Measured({SETTLED: share, **values}, progress=share, finished=finished)

    def summaries(self) -> Sequence[Summary[Knowledge]]:
        """A new observer of how it ended."""
        return (Settlement(),)


class Settlement:
    """When jobs of facts settled for good, and what they ended with."""

    def __init__(self) -> None:
        self._last: Moment[Knowledge] | None = None
        self._since: int | None = None
        self._sent: dict[str, int] = {}

    def sample(self, moment: Moment[Knowledge]) -> None:
        """Note one iteration."""
        self._last = moment
        for one in moment.jobs:
            self._sent[one.name] = self._sent.get(one.name, 0) + one.sent
        if moment.measured.values[SETTLED] < 1.0:
            self._since = None
        elif self._since is None:
            self._since = moment.state.iteration + 1

    def summary(self) -> dict[str, float | int | None]:
        """The numbers, defined in docs/computing-other.md."""
        if self._last is None:
            return {}
        found: dict[str, float | int | None] = {"iterations_to_settled": self._since}
        for one in self._last.jobs:
            if isinstance(one.knowledge, JobStanding):
                alive = self._last.state.alive
                told = {**one.knowledge.numbers(alive), **one.knowledge.answer(alive), "bytes": self._sent[one.name]}
                found |= {f"{one.name}_{name}": value for name, value in told.items()}
        return found
