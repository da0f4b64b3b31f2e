"""Does the runs that expectations need, no more, and gives a verdict on each."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Final

from swarmsim.studies.expectations.nights import ALIKE, Nights
from swarmsim.studies.expectations.reading import Expectation
from swarmsim.studies.expectations.verdicts import LEAST, Levels, Verdict, clear, decided, outcome, verdict_of
from swarmsim.studies.plan import Condition, Plan, trial
from swarmsim.studies.runner import Runner
from swarmsim.studies.store import Row

FIRST: Final = 12  # runs of an expectation with a chance before its first verdict may end it
MORE: Final = 1.3  # then, how many times as many
BUDGET: Final = 2000  # runs of one expectation


@dataclass(frozen=True, slots=True)
class ExpectationSession:
    """What all verdicts of a session share."""

    runner: Runner
    levels: Levels
    budget: int | None = None  # runs of one expectation with a chance, in place of its own
    nights: Nights | None = None  # for new seeds

    def verdicts(self, expectations: Sequence[Expectation]) -> Iterator[Verdict]:
        """A verdict on each expectation, in their order by condition; those on one condition share its runs."""
        groups: dict[tuple[int, str], list[Expectation]] = {}
        for one in expectations:
            groups.setdefault((id(one.plan), one.condition.name), []).append(one)
        for group in groups.values():
            yield from self._of_condition(group)

    def most(self, expectation: Expectation) -> int:
        """The most runs that an expectation with a chance may take."""
        return self.budget or expectation.expect.budget or BUDGET

    def _of_condition(self, group: Sequence[Expectation]) -> Iterator[Verdict]:
        open_ = {place: self._opened(one) for place, one in enumerate(group)}
        found: dict[int, Verdict] = {}
        said = asked = 0
        while open_:
            asked = max(FIRST, round(MORE * asked))
            for place, one in list(open_.items()):
                verdict = one.verdict(asked)
                if verdict is not None:
                    found[place] = verdict
                    del open_[place]
            while said in found:
                yield found[said]
                said += 1

    def _opened(self, expectation: Expectation) -> Series:
        """The runs of an expectation, none asked for yet."""
        expect = expectation.expect
        if expect.chance is None:
            return Series(self, expectation, expect.numbers)
        if self.nights is None:
            return Series(self, expectation, range(1, self.most(expectation) + 1))
        behaviour = self.behaviour(expectation.plan, expectation.condition)
        seeds = tuple(islice(self.nights.seeds(behaviour), self.most(expectation)))
        before = self.nights.before(_identity(expectation), behaviour)
        return Series(self, expectation, seeds, behaviour, tuple(before))

    def behaviour(self, plan: Plan, condition: Condition) -> str:
        """A digest of how a condition's swarm behaves: of every field of every iteration of a few runs."""
        digests = [row.digest or "" for row in self.runner.rows(plan, condition, range(1, ALIKE + 1))]
        return hashlib.blake2b(" ".join(digests).encode(), digest_size=8).hexdigest()


@dataclass(frozen=True, slots=True)
class Series:
    """The seeds of one expectation, in the order in which they count."""

    session: ExpectationSession
    expectation: Expectation
    seeds: Sequence[int]
    behaviour: str = ""
    before: tuple[bool, ...] = ()  # outcomes of other nights

    def verdict(self, asked: int) -> Verdict | None:
        """The verdict after at most this many runs; None if there are more to do."""
        expectation, session = self.expectation, self.session
        if expectation.expect.chance is None:
            rows = self._rows(len(self.seeds))
            met = all(outcome(expectation, row).met for row in rows)
            return verdict_of(expectation, "holds" if met else "fails", rows, session.levels.holds)
        asked = min(asked, len(self.seeds))
        rows = self._rows(asked)
        outcomes = [outcome(expectation, row).met for row in rows]
        least = min(LEAST, len(self.seeds)) if session.nights is not None else 1
        answer, taken = decided(outcomes, expectation.expect, session.levels, self.before, least)
        if answer == "undecided" and asked < len(self.seeds):
            return None
        rows = rows[:taken]
        if session.nights is not None:
            tonight = [(row.seed, met) for row, met in zip(rows, outcomes, strict=False)]
            session.nights.keep(_identity(expectation), self.behaviour, tonight)
        return verdict_of(expectation, answer, rows, session.levels.holds, self.before)

    def _rows(self, asked: int) -> list[Row]:
        return self.session.runner.rows(self.expectation.plan, self.expectation.condition, self.seeds[:asked])


def _identity(expectation: Expectation) -> str:
    """What the outcomes of an expectation are kept under: its request, its measure and its sentence."""
    return f"{expectation.plan.asks(expectation.condition, 0)} {' '.join(expectation.expect.that.split())}"


@dataclass(frozen=True, slots=True)
class ExpectationCost:
    """What an expectation will take."""

    expectation: Expectation
    least: int  # runs, if all are good
    most: int
    lacking: int  # of the least, how many are not stored


@dataclass(frozen=True, slots=True)
class Forecast:
    """What a session will take."""

    costs: tuple[ExpectationCost, ...]
    runs: int  # to do, if all are good; expectations of one condition share runs
    seconds: float  # of one core, about


def forecast(session: ExpectationSession, expectations: Sequence[Expectation]) -> Forecast:
    """The runs that expectations will take, timed by simulating each file's conditions briefly."""
    costs = tuple(_cost(session, one) for one in expectations)
    runs: dict[tuple[int, str], tuple[Plan, int]] = {}
    for cost in costs:
        one = cost.expectation
        key = (id(one.plan), one.condition.name)
        runs[key] = one.plan, max(cost.lacking, runs[key][1] if key in runs else 0)
    each = {id(plan): trial(plan) for plan in {id(plan): plan for plan, lacking in runs.values() if lacking}.values()}
    seconds = sum(lacking * each.get(id(plan), 0.0) for plan, lacking in runs.values())
    return Forecast(costs, sum(lacking for _, lacking in runs.values()), seconds)


def _cost(session: ExpectationSession, one: Expectation) -> ExpectationCost:
    if one.expect.chance is None:
        seeds: Sequence[int] = one.expect.numbers
        return ExpectationCost(one, len(seeds), len(seeds), session.runner.lacks(one.plan, one.condition, seeds))
    most = session.most(one)
    least = min(clear(one.expect, session.levels), most)
    lacking = session.runner.lacks(one.plan, one.condition, range(1, least + 1)) if session.nights is None else least
    return ExpectationCost(one, least, most, lacking)
