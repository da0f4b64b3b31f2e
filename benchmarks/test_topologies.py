"""The cost of one call of each topology, for 15, 100 and 1 000 robots spread over the basilica."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

from swarmsim.core.context import BuildContext
from swarmsim.core.parts import Topology
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.file import load
from swarmsim.core.scenario.part import Part
from swarmsim.core.scenario.robots import Robots
from swarmsim.core.state import State
from swarmsim.core.streams import Streams
from swarmsim.engine.build import build

SCENARIO = Path(__file__).parent.parent / "scenarios" / "basilica.toml"
SIZES = (15, 100, 1000)
CASES = [  # the topology, and its most links among 1 000 robots
    ({"use": "none"}, 0),
    ({"use": "knn", "k": 2}, 2_000),
    ({"use": "knn", "k": 10}, 10_000),
    ({"use": "knn", "k": 2, "mutual": True}, 2_000),
    ({"use": "farthest-k", "k": 2}, 2_000),
    ({"use": "radius", "radius": 1.0}, 20_000),
    ({"use": "line-of-sight", "radius": 1.0}, 20_000),
    ({"use": "line-of-sight"}, 999_000),
    ({"use": "delaunay"}, 6_000),
    ({"use": "gabriel"}, 6_000),
    ({"use": "relative-neighbourhood"}, 6_000),
    ({"use": "random", "p": 0.01}, 12_000),
    ({"use": "k-random", "k": 2}, 2_000),
    ({"use": "small-world", "k": 2, "p": 0.1}, 2_000),
    ({"use": "chain"}, 1_998),
    ({"use": "ring"}, 2_000),
    ({"use": "star"}, 1_998),
    ({"use": "edges", "links": [[0, 1], [1, 2]]}, 2),
    ({"use": "full"}, 999_000),
]


@pytest.mark.bench
def test_links_are_quick() -> None:
    run = build(load(SCENARIO), str(SCENARIO))
    building, lattice = run.simulation.parts.building, run.arena.lattice
    free = lattice.centres(np.argwhere(building.explorable & ~building.occupied))
    rng = np.random.default_rng(1)
    assert {table["use"] for table, _ in CASES} == set(registry.known("topology"))
    print(f"\n{'ms of one core per call':44}" + "".join(f"{size:>10}" for size in SIZES))
    for table, most in CASES:
        costs = []
        for size in SIZES:
            context = BuildContext.of(Robots(count=size, spawn="nave"), lattice, 1.0, Streams(1), building)
            net: Topology = Part("topology", table).build(context)
            pose = np.zeros((size, 3))
            pose[:, :2] = free[rng.choice(len(free), size, replace=False)]
            pose[:, :2] += rng.uniform(-0.5, 0.5, (size, 2)) * lattice.cell
            state = State(1, pose, np.zeros_like(pose), pose[:, :2], np.ones(size, np.bool_))
            assert len(net.links(state)) <= min(most, size * (size - 1))  # compiles, too
            costs.append(min(_seconds(net, state) for _ in range(15)))
        name = ", ".join(str(table["use"]) if key == "use" else f"{key} = {value}" for key, value in table.items())
        print(f"{name:44}" + "".join(f"{1e3 * cost:10.4f}" for cost in costs))


def _seconds(net: Topology, state: State) -> float:
    """CPU time per call, without other programs' share; measured for more than a hundredth of a second."""
    calls, spent = 1, 0.0
    while spent < 0.01:
        calls *= 4
        begun = time.process_time()
        for _ in range(calls):
            net.links(state)
        spent = time.process_time() - begun
    return spent / calls
