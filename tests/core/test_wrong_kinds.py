"""A scenario in which anything stands at the wrong place is refused in one message that names the file and the key."""

from __future__ import annotations

import copy
import tomllib
from collections.abc import Iterator
from functools import cache
from typing import Any

import pytest
from conftest import ROOT

from swarmsim.core.errors import InputError
from swarmsim.core.scenario.file import decode, table_of
from swarmsim.engine.build import build

#: Something at every place: groups of robots with a sensor, a field, a channel over two others, faults of all kinds.
TEXT = """
title = "everything"
[world]
file = "worlds/room.svg"
layers = {furniture = ["pillars"]}
floor = []
spawn = [1.0, 1.0, 2.0, 2.0]
[[robots]]
count = 2
[[robots]]
use = "e-puck"
count = 1
sensor = {reach = 0.5}
[field]
use = "sources"
sources = [{x = 1.0, y = 1.0, height = 2.0, width = 1.0}]
[network.topology]
use = "edges"
links = [[0, 1], [1, 2]]
[network.channel]
use = "latency"
delay = 1
over = {use = "bernoulli", loss = 0.1, over = {use = "range", metres = 3.0}}
[mind.computation]
sharing = {use = "gossip"}
[[faults]]
use = "crash"
life = {mean = 30}
robots = [1]
[[faults]]
use = "radio"
failure = "partition"
at = 3
groups = [[0], [1, 2]]
[[faults]]
use = "furniture"
at = 2
box = [1.0, 1.0, 1.5, 1.5]
"""
WRONG: tuple[Any, ...] = (3, -1, 1e-300, True, "", "x", [], {}, [3], [[]], {"use": 3}, {"use": ""}, float("nan"))


@cache
def everything() -> dict[str, Any]:
    """The scenario's table, complete."""
    found = table_of(decode(tomllib.loads(TEXT), "all.toml", ROOT))
    found["robots"] = found["robots"]["groups"]
    return found


def places(value: Any, at: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Every place in a table, by the keys and numbers that lead there."""
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, one in inner:
        yield (*at, key)
        yield from places(one, (*at, key))


def with_value(place: tuple[Any, ...], value: Any) -> dict[str, Any]:
    """The scenario's table with another value at a place."""
    table = copy.deepcopy(everything())
    inner: Any = table
    for key in place[:-1]:
        inner = inner[key]
    inner[place[-1]] = value
    return table


def tried(wrong: Any, builds: bool) -> tuple[int, int]:
    """Put something at every place; how often it was refused, and how often not."""
    told, taken = [], 0
    for place in places(everything()):
        try:
            scenario = decode(with_value(place, wrong), "all.toml")
            if builds:
                build(scenario, "all.toml")
            taken += 1
        except InputError as problem:
            told.append((place[0], str(problem)))
        except Exception as problem:
            problem.add_note(f"{wrong!r} at {place}")
            raise
    for key, message in told:
        assert message.startswith("all.toml: "), message
        assert builds or key in message, message
        assert "\n" not in message
    return len(told), taken


@pytest.mark.parametrize("wrong", WRONG, ids=repr)
def test_whatever_stands_at_a_key_is_read_or_refused_by_file_and_key(wrong: Any) -> None:
    refused, taken = tried(wrong, builds=False)
    assert refused > taken


@pytest.mark.slow
@pytest.mark.parametrize("wrong", WRONG, ids=repr)
def test_whatever_stands_at_a_key_is_built_or_refused_by_file(wrong: Any) -> None:
    assert sum(tried(wrong, builds=True))


@pytest.mark.parametrize(
    ("place", "value", "message"),
    [
        (("robots",), 3, "robots: expected `object`, got `int`"),
        (("robots", 1, "use"), {}, r"robots\[1\].use: no robot is called {}"),
        (("robots", 1, "count"), "a", r"robots\[1\].count: expected `int`, got `str`"),
        (
            ("robots",),
            {"count": 5, "groups": [{"count": 2}, {"count": 1}]},
            "robots.count: is 5, but robots.groups has 3",
        ),
        (("robots",), {"count": 5, "groups": 3}, "robots.groups: expected `array`, got `int`"),
        (("robots", 1, "sensor"), 3, r"robots\[1\].sensor: expected `object`, got `int`"),
        (("robots", 1, "sensor", "preset"), "x", r"robots\[1\].sensor.preset: .*'x'; expected 'ebot' or 'gternal'"),
        (("sensor",), 3, "sensor: expected `object`, got `int`"),
        (("sensor", "use"), {}, "sensor.use: expected `str`, got `object`"),
        (("sensor", "use"), "", "sensor.use: no sensor is called ''"),
        (("network",), [], "network: expected `object`, got `array`"),
        (("network", "topology"), {}, "network.topology.use: required key is missing; known: chain"),
        (("network", "channel", "over", "over"), [], "network.channel.over.over: expected `object`, got `array`"),
        (("network", "channel", "over", "over", "metres"), {}, "network.channel.over.over.metres: expected `float`"),
        (("mind", "computation", "sharing", "use"), "x", "mind.computation.sharing.use: no sharing is called 'x'"),
        (("mind", "computation", "trust"), "x", "mind.computation.trust: .*'x'; expected 'all' or 'own' or 'quorum'"),
        (("field", "sources", 0, "x"), "a", r"field.sources\[0\].x: expected `float`, got `str`"),
        (("faults", 1), {}, r"faults\[1\].use: required key is missing; known: battery"),
        (("faults", 1, "failure"), "x", r"faults\[1\].failure: invalid enum value 'x'; expected 'delay' or 'jam'"),
        (("faults", 0, "robots"), [float("nan")], r"faults\[0\].robots: nan is not a number to compute with"),
        (("stop", "when_done"), "x", "stop.when_done: invalid enum value 'x'; expected 'continue' or 'stop'"),
        (("world", "layers", "wolls"), ["x"], "world.layers.wolls: unknown key; did you mean 'walls'"),
    ],
)
def test_what_is_wrong_is_said_by_its_place(place: tuple[Any, ...], value: Any, message: str) -> None:
    with pytest.raises(InputError, match=f"^all.toml: {message}"):
        decode(with_value(place, value), "all.toml")


@pytest.mark.parametrize("reach", [1e-300, 1e-3])
def test_a_sensor_that_sees_nothing_is_refused_in_one_message(reach: float) -> None:
    table = with_value(("sensor", "reach"), reach)
    table["robots"] = {"count": 3}
    with pytest.raises(InputError, match=r"^all\.toml: sensor: robots see no cell from anywhere; expected beams that"):
        build(decode(table, "all.toml"), "all.toml")
