"""The scenario file: everything a run depends on, typed, checked and complete."""

from __future__ import annotations

import copy
import os
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import msgspec
from msgspec import Meta, Struct
from msgspec import field as of

from swarmsim.core import registry
from swarmsim.core.errors import InputError

Positive = Annotated[float, Meta(gt=0.0)]
Count = Annotated[int, Meta(ge=1, le=100_000)]
Table = dict[str, Any]  # `use` and the keys of the part it names


class World(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The building: an SVG floor plan and the factor that its metres are multiplied by."""

    file: str
    scale: Positive = 1.0


class Grid(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The cells of truth, tiles and maps."""

    cell: Positive = 0.15  # m


class Robots(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How many robots there are, where they start and what they are made of."""

    count: Count
    spawn: str  # id of an element in the floor plan's `spawn` layer
    radius: Positive = 0.055  # m
    wheel_base: Positive = 0.10  # m
    speed: Positive = 0.15  # m/s, at a wheel's rim
    acceleration: Positive = 1.0  # m/s^2, at a wheel's rim
    mass: Positive = 0.25  # kg
    traction: Positive = 0.6  # friction coefficient of wheel on floor


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
    period: Positive = 1.0  # s, one iteration
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
    stop: Stop = Stop()


#: Where each seam's table stands in a scenario; faults are a list of tables.
PLACES: Final = {
    "physics": ("physics",),
    "sensor": ("sensor",),
    "field": ("field",),
    "localisation": ("localisation",),
    "computation": ("mind", "computation"),
    "strategy": ("mind", "strategy"),
    "topology": ("network", "topology"),
    "channel": ("network", "channel"),
    "motion": ("motion",),
    "task": ("task",),
}

#: Keys of older scenarios, with what stands in their place.
MOVED: Final = {
    "behaviour": "mind.computation and mind.strategy",
    "network.sharing": "mind.computation.share",
    "stop.coverage": "task.share",
    "stop.at_coverage": "stop.when_done",
}


def tables(scenario: Scenario) -> dict[str, Table]:
    """The table of every part of a scenario but faults, by seam; a field only if there is one."""
    found: dict[str, Table] = {}
    for seam, place in PLACES.items():
        table: Any = scenario
        for key in place:
            table = getattr(table, key)
        if seam != "field" or table:
            found[seam] = table
    return found


def load(path: Path, overrides: Iterable[str] = (), changes: Mapping[str, Any] | None = None) -> Scenario:
    """Read a scenario file, with `key.path=value` overrides whose values are TOML, then `changes` by dotted key.

    Paths in it resolve from the file's folder. Raises InputError naming the file and the key.
    """
    table = spelled_out(read_toml(path, "a scenario file"), str(path))
    for override in overrides:
        set_key(table, override)
    for key, value in (changes or {}).items():
        try:
            assign(table, key, copy.deepcopy(value))
        except InputError as problem:
            raise InputError(f"{path}: {problem}") from problem
    return decode({"title": path.stem, **table}, str(path), path.parent)


def spelled_out(table: Table, name: str) -> Table:
    """The table with its short forms written out: `world = "FILE"` as a table, `mind.use` as both halves of a mind.

    Raises InputError, which starts with `name`, for a mind that is given in both ways.
    """
    world, mind = table.get("world"), table.get("mind")
    if isinstance(world, str):
        table = {**table, "world": {"file": world}}
    if isinstance(mind, dict) and "use" in mind:
        if {"computation", "strategy"} & mind.keys():
            raise InputError(
                f"{name}: mind.use: stands for computation and strategy at once; expected it without those"
            )
        table = {**table, "mind": {"computation": dict(mind), "strategy": dict(mind)}}
    return table


def read_toml(path: Path, expected: str) -> Table:
    """The table in a TOML file. Raises InputError, which names what was `expected`."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as problem:
        raise InputError(f"{path}: cannot be read ({problem.strerror}); expected {expected}") from problem
    except UnicodeDecodeError as problem:
        raise InputError(f"{path}: not UTF-8 text (byte {problem.start}); expected {expected}") from problem
    except tomllib.TOMLDecodeError as problem:
        raise InputError(f"{path}: not valid TOML: {problem}") from problem


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

    if folder is not None:
        world = msgspec.structs.replace(scenario.world, file=os.path.normpath(folder / scenario.world.file))
        scenario = msgspec.structs.replace(scenario, world=world)
    whole = {seam: complete(seam, ".".join(PLACES[seam]), table) for seam, table in tables(scenario).items()}
    return msgspec.structs.replace(
        scenario,
        title=scenario.title.replace("{robots.count}", str(scenario.robots.count)),
        network=Network(topology=whole.pop("topology"), channel=whole.pop("channel")),
        mind=Mind(computation=whole.pop("computation"), strategy=whole.pop("strategy")),
        faults=tuple(complete("fault", f"faults[{i}]", fault) for i, fault in enumerate(scenario.faults)),
        **whole,
    )


def shape(table: Table, name: str) -> Scenario:
    """The scenario in a table whose parts are taken as they stand: none of them is looked for, no code runs.

    Raises InputError, which names the file `name` and the key.
    """
    table = spelled_out(table, name)
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


def with_files(table: Table, folder: Path, place: str = "") -> Table:
    """The table with paths in it, or in tables inside it, resolved from `folder`.

    A value {file = "x.csv"} becomes the rows of that file; the path in `use = "./file.py:Name"` is written out. Raises
    InputError, which starts with the key (after `place`).
    """
    filled = dict(table)
    use = table.get("use")
    if isinstance(use, str) and use.rpartition(":")[0].endswith(".py"):
        file, _, own = use.rpartition(":")
        filled["use"] = f"{os.path.normpath(folder / file)}:{own}"
    for key, value in table.items():
        if isinstance(value, dict) and value.keys() == {"file"} and isinstance(value["file"], str):
            try:
                filled[key] = read_rows(folder / value["file"])
            except InputError as problem:
                raise InputError(f"{place}{key}: {problem}") from problem
        elif isinstance(value, dict):
            filled[key] = with_files(value, folder, f"{place}{key}.")
    return filled


def read_rows(path: Path) -> list[list[int | float]]:
    """The rows of a CSV file: numbers with commas between them, empty lines left out; of a PNG, its grey levels.

    Levels are 0 for black to 1 for white.

    Raises InputError, which names the file and the line.
    """
    if path.suffix.lower() == ".png":
        return _grey_levels(path)
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()  # spreadsheets mark UTF-8 in the first bytes
    except OSError as problem:
        raise InputError(f"{path}: cannot be read ({problem.strerror}); expected a CSV file of numbers") from problem
    except UnicodeDecodeError as problem:
        raise InputError(f"{path}: not UTF-8 text (byte {problem.start}); expected a CSV file of numbers") from problem
    rows = []
    for number, line in enumerate(lines, start=1):
        if line.strip():
            try:
                rows.append(msgspec.json.decode(f"[{line}]", type=list[int | float]))
            except msgspec.DecodeError as problem:
                raise InputError(
                    f"{path}, line {number}: {line.strip()[:60]!r} is not a row of numbers; "
                    "expected numbers with commas between them, as in 0,1"
                ) from problem
    return rows


def _grey_levels(path: Path) -> list[list[int | float]]:
    from PIL import Image  # takes a while, and few scenarios need it

    try:
        with Image.open(path) as picture:
            grey = picture.convert("L")
            levels, width = list(grey.tobytes()), grey.width
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as problem:
        raise InputError(f"{path}: cannot be read ({problem}); expected a PNG picture") from problem
    return [[level / 255.0 for level in levels[at : at + width]] for at in range(0, len(levels), width)]


def set_key(table: Table, override: str) -> None:
    """Set one dotted key of a scenario table, as in `robots.count=20`. Raises InputError."""
    path, equals, text = override.partition("=")
    if not equals or not all(key.strip() for key in path.split(".")):
        raise InputError(f"--set {override}: expected key=value, as in robots.count=20")
    try:
        value = tomllib.loads(f"value = {text}")
    except tomllib.TOMLDecodeError as problem:
        hint = f"""; a string needs quotes: --set '{path}="{text}"'""" if text.strip().isidentifier() else ""
        raise InputError(f"--set {override}: {text!r} is not a TOML value{hint}") from problem
    if list(value) != ["value"]:
        raise InputError(f"--set {override}: one value at a time")
    try:
        assign(table, path, value["value"])
    except InputError as problem:
        raise InputError(f"--set {override}: {problem}") from problem


def assign(table: Table, path: str, value: Any) -> None:
    """Set a dotted key of a table, making the tables on the way. Raises InputError where a value is in the way."""
    keys = [key.strip() for key in path.split(".")]
    for depth, key in enumerate(keys[:-1]):
        inner = table.setdefault(key, {})
        if not isinstance(inner, dict):
            raise InputError(f"{'.'.join(keys[: depth + 1])} is {inner!r}, not a table")
        table = inner
    table[keys[-1]] = value


def schema() -> dict[str, Any]:
    """The JSON Schema of scenario files, with every installed part, for editors."""
    _, parts = msgspec.json.schema_components([Scenario], ref_template="#/$defs/{name}")
    root: dict[str, Any] = parts.pop("Scenario")
    defs: dict[str, Any] = dict(parts)
    root["properties"]["world"] = {"anyOf": [{"type": "string"}, {"$ref": "#/$defs/World"}]}
    for seam in registry.SEAMS:
        choices: list[dict[str, Any]] = []
        for name, kind in registry.known(seam).items():
            (described,), inner = msgspec.json.schema_components([kind], ref_template="#/$defs/{name}")
            part = inner.pop(described["$ref"].rpartition("/")[2])
            defs.update(inner)
            keys = {key: _or_file(value) for key, value in part["properties"].items()}
            part["properties"] = {"use": {"const": name}, **keys}
            required = [] if name == registry.SEAMS[seam] else ["use"]
            part["required"] = required + part.get("required", [])
            choices.append(part)
        choices.append(
            {"type": "object", "properties": {"use": {"type": "string", "pattern": ":"}}, "required": ["use"]}
        )
        if seam == "fault":
            root["properties"]["faults"] = {"type": "array", "items": {"anyOf": choices}}
        elif seam in PLACES:
            *outer, key = PLACES[seam]
            place = defs[outer[0].capitalize()] if outer else root
            place["properties"][key] = {"anyOf": choices}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **root,
        "title": "swarmsim scenario",
        "$defs": defs,
    }


def _or_file(described: dict[str, Any]) -> dict[str, Any]:
    """A key's schema; an array may be the rows of a file instead."""
    rows = {"type": "object", "properties": {"file": {"type": "string"}}, "required": ["file"]}
    return {"anyOf": [described, rows]} if described.get("type") == "array" else described
