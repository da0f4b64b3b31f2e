"""What runs say of an expectation: it holds, it fails, or they cannot tell yet."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

import numpy as np

from swarmsim.core.durations import iterations_in, told
from swarmsim.core.scenario.expect import COMPARED, Expect, MeasureBound, NoRobot, TaskDone
from swarmsim.studies.expectations.reading import Expectation, percent
from swarmsim.studies.results import command
from swarmsim.studies.sequential import bounds, evidence, interval
from swarmsim.studies.store import Row
from swarmsim.studies.survival import Interval

Answer = Literal["holds", "fails", "undecided"]
LEAST: Final = 20  # new runs a night at least, even where the evidence of nights before decides


@dataclass(frozen=True, slots=True)
class RunOutcome:
    """Whether one run meets an expectation, and how."""

    seed: int
    met: bool
    margin: float  # by which it does, or, below 0, does not
    words: str
    ended: bool = True  # False for a run that failed with an error


@dataclass(frozen=True, slots=True)
class Verdict:
    """What the runs say."""

    expectation: Expectation
    answer: Answer
    runs: int
    met: int
    worst: RunOutcome | None  # the run that is farthest from meeting it; None if all do
    failing: tuple[int, ...]  # seeds, in the order of the runs
    interval: Interval | None  # of the chance, at any time; None without one
    seconds: float  # of one core
    command: str  # that repeats the worst run; empty without one
    film: Path | None = None  # of the worst run

    @property
    def thin(self) -> bool:
        """Whether it does not fail, but the share of good runs is within the zone of what is asked."""
        expect = self.expectation.expect
        if expect.chance is None or self.answer == "fails" or not self.runs:
            return False
        low, high = bounds(expect.chance, expect.slack)
        return low <= self.met / self.runs <= high

    @property
    def words(self) -> str:
        """The verdict in a sentence; the same for the same code."""
        expect = self.expectation.expect
        if expect.chance is None:
            return self._in_every_seed()
        share = f"{self.met} of {self.runs} runs" + (f", {percent(self.met / self.runs)}" if self.runs else "")
        asked = percent(expect.chance)
        if self.answer == "holds":
            text = f"holds: {share}; shown: above {percent(expect.chance - expect.slack)}"
        elif self.answer == "fails":
            text = f"fails: {share}; shown: below {asked}"
        else:
            text = f"undecided: {share}"
        if self.interval is not None and self.answer != "holds":
            text += f"; between {percent(self.interval[0])} and {percent(self.interval[1])}"
        if self.thin:
            text += f"; thin: {percent(self.met / self.runs)} where {asked} is asked"
        return f"{text}; worst: {self._worst()}" if self.answer == "fails" else text

    def _in_every_seed(self) -> str:
        if self.answer == "holds":
            return f"holds: with {'each of ' if self.runs > 1 else ''}{_seeds(self.expectation.expect)}"
        others = len(self.failing) - 1
        more = f", and {others} more of {self.runs} seeds" if others else f" of {self.runs}"
        return f"fails: {self._worst()}{more}"

    def _worst(self) -> str:
        return "" if self.worst is None else f"seed {self.worst.seed} ({self.worst.words})"


def _seeds(expect: Expect) -> str:
    numbers = expect.numbers
    if isinstance(expect.seeds, int) and expect.seeds > 1:
        return f"the seeds 1 to {expect.seeds}"
    return f"the seed{'s' * (len(numbers) > 1)} {', '.join(map(str, numbers))}"


@dataclass(frozen=True, slots=True)
class Levels:
    """The probabilities of errors that a session accepts."""

    fails: float  # of one expectation with a chance, that it is called failing while it has its chance
    holds: float  # likewise, that it is called holding while it has less than its chance and the zone

    @classmethod
    def of(cls, alpha: float, tests: int) -> Levels:
        """`alpha` is the session's for any wrong `fails` among its `tests`, and that of each `holds` by itself."""
        return cls(alpha / max(tests, 1), alpha)


def outcome(expectation: Expectation, row: Row) -> RunOutcome:
    """Whether a run meets an expectation. A failed run, and one whose measure is undefined, does not."""
    sentence, period = expectation.sentence, expectation.condition.scenario.period
    if row.status == "failed":
        return RunOutcome(row.seed, False, -math.inf, f"the run failed: {row.message}", ended=False)
    if isinstance(sentence, TaskDone):
        if row.status != "finished" or row.iterations is None:
            return RunOutcome(row.seed, False, -math.inf, "not finished")
        limit = math.inf if sentence.seconds is None else iterations_in(sentence.seconds, period)
        margin = limit - row.iterations
        return RunOutcome(row.seed, margin >= 0, margin, f"finished after {told(row.iterations * period)}")
    value = row.summary.get(expectation.measure)
    if isinstance(sentence, NoRobot):
        count = int(value or 0)
        return RunOutcome(row.seed, count == 0, -count, f"{count} robot{'s' * (count != 1)} {sentence.what}")
    if value is None or math.isnan(value):
        return RunOutcome(row.seed, False, -math.inf, f"{sentence.name} is undefined")
    return RunOutcome(row.seed, COMPARED[sentence.sign](value, sentence.number), _margin(sentence, value),
                   f"{sentence.name} {value:.6g}")  # fmt: skip


def _margin(bound: MeasureBound, value: float) -> float:
    if bound.sign in (">", ">="):
        return value - bound.number
    return bound.number - value if bound.sign in ("<", "<=") else -abs(value - bound.number)


def decided(
    outcomes: Sequence[bool], expect: Expect, levels: Levels, before: Sequence[bool] = (), least: int = 1
) -> tuple[Answer, int]:
    """The answer about a chance, and how many of the outcomes it takes: with more of them it stays the same.

    `before` are outcomes of the same behaviour on other nights, earlier in the sequence; then `least` new ones are
    needed. *Fails* is shown if P < chance is, *holds* if P > chance - zone is; see `sequential`.
    """
    chance = expect.chance or 0.0
    whole = np.array([*before, *outcomes], np.bool_)
    good = np.cumsum(whole)
    other = np.arange(1, len(whole) + 1) - good
    fails = evidence(other, good, 1.0 - chance) >= -np.log(levels.fails)
    holds = evidence(good, other, chance - expect.slack) >= -np.log(levels.holds)
    first = np.flatnonzero(fails | holds)
    if len(first) == 0 or len(outcomes) < least:
        return "undecided", len(outcomes)
    taken = max(int(first[0]) + 1 - len(before), least if before else 1)
    if before:  # a later night may still show that it fails
        return ("fails" if fails[: len(before) + taken].any() else "holds"), taken
    return ("fails" if fails[first[0]] else "holds"), taken


def clear(expect: Expect, levels: Levels) -> int:
    """The number of runs that show a chance if all are good."""
    counts = np.arange(1, 1_000_001)
    shown = evidence(counts, np.zeros(len(counts)), (expect.chance or 0.0) - expect.slack) >= -np.log(levels.holds)
    return int(np.argmax(shown)) + 1


def verdict_of(
    expectation: Expectation, answer: Answer, rows: Sequence[Row], level: float, before: Sequence[bool] = ()
) -> Verdict:
    """The verdict that these runs, and the outcomes of nights before, come to."""
    found = [outcome(expectation, row) for row in rows]
    missed = [one for one in found if not one.met]
    met = len(found) - len(missed) + sum(before)
    runs = len(found) + len(before)
    worst = min(missed, key=lambda one: one.margin, default=None)
    return Verdict(
        expectation, answer, runs, met, worst,
        tuple(one.seed for one in missed),
        None if expectation.expect.chance is None else interval(met, runs, 2.0 * level),
        sum(row.seconds for row in rows),
        "" if worst is None else command(expectation.plan, expectation.condition, worst.seed),
    )  # fmt: skip
