"""Robots do what they do by their own row, their inbox and their number: in a swarm, alone, and in another order."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, made, setting_of

from swarmsim import testing
from swarmsim.core.errors import InputError
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.part import Part
from swarmsim.engine import contracts

SCENARIOS = sorted(
    str(path.relative_to(ROOT / "scenarios").with_suffix(""))
    for path in (ROOT / "scenarios").rglob("*.toml")
    if not {"studies", "benchmarks"} & set(path.parts)
)
LONGER = {"merging": 110}  # frames are found after 91 iterations
FORGETS = 'faults=[{use="mind", failure="reboot", at=8, duration=3}, {use="remove", at=4, count=2, duration=9}]'
KINDS = (
    'robots=[{count=4, speed=0.1, sensor={tile=[5, 9]}}, {count=3, radius=0.04, sensor={preset="gternal"}}, {count=3}]'
)


def path_of(scenario: str) -> Path:
    return ROOT / "scenarios" / f"{scenario}.toml"


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_a_robot_that_is_built_alone_does_what_it_does_in_the_swarm(scenario: str) -> None:
    testing.check_one_robot(path_of(scenario), iterations=LONGER.get(scenario, testing.ITERATIONS))


@pytest.mark.slow
@pytest.mark.parametrize("scenario", SCENARIOS)
def test_it_does_for_long(scenario: str) -> None:
    testing.check_one_robot(path_of(scenario), iterations=150)
    testing.check_permutation(path_of(scenario), iterations=150)


@pytest.mark.parametrize("trust", ["all", "own", "quorum"])
@pytest.mark.parametrize("policy", registry.known("sharing"))
def test_so_it_does_whatever_is_shared_and_believed_and_when_it_has_to_forget(policy: str, trust: str) -> None:
    mind = f'mind.computation={{sharing={{use="{policy}"}}, trust="{trust}", decay=0.01, hits="spared"}}'
    testing.check_one_robot(path_of("exploring"), [mind, FORGETS])
    testing.check_permutation(path_of("exploring"), [mind, FORGETS], iterations=12)


@pytest.mark.parametrize(
    ("scenario", "key"),
    [
        *(("exploring", f'mind.computation.sharing={{use="{policy}"}}') for policy in registry.known("sharing")),
        *(
            (f"operations/{name}", "seed=3")
            for name in ("turn", "average-consensus", "field", "wandering", "formation")
        ),
    ],
)
def test_messages_can_be_read_by_one_that_has_said_nothing_yet(scenario: str, key: str) -> None:
    silent = made(key, scenario=scenario).simulation.parts.computation
    simulation, iterations = made(key, scenario=scenario).simulation, []
    say = simulation.parts.computation.say

    def saying(senses):
        said = say(senses)
        assert contracts.message_sizes(said, silent.codec, senses.iteration) is None
        iterations.append(senses.iteration)
        return said

    simulation.parts.computation.say = saying
    for _ in range(4):
        simulation.tick()
    assert iterations == [0, 1, 2, 3]


@pytest.mark.parametrize("check", [testing.check_one_robot, testing.check_permutation])
def test_a_robot_of_a_mixed_swarm_has_the_body_of_its_own_kind(check) -> None:
    check(path_of("exploring"), [KINDS])


def test_a_setting_for_some_robots_speaks_of_these() -> None:
    whole = made(KINDS, scenario="exploring").context
    some = whole.serving(np.array([8, 0, 5]))
    assert (whole.swarm, some.swarm) == (10, 10)
    assert some.robots.each("speed").tolist() == [0.15, 0.1, 0.15]
    assert some.robots.each("radius").tolist() == [0.055, 0.055, 0.04]
    assert (some.robots.radius, some.robots.speed, some.robots.least("speed")) == (0.055, 0.15, 0.1)
    np.testing.assert_array_equal(some.start, whole.start[[8, 0, 5]])
    drawn = [stream.uniform() for stream in some.own_streams("mind")]
    assert drawn == [whole.streams.open("mind", robot).uniform() for robot in (8, 0, 5)]
    assert not hasattr(some.robots, "count")


def test_keys_that_name_robots_are_held_against_the_swarm() -> None:
    alone = setting_of(3).serving(np.array([2]))
    with pytest.raises(InputError, match="leaders: there is no robot 3; expected ids from 0 to 2"):
        Part("computation", {"use": "heading-consensus", "leaders": [2, 3]}).build(alone)
    with pytest.raises(InputError, match="quorum: 3 of 2 others never agree"):
        Part("computation", {"use": "occupancy-grid", "trust": "quorum", "quorum": 3}).build(alone)
    with pytest.raises(InputError, match="places: 1 for 3 robots"):
        Part("strategy", {"use": "formation", "places": [[0.0, 0.0]]}).build(alone)


ROWS = """
from dataclasses import replace

import numpy as np
from msgspec import Struct

from swarmsim.operations.mapping.computation import OccupancyGrid
from swarmsim.operations.mapping.exploration.nearest import NearestFrontier
from swarmsim.operations.mapping.maps import Maps


class ByRow(Struct, frozen=True):
    \"\"\"Signs tiles with rows in the place of numbers, or adds these to the sizes.\"\"\"

    sizes: bool = False

    def build(self, context):
        return Signed(OccupancyGrid().build(context), self.sizes)


class Signed:
    knowledge_type = Maps
    codec = property(lambda self: self.inner.codec)

    def __init__(self, inner, sizes):
        self.inner, self.sizes = inner, sizes
        self.hear, self.reset, self.copy_from = inner.hear, inner.reset, inner.copy_from

    def say(self, *given):
        said = self.inner.say(*given)
        rows = np.arange(len(said.ends), dtype=np.int32)
        if self.sizes:
            return replace(said, sizes=said.sizes + rows)
        return replace(said, content=replace(said.content, sources=rows))


class Turning:
    def step(self, me):
        return me.drive(0.01, 0.1 * me.id)


def spinning(observations):
    \"\"\"Turns by its row.\"\"\"
    rows = np.arange(len(observations.alive))
    return np.stack([0.0 * rows, 0.1 * rows], axis=1)


class First:
    \"\"\"Counts who is there.\"\"\"

    there = 0

    def __init__(self):
        First.there += 1
        self.place = First.there

    def step(self, me):
        return me.drive(0.001 * self.place)
"""


@pytest.fixture
def own(tmp_path: Path) -> Path:
    (tmp_path / "rows.py").write_text(ROWS)
    room = (ROOT / "scenarios" / "room.toml").read_text().replace("../worlds", str(ROOT / "worlds"))
    (tmp_path / "room.toml").write_text(room)
    return tmp_path / "room.toml"


@pytest.mark.parametrize(
    ("key", "wrong"),
    [
        ('mind.computation={use="./rows.py:ByRow"}', "iteration 0, robot 1: says other sources when it is built alone"),
        (
            'mind.computation={use="./rows.py:ByRow", sizes=true}',
            "iteration 0, robot 1: says 21 bytes, not 22, when it is built alone",
        ),
        ('mind.strategy={use="./rows.py:spinning"}', "iteration 0, robot 1: does something else when it is built al"),
        ('mind.strategy={use="./rows.py:First"}', "robot 0: does something else when it is built alone"),
    ],
)
def test_the_check_finds_minds_that_take_rows_for_numbers(own: Path, key: str, wrong: str) -> None:
    with pytest.raises(AssertionError, match=wrong):
        testing.check_one_robot(own, [key], allow_code=True)


def test_the_checks_find_rows_in_another_order(own: Path) -> None:
    with pytest.raises(AssertionError, match="does something else when rows are in another order"):
        testing.check_permutation(own, ['mind.strategy={use="./rows.py:spinning"}'], allow_code=True)
    testing.check_permutation(own, ['mind.strategy={use="./rows.py:Turning"}'], allow_code=True)
    testing.check_one_robot(own, ['mind.strategy={use="./rows.py:Turning"}'], allow_code=True)
