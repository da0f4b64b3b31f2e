"""The scenario file: everything a run depends on, typed, checked and complete."""

from __future__ import annotations

import copy
import os
from collections.abc import Iterable, Mapping
from functools import reduce
from pathlib import Path
from typing import Annotated, Any, Final, Literal, TypeVar

import msgspec
from msgspec import Meta, Struct
from msgspec import field as of
from msgspec import inspect as types

from swarmsim.core import registry
from swarmsim.core.budget import BUDGET
from swarmsim.core.describe import words
from swarmsim.core.errors import InputError
from swarmsim.core.files import Table, outside, with_files
from swarmsim.core.platforms import with_platforms
from swarmsim.core.robots import Count, Positive, Robots
from swarmsim.core.seams import SEAMS, at_place
from swarmsim.core.toml import DEEPEST, TOO_DEEP, parsed, read_toml

_HOMES: Final = (Path(__file__).parents[1], Path(__file__).parents[2])  # of our own scenarios and worlds


S = TypeVar("S", bound=Struct)
Edges = Annotated[float, Meta(ge=-1e4, le=1e4)]
Name = Annotated[str, Meta(min_length=1)]
Names = Annotated[list[Name], Meta(min_length=1)]


class World(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, omit_defaults=True):
    """The building: a drawing, a map, polygons, a plan of a building program, or one that is made.

    `scale` multiplies the metres of the file, or `width` says how many metres its page is wide; `resolution` is that of
    a bitmap without a YAML. `layers` says by which ids, labels or classes a drawing's layers (walls, pillars,
    furniture, doors, spawn, unknown) are known, where they are not called so, and `floor` which names are floor.
    `level` is the storey of a file with several. `solid` says whether all that a drawing without layers shows is
    solid, or its strokes alone, with floor between them; left out, the drawing decides. Closed rooms get doors
    `doors` wide; left out, they do where a drawing of rooms has none. `border` closes a building that is open to the
    page's edge; left out, it does where that is needed. What robots cannot enter is ignored, filled or refused, by
    `pockets`. Solid specks up to `despeckle` are dropped. `spawn` is an area in which robots may start, called
    `spawn`; where the file has none either, the floor is. What a map does not know is a wall, or a space that does
    not count.
    """

    file: str = ""
    scale: Positive | None = None
    width: Positive | None = None  # m, of the whole page
    resolution: Positive | None = None  # m, one pixel
    layers: dict[str, Names] = of(default_factory=dict)
    floor: list[Name] = of(default_factory=list)
    level: str = ""
    solid: Literal["all", "strokes"] | None = None
    doors: Annotated[float, Meta(ge=0.0, le=10.0)] | None = None  # m, 0 for none
    border: bool | None = None
    pockets: Literal["ignore", "fill", "refuse"] = "ignore"
    despeckle: Annotated[float, Meta(ge=0.0, le=1e4)] = 0.0  # m2
    spawn: tuple[Edges, Edges, Positive, Positive] | None = None  # x, y of the lower left corner, width, height in m
    unknown: Literal["wall", "space"] = "wall"
    generate: Table = of(default_factory=dict)  # none unless it has a `use`
    seed: Annotated[int, Meta(ge=0, le=2**63 - 1)] = 1  # of what is made

    def __post_init__(self) -> None:
        if bool(self.file) == bool(self.generate):
            raise ValueError("expected either a file or a table 'generate'")
        if sum(given is not None for given in (self.scale, self.width, self.resolution)) > 1:
            raise ValueError("scale, width and resolution say the same in three ways; expected one of them")

    @property
    def title(self) -> str:
        """What messages call it."""
        return self.file or f"{self.generate.get('use')} {self.seed}"


class Grid(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The cells of truth, tiles and maps."""

    cell: Positive = 0.15  # m


class Network(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Who hears whom, and what arrives."""

    topology: Table
    channel: Table = of(default_factory=dict)


class Mind(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What a robot computes from what it senses and hears, and what it does with that."""

    computation: Table = of(default_factory=dict)
    strategy: Table = of(default_factory=dict)


class Stop(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """When a run ends: with its task or, unfinished, after so many iterations.

    A run that goes on when its task is done ends after `iterations`, and is finished if it was done on the way.
    """

    when_done: Literal["stop", "go-on"] = "stop"
    iterations: Count = 5000


class Scenario(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One run. The tables of parts (`sensor`, `network.topology`, ...) are complete once read."""

    title: str = ""  # default: the name of the file; {robots.count} in it is their number
    world: World
    seed: Annotated[int, Meta(ge=0, le=2**63 - 1)] = 1
    period: Annotated[float, Meta(ge=1e-4, le=1e5)] = 1.0  # s, one iteration
    grid: Grid = Grid()
    robots: Robots
    physics: Table = of(default_factory=dict)
    sensor: Table = of(default_factory=dict)
    field: Table = of(default_factory=dict)  # none unless it has a `use`
    localisation: Table = of(default_factory=dict)
    network: Network
    mind: Mind = Mind()
    motion: Table = of(default_factory=dict)
    task: Table = of(default_factory=dict)
    faults: tuple[Table, ...] = ()
    probes: tuple[Table, ...] = ()
    stop: Stop = Stop()
    budget: Annotated[float, Meta(ge=1.0, le=1e9)] = BUDGET  # s, which to prepare the run, and to do it, may each take


HALVES: Final = ("computation", "strategy")  # of a mind

#: Keys that are not written out where there is nothing at them.
LATER: Final = ("probes",)
#: Keys of older scenarios, with what stands in their place.
MOVED: Final = {
    "behaviour": "mind.computation and mind.strategy",
    "network.sharing": "mind.computation.share",
    "stop.coverage": "task.share",
    "stop.at_coverage": "stop.when_done",
}


def tables(scenario: Scenario) -> dict[str, Table]:
    """The table of every part that a scenario has one of, by seam: a field or a generator only if there is one."""
    found: dict[str, Table] = {}
    for seam in SEAMS.values():
        table = _at(scenario, seam.place) if seam.place and not seam.many else None
        if isinstance(table, dict) and (seam.default is not None or seam.required or table):
            found[seam.name] = table
    return found


def lists(scenario: Scenario) -> list[tuple[str, str, Table]]:
    """The table of every part that a scenario has any number of, with its seam and its place: `faults[2]`."""
    return [
        (seam.name, f"{seam.at}[{i}]", table)
        for seam in SEAMS.values()
        if seam.many
        for i, table in enumerate(_at(scenario, seam.place))
    ]


def without_later(table: Table) -> Table:
    """A scenario's table as it was before there was what it has none of: recordings and studies hold such texts."""
    return {key: value for key, value in table.items() if value or key not in LATER}


def _at(whole: Any, place: tuple[str, ...]) -> Any:
    """What is at these keys of a scenario."""
    return reduce(getattr, place, whole)


def _with(whole: S, place: tuple[str, ...], value: object) -> S:
    """A scenario, or a struct in it, with another value at these keys."""
    key, *rest = place
    inner = _with(getattr(whole, key), tuple(rest), value) if rest else value
    return msgspec.structs.replace(whole, **{key: inner})


def load(path: Path, overrides: Iterable[str] = (), changes: Mapping[str, Any] | None = None) -> Scenario:
    """Read a scenario file, with `key.path=value` overrides whose values are TOML, then `changes` by dotted key.

    Paths in it resolve from the file's folder. Raises InputError naming the file and the key.
    """
    table = read_toml(path, "a scenario file")
    for override in overrides:
        set_key(table, override)
    for key, value in (changes or {}).items():
        try:
            assign(table, key, value)
        except InputError as problem:
            raise InputError(f"{path}: {problem}") from problem
    return decode({"title": path.stem, **table}, str(path), path.parent)


def files_outside(path: Path, overrides: Iterable[str] = ()) -> list[str]:
    """A notice for each file that a scenario file reads from outside of its folder; ours may read our own worlds."""
    table = read_toml(path, "a scenario file")
    for override in overrides:
        set_key(table, override)
    ours = next((home for home in _HOMES if path.resolve().is_relative_to(home / "scenarios")), None)
    return outside(spelled_out(table), path.parent, ours)


def spelled_out(table: Table) -> Table:
    """The table with its short forms written out: `world = "FILE"` as a table, `mind.use` as both halves of a mind."""
    world, mind = table.get("world"), table.get("mind")
    if isinstance(world, str):
        table = {**table, "world": {"file": world}}
    if isinstance(mind, dict) and "use" in mind and not set(HALVES) & mind.keys():
        table = {**table, "mind": {half: copy.deepcopy(mind) for half in HALVES}}
    return table


def decode(table: Table, name: str, folder: Path | None = None) -> Scenario:
    """The scenario that a table describes; `name` is the file named in messages.

    If `folder` is given, the world's path is resolved from it, and so are those of tables of numbers (a value
    {file = "net.csv"} of a part stands for the rows of that file) and of its own parts. Raises InputError.
    """
    scenario = shape(table, name)

    def complete(seam: str, place: str, table: Table) -> Table:
        try:
            return registry.complete(seam, table if folder is None else with_files(table, folder))
        except InputError as problem:
            raise InputError(f"{name}: {place}.{problem}") from problem

    groups = list(scenario.robots.groups)
    for i, group in enumerate(groups):
        for seam in SEAMS.values():
            if seam.of_groups and (table := getattr(group, seam.name)):
                whole = complete(seam.name, f"robots[{i}].{seam.name}", table)
                groups[i] = msgspec.structs.replace(groups[i], **{seam.name: whole})
    if groups:
        scenario = _with(scenario, ("robots", "groups"), tuple(groups))
    for which, table in tables(scenario).items():
        scenario = _with(scenario, SEAMS[which].place, complete(which, SEAMS[which].at, table))
    for seam in SEAMS.values():
        if seam.many:
            listed = [complete(which, place, one) for which, place, one in lists(scenario) if which == seam.name]
            scenario = _with(scenario, seam.place, tuple(listed))
    if folder is not None and scenario.world.file:
        scenario = _with(scenario, ("world", "file"), os.path.normpath(folder / scenario.world.file))
    return _with(scenario, ("title",), scenario.title.replace("{robots.count}", str(scenario.robots.count)))


def shape(table: Table, name: str) -> Scenario:
    """The scenario in a table whose parts are taken as they stand: none of them is looked for, no code runs.

    Raises InputError, which names the file `name` and the key.
    """
    try:
        table = with_platforms(spelled_out(table))
    except InputError as problem:
        raise InputError(f"{name}: {problem}") from problem
    if isinstance(mind := table.get("mind"), dict) and "use" in mind:
        raise InputError(f"{name}: mind.use: stands for computation and strategy at once; expected it without those")
    for key, now in MOVED.items():
        inner: Any = table
        for step in key.split("."):
            inner = inner.get(step) if isinstance(inner, dict) else None
        if inner is not None:
            raise InputError(f"{name}: {key}: is not called so any more; expected {now}")
    try:
        return registry.convert(table, Scenario)
    except InputError as problem:
        raise InputError(f"{name}: {problem}") from problem


def set_key(table: Table, override: str) -> None:
    """Set one dotted key of a scenario table, as in `robots.count=20` or `title=My room`. Raises InputError."""
    path, equals, text = override.partition("=")
    if not equals or not all(key.strip() for key in path.split(".")):
        raise InputError(f"--set {_short(override)}: expected key=value, as in robots.count=20")
    try:
        assign(table, path, _value(table, path, text.strip()))
    except InputError as problem:
        raise InputError(f"--set {_short(override)}: {problem}") from problem


def _value(table: Table, path: str, text: str) -> Any:
    """The TOML value in a text or, where the key takes text, the text itself. Raises InputError."""
    kind = _kind(table, path)
    try:
        given = parsed(f"value = {text}")
    except ValueError as problem:
        if not text or text[0] in "\"'[{" or not text.isprintable():
            raise InputError(f"{_short(text)!r} is not a TOML value: {problem}") from problem
        if kind is not None and not _takes_text(kind):
            wanted = words(kind)
            article = "a " if wanted.startswith(("whole", "number", "list", "table")) else ""
            raise InputError(f"{_short(text)!r} is not what {path} takes: {article}{wanted}") from problem
        return text
    if list(given) != ["value"]:
        raise InputError("one value at a time")
    value = given["value"]
    return text if isinstance(kind, types.StrType) and not isinstance(value, str | list | dict) else value


def _short(text: str) -> str:
    """A text of one line and no great length, for messages."""
    line = " ".join(text.split("\n"))
    return line if len(line) <= 100 else f"{line[:100]}..."


def _takes_text(kind: types.Type) -> bool:
    match kind:
        case types.Metadata():
            return _takes_text(kind.type)
        case types.UnionType():
            return any(_takes_text(one) for one in kind.types)
        case types.LiteralType():
            return any(isinstance(value, str) for value in kind.values)
    return isinstance(kind, types.StrType | types.AnyType)


def _kind(table: Table, path: str) -> types.Type | None:
    """What a dotted key of a scenario takes; None if that is not known, as of parts of one's own."""
    if path.strip() == "world":  # for which the name of its file may stand
        return types.StrType()
    keys, inner = _places(table, path)[0], spelled_out(table)
    kind: types.Type = types.type_info(Scenario)
    for depth, key in enumerate(keys):
        seam = at_place(tuple(keys[:depth]))
        if seam is not None and key == "use":
            return types.StrType()
        if seam is not None:
            use = inner.get("use", seam.default)
            if not isinstance(use, str) or use not in registry.entries(seam.name):
                return None
            kind = types.type_info(registry.find(seam.name, use))
        fields = kind.fields if isinstance(kind, types.StructType) else ()
        found = [field.type for field in fields if field.encode_name == key]
        if not found:
            return None
        kind, value = found[0], inner.get(key)
        inner = value if isinstance(value, dict) else {}
    return kind


def assign(table: Table, path: str, value: Any) -> None:
    """Set a dotted key of a scenario's table, making the tables on the way.

    `mind.KEY` is a key of both halves of a mind that are one part. Raises InputError where a value is in the way.
    """
    table.update(spelled_out(table))
    for place in _places(table, path):
        inner = table
        for depth, key in enumerate(place[:-1]):
            inner = inner.setdefault(key, {})
            if not isinstance(inner, dict):
                raise InputError(f"{'.'.join(place[: depth + 1])} is {inner!r}, not a table")
        inner[place[-1]] = copy.deepcopy(value)


def _places(table: Table, path: str) -> list[list[str]]:
    """Where a dotted key of a scenario stands, once short forms are written out. Raises InputError."""
    keys = [key.strip() for key in path.split(".")]
    if len(keys) > DEEPEST:
        raise InputError(f"{TOO_DEEP}, as keys do")
    mind = spelled_out(table).get("mind")
    if keys[0] != "mind" or len(keys) < 2 or keys[1] in HALVES or not isinstance(mind, dict):
        return [keys]
    uses = [half.get("use") if isinstance(half, dict) else None for half in (mind.get(half) for half in HALVES)]
    if uses[0] is None or uses[0] != uses[1]:
        return [keys]
    return [["mind", half, *keys[1:]] for half in HALVES]
