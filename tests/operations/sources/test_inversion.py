"""Green's functions, candidates and the inversion, against the solver of the truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from floors import floor, rooms

from swarmsim.core.errors import InputError
from swarmsim.core.jobs import Domain
from swarmsim.operations.methods.problem import Problem
from swarmsim.operations.methods.sweeps import BlockJacobi
from swarmsim.operations.models.advection import AdvectionDiffusion, Vents
from swarmsim.operations.models.diffusion import Diffusion
from swarmsim.operations.models.emitters import Emission, Emitter
from swarmsim.operations.models.faces import Faces
from swarmsim.operations.models.job import ModelJob
from swarmsim.operations.models.truth import SolvedField
from swarmsim.operations.models.wave import Wave
from swarmsim.operations.sources.candidates import SourceCandidates
from swarmsim.operations.sources.greens import Greens
from swarmsim.operations.sources.inversion import Inversion, Samples

SMELL = Diffusion(diffusivity=0.01, decay=0.01)
DRAUGHT = AdvectionDiffusion(diffusivity=0.01, vents=Vents(inlet=(0.2, 0.2), outlet=(3.7, 2.5), flow=0.02))


def greens(domain: Domain, model=SMELL, **keys) -> Greens:
    return Greens(model.on(domain), domain, **{"dt": 2.0, "pulse": 6.0, "duration": 60.0, **keys})


def truth(domain: Domain, *emitters: Emitter, model=SMELL, dt: float = 2.0) -> SolvedField:
    """The field of some sources, by the solver of scenarios' truth."""
    problem = Problem(model.on(domain), Emission(emitters, Faces.of(domain)), dt)
    job = ModelJob.of(problem, BlockJacobi(sweeps=1), domain, 1, 1)
    return SolvedField(job, domain, 1, np.zeros(np.count_nonzero(domain.free)))


def source(domain: Domain, cell: int, begin: float, end: float, strength: float = 0.3) -> Emitter:
    x, y = Faces.of(domain).places[cell].tolist()
    return Emitter(x=x, y=y, begin=begin, end=end, strength=strength)


def sampled(field: SolvedField, domain: Domain, until: float, noise: float = 0.0, seed: int = 1) -> Samples:
    """What five robots measure that jump about."""
    dice, places = np.random.default_rng(seed), Faces.of(domain).places
    times = np.repeat(np.arange(0.0, until + 1.0, 2.0), 5)
    cells = dice.integers(len(places), size=len(times))
    values = [field.value(time, places[[cell]])[0] for time, cell in zip(times.tolist(), cells.tolist(), strict=True)]
    return Samples(cells, times, np.array(values) + noise * dice.standard_normal(len(times)))


def inversion(domain: Domain, model=SMELL, noise: float = 1e-6, **keys) -> Inversion:
    return Inversion(greens(domain, model, **keys), SourceCandidates(domain, 1.2), noise, 0.3)


@pytest.mark.parametrize("model", [SMELL, DRAUGHT])
@pytest.mark.parametrize("pulse", [0, 3])
def test_a_response_is_what_the_truth_s_solver_gives_for_a_source_that_is_on_for_that_pulse(model, pulse: int) -> None:
    domain, cell = rooms(), 77
    its = greens(domain, model)
    every = np.arange(its.cells)
    field = truth(domain, source(domain, cell, 6.0 * pulse, 6.0 * pulse + 6.0, 1.0), model=model)
    for time in (6.0 * pulse, 6.0 * pulse + 3.0, 40.0, 60.0):
        found = its.reading(every, np.full(len(every), time), 10).of(its.of(cell))[:, pulse]
        np.testing.assert_allclose(found, field.value(time, Faces.of(domain).places), atol=1e-6)


@pytest.mark.parametrize("model", [SMELL, DRAUGHT])
def test_without_noise_the_cell_the_strengths_and_the_future_are_exact(model) -> None:
    domain, places = rooms(), Faces.of(rooms()).places
    for cell in (30, 390):
        field = truth(domain, source(domain, cell, 12.0, 60.0), model=model)
        its = inversion(domain, model)
        found = its.find(sampled(field, domain, 40.0))
        assert found is not None
        assert found.cell == cell
        np.testing.assert_allclose(found.strengths, [0.0, 0.0, *[0.3] * 5], atol=1e-3)
        ahead = found.forecast(its.greens, 60.0, np.arange(len(places)), lasting=np.inf)
        np.testing.assert_allclose(ahead, field.value(60.0, places), atol=2e-3 * ahead.max())
        assert found.spread == pytest.approx(0.15 / 6.0**0.5), "that within a cell"


def test_a_prediction_lies_between_those_of_a_source_that_ends_now_and_one_that_never_ends() -> None:
    domain, cells = rooms(), np.arange(len(Faces.of(rooms()).places))
    its = inversion(domain)
    found = its.find(sampled(truth(domain, source(domain, 300, 12.0, 99.0)), domain, 34.0))
    assert found is not None
    ends, by_age, goes_on = (found.forecast(its.greens, 60.0, cells, lasting) for lasting in (0.0, None, np.inf))
    stopped = truth(domain, source(domain, 300, 12.0, 36.0)).value(60.0, Faces.of(domain).places)
    np.testing.assert_allclose(ends, stopped, atol=2e-3 * stopped.max())
    assert (ends <= by_age).all()
    assert (by_age <= goes_on).all()
    # on for 24 s, so after 3, 9, 15 and 21 s it is still on with these chances
    later = [24.0 / (24.0 + after) for after in (3.0, 9.0, 15.0, 21.0)]
    mixed = its.greens.reading(cells, np.full(len(cells), 60.0), 10).of(its.greens.of(300))
    expected = mixed[:, 2:6].sum(axis=1) * 0.3 + mixed[:, 6:] @ np.array(later) * 0.3
    np.testing.assert_allclose(by_age, expected, atol=5e-3 * expected.max())


def test_candidates_disagree_where_a_sample_would_tell_most() -> None:
    """The variance is that of fields drawn from what is known: of candidates by weight, and of strengths."""
    domain, dice = rooms(), np.random.default_rng(1)
    its = inversion(domain, noise=0.1)
    found = its.find(sampled(truth(domain, source(domain, 300, 6.0, 60.0, 0.6)), domain, 24.0, 0.1))
    assert found is not None
    assert len(found.fits) > 1
    cells = np.arange(its.greens.cells)
    told = found.variance(its.greens, np.full(len(cells), 30.0), cells)
    reading = its.greens.reading(cells, np.full(len(cells), 30.0), 6)
    best, drawn = found.fits[0], []
    for which in dice.choice(len(found.fits), 4000, p=found.weights):
        fit = found.fits[which]
        wrong = np.linalg.solve(best.upper, dice.standard_normal(5))
        last = np.append(fit.strengths, fit.strengths[-1])
        drawn.append(reading.of(its.greens.of(fit.cell)) @ last)
        drawn[-1] += reading.of(its.greens.of(best.cell)) @ np.append(wrong, wrong[-1])
    np.testing.assert_allclose(told, np.var(drawn, axis=0), rtol=0.15, atol=0.02 * told.max())


def test_an_unlikely_candidate_that_could_explain_anything_does_not_win() -> None:
    """The probability of samples is that of a normal distribution with the prior's and the noise's variance."""
    domain = rooms()
    its = inversion(domain, noise=0.1)
    samples = sampled(truth(domain, source(domain, 300, 6.0, 60.0, 0.6)), domain, 11.0, 0.1)
    reading, right = its.greens.reading(samples.cells, samples.times, 2), samples.values / its.noise
    fits = [its._fit(cell, reading, right) for cell in (300, 30)]
    steps = np.eye(2) - np.eye(2, k=-1)
    prior = np.linalg.inv(steps.T @ steps) * its.change**2
    expected = []
    for fit in fits:
        matrix = reading.of(its.greens.of(fit.cell))
        spread = matrix @ prior @ matrix.T + its.noise**2 * np.eye(len(matrix))
        free = samples.values @ np.linalg.solve(spread, samples.values)
        expected.append(free + np.linalg.slogdet(spread)[1] - len(matrix) * np.log(its.noise**2))
        assert fit.unlikely - fit.left == pytest.approx(expected[-1] - free)
        assert fit.left >= free - 1e-6


def test_with_noise_it_comes_within_half_a_metre_and_says_how_sure_it_is() -> None:
    domain = rooms()
    places, field = Faces.of(domain).places, truth(domain, source(domain, 300, 6.0, 60.0, 0.6), dt=1.0)
    its = inversion(domain, noise=0.1)
    early, late = (its.find(sampled(field, domain, until, 0.1)) for until in (24.0, 50.0))
    assert early is not None
    assert late is not None
    assert np.hypot(*(places[late.cell] - places[300])) < 0.5
    assert late.spread < early.spread < 3.0


def test_without_samples_or_a_source_there_is_nothing_to_find() -> None:
    domain = rooms()
    its, none = inversion(domain, noise=0.1), truth(domain)
    assert its.find(Samples(np.zeros(0, np.int64), np.zeros(0), np.zeros(0))) is None
    assert all(its.find(sampled(none, domain, 20.0, 0.1, seed)) is None for seed in range(6))


@pytest.mark.parametrize("domain", [rooms(), floor(9, 14)])
@pytest.mark.parametrize("spacing", [0.15, 0.5, 1.2])
def test_refining_comes_to_the_cell_that_is_nearest_whichever_it_is(domain: Domain, spacing: float) -> None:
    candidates = SourceCandidates(domain, spacing)
    assert len(candidates.coarse) >= np.prod(np.ptp(candidates.places, axis=0)) / spacing**2 * 0.5
    for wanted in candidates.places[::7]:
        cells = candidates.coarse
        for level in range(candidates.levels):
            away = np.hypot(*(candidates.places[cells] - wanted).T)
            best = cells[np.argsort(away)[:3]]
            if level + 1 < candidates.levels:
                cells = candidates.finer(level, best)
        assert away.min() == 0.0


@pytest.mark.parametrize(
    ("model", "keys", "told"),
    [
        (Wave(), {}, "model: responses .* linear and of first order"),
        (Diffusion(walls="fixed", value=1.0), {}, r"model\.value: the field has to be 0 without a source"),
        (SMELL, {"pulse": 5.0}, "pulse: 5 s; expected a whole number of times dt, 2 s"),
        (SMELL, {"duration": 62.0}, "duration: 62 s; expected a whole number of times pulse, 6 s"),
        (SMELL, {"duration": 6e6}, "duration: 3000000 steps .* expected .* steps at most"),
    ],
)
def test_what_does_not_fit_is_refused(model, keys, told: str) -> None:
    with pytest.raises(InputError, match=told):
        greens(rooms(), model, **keys)


def test_candidates_closer_than_cells_are_refused() -> None:
    with pytest.raises(InputError, match=r"spacing: 0\.1 m is less than a cell, 0\.15 m"):
        SourceCandidates(rooms(), 0.1)


def test_what_is_kept_changes_nothing() -> None:
    """Two robots that share Green's functions find what each would find alone."""
    domain = rooms()
    field = truth(domain, source(domain, 120, 0.0, 60.0))
    shared = inversion(domain, noise=0.1)
    for seed in (1, 2):
        samples = sampled(field, domain, 30.0, 0.1, seed)
        own = replace(shared, greens=greens(domain)).find(samples)
        again = shared.find(samples)
        assert own is not None
        assert again is not None
        assert own.cell == again.cell
        assert own.strengths.tobytes() == again.strengths.tobytes()
