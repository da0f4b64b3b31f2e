"""Jobs of facts in scenarios: their contracts, recordings, summaries and refusals."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, called, moments_of
from test_jobs_beside_minds import MAPPING, ROOM, built

from swarmsim.core.errors import InputError, PartError
from swarmsim.recording.measures import RunMeasures
from swarmsim.recording.reader import Recording
from swarmsim.testing import check_locality, check_one_robot, check_permutation, check_strictly

JOBS = """
[[jobs]]
use = "stigmergy"
during = 4

[[jobs]]
use = "storage"
during = 4
items = 9
copies = 1

[[jobs]]
use = "percolation"
items = 12
lattices = 1
side = 8
rate = 400.0

[task]
use = "settled"
"""
OWN = """
import numpy as np
from msgspec import Struct

from swarmsim.jobs.facts.bag import Carried, bag


class Squares:
    items, length = 6, 1

    def __init__(self, wrong):
        self.wrong = wrong

    def work(self, item):
        return 1.0

    def result(self, item):
        return np.array([float(item**2)] * (2 if item == self.wrong else 1))

    def answer(self, results):
        return {"sum": float(results.sum())}


class Summed(Struct, frozen=True, kw_only=True):
    wrong: int = -1

    def build(self, context):
        return bag(Squares(self.wrong), Carried(name="summed"), context)
"""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    (tmp_path / "room.svg").write_text(ROOM)
    (tmp_path / "own.py").write_text(OWN)
    (tmp_path / "mapping.toml").write_text(MAPPING)
    (tmp_path / "facts.toml").write_text(MAPPING + JOBS)
    return tmp_path / "facts.toml"


@pytest.mark.parametrize("check", [check_strictly, check_locality, check_one_robot, check_permutation])
def test_they_keep_their_contracts_in_several_exchanges_under_loss_and_delay(path: Path, check) -> None:
    channel = 'network.channel={use="latency", delay=2, over={use="bernoulli", loss=0.2}}'
    check(path, ("network.rounds=3", channel), 7, True)


def test_each_is_measured_summed_up_and_recorded_under_its_name(path: Path, tmp_path: Path) -> None:
    overrides = ("stop.when_done=stop", "stop.iterations=60", "network.rounds=2")
    run = built(path, *overrides)
    measures = RunMeasures(run.scenario.robots, 1.0, run.simulation.parts.task.curve)
    (observer,) = run.simulation.parts.task.summaries()
    moments = moments_of(run)
    for moment in moments:
        measures.sample(moment)
        observer.sample(moment)
    found, last = observer.summary(), moments[-1]
    assert found["iterations_to_settled"] == len(moments) < 60
    assert last.measured.values["stigmergy_equal_share"] == 1.0
    assert (found["storage_items"], found["storage_holders"]) == (9, 2)
    assert found["percolation_items_done"] == 12
    assert 0.0 <= found["percolation_spanning_share"] <= 1.0
    sent = sum(one.sent for moment in moments for one in moment.jobs if one.name == "percolation")
    assert found["percolation_bytes"] == sent > 0
    told = called("run", path, "--out", tmp_path / "out", *(word for one in overrides for word in ("--set", one)))
    assert told.returncode == 0, told.stdout + told.stderr
    recording = Recording(tmp_path / "out")
    assert recording["stigmergy_value"].shape == (len(moments), 4, 8)
    assert recording["percolation_known"][-1].all(axis=1).any()
    assert recording["storage_held"][-1].sum(axis=0).tolist() == [2] * 9


@pytest.mark.parametrize("name", ["stigmergy", "storage", "percolation"])
def test_the_shipped_ones_run(name: str) -> None:
    path = ROOT / "scenarios" / "computing" / f"{name}.toml"
    run = built(path, "robots.count=4", "stop.iterations=4", "stop.when_done=continue", "faults=[]")
    assert len(moments_of(run)) == 4


def own(wrong: int) -> str:
    return f'jobs=[{{use = "./own.py:Summed", wrong = {wrong}}}]'


def test_a_bag_of_ones_own_is_shared(path: Path) -> None:
    mapping = path.with_name("mapping.toml")
    last = moments_of(built(mapping, own(-1), 'task={use="settled"}'))[-1]
    assert last.jobs[0].knowledge.answer(last.state.alive) == {"sum": 55.0}


def test_the_bag_in_the_docs_is_shared(path: Path) -> None:
    (text,) = re.findall(r"```python\n(.*?)```", (ROOT / "docs/computing-other.md").read_text(), flags=re.DOTALL)
    (path.parent / "squares.py").write_text(text)
    found = built(path.with_name("mapping.toml"), 'jobs=[{use = "./squares.py:Squares"}]', "stop.iterations=40")
    last = moments_of(found)[-1]
    in_sequence = np.sqrt(6.0 * np.array([[1.0 / (item + 1) ** 2] for item in range(100)]).sum())
    assert last.jobs[0].knowledge.answer(last.state.alive) == {"pi": in_sequence}


def test_a_bag_of_ones_own_that_breaks_its_word_ends_the_run_by_name(path: Path) -> None:
    with pytest.raises(PartError, match=r"own\.py.*result: item 2 gives shape \(2,\); expected \(1,\)"):
        built(path.with_name("mapping.toml"), own(2)).simulation.run()


@pytest.mark.parametrize(
    ("overrides", "told"),
    [
        ("jobs=[{use='storage', capacity=9}]", r"jobs\[0\]\.capacity: 9 bytes; expected 256 or more"),
        (
            "jobs=[{use='stigmergy', budget=9}]",
            r"jobs\[0\]\.budget: 9 bytes a message; .* take 40; expected 40 or more",
        ),
        ("jobs=[{use='stigmergy', keys=0}]", r"jobs\[0\]\.keys: .*>= 1"),
        ("jobs=[]", r"task\.use: 'settled' measures jobs, and there are none"),
    ],
)
def test_what_cannot_be_is_refused_before_the_run(path: Path, overrides: str, told: str) -> None:
    with pytest.raises(InputError, match=told):
        built(path, overrides)
