"""The scenario file: everything a run depends on, typed, checked and complete."""

from __future__ import annotations

import copy
import math
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache, reduce
from pathlib import Path
from typing import Annotated, Any, Final, Literal, Protocol, TypeGuard, cast

import msgspec
from msgspec import UNSET, Meta, Struct, UnsetType
from msgspec import inspect as types

from swarmsim.core.context import Field
from swarmsim.core.crew import Length
from swarmsim.core.drawing import Layer
from swarmsim.core.durations import iterations_in
from swarmsim.core.errors import InputError
from swarmsim.core.jobs import AnyJob
from swarmsim.core.kinematics import Kinematics
from swarmsim.core.parts import (
    Actuator,
    AnyComputation,
    AnyStrategy,
    AnyTask,
    Bodies,
    Fault,
    Generator,
    Localisation,
    Motion,
    NetworkChannel,
    Probe,
    Sensor,
    Topology,
)
from swarmsim.core.scenario import registry, shipped
from swarmsim.core.scenario.budget import BUDGET
from swarmsim.core.scenario.decoding import Take, convert
from swarmsim.core.scenario.describe import words
from swarmsim.core.scenario.expect import without_expectations
from swarmsim.core.scenario.files import Table, outside
from swarmsim.core.scenario.part import NONE, Part, plain
from swarmsim.core.scenario.platforms import with_platforms
from swarmsim.core.scenario.robots import LONGEST, Count, Group, GroupMind, Positive, Robots
from swarmsim.core.scenario.toml import DEEPEST, TOO_DEEP, parsed, read_toml
from swarmsim.core.seams import PLACED, at_place

_HOMES: Final = (Path(__file__).parents[2], Path(__file__).parents[3])  # of our own scenarios and worlds


Edges = Annotated[float, Meta(ge=-1e4, le=1e4)]
Name = Annotated[str, Meta(min_length=1)]
Names = Annotated[tuple[Name, ...], Meta(min_length=1)]


class Layers(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, omit_defaults=True):
    """Names of a drawing's layers."""

    # in the order used by identities of studies
    doors: Names | None = None  # openings in walls, which are floor
    floor: Names | None = None  # where robots can be
    furniture: Names | None = None  # solid things that stand about
    pillars: Names | None = None  # solid, as walls
    spawn: Names | None = None  # areas where robots can start, by their names
    unknown: Names | None = None  # space that does not count
    walls: Names | None = None  # solid

    def __reduce__(self) -> str | tuple[object, ...]:
        """The default itself if it names nothing, since texts omit only that very object."""
        return "UNNAMED" if self == UNNAMED else (msgspec.convert, (msgspec.to_builtins(self), Layers))


UNNAMED: Final = Layers()


class World(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, omit_defaults=True):
    """The building: a drawing, a map, polygons, a building program's plan, or a generated one.

    `scale` multiplies the file's metres, or `width` gives its page's width in metres; `resolution` is for a bitmap
    without a YAML. `layers` gives the ids, labels or classes of a drawing's layers (walls, pillars, furniture,
    doors, spawn, unknown) with other names, and `floor` those that are floor. `level` is the storey of a file with
    several. `solid` tells whether all of a drawing without layers is solid, or only its strokes, with floor between
    them; by default the drawing decides. Closed rooms get doors `doors` wide; by default only where a drawing of
    rooms has none. `border` closes a building that is open to the page's edge; by default where needed. `pockets`
    ignores, fills or refuses space that robots cannot enter. Solid specks up to `despeckle` are dropped. `spawn` is
    a start area called `spawn`; without it, the file's, or the floor. A map's unknown cells are walls, or space
    that does not count.
    """

    file: str = ""  # path from the scenario, or the name of a world that ships
    scale: Positive | None = None  # factor on the file's metres
    width: Positive | None = None  # m, of the whole page
    resolution: Positive | None = None  # m, one pixel
    layers: Layers = UNNAMED  # ids, labels or classes of a drawing's layers that have other names
    floor: tuple[Name, ...] = ()  # layers or areas that are floor; default: what is not solid
    level: str = ""  # the storey, of a file with several
    solid: Literal["all", "strokes"] | None = None  # what is wall in a drawing without layers; default: by its look
    doors: Annotated[float, Meta(ge=0.0, le=10.0)] | None = None  # m, width of doors in closed rooms; 0 for none
    border: bool | None = None  # whether a wall closes the page's edge; default: where it is open
    pockets: Literal["ignore", "fill", "refuse"] = "ignore"  # what becomes of space that no robot can enter
    despeckle: Annotated[float, Meta(ge=0.0, le=1e4)] = 0.0  # m2, solid specks up to this size are dropped
    spawn: tuple[Edges, Edges, Length, Length] | None = None  # x, y of the lower left corner, width, height in m
    unknown: Literal["wall", "space"] = "wall"  # what unknown cells of a map are: walls, or space that does not count
    generate: Part[Generator] = NONE  # makes a building instead of a file
    seed: Annotated[int, Meta(ge=0, le=2**63 - 1)] = 1  # of the generator

    def __post_init__(self) -> None:
        if bool(self.file) == bool(self.generate):
            raise ValueError("expected either a file or a table 'generate'")
        if sum(given is not None for given in (self.scale, self.width, self.resolution)) > 1:
            raise ValueError("scale, width and resolution say the same in three ways; expected one of them")

    @property
    def title(self) -> str:
        """Its name in messages."""
        return self.file or f"{self.generate.use} {self.seed}"

    @property
    def named(self) -> dict[str, Names]:
        """The names of a drawing's layers, as far as the scenario gives them."""
        return {layer: names for layer, names in msgspec.structs.asdict(self.layers).items() if names is not None}


class Grid(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The cells of truth, tiles and maps."""

    cell: Positive = 0.15  # m, side of a cell


class Network(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Which robot hears which, and which messages arrive."""

    topology: Part[Topology]  # who hears whom
    channel: Part[NetworkChannel] = Part("channel")  # what arrives, and when
    rounds: Annotated[int, Meta(ge=1, le=1000, extra_json_schema={"default": 1})] | UnsetType = (
        UNSET  # exchanges of messages in an iteration; all but the first are for jobs alone
    )
    charged: Annotated[Literal["heard", "sent"], Meta(extra_json_schema={"default": "heard"})] | UnsetType = (
        UNSET  # whether a radio's bandwidth is charged for each robot that hears a message, or once for all
    )

    @property
    def exchanges(self) -> int:
        """The exchanges of messages in an iteration."""
        return 1 if self.rounds is UNSET else self.rounds


class Mind(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A robot's mind: its computation and its strategy."""

    computation: Part[AnyComputation] = Part("computation")  # what a robot knows and tells
    strategy: Part[AnyStrategy] = Part("strategy")  # where it goes


class Stop(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """When a run ends: with its task or, unfinished, at its limit, in `iterations` or in simulated `seconds`.

    With both, the earlier is the limit; with neither, 5000 iterations. A run that continues when its task is done
    ends at the limit, and counts as finished.
    """

    when_done: Literal["stop", "continue"] = "stop"  # what a run does when its task is done
    iterations: Annotated[Count, Meta(extra_json_schema={"default": 5000})] | UnsetType = UNSET  # the limit
    seconds: Annotated[float, Meta(gt=0.0, le=1e9)] | UnsetType = UNSET  # s, simulated

    def __post_init__(self) -> None:
        if self.iterations is UNSET and self.seconds is UNSET:  # written out, as texts of older scenarios have it
            msgspec.structs.force_setattr(self, "iterations", 5000)


class Scenario(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One run. Its parts (`sensor`, `network.topology`, ...) are typed values, complete once read."""

    title: str = ""  # default: the file's name; {robots.count} in it becomes the number
    world: World  # the building: a file, or a table
    seed: Annotated[int, Meta(ge=0, le=2**63 - 1)] = 1  # of everything random in the run
    period: Annotated[float, Meta(ge=1e-4, le=1e5)] = 1.0  # s, one iteration
    grid: Grid = Grid()  # the cells of truth, tiles and maps
    robots: Robots  # their number, starts and bodies; several [[robots]] are groups
    physics: Part[Bodies] = Part("physics")  # what moves bodies
    sensor: Part[Sensor] = Part("sensor")  # what each robot measures
    sensors: tuple[Part[Sensor], ...] = ()  # further ones or, without `sensor`, all
    actuators: tuple[Part[Actuator], ...] = ()  # what robots do besides driving
    field: Part[Field] = NONE  # a quantity that has a value everywhere
    localisation: Part[Localisation] = Part("localisation")  # what each robot takes for its pose
    network: Network  # who hears whom, and what arrives
    mind: Mind = Mind()  # what each robot computes, and where it goes
    jobs: tuple[Part[AnyJob], ...] = ()  # computed beside the minds
    motion: Part[Motion] = Part("motion")  # how a robot follows its way
    kinematics: Part[Kinematics] = Part("kinematics")  # what its wheels can do
    task: Part[AnyTask] = Part("task")  # what is measured, and when the run is done
    faults: tuple[Part[Fault], ...] = ()  # what goes wrong, when, for whom
    probes: tuple[Part[Probe], ...] = ()  # what else is recorded
    layers: tuple[Part[Layer], ...] = ()  # shown in pictures as well
    stop: Stop = Stop()  # when the run ends
    budget: Annotated[float, Meta(ge=1.0, le=1e9)] = BUDGET  # s, limit for preparing the run and for doing it

    def __post_init__(self) -> None:
        if self.stop.seconds is not UNSET and not 1 <= self.limit <= LONGEST:
            raise ValueError(
                f"stop.seconds: {self.stop.seconds:g} s are {self.stop.seconds / self.period:.4g} iterations with a "
                f"period of {self.period:g} s; expected 1 to {LONGEST} iterations"
            )

    @property
    def limit(self) -> int:
        """The iterations after which a run that is not done ends: the whole ones within `stop.seconds`."""
        within = math.inf if self.stop.seconds is UNSET else iterations_in(self.stop.seconds, self.period)
        return int(min(within, math.inf if self.stop.iterations is UNSET else self.stop.iterations))


Tables = Table | list[Table]
Sensors = tuple[tuple[str, Part[Sensor]], ...]  # each with its place in the scenario
HALVES: Final = ("computation", "strategy")  # of a mind

#: Keys left out of texts where they are empty or have the value implied by older scenarios.
LATER: Final[Mapping[str, object]] = {
    "actuators": (), "jobs": (), "layers": (), "probes": (), "sensors": (), "kinematics": {"use": "differential"},
}  # fmt: skip
#: Keys of older scenarios, with their replacements.
MOVED: Final = {
    "behaviour": "mind.computation and mind.strategy",
    "network.sharing": "mind.computation.sharing",
    "stop.coverage": "task.share",
    "stop.at_coverage": "stop.when_done",
}


def parts_of(scenario: Scenario) -> dict[str, Part[object]]:
    """The parts of seams with one part, by seam; a field or a generator only if there is one."""
    found: dict[str, Part[object]] = {}
    for seam in PLACED.values():
        part = _at(scenario, seam.place) if seam.place and not seam.many else NONE
        if part or seam.required:
            found[seam.name] = part
    return found


def lists(scenario: Scenario) -> list[tuple[str, Part[object]]]:
    """The parts of seams with any number, with their places: `faults[2]`."""
    return [
        (f"{seam.at}[{i}]", part)
        for seam in PLACED.values()
        if seam.many
        for i, part in enumerate(_at(scenario, seam.place))
    ]


def all_parts(scenario: Scenario) -> list[Part[object]]:
    """All parts that a scenario names."""
    minds = minds_of(scenario)
    single: list[Part[object]] = []
    for seam, part in parts_of(scenario).items():
        if seam in HALVES:  # those that some robots have
            single += dict.fromkeys(getattr(one.mind, seam) for one in minds)
        elif seam not in ("sensor", "kinematics"):
            single.append(part)
    of_groups = (*sensors_of(scenario), *dict.fromkeys(kinematics_of(scenario)))
    return [*single, *(part for _, part in of_groups), *(part for _, part in lists(scenario))]


def every_part(scenario: Scenario) -> list[Part[object]]:
    """All parts that a scenario names, including those in others' keys."""
    return [one for part in all_parts(scenario) for one in part.inside()]


def fitted(scenario: Scenario) -> list[Sensors]:
    """The sensors of each group of robots, with their places in the scenario; one entry if no group has its own.

    `[sensor]` and all of `[[sensors]]`; without either, one sensor. A group with its own has no others.
    """
    listed = tuple((f"sensors[{i}]", one) for i, one in enumerate(scenario.sensors))
    all_have: Sensors = (("sensor", scenario.sensor), *listed) if scenario.sensor else listed
    own: list[Sensors] = []
    for i, group in enumerate(scenario.robots.groups):
        place, more = f"robots[{i}].sensor", () if group.sensors is UNSET else group.sensors
        found = tuple((f"{place}s[{j}]", one) for j, one in enumerate(more))
        own.append(((place, group.sensor), *found) if group.sensor else found)
    return [mine or all_have for mine in own] if any(own) else [all_have]


@dataclass(frozen=True, slots=True)
class Minded:
    """The robots with one mind, and where its halves are in the scenario."""

    mind: Mind
    places: Mapping[str, str]  # of the halves, by seam
    groups: tuple[int, ...]  # the numbers of these robots' groups; empty: all robots


class Manned(Protocol):
    """What has robots with minds: a scenario, or what one robot is told of it."""

    @property
    def robots(self) -> Robots: ...

    @property
    def mind(self) -> Mind: ...


def minds_of(scenario: Manned) -> list[Minded]:
    """The minds of a scenario: groups with equal ones share them; one entry if all robots have the same.

    A half that a group does not name is the scenario's.
    """
    found: dict[Mind, Minded] = {}
    for number, group in enumerate(scenario.robots.groups):
        own = GroupMind() if group.mind is UNSET else group.mind
        halves = {half: getattr(own, half) or getattr(scenario.mind, half) for half in HALVES}
        mind = Mind(**halves)
        places = {half: f"robots[{number}].mind.{half}" if getattr(own, half) else f"mind.{half}" for half in HALVES}
        first = found.setdefault(mind, Minded(mind, places, ()))
        found[mind] = Minded(mind, first.places, (*first.groups, number))
    if len(found) > 1:
        return list(found.values())
    alone = next(iter(found.values()), Minded(scenario.mind, {half: f"mind.{half}" for half in HALVES}, ()))
    return [Minded(alone.mind, alone.places, ())]


def sensors_of(scenario: Scenario) -> Sensors:
    """All sensors of any robots, with their places in the scenario."""
    return tuple(dict(one for of in fitted(scenario) for one in of).items())


def kinematics_of(scenario: Scenario) -> list[tuple[str, Part[Kinematics]]]:
    """Each group's kinematics, with its place in the scenario; one entry if no group has its own."""
    groups = scenario.robots.groups
    all_have = ("kinematics", scenario.kinematics)
    if all(group.kinematics is UNSET for group in groups):
        return [all_have]
    return [
        all_have if group.kinematics is UNSET else (f"robots[{i}].kinematics", group.kinematics)
        for i, group in enumerate(groups)
    ]


def table_of(scenario: Scenario) -> Table:
    """A scenario as a complete TOML table."""
    table: Table = without_none(without_later(msgspec.to_builtins(scenario, enc_hook=plain)))
    return table


def without_none(value: object) -> Any:  # noqa: ANN401 - same type out as in
    """The same without None, which TOML lacks."""
    if isinstance(value, dict):
        return {key: without_none(inner) for key, inner in value.items() if inner is not None}
    return [without_none(inner) for inner in value] if isinstance(value, list | tuple) else value


def without_later(table: Table) -> Table:
    """A scenario's table without the newer keys that it does not use, as older recordings and studies have it."""

    def says(key: str, value: object) -> bool:
        found = value.table if isinstance(value, Part) else value
        return key not in LATER or bool(found and found != LATER[key])

    return {key: value for key, value in table.items() if says(key, value)}


def _at(whole: Scenario, place: tuple[str, ...]) -> Any:  # noqa: ANN401 - a part, or several
    """The value at these keys of a scenario."""
    return reduce(getattr, place, whole)


def load(path: Path, overrides: Iterable[str] = (), changes: Mapping[str, object] | None = None) -> Scenario:
    """Read a scenario file, with `key.path=value` overrides whose values are TOML, then `changes` by dotted key.

    The path may be the name of one that ships. Paths in it resolve from the file's folder. Raises InputError naming
    the file and the key.
    """
    path = shipped.found(path)
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
    """A notice for each file that a scenario reads from outside its folder; ours may read our own worlds."""
    path = shipped.found(path)
    table = read_toml(path, "a scenario file")
    for override in overrides:
        set_key(table, override)
    ours = next((home for home in _HOMES if path.resolve().is_relative_to(home / "scenarios")), None)
    return outside(spelled_out(table), path.parent, ours)


def spelled_out(table: Table) -> Table:
    """The table with its short forms written out: `world = "FILE"` as a table, `mind.use` as both halves of a mind."""
    world, robots, changed = table.get("world"), table.get("robots"), dict[str, object]()
    if isinstance(world, str):
        changed["world"] = {"file": world}
    if "mind" in table:
        changed["mind"] = _halves(table["mind"])
    if isinstance(robots, list):
        changed["robots"] = [_with_halves(one) for one in robots]
    elif isinstance(robots, dict) and isinstance(robots.get("groups"), list):
        changed["robots"] = {**robots, "groups": [_with_halves(one) for one in robots["groups"]]}
    return {**table, **changed}


def _with_halves(group: object) -> object:
    """A group of robots, its mind written out."""
    return {**group, "mind": _halves(group["mind"])} if isinstance(group, dict) and "mind" in group else group


def _halves(mind: object) -> object:
    """A mind's table, with both halves even where it names one part for both."""
    if isinstance(mind, dict) and "use" in mind and not set(HALVES) & mind.keys():
        return {half: copy.deepcopy(mind) for half in HALVES}
    return mind


def _check_halves(mind: object, place: str) -> None:
    """Raise InputError for a mind that names both one part for both halves and a half."""
    if isinstance(mind, dict) and "use" in mind and set(HALVES) & mind.keys():
        raise InputError(f"{place}.use sets both computation and strategy; remove those tables")


def decode(table: Table, name: str, folder: Path | None = None) -> Scenario:
    """The scenario that a table describes; `name` is the file named in messages.

    `folder`, if given, is the base of the world's path, and of the paths of tables of numbers (a value
    {file = "net.csv"} of a part stands for the rows of that file) and of its own parts. Raises InputError.
    """

    def complete(part: Part[object]) -> Part[object]:
        return (part if folder is None else part.beside(folder)).decoded()

    scenario = _scenario(table, name, complete)
    world = scenario.world
    if folder is not None and world.file:
        world = msgspec.structs.replace(world, file=os.path.normpath(shipped.found(world.file, "worlds", folder)))
    return msgspec.structs.replace(
        scenario, title=scenario.title.replace("{robots.count}", str(scenario.robots.count)), world=world
    )


def shape(table: Table, name: str) -> Scenario:
    """The scenario in a table with its parts undecoded: none is looked up, no code runs.

    Raises InputError, which names the file `name` and the key.
    """
    return _scenario(table, name, lambda part: part)


def _scenario(table: Table, name: str, take: Take) -> Scenario:
    robots = table.get("robots")
    listed = isinstance(robots, list)
    groups = robots if isinstance(robots, list) else robots.get("groups") if isinstance(robots, dict) else ()
    try:
        _check_halves(table.get("mind"), "mind")
        for number, group in enumerate(groups if isinstance(groups, list) else ()):
            _check_halves(group.get("mind") if isinstance(group, dict) else None, f"robots[{number}].mind")
        table = with_platforms(spelled_out(without_expectations(table)))
        if table.get("sensors") and not table.get("sensor"):
            table = {**table, "sensor": NONE}
        for key, now in MOVED.items():
            inner: object = table
            for step in key.split("."):
                inner = inner.get(step) if isinstance(inner, dict) else None
            if inner is not None:
                raise InputError(f"{key}: has been renamed; expected {now}")
        return convert(table, Scenario, take)
    except InputError as problem:
        wrong = str(problem).replace("robots.groups[", "robots[") if listed else problem
        raise InputError(f"{name}: {wrong}") from problem


def set_key(table: Table, override: str) -> None:
    """Set one dotted key of a scenario table, as in `robots.count=20` or `title=My room`. Raises InputError."""
    path, equals, text = override.partition("=")
    if not equals or not all(key.strip() for key in path.split(".")):
        raise InputError(f"--set {_short(override)}: expected key=value, as in robots.count=20")
    try:
        assign(table, path, _value(table, path, text.strip()))
    except InputError as problem:
        raise InputError(f"--set {_short(override)}: {problem}") from problem


def _value(table: Table, path: str, text: str) -> object:
    """The TOML value in a text or, for a text key, the text itself. Raises InputError."""
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
    """A short one-line text, for messages."""
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
    """The type of a dotted key of a scenario; None if unknown, as for custom parts."""
    if path.strip() == "world":  # may be just its file's name
        return types.StrType()
    keys, inner = _places(table, path)[0], cast(Tables, spelled_out(table))
    kind: types.Type = _info(Scenario)
    place: tuple[str, ...] = ()  # in the scenario or, below it, in a group of robots
    for depth, key in enumerate(keys):
        if isinstance(inner, list):
            if keys[:depth] not in (["robots"], ["robots", "groups"]):
                return None
            kind, place, inner = _info(Group), (), inner[_number(inner, key, ".".join(keys[:depth]))]
            continue
        seam = at_place(place)
        if seam is not None and key == "use":
            return types.StrType()
        if seam is not None:
            use = inner.get("use", seam.default)
            if not isinstance(use, str) or use not in registry.entries(seam.name):
                return None
            kind = _info(registry.find(seam.name, use))
        fields = kind.fields if isinstance(kind, types.StructType) else ()
        found = [field.type for field in fields if field.encode_name == key]
        if not found:
            return None
        kind, value, place = found[0], inner.get(key), (*place, key)
        inner = value if isinstance(value, dict) or _are_tables(value) else {}
    return kind


@lru_cache(maxsize=128)
def _info(kind: type) -> types.Type:
    return types.type_info(kind)


def assign(table: Table, path: str, value: object) -> None:
    """Set a dotted key of a scenario's table, making the tables on the way.

    In a list of tables the key is a table's number, from 0, or its name: `robots.0.count`, `robots.dogs.count`.
    `mind.KEY` sets a key of both halves of a mind that is one part. Raises InputError where a value is in the way.
    """
    table.update(spelled_out(table))
    for place in _places(table, path):
        inner: Tables = table
        for depth, key in enumerate(place[:-1]):
            inner = _below(inner, key, place[:depth])
        last, given = place[-1], copy.deepcopy(value)
        if not isinstance(inner, list):
            inner[last] = given
        elif isinstance(given, dict):
            inner[_number(inner, last, ".".join(place[:-1]))] = given
        else:
            raise InputError(f"{path}: {given!r}, where a table stands; expected one, or a key of it")


def _below(inner: Tables, key: str, place: list[str]) -> Tables:
    """The table, or list of tables, at a key within a place; made if missing. Raises InputError."""
    if isinstance(inner, list):
        return inner[_number(inner, key, ".".join(place))]
    found = inner.setdefault(key, {})
    if not isinstance(found, dict) and not _are_tables(found):
        raise InputError(f"{'.'.join([*place, key])} is {found!r}, not a table")
    return found


def _are_tables(value: object) -> TypeGuard[list[Table]]:
    return isinstance(value, list) and bool(value) and all(isinstance(one, dict) for one in value)


def _number(tables: list[Table], key: str, place: str) -> int:
    """The table that a key means in a list, by number or name. Raises InputError."""
    names = [one.get("name") for one in tables]
    if key in names:
        return names.index(key)
    if key.isdecimal() and int(key) < len(tables):
        return int(key)
    known = "".join(f" or {name!r}" for name in names if isinstance(name, str))
    last = f" to {len(tables) - 1}" if len(tables) > 1 else ""
    raise InputError(f"{place}: has no {key!r}; expected 0{last}{known}, as in {place}.0")


def _places(table: Table, path: str) -> list[list[str]]:
    """The place of a dotted key of a scenario with short forms written out. Raises InputError."""
    keys = [key.strip() for key in path.split(".")]
    if len(keys) > DEEPEST:
        raise InputError(f"{TOO_DEEP}, as keys do")
    if "mind" not in keys[:4]:
        return [keys]
    at = keys.index("mind")
    mind: object = spelled_out(table)
    for depth, key in enumerate(keys[: at + 1]):
        if _are_tables(mind):
            mind = mind[_number(mind, key, ".".join(keys[:depth]))]
        else:
            mind = mind.get(key) if isinstance(mind, dict) else None
    if (at and keys[0] != "robots") or len(keys) < at + 2 or keys[at + 1] in HALVES or not isinstance(mind, dict):
        return [keys]
    halves = [mind.get(half) for half in HALVES]
    uses = [half["use"] for half in halves if isinstance(half, dict) and "use" in half]
    if len(uses) < 2 or uses[0] != uses[1]:
        return [keys]
    return [[*keys[: at + 1], half, *keys[at + 1 :]] for half in HALVES]
