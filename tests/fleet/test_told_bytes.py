"""A swarm whose robots are told nothing but bytes is the swarm of one process, to the last bit."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from fleet.crews import fleet_of

from swarmsim import testing
from swarmsim.core.errors import InputError

ITERATIONS = 40
ALL = sorted(
    str(path.relative_to(ROOT / "scenarios").with_suffix(""))
    for path in (ROOT / "scenarios").rglob("*.toml")
    if not {"studies", "benchmarks"} & set(path.parts)
)
COMPUTING = [one for one in ALL if "jobs" in tomllib.loads((ROOT / "scenarios" / f"{one}.toml").read_text())]
ALONE = {"computing/buoys-disputed": "mind.computation: nobody can report Located; expected Estimates, or a comput"}
TOLD = [one for one in ALL if one not in {*COMPUTING, *ALONE}]
LONGER = {"merging": 110}  # frames are found after 91 iterations
EXPLORING = (
    ['faults=[{use="mind", failure="reboot", at=8, duration=3}, {use="remove", at=4, count=2, duration=9}]'],
    ['faults=[{use="mind", failure="frozen", at=8, count=4}, {use="mind", failure="random-walk", at=9, count=4}]'],
    ['mind.computation={sharing={use="gossip", goals=true}, trust="quorum", decay=0.01, hits="spared"}'],
    ['mind.computation.sharing={use="relay"}'],
    ['mind.computation.sharing={use="map"}', 'network.channel={use="latency", delay=2.5, law="geometric"}'],
    ['mind={strategy={use="oracle-frontier"}, computation={sharing={use="tile-and-goal"}}}'],
    ['localisation={use="noisy", sigma=0.1, sigma_yaw=0.05}'],
)


def path_of(scenario: str) -> Path:
    return ROOT / "scenarios" / f"{scenario}.toml"


@pytest.mark.parametrize("scenario", [one for one in TOLD if "/" not in one and one not in LONGER])
def test_robots_that_are_told_bytes_do_what_the_swarm_does(scenario: str) -> None:
    testing.check_apart(path_of(scenario), iterations=ITERATIONS)


@pytest.mark.thorough
@pytest.mark.parametrize("scenario", [one for one in TOLD if "/" in one or one in LONGER])
def test_so_they_do_in_every_scenario(scenario: str) -> None:
    testing.check_apart(path_of(scenario), iterations=LONGER.get(scenario, ITERATIONS))


@pytest.mark.parametrize("overrides", EXPLORING)
def test_so_they_do_with_faults_of_minds_and_whatever_they_share(overrides: list[str]) -> None:
    testing.check_apart(path_of("exploring"), overrides, ITERATIONS)


@pytest.mark.parametrize("scenario", COMPUTING)
def test_jobs_are_refused_in_words(scenario: str) -> None:
    with pytest.raises(InputError, match="jobs: robots in processes of their own do not compute jobs; expected none"):
        fleet_of(path_of(scenario))


@pytest.mark.parametrize("scenario", ALONE)
def test_knowledge_that_nobody_can_report_is_refused_in_words(scenario: str) -> None:
    with pytest.raises(InputError, match=ALONE[scenario]):
        fleet_of(path_of(scenario))


def test_a_fault_that_copies_knowledge_is_refused_in_words() -> None:
    fleet = fleet_of(path_of("room"), iterations=4)
    with pytest.raises(InputError, match=r"robots \[1\] would begin with the knowledge of robot 0, which is in a pro"):
        fleet.minds.copy_from(np.array([1]), 0)


SCENARIO = f"""
world = "{ROOT}/worlds/room.svg"
mind.use = "./own.py:Counting"
task = {{use = "travelled", distance = 1.0}}
network.topology = {{use = "knn", k = 2}}

[robots]
count = 3
"""
OWN = """
class Counting:
    message_fields = {"count": "i4"}
    recorded = ("seen",)

    def __init__(self):
        self.seen = 0

    def say(self, me):
        return {"count": self.seen}

    def hear(self, me):
        self.seen += 1 + sum(one.count for one in me.heard) % 3

    def step(self, me):
        return me.drive(0.02, 0.1 * (self.seen % 5 - 2) + 0.01 * me.random.random())
"""


def test_minds_of_ones_own_are_processes_too(tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(OWN)
    (tmp_path / "room.toml").write_text(SCENARIO)
    testing.check_apart(tmp_path / "room.toml", iterations=12, allow_code=True)


def test_what_depends_on_the_process_is_found(tmp_path: Path) -> None:
    counted = OWN.replace("class Counting:", "class Counting:\n    made = 0\n")
    counted = counted.replace("self.seen = 0", "Counting.made += 1\n        self.seen = Counting.made")
    (tmp_path / "own.py").write_text(counted)
    (tmp_path / "room.toml").write_text(SCENARIO)
    with pytest.raises(testing.BrokenError, match=r"iteration 0: other \w+ when robots are told nothing but bytes"):
        testing.check_apart(tmp_path / "room.toml", iterations=3, allow_code=True)
