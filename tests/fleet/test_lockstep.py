"""A swarm whose robots are told nothing but bytes is the swarm of one process, to the last bit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from fleet.crews import BytesCrew, fleet_of

from swarmsim.core.errors import InputError
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.file import load
from swarmsim.engine.build import build
from swarmsim.recording.digests import DIGESTED, Digests

ITERATIONS = 40
ALL = sorted(
    str(path.relative_to(ROOT / "scenarios").with_suffix(""))
    for path in (ROOT / "scenarios").rglob("*.toml")
    if not {"studies", "benchmarks"} & set(path.parts)
)
COMPUTING = [one for one in ALL if one.startswith("computing/")]  # with jobs
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


def check_same(path: Path, *overrides: str, iterations: int = ITERATIONS) -> None:
    whole, apart = Digests(), Digests()
    limit = f'stop={{iterations={iterations}, when_done="continue"}}'
    build(load(path, [*overrides, limit]), str(path)).simulation.run([whole])
    fleet = fleet_of(path, *overrides, iterations=iterations)
    BytesCrew(fleet)
    fleet.run.simulation.run([apart])
    for iteration, (one, other) in enumerate(zip(whole.rows, apart.rows, strict=True)):
        names = [*DIGESTED, "actuators"][: len(one) // 8]
        differs = [name for at, name in enumerate(names) if one[8 * at : 8 * at + 8] != other[8 * at : 8 * at + 8]]
        assert not differs, f"iteration {iteration}"
    assert len(whole.rows) == iterations


@pytest.mark.parametrize("scenario", [one for one in ALL if one not in COMPUTING])
def test_robots_that_are_told_bytes_do_what_the_swarm_does(scenario: str) -> None:
    check_same(path_of(scenario), iterations=LONGER.get(scenario, ITERATIONS))


@pytest.mark.parametrize("overrides", EXPLORING)
def test_so_they_do_with_faults_of_minds_and_whatever_they_share(overrides: list[str]) -> None:
    check_same(path_of("exploring"), *overrides)


@pytest.mark.parametrize("scenario", COMPUTING)
def test_jobs_are_refused_in_words(scenario: str) -> None:
    with pytest.raises(InputError, match="jobs: robots in processes of their own do not compute jobs; expected none"):
        fleet_of(path_of(scenario))


def test_a_fault_that_copies_knowledge_is_refused_in_words() -> None:
    fleet = fleet_of(path_of("room"), iterations=4)
    BytesCrew(fleet)
    with pytest.raises(InputError, match=r"robots \[1\] would begin with the knowledge of robot 0, which is in a pro"):
        fleet.minds.copy_from(np.array([1]), 0)


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
    (tmp_path / "room.toml").write_text(
        f'world = "{ROOT}/worlds/room.svg"\n[robots]\ncount = 3\n[network.topology]\nuse = "knn"\nk = 2\n'
        '[task]\nuse = "travelled"\ndistance = 1.0\n[mind]\nuse = "./own.py:Counting"\n'
    )
    with registry.own_code(True):
        check_same(tmp_path / "room.toml", iterations=12)
