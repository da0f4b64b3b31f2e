"""Fields that a model makes."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from conftest import made, moments_of, setting_of
from floors import laplacian
from scipy import sparse
from scipy.sparse import linalg

from swarmsim.core.building import Building, Survey
from swarmsim.core.errors import InputError
from swarmsim.core.jobs import Domain
from swarmsim.core.scenario.part import Part
from swarmsim.jobs.pieces import given
from swarmsim.operations.fields.truth import FiniteField
from swarmsim.operations.methods.problem import Problem
from swarmsim.operations.methods.sweeps import BlockJacobi
from swarmsim.operations.models.emitters import Emitter
from swarmsim.operations.models.job import ModelJob, problem_of
from swarmsim.operations.models.truth import ModelField, Past

SMELL = {"use": "diffusion", "diffusivity": 0.05, "decay": 0.01}
SOURCE = Emitter(x=0.5, y=0.5, strength=0.3, begin=1.5, end=6.0)
FLOOR = np.pad(np.ones((10, 14), bool), 1)
FLOOR[4, 3:12] = False


def setting():
    """A room with a bar of wall, which robots enter at its lower left."""
    context = setting_of(shape=FLOOR.shape)
    survey = Survey(np.zeros((0, 4)), ~FLOOR, np.array([[0.2, 0.2]]), lambda: np.ones_like(FLOOR))
    return replace(context, building=Building(survey, lambda boxes: survey, lattice=context.lattice))


def field(**keys) -> FiniteField:
    """The field of a diffusing smell in that room."""
    parameters = {"model": Part("model", SMELL), "sources": (SOURCE,), "dt": 0.5, **keys}
    return ModelField(**parameters).build(setting())


def centres() -> np.ndarray:
    return setting().lattice.centres(np.argwhere(FLOOR))


def test_it_is_the_solution_of_an_independent_solver() -> None:
    """Implicit steps of a matrix put together cell by cell, solved as a whole."""
    domain = Domain(setting().lattice, FLOOR)
    matrix, _ = laplacian(domain)
    system = linalg.splu(sparse.csc_array((1.0 + 0.005) * sparse.eye_array(FLOOR.sum()) - 0.025 * matrix))
    at, u, truth = np.flatnonzero(np.hypot(*(centres() - (0.525, 0.525)).T) < 1e-9)[0], np.zeros(FLOOR.sum()), field()
    for step in range(1, 20):
        u[at] += 0.3 * 0.5 / 0.15**2 * (3 < step <= 12)
        u = system.solve(u)
        np.testing.assert_allclose(truth.value(0.5 * step, centres()), u, atol=1e-13)


def test_with_smaller_cells_it_holds_as_much_on_the_same_floor_and_comes_nearer_to_a_smooth_field() -> None:
    """Errors at the centres of the lattice's cells, of a smooth start, against four times as many cells as the last."""
    start = Part("field", {"use": "formula", "formula": "exp(-(x - 1)**2 - (y - 1)**2)"})
    fields = {times: field(sources=(), start=start, refine=times) for times in (1, 3, 9)}
    away = [np.abs(fields[times].value(4.0, centres()) - fields[9].value(4.0, centres())).max() for times in (1, 3)]
    assert 0.0 < away[1] < 0.4 * away[0]
    smell, lattice = field(refine=3), setting().lattice
    fine = Domain(replace(lattice, cell=0.05, rows=36, columns=48), np.kron(FLOOR, np.ones((3, 3), bool)))
    every = fine.lattice.centres(np.argwhere(fine.free))
    expected = sum(0.15 / 1.005**age for age in range(1, 10))
    assert 0.05**2 * smell.value(6.0, every).sum() == pytest.approx(expected, rel=1e-12)
    assert len(np.unique(smell.value(6.0, every))) > 2 * FLOOR.sum()


def test_between_steps_it_changes_linearly_and_in_walls_it_is_the_nearest_cell_s() -> None:
    truth = field()
    ends = [truth.value(time, centres()) for time in (2.0, 2.5)]
    np.testing.assert_allclose(truth.value(2.125, centres()), 0.75 * ends[0] + 0.25 * ends[1], atol=1e-15)
    inside, wall = np.array([[0.225, 0.5]]), np.array([[0.075, 0.5], [-3.0, 0.5]])
    assert truth.value(3.0, wall).tolist() == truth.value(3.0, inside).tolist() * 2


def test_any_order_of_times_gives_the_same_bits() -> None:
    once, again = field(), field()
    times = np.random.default_rng(0).permutation(np.arange(0.0, 12.0, 0.25))
    late = {time: again.value(time, centres()) for time in times.tolist()}
    assert all(np.array_equal(once.value(time, centres()), late[time]) for time in sorted(late))


def test_the_past_is_thinned_and_the_same() -> None:
    context = setting()
    problem = problem_of(Part("model", SMELL), [SOURCE], 0.5, given(context), context)
    job = ModelJob.of(problem, BlockJacobi(sweeps=1), given(context), 1, 1)
    first = np.zeros(FLOOR.sum())
    whole, few = Past(job, 1, first), Past(job, 1, first, most=1)
    few.at(300)
    assert len(few._states) <= 9
    assert len(whole._states) == 1
    for level in (7, 150, 299, 3, 300):
        assert np.array_equal(few.at(level), whole.at(level))


def test_a_smell_starts_stops_and_stays_in_its_room() -> None:
    quiet, smell = field(sources=()), field()
    assert quiet.value(9.0, centres()).max() == 0.0
    sums = [0.15**2 * smell.value(time, centres()).sum() for time in (1.5, 6.0, 6.5)]
    assert sums[0] == 0.0
    expected = sum(0.15 / 1.005**age for age in range(1, 10))  # 9 steps of 0.3 x 0.5, and the decay since
    assert sums[1] == pytest.approx(expected, rel=1e-12)
    assert sums[2] == pytest.approx(expected / 1.005, rel=1e-12)


def test_it_starts_as_another_field_says() -> None:
    formula = Part("field", {"use": "formula", "formula": "x"})
    start = field(start=formula).value(0.0, centres())
    np.testing.assert_allclose(start, centres()[:, 0])


def test_a_wave_is_solved_by_the_method_that_is_named() -> None:
    keys = {"model": Part("model", {"use": "wave"}), "method": Part("method", {"use": "explicit"}), "dt": 0.1}
    assert np.abs(field(**keys).value(7.0, centres())).max() > 0.0
    with pytest.raises(InputError, match="method: sweeps step equations of first order in time"):
        field(model=keys["model"])


def test_what_diverges_ends_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where nobody looks at the limit of a step."""
    monkeypatch.setattr(Problem, "check_step", lambda *given: None)
    truth = field(
        method=Part("method", {"use": "explicit"}), dt=1.0, start=Part("field", {"use": "formula", "formula": "x"})
    )
    with pytest.raises(InputError, match=r"field\.model: its solution passes 1e\+100 after step 87, so it diverges"):
        truth.value(1000.0, centres())


WRONG = [
    ("field.model={use='difusion'}", "field.model.use: no model is called 'difusion'; did you mean 'diffusion'?"),
    ("field.model={use='diffusion', walls='fixed'}", "field.model.value: required key is missing; fixed walls need"),
    ("field.method={use='explicit'}", "field.dt: 1 s is more than explicit steps bear: r = D dt / h^2 is 2.222"),
    ("field.method={use='conjugate-gradients'}", "field.method: conjugate-gradients needs 2 sums over all pieces"),
    ("field.sources=[{x=-1.0, y=1.0}]", "field.sources[0].x: -1 m, 1 m is not on the floor; expected a free place"),
    ("field.start={use='formula', formula='z'}", "field.start.formula: 'z' cannot stand in a formula"),
]
SCENARIO = ("field={use='model', model={use='diffusion'}, noise=0.01, sources=[{x=2.0, y=5.5, end=20.0}]}",)


@pytest.mark.parametrize(("key", "told"), WRONG)
def test_a_wrong_key_is_told_before_the_run(key, told) -> None:
    with pytest.raises(InputError, match=re.escape(told)):
        made(*SCENARIO, key, scenario="operations/field")


def test_robots_sample_it_as_any_field() -> None:
    """What they think of it comes from samples: twice the same, and other than without the source."""
    found = []
    for keys in ((), (), ("field.sources=[]",)):
        run = made(
            *SCENARIO,
            "field.model.diffusivity=1.0",
            "stop={iterations=12, when_done='continue'}",
            *keys,
            scenario="operations/field",
        )
        last = moments_of(run)[-1]
        found.append(last.knowledge.record().rows["weights"].copy())
        truth = run.context.scalar_field.value(11.0, last.state.pose[:, :2])
        assert (truth.max() > 0.05) == (not keys)
    assert np.array_equal(found[0], found[1])
    assert np.abs(found[0] - found[2]).max() > 0.01
