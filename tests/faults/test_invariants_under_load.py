"""A million robot-steps of worlds, networks, tasks and faults at random, and what has to hold (`make soak`)."""

from __future__ import annotations

import gc
import os
import resource
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from conftest import ROOT
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st
from test_random_timelines import CHANNELS, OF_ROBOTS, TIMED, alone, check, merged, whom

from swarmsim.core.errors import InputError
from swarmsim.core.scenario import Table, decode
from swarmsim.core.state import Moment
from swarmsim.engine.build import Run, build

STEPS = int(os.environ.get("SOAK_STEPS", "1000000"))  # robots times iterations
ITERATIONS = 150
FASTEST = 3.0  # times a wheel's top speed: whoever is faster, without a push, was given energy by a collision

KINDS = ("rooms", "office", "maze", "cave")
WORLDS = [
    str(ROOT / "worlds" / "room.svg"),
    *({"generate": {"use": kind, "width": 6.0, "height": 4.5}, "seed": made} for kind in KINDS for made in (1, 2)),
]
MINDS: list[Table] = [
    {"mind": {"computation": {"share": {"use": "current-tile"}}}},
    {"mind": {"computation": {"share": {"use": "relay"}, "decay": 0.02}, "strategy": {"idle": "patrol"}}},
    {"mind": {"computation": {"share": {"use": "map"}, "trust": "own"}}},
    {"mind": {"computation": {"use": "positions"}, "strategy": {"use": "rendezvous"}}, "task": {"use": "gathered"}},
    {"mind": {"computation": {"use": "positions"}, "strategy": {"use": "disperse"}}, "task": {"use": "spacing"}},
    {"mind": {"computation": {"use": "positions"}, "strategy": {"use": "lloyd"}}, "task": {"use": "locational-cost"}},
    {
        "mind": {"computation": {"use": "heading-consensus"}, "strategy": {"use": "self-propelled"}},
        "task": {"use": "alignment"},
    },
    {
        "mind": {"computation": {"use": "reactive"}, "strategy": {"use": "wander"}},
        "task": {"use": "travelled", "distance": 1e6},
        "sensor": {"ranges": True, "robots": "occlude"},
    },
]
NETWORKS: list[Table] = [
    {"use": "knn", "k": 3},
    {"use": "knn", "k": 2, "mutual": True},
    {"use": "none"},
    {"use": "chain"},
    {"use": "ring"},
    {"use": "star", "hub": 1},
    {"use": "full"},
    {"use": "radius", "radius": 1.0},
    {"use": "line-of-sight", "radius": 3.0},
    {"use": "farthest-k", "k": 2},
    {"use": "delaunay"},
    {"use": "gabriel"},
    {"use": "relative-neighbourhood"},
    {"use": "random", "p": 0.2},
    {"use": "k-random", "k": 2},
    {"use": "small-world", "k": 2, "p": 0.2},
]


@st.composite
def loads(draw: st.DrawFn) -> Table:
    """Scenarios of 8 to 24 robots with up to four faults."""
    robots = draw(st.integers(8, 24))
    kinds = {**{kind: merged(fault, TIMED, whom(robots)) for kind, fault in OF_ROBOTS.items()}, **alone(robots)}
    mind = dict(draw(st.sampled_from(MINDS)))
    chosen = draw(st.lists(st.sampled_from(sorted(kinds)), max_size=4))
    chosen = ["join"] * ("join" in chosen) + [kind for kind in chosen if kind != "join"]
    return {
        "world": draw(st.sampled_from(WORLDS)),
        "seed": draw(st.integers(0, 2**32)),
        "robots": {"count": robots},
        "network": {"topology": draw(st.sampled_from(NETWORKS)), "channel": draw(CHANNELS)},
        "stop": {"iterations": ITERATIONS, "when_done": "go-on"},
        "faults": [draw(kinds[kind]) for kind in chosen],
        **mind,
    }


class Sound:
    """A probe that sees to numbers and energy."""

    def __init__(self, run: Run) -> None:
        self._limit = FASTEST * run.scenario.robots.speed
        self._pushed = any(fault["use"] in ("push", "people") for fault in run.scenario.faults)

    def sample(self, moment: Moment) -> None:
        """Nothing is NaN that may not be, and nobody is faster than wheels make."""
        state = moment.state
        assert np.isfinite(state.pose).all()
        assert np.isfinite(state.velocity).all()
        assert np.isfinite(state.wheels).all()
        assert np.isfinite(moment.measured.progress)
        assert 0.0 <= moment.measured.progress <= 1.0
        pace = np.hypot(state.velocity[:, 0], state.velocity[:, 1])
        assert self._pushed or pace.max() <= self._limit, pace.max()


def memory() -> int:
    """MiB now."""
    gc.collect()
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() >> 20


@pytest.mark.slow
def test_a_million_robot_steps_of_anything() -> None:
    tried: Counter[str] = Counter()
    held: list[int] = []

    @settings(
        deadline=None, max_examples=40, database=None, phases=[Phase.generate], print_blob=False,
        suppress_health_check=list(HealthCheck),
    )  # fmt: skip
    @given(loads(), st.integers(0, 2**32))
    def one(table: Table, salt: int) -> None:
        try:
            run = build(decode(table, "random"), "random")
        except InputError:
            tried["refused"] += 1
            return
        try:
            sound = Sound(run)
            sample = run.simulation.run
            run.simulation.run = lambda probes=(): sample([*probes, sound])  # type: ignore[method-assign]
            check(run, deep=0.5, tight=1.4)
        except Exception as problem:
            problem.add_note(f"Save this as a scenario file to see it again:\n\n{tomli_w.dumps(table)}")
            raise
        tried["runs"] += 1
        tried["robot-steps"] += run.scenario.robots.count * ITERATIONS
        tried[run.scenario.network.topology["use"]] += 1
        for fault in run.scenario.faults:
            tried[f"fault {fault['use']}"] += 1
        if tried["runs"] % 50 == 0:
            held.append(memory())

    batch = 0
    while tried["robot-steps"] < STEPS:
        batch += 1
        seed(batch)(one)()
    print(dict(tried), "MiB", held)
    assert tried["robot-steps"] >= STEPS
    assert not held or held[-1] - held[0] < 200
