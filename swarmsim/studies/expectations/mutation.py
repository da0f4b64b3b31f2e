"""Finds expectations that no broken swarm ever fails: every robot is broken in one way after another."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, Literal

from swarmsim.core.errors import InputError
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.files import Table
from swarmsim.studies.expectations.nights import ALIKE
from swarmsim.studies.expectations.reading import Expectation
from swarmsim.studies.expectations.session import ExpectationSession
from swarmsim.studies.expectations.verdicts import Answer, Levels, outcome
from swarmsim.studies.plan import Condition, Plan, planned
from swarmsim.studies.runner import Runner
from swarmsim.studies.worst import KINDS

STANDING: Final = "robots stand still"
#: Ways to break every robot from the start, by their names in tables; a run of each has to differ from the sound one.
MUTANTS: Final[Mapping[str, Table]] = {
    STANDING: KINDS["motor off"],
    **{name: table for name, table in KINDS.items() if name not in ("motor off", "remove, map lost")},
    "motor slow": {"use": "motor", "failure": "slow", "factor": 0.25},
    "sensor garbage": {"use": "sensor", "failure": "garbage"},
    "mind walks at random": {"use": "mind", "failure": "random-walk"},
    "mind always reboots": {"use": "mind", "failure": "reboot", "duration": 100_000},
    "position drifts": {"use": "localisation", "failure": "drift", "sigma": 0.1},
}
PATIENCE: Final = 300  # runs of a mutant that may pass for the sound swarm; one that is broken takes a few
ALL: Final[Table] = {"at": 0, "fraction": 1.0, "min_alive": 0}
Fate = Literal["fails", "holds", "undecided", "same"]


@dataclass(frozen=True, slots=True)
class Broken:
    """What breaks a swarm: a fault or other values of keys."""

    fault: Table | None = None  # all robots have it from the start, unless it says otherwise
    changes: Mapping[str, object] = field(default_factory=dict)  # by dotted key
    own: bool = False  # whether the user named it, so that it has to be possible


@dataclass(frozen=True, slots=True)
class Tried:
    """What mutants do to one expectation."""

    expectation: Expectation
    sound: Answer  # with nothing broken; where it fails, no mutant is tried
    fates: Mapping[str, Fate]  # by mutant; `same`: its runs are those of the sound swarm, to the bit
    left_out: Mapping[str, str]  # mutants that this swarm cannot have, with the reason

    @property
    def killers(self) -> list[str]:
        """The mutants that are shown to fail it."""
        return [name for name, fate in self.fates.items() if fate == "fails"]

    @property
    def equivalent(self) -> list[str]:
        """The mutants that change nothing."""
        return [name for name, fate in self.fates.items() if fate == "same"]

    @property
    def met_standing(self) -> bool:
        """Whether robots that stand still meet it."""
        return self.fates.get(STANDING) == "holds"


def tried(
    expectations: Sequence[Expectation],
    runner: Runner,
    alpha: float = 0.01,
    budget: int | None = None,
    own: Mapping[str, Broken] | None = None,
) -> Iterator[Tried]:
    """Each expectation with every mutant: one is killed only where the expectation is shown to fail.

    The error `alpha` of a wrong *fails* is shared by all expectations with a chance and all mutants.
    """
    mutants = installed() | dict(own or {})
    chances = sum(one.expect.chance is not None for one in expectations)
    alone = ExpectationSession(runner, Levels.of(alpha, chances), budget)
    session = ExpectationSession(runner, Levels.of(alpha, chances * len(mutants)), budget or PATIENCE)
    made: dict[tuple[int, str, str], tuple[Plan, Condition] | InputError] = {}
    for one in expectations:
        fates, left_out = dict[str, Fate](), dict[str, str]()
        sound = _answer(one, alone)
        for name, broken in mutants.items() if sound != "fails" else ():
            key = (id(one.plan), one.condition.name, name)
            if key not in made:
                made[key] = _mutant(one, name, broken)
            found = made[key]
            if isinstance(found, InputError):
                left_out[name] = str(found)
            elif _alike(one, found, runner):
                fates[name] = "same"
            else:
                fates[name] = _answer(replace(one, plan=found[0], condition=found[1]), session)
        yield Tried(one, sound, fates, left_out)


def _answer(one: Expectation, session: ExpectationSession) -> Answer:
    """The verdict; without a chance the first seed that does not meet it is enough."""
    if one.expect.chance is None:
        rows = (session.runner.rows(one.plan, one.condition, [seed])[0] for seed in one.expect.numbers)
        return "holds" if all(outcome(one, row).met for row in rows) else "fails"
    (verdict,) = session.verdicts([one])
    return verdict.answer


def installed() -> dict[str, Broken]:
    """The mutants whose faults are installed."""
    known = registry.known("fault")
    return {name: Broken(table) for name, table in MUTANTS.items() if table["use"] in known}


def _mutant(one: Expectation, name: str, broken: Broken) -> tuple[Plan, Condition] | InputError:
    """The condition with every robot broken; the error of one that cannot be. Raises it for the user's own."""
    changes = {**one.condition.changes, **broken.changes}
    if broken.fault is not None:
        before = [part.table for part in one.condition.scenario.faults]
        changes["faults"] = [*before, {**({} if broken.own else ALL), **broken.fault}]
    try:
        plan = planned(one.plan.path, one.plan.study, {f"{one.condition.name}, {name}".lstrip(", "): changes}, (1,))
    except InputError as problem:
        if broken.own:
            raise InputError(f"--mutant {name!r}: {problem}") from problem
        return problem
    condition = replace(plan.conditions[0], watched=one.condition.watched)
    return replace(plan, conditions=(condition,)), condition


def _alike(one: Expectation, mutant: tuple[Plan, Condition], runner: Runner) -> bool:
    """Whether a mutant's first runs are those of the sound swarm, to the bit."""
    seeds = one.expect.numbers if one.expect.chance is None else range(1, ALIKE + 1)
    pairs = ((runner.rows(one.plan, one.condition, [seed])[0], runner.rows(*mutant, [seed])[0]) for seed in seeds)
    return all(sound.digest == broken.digest is not None for sound, broken in pairs)
