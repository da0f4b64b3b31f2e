"""Entries of a benchmark: one method's runs on all tasks of a set, each with its digest, so that all can repeat it."""

from __future__ import annotations

import hashlib
import random
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Final, Literal

import msgspec
import tomli_w
from msgspec import Meta, Struct

from swarmsim.core.errors import InputError
from swarmsim.core.scenario.decoding import read_struct
from swarmsim.core.scenario.files import content, with_files, write_whole
from swarmsim.core.scenario.identity import Code
from swarmsim.recording.digests import versions
from swarmsim.studies.benchmark.sets import Count, Digest, Name, SetTask, TaskSet, plan_of
from swarmsim.studies.plan import Plan
from swarmsim.studies.requests import libraries
from swarmsim.studies.results import Result
from swarmsim.studies.store import Row

FORMAT: Final = 1
FILE, METHOD = "entry.json", "method.toml"  # in an entry's folder
ENTERED: Final = "entries"  # folder of the entries that come with a set, in the set's
EXPECTED: Final = "an entry of a benchmark, made by swarmsim benchmark explore"

Real = Annotated[float, Meta(ge=0.0, le=1e15)]


class Method(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What enters: a mind for every robot. All else belongs to the tasks."""

    name: Name
    title: Annotated[str, Meta(max_length=200)] = ""
    tuning: Annotated[str, Meta(max_length=500)] = ""  # how its numbers were chosen, and on what
    oracle: bool = False  # whether its robots hear all others, whatever the task's network
    mind: dict[str, object]  # `strategy` and `computation` as in a scenario


class EntryRun(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One run's scores; times in iterations, None if never reached."""

    task: Annotated[str, Meta(max_length=100)]
    seed: Count
    status: Literal["finished", "not finished"]
    iterations: Count  # of the run
    t50: Count | None  # until half of the domain was on any map
    t90: Count | None
    t99: Count | None
    t100: Count | None
    overlap: Real | None  # cells that several robots sensed: sum of each one's over their union's, less 1
    way: Real  # m, driven by all robots
    bytes: Annotated[int, Meta(ge=0, le=10**15)]  # that arrived
    messages: Annotated[int, Meta(ge=0, le=10**12)]
    digest: Digest  # of everything that happened in it


class MethodEntry(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The contents of entry.json."""

    format: Literal[1] = FORMAT
    set: Name  # the set with its edition
    set_digest: Digest
    parts: tuple[Literal["public", "held-out"], ...]  # that it ran
    method: Method
    code: dict[str, str]  # a hash of each piece that made the runs
    libraries: dict[str, str]  # their versions
    runs: tuple[EntryRun, ...]
    checksum: str  # of all the rest: tells of damage, not of forgery


def read_method(path: Path) -> Method:
    """A method's file. Raises InputError, which names what belongs to the task if that is set."""
    method = read_struct(path, "a method's file (TOML)", Method)
    _check_mind(method, path)
    return method


def _check_mind(method: Method, path: Path) -> None:
    if extra := sorted(method.mind.keys() - {"strategy", "computation"}):
        raise InputError(f"{path}: mind.{extra[0]}: expected mind.strategy and mind.computation alone")
    if "strategy" not in method.mind:
        raise InputError(f"{path}: mind.strategy: required key is missing")


def open_method(tasks: TaskSet, method: Method, place: Path, chosen: Sequence[SetTask]) -> Plan:
    """The study of a method over the chosen tasks; its own files are looked for beside `place`. Raises InputError."""
    mind = {
        key: _resolved(value, place.absolute().parent, f"{place}: mind.{key}") for key, value in method.mind.items()
    }
    return plan_of(tasks, mind, place, [overheard(task) for task in chosen] if method.oracle else chosen)


def overheard(task: SetTask) -> SetTask:
    """The task as an oracle has it: every robot hears all others, and no message is lost."""
    changes = dict(task.changes or {})
    faults = changes.get("faults")
    if isinstance(faults, list):
        changes["faults"] = [fault for fault in faults if fault.get("use") != "radio"]
    network = {"network.topology": {"use": "full"}, "network.channel": {"use": "perfect"}}
    return replace(task, changes=changes | network)


def _resolved(value: object, folder: Path, place: str) -> object:
    if not isinstance(value, dict):
        raise InputError(f"{place}: expected a table, as in {{use = 'NAME'}}")
    return with_files(value, folder, f"{place}.")


def entry_of(tasks: TaskSet, method: Method, plan: Plan, results: Mapping[str, Result]) -> MethodEntry:
    """The entry of a method's runs. Raises InputError if runs failed or are missing."""
    failed = [row for result in results.values() for row in result.failed]
    if failed:
        raise InputError(
            f"{plan.path}: {len(failed)} of its runs failed, so there is no entry; the first: {failed[0].condition}, "
            f"seed {failed[0].seed}: {failed[0].message}"
        )
    if lacking := [name for name, result in results.items() if result.missing]:
        raise InputError(f"{plan.path}: runs are missing, so there is no entry: {lacking[0]}, and others")
    runs = tuple(run_of(row) for result in results.values() for row in result.rows)
    whole = MethodEntry(
        set=tasks.name, set_digest=tasks.digest, parts=_parts(tasks, results), method=method,
        code=dict(plan.conditions[0].code.hashes), libraries=libraries(versions()), runs=runs, checksum="",
    )  # fmt: skip
    return msgspec.structs.replace(whole, checksum=checksum(whole))


def _parts(tasks: TaskSet, names: Iterable[str]) -> tuple[Literal["public", "held-out"], ...]:
    return tuple(sorted({task.world.part for task in tasks.tasks if task.name in set(names)}, reverse=True))


def run_of(row: Row) -> EntryRun:
    """A run's scores. Raises InputError if the run lacks one, as where robots have no maps."""
    found = row.summary
    try:
        return EntryRun(
            task=row.condition, seed=row.seed, status=_status(row), iterations=row.iterations or 0,
            t50=_count(found["t50"]), t90=_count(found["t90"]), t99=_count(found["t99"]), t100=_count(found["t100"]),
            overlap=found["overlap_sensed"], way=found["path_sum"] or 0.0, bytes=_count(found["bytes"]) or 0,
            messages=_count(found["messages"]) or 0, digest=row.digest or "",
        )  # fmt: skip
    except KeyError as problem:
        raise InputError(f"{row.condition}: its runs lack the measure {problem}; expected robots that map") from problem


def _status(row: Row) -> Literal["finished", "not finished"]:
    return "finished" if row.status == "finished" else "not finished"


def _count(value: float | None) -> int | None:
    return None if value is None else int(value)


def checksum(entry: MethodEntry) -> str:
    """A hash of all but the checksum itself."""
    text = msgspec.json.encode(msgspec.structs.replace(entry, checksum=""), order="deterministic")
    return hashlib.blake2b(text, digest_size=16).hexdigest()


def write_entry(entry: MethodEntry, out: Path, code: Code, folder: Path) -> list[Path]:
    """Write an entry as a .json file or, with the method's own code, into a folder; gives the files.

    Own code has to lie in `folder`, that of the method's file. Raises InputError.
    """
    texts = {Path(name): text.decode() for name, text in code.files.texts}
    if out.suffix == ".json":
        if texts:
            raise InputError(f"--out {out}: the method has code of its own; expected a folder, into which it goes too")
        files = {out: _json(entry)}
    else:
        files = {out / FILE: _json(entry), out / METHOD: _toml(entry.method)}
        for file, text in texts.items():
            if not file.is_relative_to(folder.absolute()):
                raise InputError(f"{file}: lies outside of {folder}; expected a method's code beside its file")
            files[out / file.relative_to(folder.absolute())] = text
    for path, whole in files.items():
        write_whole(path, whole)
    return list(files)


def _json(entry: MethodEntry) -> str:
    """An entry with a line for each run."""
    return msgspec.json.encode(entry).decode().replace('{"task":', '\n{"task":') + "\n"


def _toml(method: Method) -> str:
    return tomli_w.dumps(msgspec.to_builtins(method))


def read_entry(path: Path, tasks: TaskSet | None = None) -> MethodEntry:
    """An entry from its file or folder, checked against its set if that is given. Raises InputError."""
    file = path / FILE if path.is_dir() else path
    try:
        entry = msgspec.json.decode(content(file, EXPECTED), type=MethodEntry)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as problem:
        raise InputError(f"{file}: {problem}; expected {EXPECTED}") from problem
    if entry.checksum != checksum(entry):
        raise InputError(f"{file}: it was damaged or edited after it was made: its checksum is another")
    _check_mind(entry.method, file)
    for run in entry.runs:
        if wrong := _contradiction(run):
            raise InputError(f"{file}: {run.task}, seed {run.seed}: {wrong}")
    if tasks is not None:
        _check_tasks(entry, tasks, file)
    return entry


def entries_to_compare(tasks: TaskSet, given: Sequence[Path], alone: bool) -> list[MethodEntry]:
    """The given entries and, unless they stay `alone`, those that come with the set; of one name, the given one.

    Raises InputError for a damaged entry, one of another set, and if there are none.
    """
    mine = [read_entry(path, tasks) for path in given]
    names = {entry.method.name for entry in mine}
    files = () if alone else sorted((tasks.folder / ENTERED).glob("*.json"))
    mine += [entry for file in files if (entry := read_entry(file, tasks)).method.name not in names]
    if not mine:
        raise InputError(f"{tasks.folder}: no entries come with this set; expected some of your own to compare")
    return mine


def _contradiction(run: EntryRun) -> str:
    """What cannot be true of a run, or nothing."""
    times = [run.t50, run.t90, run.t99, run.t100]
    reached = [time for time in times if time is not None]
    if None in times[: len(reached)] or reached != sorted(reached) or any(time < 1 for time in reached):
        return f"t50 to t100 are {times}; expected rising numbers"
    if reached and reached[-1] > run.iterations:
        return f"reached a share after {reached[-1]} iterations, but ran {run.iterations}"
    if (run.t100 is not None) != (run.status == "finished"):
        return f"{run.status}, but t100 is {run.t100}"
    return ""


def _check_tasks(entry: MethodEntry, tasks: TaskSet, file: Path) -> None:
    if entry.set != tasks.name or entry.set_digest != tasks.digest:
        raise InputError(
            f"{file}: made for {entry.set} ({entry.set_digest[:8]}); expected {tasks.name} ({tasks.digest[:8]}), the "
            f"set in {tasks.folder}"
        )
    mine = [task for part in entry.parts for task in tasks.of_part(part)]
    expected = {(task.name, seed) for task in mine for seed in tasks.about.seeds}
    found = [(run.task, run.seed) for run in entry.runs]
    if "public" not in entry.parts or len(found) != len(set(found)) or set(found) != expected:
        raise InputError(
            f"{file}: has {len(set(found) & expected)} of the {len(expected)} runs of its parts of the set, and "
            f"{len(found) - len(set(found) & expected)} others; expected each once"
        )


def disagreements(entry: MethodEntry, repeated: Sequence[EntryRun]) -> list[str]:
    """A sentence for each number of the entry that a repeated run does not confirm."""
    claimed = {(run.task, run.seed): run for run in entry.runs}
    told = []
    for run in repeated:
        said = claimed[run.task, run.seed]
        for field in msgspec.structs.fields(EntryRun):
            was, now = getattr(said, field.name), getattr(run, field.name)
            if was != now:
                told.append(f"{run.task}, seed {run.seed}: {field.name} is {now}, the entry says {was}")
    return told


def sampled(entry: MethodEntry, share: float, names: Iterable[str], seed: int) -> list[str]:
    """The tasks to repeat: a share of the entry's among `names`, one at least, drawn by the seed."""
    known = sorted(set(names) & {run.task for run in entry.runs})
    count = max(1, round(share * len(known)))
    return sorted(random.Random(seed).sample(known, min(count, len(known))))


def place_of(path: Path) -> Path:
    """The file beside which an entry's own code is looked for."""
    return path / FILE if path.is_dir() else path
