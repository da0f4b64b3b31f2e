"""Reads what scenarios and studies expect, and checks before any run that their runs can tell."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path

import msgspec

from swarmsim.core.durations import iterations_in, told
from swarmsim.core.errors import InputError, nearest
from swarmsim.core.scenario import shipped
from swarmsim.core.scenario.expect import (
    KEY,
    Expect,
    NoRobot,
    Sentence,
    TaskDone,
    expectations_in,
    sentence_of,
)
from swarmsim.core.scenario.toml import read_toml
from swarmsim.engine.build import build
from swarmsim.faults.in_words import fault_in_words
from swarmsim.recording.measures import RunMeasures
from swarmsim.studies.labels import shown
from swarmsim.studies.plan import Condition, Plan, Study, changed, changes_of, planned, read_study
from swarmsim.studies.watching import Watch


@dataclass(frozen=True, slots=True, eq=False)
class Expectation:
    """One expectation of the runs of one condition."""

    name: str  # FILE::sentence, with the condition's name before the sentence if it has one
    expect: Expect
    sentence: Sentence
    measure: str  # of a run's summary that the sentence is about; empty for being done
    plan: Plan
    condition: Condition


@dataclass(frozen=True, slots=True)
class Known:
    """The measures of a condition's runs, by name."""

    summary: Mapping[str, object]  # at the end
    values: Mapping[str, float]  # in every iteration


def files_of(paths: Sequence[Path]) -> list[Path]:
    """The files among these, named ones that ship, and those with expectations in these folders.

    Raises InputError if there are none.
    """
    found: list[Path] = []
    for given in paths:
        path = given if given.is_dir() else shipped.found(given)
        inside = [file for file in sorted(path.rglob("*.toml")) if expects(file)] if path.is_dir() else [path]
        if not inside:
            raise InputError(f"{path}: no file in it has [[{KEY}]]; expected a scenario or a study that has")
        found += inside
    return list(dict.fromkeys(found))


def expects(path: Path) -> bool:
    """Whether a TOML file has expectations. Raises InputError if it cannot be read."""
    return KEY in read_toml(path, "a scenario or study file")


def expectations_of(path: Path) -> list[Expectation]:
    """The expectations in a scenario or study file, in their order, with conditions outermost.

    Every swarm is built as a check. Raises InputError that names the file and the key.
    """
    table = read_toml(path, "a scenario or study file")
    if KEY not in table:
        raise InputError(f"{path}: expects nothing; expected [[{KEY}]] in it")
    if "scenario" in table:
        study = msgspec.structs.replace(read_study(path), keep="summary")  # no sentence is about curves
        cells = changes_of(path, study)
    else:
        try:
            study = Study(title=path.stem, scenario=path.name, expect=expectations_in(table), keep="summary")
        except InputError as problem:
            raise InputError(f"{path}: {problem}") from problem
        cells = {"": {}}
    given: dict[str, dict[str, object]] = {}
    belong: list[tuple[int, str]] = []  # each expectation's number, with its condition's name in `given`
    for number, expect in enumerate(study.expect):
        if expect.condition and expect.condition not in cells:
            raise InputError(f"{path}: {KEY}[{number}].condition: {nearest(expect.condition, cells)}")
    for cell, change in cells.items():
        for number, expect in enumerate(study.expect):
            if expect.condition in ("", cell):
                name, given_changes = _struck(path, study, number, cell, change)
                given[name] = given_changes
                belong.append((number, name))
    plan = planned(path, study, given, (1,))
    return _with_watches(plan, belong)


def _struck(
    path: Path, study: Study, number: int, cell: str, change: dict[str, object]
) -> tuple[str, dict[str, object]]:
    """The name and the changes of a condition with an expectation's own settings and faults. Raises InputError."""
    expect, place = study.expect[number], f"{path}: {KEY}[{number}]"
    changes = {**change, **expect.set}
    words = [cell] if cell not in ("", "base") else []
    words += [f"{key}={shown(value)}" for key, value in expect.set.items()]
    if expect.faults:
        base = shipped.found(study.scenario, folder=path.parent)
        scenario = changed(
            f"{place}.set", read_toml(base, "the study's scenario file"), {**study.set, **changes}, base.parent
        )
        more = []
        for text in expect.faults:
            try:
                more.append(fault_in_words(text).table)
            except InputError as problem:
                raise InputError(f"{place}.faults: {text!r}: {problem}") from problem
        changes["faults"] = [*(part.table for part in scenario.faults), *more]
        words += expect.faults
    return "; ".join(words), changes


def _with_watches(plan: Plan, belong: Sequence[tuple[int, str]]) -> list[Expectation]:
    """The expectations, each with its condition, whose runs keep all that is expected of them. Raises InputError."""
    conditions = {one.name: one for one in plan.conditions}
    measured = cache(lambda name: known_of(plan, conditions[name]))
    asked: list[tuple[int, str, Sentence, Watch | str]] = []
    for number, name in belong:
        sentence = sentence_of(plan.study.expect[number].that)
        try:
            watch = watch_of(sentence, conditions[name], partial(measured, name))
        except InputError as problem:
            raise InputError(f"{plan.path}: {KEY}[{number}].that: {problem}") from problem
        asked.append((number, name, sentence, watch))
    for name, one in conditions.items():
        watched = {watch.key: watch for _, of, _, watch in asked if of == name and isinstance(watch, Watch)}
        conditions[name] = replace(one, watched=tuple(watched[key] for key in sorted(watched)))
    plan = replace(plan, conditions=tuple(conditions.values()))
    found: dict[str, Expectation] = {}
    for number, name, sentence, watch in asked:
        expect, called = plan.study.expect[number], _called(plan, number, name)
        if called in found:
            raise InputError(f"{plan.path}: {KEY}[{number}]: {expect.that!r} is listed twice; expected it once")
        measure = watch.key if isinstance(watch, Watch) else watch
        found[called] = Expectation(called, expect, sentence, measure, plan, conditions[name])
    return list(found.values())


def _called(plan: Plan, number: int, condition: str) -> str:
    """The name of an expectation of a condition."""
    expect = plan.study.expect[number]
    chance = "" if expect.chance is None else f" ({percent(expect.chance)})"
    return f"{plan.path}::{f'{condition}: ' if condition else ''}{' '.join(expect.that.split())}{chance}"


def percent(share: float) -> str:
    """A share in per cent, to one decimal if it has any."""
    return f"{100.0 * share:.1f}".removesuffix(".0") + " %"


def known_of(plan: Plan, condition: Condition) -> Known:
    """The measures of a condition's runs, found by its first iteration. Raises InputError as `build`."""
    made = build(condition.scenario, f"{plan.path}: condition {condition.name!r}", plan.world_of(condition))
    task = made.simulation.parts.task
    summaries = [RunMeasures(condition.scenario.robots, condition.scenario.period, task.curve), *task.summaries()]
    moment = made.simulation.tick(summaries)
    return Known(
        {name: value for one in summaries for name, value in one.summary().items()}, dict(moment.measured.values)
    )


def watch_of(sentence: Sentence, condition: Condition, known: Callable[[], Known]) -> Watch | str:
    """What a run has to keep for a sentence, or the name of the measure that is kept anyway.

    Raises InputError for an unknown measure, and for a time that the run's limit comes before.
    """
    if isinstance(sentence, NoRobot) and sentence.what == "dead":
        return Watch("dead")
    until = _until(sentence, condition)
    if isinstance(sentence, TaskDone):
        return ""
    if isinstance(sentence, NoRobot):
        return Watch("stuck", iterations=until)
    values, summary = known().values, known().summary
    if sentence.when == "end" and sentence.name in summary:
        return sentence.name
    if sentence.name not in values:
        if sentence.name in summary:
            raise InputError(f"{sentence.name} is known at a run's end only; {nearest('', values)} in every iteration")
        raise InputError(f"{sentence.name}: no such measure; {nearest(sentence.name, {**values, **summary})}")
    if sentence.when in ("end", "at"):
        return Watch("at", sentence.name, until)
    rises = sentence.sign.startswith(">")
    return Watch("most" if rises == (sentence.when == "within") else "least", sentence.name, until)


def _until(sentence: Sentence, condition: Condition) -> int | None:
    """The iterations that a sentence's time takes; None without one. Raises InputError if runs end before."""
    if sentence.seconds is None:
        return None
    period, limit = condition.scenario.period, condition.scenario.limit
    count = iterations_in(sentence.seconds, period)
    if isinstance(sentence, NoRobot):
        count = math.ceil(sentence.seconds / period * (1.0 - 1e-12))
    if count > limit:
        raise InputError(
            f"{told(sentence.seconds)} are {count} iterations, but runs end after {limit} ([stop]); "
            f"expected a time up to {told(limit * period)}, or a later limit"
        )
    if count < 1:
        raise InputError(
            f"{told(sentence.seconds)} is before the end of the first iteration; expected {told(period)} or more"
        )
    return count
