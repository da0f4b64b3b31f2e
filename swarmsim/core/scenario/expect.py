"""What a scenario or study expects of its runs: `[[expect]]`, each with a sentence that runs meet or do not."""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Final, Literal

from msgspec import Meta, Struct

from swarmsim.core.durations import seconds_of
from swarmsim.core.errors import InputError
from swarmsim.core.scenario.decoding import convert
from swarmsim.core.scenario.files import Table

KEY: Final = "expect"
SEEDS: Final = 5  # of an expectation without a chance
STUCK: Final = 60.0  # s
Seed = Annotated[int, Meta(ge=0, le=2**63 - 1)]


class Expect(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One expectation. It never changes a run.

    Without `chance` the sentence has to be true with each of the seeds. With `chance` it has to be true with at least
    this probability; `zone` is how much less is close enough to hold, and `budget` the most runs to spend on it.
    """

    that: Annotated[str, Meta(min_length=1, max_length=200)]  # the sentence
    seeds: Annotated[int, Meta(ge=1)] | Annotated[tuple[Seed, ...], Meta(min_length=1)] = SEEDS  # 1 to N, or a list
    chance: Annotated[float, Meta(gt=0.0, lt=1.0)] | None = None  # that it is true in a run, at least
    zone: Annotated[float, Meta(gt=0.0, lt=1.0)] | None = None  # how much less of a chance is close enough
    budget: Annotated[int, Meta(ge=1, le=1_000_000)] | None = None  # runs, at most, of an expectation with a chance
    faults: tuple[str, ...] = ()  # besides the scenario's, in words
    set: dict[str, Any] = {}  # dotted key: value
    condition: str = ""  # of a study; default: all of them

    def __post_init__(self) -> None:
        try:
            sentence_of(self.that)
        except InputError as problem:
            raise ValueError(f"that: {problem}") from problem
        if self.chance is None and (self.zone is not None or self.budget is not None):
            raise ValueError("zone and budget are those of a chance; expected chance beside them")
        if self.chance is not None and self.seeds != SEEDS:
            raise ValueError("with a chance the seeds are 1, 2, 3, ...; expected either chance or seeds")
        if self.chance is not None and self.slack >= min(self.chance, 2.0 * (1.0 - self.chance)):
            most = min(self.chance, 2.0 * (1.0 - self.chance))
            raise ValueError(f"zone = {self.slack:g}: too wide for chance = {self.chance:g}; expected below {most:.3g}")
        if not isinstance(self.seeds, int) and len(set(self.seeds)) < len(self.seeds):
            raise ValueError("seeds: one is listed twice; expected each once")

    @property
    def slack(self) -> float:
        """How far below `chance` is close enough: by default 0.02, near certainty two fifths of what is left to 1."""
        return self.zone if self.zone is not None else min(0.02, 0.4 * (1.0 - (self.chance or 0.0)))

    @property
    def numbers(self) -> tuple[int, ...]:
        """The seeds of an expectation without a chance."""
        return tuple(range(1, self.seeds + 1)) if isinstance(self.seeds, int) else self.seeds


class ExpectTable(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A scenario's expectations."""

    expect: tuple[Expect, ...] = ()


When = Literal["end", "at", "within", "always"]
COMPARED: Final[Mapping[str, Callable[[float, float], bool]]] = {
    ">=": operator.ge, "<=": operator.le, ">": operator.gt, "<": operator.lt, "==": operator.eq, "!=": operator.ne,
}  # fmt: skip
_MEASURED: Final = re.compile(
    r"([A-Za-z_][\w.-]*)\s*(>=|<=|==|!=|>|<)\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)(\s*%)?(?:\s+(\S.*))?",
    re.ASCII | re.DOTALL,
)
EXPECTED: Final = (
    'expected "finished", "finished within 10min", "nobody stuck", "nobody dead", or a measure, a comparison '
    f'({", ".join(COMPARED)}) and a number, as in "path_sum <= 200", with "at 300s", "within 300s" or "always"'
)


@dataclass(frozen=True, slots=True)
class TaskDone:
    """The task is done, before the limit and within `seconds` if given."""

    seconds: float | None = None


@dataclass(frozen=True, slots=True)
class NoRobot:
    """No robot is ever stuck for `seconds`, or dead at the end."""

    what: Literal["stuck", "dead"]
    seconds: float = STUCK


@dataclass(frozen=True, slots=True)
class MeasureBound:
    """A measure compares so with a number: at the run's end, at or within `seconds`, or in every iteration."""

    name: str
    sign: str  # among COMPARED
    number: float
    when: When = "end"
    seconds: float | None = None


Sentence = TaskDone | NoRobot | MeasureBound


def sentence_of(text: str) -> Sentence:
    """What an expectation's sentence says. Raises InputError, which starts with the sentence."""
    first, *rest = text.split() or [""]
    try:
        if first == "finished":
            return TaskDone(_time(rest, "within"))
        if first == "nobody" and rest[:1] in (["stuck"], ["dead"]):
            seconds = _time(rest[1:], "for") if rest[0] == "stuck" else _time(rest[1:])
            return NoRobot("stuck", seconds or STUCK) if rest[0] == "stuck" else NoRobot("dead")
        if found := _MEASURED.fullmatch(text.strip()):
            return _compared(*found.groups())
    except ValueError as problem:
        raise InputError(f"{text!r}: {problem}") from problem
    raise InputError(f"{text!r} is no sentence; {EXPECTED}")


def _compared(name: str, sign: str, digits: str, percent: str | None, rest: str | None) -> MeasureBound:
    """A measure's sentence from its pieces. Raises ValueError."""
    number = float(digits) / (100.0 if percent else 1.0)
    if not math.isfinite(number):
        raise ValueError(f"{digits} is not finite; expected a number to compare with")
    word, *time = (rest or "end").split()
    if word == "end" and rest is None:
        return MeasureBound(name, sign, number)
    if word == "always" and not time:
        when: When = "always"
    elif word in ("at", "within") and time:
        when = "at" if word == "at" else "within"
    else:
        raise ValueError(f'{rest!r} after the number; expected "at 300s", "within 300s", "always" or nothing')
    if when != "at" and sign in ("==", "!="):
        raise ValueError(f"{sign} with {word}; expected >=, <=, > or <")
    return MeasureBound(name, sign, number, when, seconds_of(" ".join(time)) if time else None)


def _time(words: list[str], *prepositions: str) -> float | None:
    """The seconds after one of these words; None for no words at all. Raises ValueError."""
    if not words:
        return None
    if words[0] not in prepositions or len(words) == 1:
        wanted = (
            f"{prepositions[0]} and a time, as in {prepositions[0]} 10min, or nothing" if prepositions else "nothing"
        )
        raise ValueError(f"{' '.join(words)!r} at its end; expected {wanted}")
    return seconds_of(" ".join(words[1:]))


def expectations_in(table: Table) -> tuple[Expect, ...]:
    """The expectations in a scenario's table. Raises InputError, which starts with the key at fault."""
    given = {KEY: table.get(KEY, [])}
    found = convert(given, ExpectTable).expect
    for number, one in enumerate(found):
        if one.condition:
            raise InputError(f"{KEY}[{number}].condition: a scenario has none; expected it in a study")
    return found


def without_expectations(table: Table) -> Table:
    """A scenario's table without `[[expect]]`, checked first: runs do not depend on it. Raises InputError."""
    expectations_in(table)
    return {key: value for key, value in table.items() if key != KEY}
