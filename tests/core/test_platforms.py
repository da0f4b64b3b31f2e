"""Robots that people have, and swarms of several kinds."""

from __future__ import annotations

import json
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from conftest import ROOT

from swarmsim.core.errors import InputError
from swarmsim.core.scenario.file import Scenario, decode, table_of
from swarmsim.core.scenario.platforms import PLATFORMS
from swarmsim.core.scenario.schema import schema
from swarmsim.core.state import UNKNOWN
from swarmsim.engine.build import build

ROOM = str(ROOT / "worlds" / "room.svg")
TABLE = {"world": ROOM, "network": {"topology": {"use": "full"}}, "stop": {"iterations": 400}}


def scenario(robots: object, **more: object) -> Scenario:
    return decode({**TABLE, "robots": robots, **more}, "s.toml", Path())


def test_a_platform_fills_what_is_left_out() -> None:
    made = scenario({"use": "e-puck", "count": 3, "speed": 0.1})
    assert (made.robots.radius, made.robots.speed) == (0.035, 0.1)
    assert made.sensor.table["reach"] == 0.105
    assert scenario({"use": "e-puck", "count": 3}, sensor={"use": "ir-ring"}).sensor.table["reach"] == 1.0
    assert scenario({"use": "thymio", "count": 3}, sensor={"reach": 0.3}).sensor.table["bearings"][:2] == [40.0, 20.0]
    assert scenario({"count": 3}) == scenario({"use": "paper", "count": 3})


@pytest.mark.parametrize("use", [name for name in PLATFORMS if name != "kilobot"])
def test_every_platform_maps_the_room(use: str) -> None:
    run = build(scenario({"use": use, "count": 2, "spawn": "room"}, grid={"cell": 0.1}), "s.toml")
    for _ in range(100):
        moment = run.simulation.tick()
    assert moment.measured.progress > 0.1


def test_who_senses_nothing_cannot_map() -> None:
    with pytest.raises(InputError, match="tile"):
        build(scenario({"use": "kilobot", "count": 2, "spawn": "room"}), "s.toml").simulation.tick()


def test_a_mixed_swarm_has_bodies_wheels_and_sensors_of_each_kind() -> None:
    groups = [{"use": "khepera-iv", "count": 1, "spawn": "room"}, {"use": "e-puck", "count": 2}, {"count": 1}]
    made = scenario(groups)
    assert (made.robots.count, made.robots.radius, made.robots.speed) == (4, 0.0704, 0.813)
    assert made.robots.each("radius").tolist() == [0.0704, 0.035, 0.035, 0.055]
    run = build(made, "s.toml")
    fastest = np.zeros(4)
    for _ in range(60):
        moment = run.simulation.tick()
        fastest = np.maximum(fastest, np.abs(run.simulation.state.wheels).max(axis=1))
    assert (fastest <= made.robots.each("speed") + 1e-9).all()
    assert fastest[0] > 0.3 > fastest[1]
    seen = (moment.readings.tiles.values != UNKNOWN).sum(axis=(1, 2))
    assert seen[3] > 2 * seen[1:3].max()  # beams of 1 m against sensors of 7 cm
    alone = decode(json.loads(json.dumps(table_of(made))), "again.toml")
    assert alone.robots == made.robots


def test_groups_in_a_table_are_those_of_a_list() -> None:
    groups = [{"use": "thymio", "count": 2}, {"count": 1, "speed": 0.1}]
    assert scenario({"groups": groups}) == scenario({"count": 3, "groups": groups}) == scenario(groups)


@pytest.mark.parametrize(
    ("robots", "message"),
    [
        ({"use": "r2d2", "count": 1}, r"robots\.use: no robot is called 'r2d2'"),
        ({"use": "epuck", "count": 1}, "did you mean 'e-puck'"),
        ([], "robots: no group in it"),
        ([3], r"robots\[0\]: 3 is no table"),
        ([{"count": 1, "spawn": "a"}, {"count": 1, "spawn": "b"}], "groups start in one spawn area"),
        ([{"count": 1, "colour": "red"}], r"robots\[0\]\.colour: unknown key"),
        ([{"count": 1, "sensor": {"use": "radar"}}], r"robots\[0\]\.sensor\.use: no sensor is called 'radar'"),
        ([{"use": "e-puck"}], "count"),
        ({"count": 4, "groups": [{"use": "thymio", "count": 2}]}, r"robots\.count: is 4, but robots\.groups has 2"),
        ({"groups": [{"use": "r2d2", "count": 2}]}, r"robots\[0\]\.use: no robot is called 'r2d2'"),
        ({"count": 1, "use": ["e-puck"]}, r"robots\.use: no robot is called \['e-puck'\]"),
    ],
)
def test_bad_robots_are_refused(robots: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        scenario(robots)


def test_the_schema_knows_groups() -> None:
    groups = [{"use": "e-puck", "count": 2, "spawn": "room"}, {"count": 1}]
    jsonschema.validate({**TABLE, "robots": groups}, schema())
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate({**TABLE, "robots": [{"count": 1, "colour": "red"}]}, schema())
