"""A frozen set of tasks: worlds by digest, swarm sizes, regimes of communication, and the times of a known map's tour.

A set is a folder: `set.toml` says what its tasks are made of, `worlds.csv` has a line for each world, and
`references.csv` one for each task's reference. Some worlds may be held out: their seeds come from a secret. The
set holds only a hash of it.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Final, Literal

import msgspec
from msgspec import Meta, Struct

from swarmsim.core.errors import InputError
from swarmsim.core.scenario import shipped
from swarmsim.core.scenario.decoding import read_struct
from swarmsim.core.scenario.file import World, decode, load
from swarmsim.core.scenario.files import content
from swarmsim.core.scenario.toml import read_toml
from swarmsim.studies.benchmark.listed import read_lines
from swarmsim.studies.plan import Named, Plan, Study, plan_study
from swarmsim.world.source import read_world

SET, WORLDS, REFERENCES = "set.toml", "worlds.csv", "references.csv"
SHORTEST_SECRET: Final = 16  # characters: shorter ones could be guessed from their hash
Name = Annotated[str, Meta(pattern=r"^[a-z0-9][a-z0-9-]{0,59}$")]
Digest = Annotated[str, Meta(pattern="^[0-9a-f]{32}$")]
Count = Annotated[int, Meta(ge=0, le=1_000_000)]


class Regime(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What a task's scenario has in place of the set's."""

    title: str
    set: dict[str, object]  # by dotted key


class SetFile(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The contents of set.toml."""

    name: Name
    edition: Annotated[int, Meta(ge=1)]
    title: str
    scenario: str  # of every task, beside this file
    counts: Annotated[tuple[Annotated[int, Meta(ge=1)], ...], Meta(min_length=1)]  # of robots
    seeds: Annotated[tuple[Count, ...], Meta(min_length=1)] = (1,)
    cap: Annotated[float, Meta(gt=1.0, le=1000.0)] = 16.0  # a ratio beyond which slower runs count alike
    kinds: dict[Name, dict[str, object]] = {}  # generators of worlds
    regimes: Annotated[dict[Name, Regime], Meta(min_length=1)]
    struck: Regime | None = None  # for the worlds in which something goes wrong
    commitment: str = ""  # a hash of the secret behind the held-out worlds
    sealed: str = ""  # a digest of these worlds, which the secret opens


class SetWorld(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A line of worlds.csv."""

    world: Name
    kind: Name
    part: Literal["public", "held-out"]
    regime: Name
    struck: bool
    seed: Annotated[int, Meta(ge=0, le=2**63 - 1)] | None  # of the kind's generator; None if held out or from a file
    file: str  # the world, beside the set; empty if it is generated
    digest: Digest | None  # of its floor plan's text; None if held out


class ReferenceRow(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A line of references.csv: what nobody can beat in a task, and a tour with the map known; in iterations."""

    task: str
    seed: Count
    cells: Count  # of the coverage domain
    bound50: Count  # proved: no swarm with these starts sees half of the domain in less ...
    bound90: Count
    bound99: Count
    bound100: Count
    tour: Annotated[float, Meta(gt=0.0, le=1e6)]  # planned length of the best tour found
    t50: Count | None  # of that tour, replayed by the simulator; None if never reached
    t90: Count | None
    t99: Count | None
    t100: Count | None
    covered: Annotated[float, Meta(ge=0.0, le=1.0)]  # share of the domain at the replay's end
    digest: Digest  # of the replay


@dataclass(frozen=True, slots=True)
class SetTask:
    """One task: a world with a number of robots."""

    name: str
    world: SetWorld
    robots: int
    changes: dict[str, object] | None  # by dotted key, of the set's scenario; None if it is held out from us


@dataclass(frozen=True, slots=True)
class TaskSet:
    """A set whose worlds have been found to be those that it names."""

    folder: Path
    about: SetFile
    tasks: tuple[SetTask, ...]
    limit: int  # iterations after which a run counts as not finished
    period: float  # s, one iteration
    references: Mapping[tuple[str, int], ReferenceRow]  # by task and seed
    digest: str  # of everything that its runs depend on

    @property
    def name(self) -> str:
        """Its name with its edition, as in explore-1."""
        return f"{self.about.name}-{self.about.edition}"

    @property
    def made(self) -> tuple[SetTask, ...]:
        """The tasks that can be run: the public ones and, with the secret, those held out."""
        return tuple(task for task in self.tasks if task.changes is not None)

    def of_part(self, part: str) -> tuple[SetTask, ...]:
        """The tasks that are public, or held out."""
        return tuple(task for task in self.tasks if task.world.part == part)


def shipped_set() -> Path:
    """The newest set of exploration tasks that comes with swarmsim."""
    editions = (shipped.root() / "scenarios" / "benchmarks" / "explore").glob("[0-9]*")
    return max(editions, key=lambda path: int(path.name))


def open_set(folder: Path, secret: Path | None = None) -> TaskSet:
    """Read a set and make its worlds; with the file of its `secret` also those held out.

    Raises InputError for a damaged set, for a world that is no longer what it was, and for another secret.
    """
    about = read_struct(folder / SET, "a set of benchmark tasks", SetFile)
    worlds = read_lines(folder / WORLDS, SetWorld)
    _check(folder, about, worlds)
    opened = None if secret is None else _secret(folder, about, secret)
    tasks, held = list[SetTask](), hashlib.blake2b(digest_size=16, key=(opened or "").encode()[:64])
    for world in worlds:
        if world.part == "held-out" and opened is None:
            tasks += _tasks(about, world, None)
            continue
        where = _where(folder, about, world, opened)
        found = digest_of(folder, about, where, world.world)
        if world.part == "held-out":
            held.update(found.encode())
        elif found != world.digest:
            raise InputError(
                f"{folder / WORLDS}: {world.world}: this is another world than the set's (digest {found}, not "
                f"{world.digest}); expected the swarmsim and the files that the set was made with"
            )
        tasks += _tasks(about, world, where)
    if opened is not None and held.hexdigest() != about.sealed:
        raise InputError(f"{folder / SET}: sealed: the held-out worlds are others than those the set was made with")
    base = load(folder / about.scenario)
    whole = TaskSet(folder, about, tuple(tasks), base.limit, base.period, {}, _digest(folder, about))
    return replace(whole, references=_references(whole))


def _check(folder: Path, about: SetFile, worlds: list[SetWorld]) -> None:
    names = set[str]()
    for regime in (*about.regimes.values(), *filter(None, [about.struck])):
        if fixed := [key for key in regime.set if key.partition(".")[0] in ("period", "stop")]:
            raise InputError(f"{folder / SET}: {fixed[0]}: all tasks have {about.scenario}'s; expected other keys")
    for world in worlds:
        place = f"{folder / WORLDS}: {world.world}"
        if world.world in names:
            raise InputError(f"{place}: is listed twice; expected each world once")
        names.add(world.world)
        if world.regime not in about.regimes:
            raise InputError(f"{place}: regime {world.regime!r} is not in {SET}; known: {', '.join(about.regimes)}")
        if world.struck and about.struck is None:
            raise InputError(f"{place}: struck, but {SET} does not say by what; expected a table struck")
        if not world.file and world.kind not in about.kinds:
            raise InputError(f"{place}: kind {world.kind!r} is not in {SET}; known: {', '.join(about.kinds)}")
        held = world.part == "held-out"
        if held and (world.seed is not None or world.digest is not None or world.file or not about.commitment):
            raise InputError(f"{place}: held out, but its seed, file or digest stands here; expected none of them")
        if not held and (world.digest is None or (world.seed is None) == (not world.file)):
            raise InputError(f"{place}: expected a digest, and either a seed or a file")


def _where(folder: Path, about: SetFile, world: SetWorld, secret: str | None) -> dict[str, object]:
    """The scenario's table `world`."""
    if world.file:
        return {**_beside(folder, world), **about.kinds.get(world.kind, {})}
    seed = world.seed if secret is None or world.seed is not None else held_out_seed(secret, world.world)
    return {"generate": about.kinds[world.kind], "seed": seed}


def _beside(folder: Path, world: SetWorld) -> dict[str, object]:
    path = (folder / world.file).resolve()
    if not path.is_relative_to(folder.resolve()):
        raise InputError(f"{folder / WORLDS}: {world.world}: {world.file} lies outside of the set's folder")
    return {"file": str(path)}


def _tasks(about: SetFile, world: SetWorld, where: dict[str, object] | None) -> list[SetTask]:
    changes = {"world": where, **about.regimes[world.regime].set}
    if world.struck and about.struck is not None:
        changes |= about.struck.set
    each = {count: None if where is None else {**changes, "robots.count": count} for count in about.counts}
    return [SetTask(f"{world.world}/{count}", world, count, changes) for count, changes in each.items()]


def held_out_seed(secret: str, world: str) -> int:
    """The generator's seed of a held-out world: 62 bits of a keyed hash."""
    found = hashlib.blake2b(world.encode(), digest_size=8, key=secret.encode()[:64])
    return int.from_bytes(found.digest(), "big") >> 2


def commitment(secret: str, name: str) -> str:
    """The hash of a secret that a set publishes; `name` is the set's."""
    return hashlib.blake2b(f"swarmsim benchmark {name}: {secret}".encode(), digest_size=32).hexdigest()


def _secret(folder: Path, about: SetFile, file: Path) -> str:
    found = content(file, "the secret of a set, in a text file").decode("utf-8", "replace").strip()
    if not about.commitment:
        raise InputError(f"--secret {file}: the set {folder} holds nothing out; expected no secret")
    if len(found) < SHORTEST_SECRET or commitment(found, f"{about.name}-{about.edition}") != about.commitment:
        raise InputError(f"--secret {file}: not the secret of this set: its hash is not that in {folder / SET}")
    return found


def digest_of(folder: Path, about: SetFile, where: Mapping[str, object], name: str) -> str:
    """The digest of a world's floor plan, as its robots find it. Raises InputError."""
    table = read_toml(folder / about.scenario, "the scenario of a set")
    scenario = decode({**table, "world": dict(where)}, str(folder / about.scenario), folder)
    try:
        return text_digest(read_world(scenario.world, scenario.grid.cell), scenario.world)
    except InputError as problem:
        raise InputError(f"{folder / WORLDS}: {name}: {problem}") from problem


def text_digest(text: str, world: World) -> str:
    """The digest of a floor plan's text and of how it is read, wherever its file lies."""
    how = {**msgspec.structs.asdict(world), "file": "", "generate": None, "seed": 0}
    return hashlib.blake2b(text.encode() + msgspec.json.encode(how, order="sorted"), digest_size=16).hexdigest()


def _digest(folder: Path, about: SetFile) -> str:
    """A digest of the set without its references, whatever its files' line ends."""
    files = (folder / SET, folder / WORLDS, folder / about.scenario)
    texts = [content(file, "a file of a set of tasks").decode("utf-8", "replace").splitlines() for file in files]
    return hashlib.blake2b(msgspec.json.encode(texts), digest_size=16).hexdigest()


def _references(tasks: TaskSet) -> dict[tuple[str, int], ReferenceRow]:
    path = tasks.folder / REFERENCES
    if not path.is_file():
        return {}
    known = {(task.name, seed) for task in tasks.tasks for seed in tasks.about.seeds}
    found: dict[tuple[str, int], ReferenceRow] = {}
    for line in read_lines(path, ReferenceRow):
        if (line.task, line.seed) not in known or (line.task, line.seed) in found:
            raise InputError(f"{path}: {line.task}, seed {line.seed}: no task of the set, or listed twice")
        found[line.task, line.seed] = line
    return found


def plan_of(tasks: TaskSet, mind: Mapping[str, object], place: Path, chosen: Iterable[SetTask]) -> Plan:
    """The study of these robots' `mind` over the chosen tasks; messages name `place`. Raises InputError."""
    study = Study(
        title=tasks.about.title,
        scenario=str((tasks.folder / tasks.about.scenario).resolve()),
        seeds=list(tasks.about.seeds),
        keep="summary",
        set={f"mind.{key}": value for key, value in mind.items()},
        condition=tuple(Named(name=task.name, set=task.changes or {}) for task in chosen),
    )
    return plan_study(place, study)
