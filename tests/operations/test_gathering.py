"""Samples that go to those who compute a model whole, and what they compute of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import moments_of
from numpy.testing import assert_array_equal
from scipy import sparse

from swarmsim.core.errors import InputError
from swarmsim.core.messages import HEADER
from swarmsim.core.scenario.file import load
from swarmsim.engine.build import build
from swarmsim.jobs.facts.tellers import Tellers
from swarmsim.jobs.pieces import given
from swarmsim.operations.gathering.gatherer import NUMBER
from swarmsim.operations.gathering.levels import WholeFloor
from swarmsim.operations.gathering.ways import AFAR, Ways
from swarmsim.operations.methods.problem import Problem
from swarmsim.operations.models.equations import Equations
from swarmsim.recording.reader import Recording
from swarmsim.testing import check_locality, check_one_robot, check_permutation, check_strictly

ROOM = """<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 4 4" width="4m" height="4m">
  <g id="walls"><path fill-rule="evenodd" d="M0 0H4V4H0Z M0.2 0.2V3.8H3.8V0.2Z"/></g>
  <g id="spawn"><rect id="floor" x="0.5" y="0.5" width="3" height="3"/></g>
</svg>"""
MODEL = '{use = "diffusion", diffusivity = 0.02}'
SCENARIO = f"""
world = "room.svg"
robots = {{count = 5, spawn = "floor"}}
grid.cell = 0.2
field = {{use = "model", model = {MODEL}, sources = [{{x = 2.0, y = 2.5}}]}}
network = {{rounds = 6, topology = {{use = "relative-neighbourhood"}}}}
task = {{use = "settled"}}
stop = {{iterations = 30}}
[[jobs]]
use = "gather"
model = {MODEL}
to = "all"
every = 4
levels = 3
"""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    (tmp_path / "room.svg").write_text(ROOM)
    (tmp_path / "gather.toml").write_text(SCENARIO)
    return tmp_path / "gather.toml"


def built(path: Path, *overrides: str):
    return build(load(path, overrides), str(path))


def last(path: Path, *overrides: str):
    """What robots know at the end, and the moments."""
    moments = moments_of(built(path, *overrides))
    return moments[-1].jobs[0].knowledge, moments


@pytest.mark.parametrize("check", [check_strictly, check_locality, check_one_robot, check_permutation])
def test_it_keeps_its_contracts_in_several_exchanges_under_loss_and_delay(path: Path, check) -> None:
    channel = 'network.channel={use="latency", delay=2, over={use="bernoulli", loss=0.2}}'
    check(path, (channel, "jobs.0.to=servers", "jobs.0.servers=2"), 6, True)


def test_a_level_is_the_implicit_step_drawn_to_the_mean_of_samples() -> None:
    dice, cells, dt, rate = np.random.default_rng(2), 40, 3.0, 0.7
    line = sparse.diags_array([np.ones(cells - 1), -2.0 * np.ones(cells), np.ones(cells - 1)], offsets=(-1, 0, 1))
    equations = Equations(operators=(line.tocsr(),), inflow=np.full((cells, 1), 0.1), pace=("r", 1.0))
    solver = WholeFloor(Problem(equations, lambda cells, begin, end: np.zeros(len(cells)), dt), rate)
    field, at = dice.random(cells), np.array([3, 3, 17])
    values = np.array([1.0, 2.0, -1.0])
    pull = np.zeros(cells)
    pull[[3, 17]] = dt * rate
    wanted = field + dt * 0.1
    wanted[3] += dt * rate * 1.5
    wanted[17] += dt * rate * -1.0
    exact = np.linalg.solve(np.eye(cells) - dt * line.toarray() + np.diag(pull), wanted)
    found, work = solver.after(field, 0, at, values)
    assert np.abs(found - exact).max() < 1e-4
    assert work == solver.work(round(work / solver.work(0)) - 1) > solver.work(5)


def test_flooded_samples_reach_everybody_who_then_computes_the_same(path: Path) -> None:
    known, moments = last(path)
    assert len(moments) == 13  # the last level ends with the twelfth iteration
    assert (known.fields == known.fields[0]).all()
    assert known.fields[0].any()
    assert (known.level == 3).all()
    assert (known.counts[:, 2] == 5 * 12).all()  # every sample of every robot


def test_alone_nothing_is_said_and_everybody_knows_something_else(path: Path) -> None:
    known, moments = last(path, "jobs.0.to=none")
    assert sum(moment.jobs[0].sent for moment in moments) == 0
    assert not (known.fields[1:] == known.fields[0]).all(axis=1).any()
    assert known.numbers(moments[-1].state.alive)["used"] == pytest.approx(1 / 5)


@pytest.mark.parametrize("loss", [0.0, 0.4])
def test_a_base_computes_and_tells_each_robot_its_piece(path: Path, loss: float) -> None:
    lossy = f'network.channel={{use="bernoulli", loss={loss}}}'
    known, moments = last(path, "jobs.0.to=base", lossy, "stop.iterations=90")
    alive = moments[-1].state.alive
    assert known.ended(alive)
    for robot in range(1, 5):
        cells = known.scheme.cells[robot]
        told = known.fields[0][cells].astype(NUMBER).astype(float)
        assert (known.fields[robot][cells] == told).all()
        elsewhere = np.delete(known.fields[robot], cells)
        assert not elsewhere.any()
    share = known.numbers(alive)["used"]
    assert share > 0.8 if loss == 0.0 else 0.2 < share < 0.8
    assert known.counts[1:, 0].sum() == 0 < known.counts[0, 0]


def test_everybody_is_told_the_field_if_asked(path: Path) -> None:
    known, _ = last(path, "jobs.0.to=base", "jobs.0.down=field")
    assert (known.level == 3).all()
    assert (known.fields[1:] == known.fields[0].astype(NUMBER).astype(float)).all()


def test_a_dead_base_ends_everything_and_a_dead_server_little(path: Path) -> None:
    dead = 'faults=[{use="crash", at=6, robots=[0], min_alive=0}]'
    known, moments = last(path, "jobs.0.to=base", dead)
    assert not known.ended(moments[-1].state.alive)
    assert known.level[1:].max() == 1
    known, moments = last(path, "jobs.0.to=servers", "jobs.0.servers=2", "stop.iterations=60", "jobs.0.levels=9", dead)
    assert known.ended(moments[-1].state.alive)


@pytest.mark.parametrize("to", ["all", "base", "servers", "holders"])
def test_bytes_are_those_of_the_packed_messages(path: Path, to: str, monkeypatch: pytest.MonkeyPatch) -> None:
    packed, say = [0, 0], Tellers.say

    def counted(self, senses):
        said = say(self, senses)
        for robot, size in enumerate(said.sizes.tolist()):
            content = said.of(robot)
            data = self.codec.pack(robot, senses.iteration, content) if size else b""
            assert len(data) == size
            if size:
                assert self.codec.unpack(data)[2].rows() == content.rows()
                packed[0] += 1
            packed[1] += size
        return said

    monkeypatch.setattr(Tellers, "say", counted)
    known, moments = last(path, f"jobs.0.to={to}", "stop.when_done=continue", "stop.iterations=14")
    assert packed[1] == sum(moment.jobs[0].sent for moment in moments) > 0
    assert known.counts[:, 3:].sum() == packed[1] - packed[0] * HEADER.size


def test_shared_pieces_say_no_less_than_their_edges_in_each_sweep(path: Path) -> None:
    method = '{use = "schwarz", overlap = 1, sweeps = 4}'
    solve = f'jobs=[{{use="solve", model={MODEL}, method={method}, dt=4.0, duration=8.0, value=4}}]'
    moments = moments_of(built(path, solve, "task.use=computed", "stop.iterations=60"))
    plan = moments[-1].jobs[0].knowledge.plan
    assert moments[-1].measured.finished
    edges = sum(len(piece.rim) for piece in plan.pieces)
    assert edges > 0
    assert sum(moment.jobs[0].sent for moment in moments) > edges * 4 * plan.steps


def test_the_robots_drive_the_same_ways_whatever_is_computed(path: Path) -> None:
    ways = [
        moments_of(built(path, f"jobs.0.to={to}", "stop.when_done=continue", "stop.iterations=13"))
        for to in ("all", "base")
    ]
    assert all((a.state.pose == b.state.pose).all() for a, b in zip(*ways, strict=True))


def test_a_way_is_the_newest_and_of_these_the_shortest() -> None:
    ways = Ways(5)
    assert ways.hops(2, 0) == AFAR
    assert ways.note(2, 10, 3)
    assert ways.note(2, 10, 2)
    assert not ways.note(2, 10, 4)
    assert not ways.note(2, 9, 1)
    assert ways.hops(2, 15) == 2
    assert ways.hops(2, 16) == AFAR


@pytest.mark.parametrize(
    ("overrides", "told"),
    [
        (["jobs.0.to=base", "jobs.0.base=5"], r"jobs\[0\]\.base: 5 with 5 robots; expected 4 or less"),
        (["jobs.0.to=servers", "jobs.0.servers=6"], r"jobs\[0\]\.servers: 6 with 5 robots; expected 5 or less"),
        (["jobs.0.to=base", "jobs.0.budget=90"], r"jobs\[0\]\.budget: 90 bytes a message; .* expected \d+ or more"),
        (["jobs.0.model={use='wave', speed=1.0}"], r"jobs\[0\]\.model: waves, .*expected diffusion"),
    ],
)
def test_what_cannot_be_gathered_is_refused(path: Path, overrides: list[str], told: str) -> None:
    with pytest.raises(InputError, match=told):
        built(path, *overrides)


def test_a_field_is_needed(path: Path) -> None:
    path.write_text("\n".join(line for line in SCENARIO.splitlines() if not line.startswith("field")))
    with pytest.raises(InputError, match=r"jobs\[0\]\.use: 'gather' needs samples .* expected a table \[field\]"):
        built(path)


def test_levels_and_costs_are_recorded_under_its_name(path: Path, tmp_path: Path) -> None:
    run = built(path)
    with run.recorder(tmp_path / "recording.h5") as recorder:
        assert run.simulation.run([recorder])
    recording = Recording(tmp_path / "recording.h5")
    assert recording["gather_level"].shape == (13, 5, 5)
    assert recording["gather_samples"][-1].sum() > 0


def test_pictures_get_the_level_of_each_robot_and_the_field_of_who_knows_most(path: Path, tmp_path: Path) -> None:
    run = built(path, "jobs.0.to=base")
    with run.recorder(tmp_path / "recording.h5") as recorder:
        run.simulation.run([recorder])
    recording = Recording(tmp_path / "recording.h5")
    level, known, field = (recording[name] for name in ("gather.level", "gather_level", "gather.field"))
    assert_array_equal(level, known[:, np.arange(5), np.arange(5)])
    assert level.max() == 3
    assert np.isnan(field[0]).all()  # nobody knows anything yet
    assert_array_equal(np.isfinite(field[1]), given(run.context).free)
    assert np.nanmax(field[1]) > 0.0
