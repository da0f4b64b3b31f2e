"""The reference of all keys, parts, presets, events and exit codes, made from what defines them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, get_args

import msgspec

from swarmsim.core import events
from swarmsim.core.crew import Body
from swarmsim.core.errors import InputError, nearest
from swarmsim.core.scenario import describe
from swarmsim.core.scenario.boards import BOARDS
from swarmsim.core.scenario.describe import Parameter, PartDescription
from swarmsim.core.scenario.expect import Expect
from swarmsim.core.scenario.file import Scenario
from swarmsim.core.scenario.platforms import PLATFORMS
from swarmsim.core.seams import SEAMS
from swarmsim.core.tables import markdown
from swarmsim.studies.plan import Study

#: Values to show for keys that have no default, or an empty one; others show their default.
EXAMPLES: Final = {
    "title": '"Five robots"', "world": '"house"', "world.file": '"house"', "world.scale": "0.01", "world.width": "24.0",
    "world.resolution": "0.05", "world.floor": '["Hall"]', "world.level": '"2"',
    "world.solid": '"strokes"', "world.doors": "0.9", "world.border": "true", "world.spawn": "[1.0, 1.0, 2.0, 2.0]",
    "world.generate": '{use = "rooms"}', "grid": "{cell = 0.1}", "robots": '{count = 5, use = "e-puck"}',
    "robots.count": "5", "robots.spawn": '"hall"', "robots[].name": '"scouts"', "robots[].count": "3",
    "network": '{topology = {use = "ring"}}', "network.topology": '{use = "knn", k = 2}', "stop": "{iterations = 300}",
    "stop.seconds": "600.0", "mind": '{strategy = {use = "stand"}}', "jobs": '[{use = "storage"}]',
    "faults": '[{use = "crash", at = 50, count = 2}]', "probes": '[{use = "batteries"}]',
    "layers": '[{use = "trails"}]', "world.layers": '{walls = ["Wände"]}', "processor": '{use = "esp32"}',
    "actuators": '[{use = "led"}]', "sensors": '[{use = "bump"}]', "field": '{use = "formula", formula = "x + y"}',
    "scenario": '"room"', "set": '{"robots.count" = 6}', "axis": '"robots"', "expect[].that": '"finished within 4min"',
    "vary[].key": '"robots.count"', "vary[].values": "[1, 2, 4]", "vary[].together": '"size"',
    "vary[].names": '["one", "two", "four"]',
    "condition[].name": '"three die"', "condition[].set": '{"robots.count" = 3}', "condition[].x": "3.0",
    "condition[].series": '"crashes"', "expect[].chance": "0.9", "expect[].zone": "0.05", "expect[].budget": "300",
    "expect[].faults": '["crash at=5"]', "expect[].set": '{"robots.count" = 3}', "expect[].condition": '"three die"',
    "use": '"e-puck"', "rate": "6e7", "memory": "327680.0", "sensor": '{use = "bump"}',
    "kinematics": '{use = "omni"}', "computation": '{use = "reactive"}', "strategy": '{use = "wander"}',
    "robots.processor.use": '"esp32"',
    "robots[].processor.use": '"esp32"',
}  # fmt: skip
EXIT_CODES: Final = {
    0: "done: the task is done, all is well, every claim or expectation holds",
    1: "not so: a run ends at its limit, a recording differs, a claim or an expectation fails",
    2: "bad input; a message names the file, the key and what would be right",
    3: "a third-party part fails; the message names the part and its line",
    4: "the disk is full, or standard output cannot be written",
    5: "no expectation fails, but some are undecided",
    130: "ended by Ctrl-C; what was recorded until then can be read",
    141: "the reader of standard output has gone, as after `| head`",
    143: "ended by SIGTERM, as Ctrl-C does",
}


def scenario_keys() -> list[Parameter]:
    """Every key of a scenario, by its dotted path; those of several `[[robots]]` begin with `robots[]`."""
    found = [replace(one, key=one.key.replace("robots.groups[]", "robots[]")) for one in describe.keys(Scenario)]
    return [*(one for one in found if one.key != "robots.groups"), *describe.keys(Expect, "expect[].")]


def study_keys() -> list[Parameter]:
    """Every key of a study, by its dotted path."""
    return list(describe.keys(Study))


def has(path: str) -> bool:
    """Whether a scenario has this key, or a table whose keys begin with its first name, which `key` then tells."""
    first = path.partition(".")[0].partition("[")[0]
    return any(one.key.partition(".")[0].partition("[")[0] == first for one in scenario_keys())


def key(path: str) -> list[Parameter]:
    """A key of scenarios and the keys of the table that it takes: `swarmsim parts robots.wheel_base`.

    Raises InputError for an unknown one.
    """
    found = [one for one in scenario_keys() if one.key == path or one.key.startswith((f"{path}.", f"{path}[]."))]
    if not found:
        table = path.rpartition(".")[0]
        known = {one.key: one for one in scenario_keys() if one.key.startswith(table)}
        raise InputError(f"{path}: no such key; {nearest(path, known)}")
    return found


def example_of(one: Parameter) -> str:
    """A value of a key, in TOML."""
    shown = EXAMPLES.get(one.key) or EXAMPLES.get(one.key.rpartition(".")[2])
    if one.kind.startswith("a part ") and one.default not in (None, "none"):
        return f"{{use = {one.default}}}"
    if one.key.startswith("world.layers."):
        return '["an id or a label"]'
    return shown if shown and one.default in (None, "none", '""', "[]", "{}") else str(one.default)


def keys_in_markdown() -> str:
    """The page docs/keys.md."""
    return "\n".join(
        [
            "# Every key\n",
            "Made from the code, as `swarmsim parts KEY` prints it and editors show it (`swarmsim schema`). Units are",
            "SI. A key without a default has to be given. Parts and their keys are on [the next page](part-keys.md).\n",
            "## Scenarios\n",
            _rows(scenario_keys()),
            "\n## Studies\n",
            "`[[expect]]` is as in scenarios.\n",
            _rows([one for one in study_keys() if not one.key.startswith("expect[]")]),
            "\n## Real robots\n",
            "`robots.use` names one; each number can be replaced. [Robots](robots.md) has the sources.\n",
            _presets(PLATFORMS, ("radius", "wheel_base", "speed", "acceleration", "mass", "traction")),
            "\n## Real processors\n",
            "`robots.processor.use` names one. [Processors](computing-processors.md) has the sources.\n",
            _presets(BOARDS, ("rate", "memory", "energy")),
            "\n## Events\n",
            "What happens in a run, as `Run.events` gives it and recordings keep it.\n",
            markdown(("event", "what happened", "what it tells"), map(_event, get_args(events.Event))),
            "\n## Exit codes\n",
            markdown(("code", "meaning"), ((str(code), told) for code, told in EXIT_CODES.items())),
            "",
        ]
    )


def parts_in_markdown() -> str:
    """The page docs/part-keys.md."""
    lines = [
        "# Every part and its keys\n",
        "Made from the code, as `swarmsim parts SEAM.NAME` prints it, of the parts that ship. [Parts](parts.md) says",
        "what each seam is for.",
    ]
    ours = [one for one in describe.parts() if one.origin.startswith("swarmsim-lab ")]
    for seam in SEAMS:
        lines.append(f"\n## {seam.capitalize()}")
        for one in ours:
            lines += _part(one) if one.seam == seam else []
    return "\n".join([*lines, ""])


def _part(one: PartDescription) -> list[str]:
    lines = [
        f"\n### {one.seam}.{one.name}\n",
        f"{' '.join(one.text.split())}{' *The default.*' if one.default else ''}\n",
    ]
    if one.parameters:
        head = ("key", "value", "default", "meaning")
        rows = ((f"`{each.key}`", each.kind, _default(each), each.meaning) for each in one.parameters)
        return [*lines, markdown(head, rows)]
    return [*lines, "It has no keys."]


def _rows(found: Sequence[Parameter]) -> str:
    head = ("key", "value", "default", "meaning", "example")
    return markdown(
        head, ((f"`{one.key}`", one.kind, _default(one), one.meaning, f"`{example_of(one)}`") for one in found)
    )


def _default(one: Parameter) -> str:
    return "required" if one.default is None else "" if one.default == "none" else f"`{one.default}`"


def _presets(presets: dict[str, dict[str, object]], columns: Sequence[str]) -> str:
    usual = {field.name: field.default for field in msgspec.structs.fields(Body)}
    rows = ([f"`{name}`", *(str({**usual, **table}[one]) for one in columns)] for name, table in presets.items())
    return markdown(("name", *(f"`{one}`" for one in columns)), rows)


def _event(kind: type[events.Happened]) -> tuple[str, str, str]:
    told = ", ".join(f"`{name}`" for name in kind.__struct_fields__)
    return f"`{kind.__struct_config__.tag}`", " ".join((kind.__doc__ or "").split()), told
