"""Jobs with a clock take the newest halos there are: how fast that converges, where it does not, and what is told."""

from __future__ import annotations

import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import numpy as np
import pytest
from networks import Swarm, context_of

from swarmsim.core.errors import InputError
from swarmsim.core.jobs import Domain
from swarmsim.core.scenario.part import Part
from swarmsim.jobs.pieces import bisected, given
from swarmsim.operations.methods.problem import Problem
from swarmsim.operations.methods.sweeps import BlockJacobi, Schwarz
from swarmsim.operations.models.faces import Faces
from swarmsim.operations.models.job import ModelJob, Solve

LOSSY = {"use": "bernoulli", "loss": 0.3}
LATE = {"use": "latency", "delay": 5}
CLOCK = {"fence": "clock", "patience": 40}
NETWORKS = {
    "everybody": {},
    "everybody, delay 5": {"channel": LATE},
    "ring, relayed": {"topology": "ring"},
    "ring, 30 % lost": {"topology": "ring", "channel": LOSSY},
    "ring, 30 % lost, late": {"topology": "ring", "channel": {**LATE, "delay": 2, "law": "geometric", "over": LOSSY}},
    "ring, delay 5": {"topology": "ring", "channel": LATE},
}


@pytest.fixture(scope="module")
def rates():
    """The script that does the same in the basilica."""
    spec = spec_from_file_location("rates", Path("benchmarks/computing/rates.py"))
    sys.modules["rates"] = module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def job_of(rates, domain: Domain, method):
    problem = Problem(rates.MODEL.on(domain), lambda cells, begin, end: np.zeros(len(cells)), rates.R * 0.25 / 0.05)
    return rates.Mode(ModelJob.of(problem, method, domain, 7, method.exchanges), Faces.of(domain).number)


@pytest.mark.parametrize(
    "network", [*list(NETWORKS)[:4], *(pytest.param(one, marks=pytest.mark.slow) for one in list(NETWORKS)[4:])]
)
def test_a_solve_converges_as_the_ages_of_its_halos_tell(rates, network: str) -> None:
    """From the slowest mode, in logarithms: by the mean age where all are as old, and by the age of each anywhere.

    Who peeked at others' pieces would be faster by the same factor, and who heard nothing would not converge.
    """
    job, errors = job_of(rates, given(context_of(7)), BlockJacobi(sweeps=400)), list[float]()

    def small(swarm: Swarm) -> bool:
        errors.append(job.error(swarm.parcel.states))
        return errors[-1] < 1e-8

    swarm = Swarm(job, keys=CLOCK, until=small, limit=399, **NETWORKS[network]).run()
    assert errors[-1] < 1e-5
    rate = np.log(errors[-1]) / len(errors)
    assert np.log(job.rate()) / rate == pytest.approx(1.0, abs=0.15)
    age = swarm.parcel.counts[:, 1].sum() / swarm.parcel.counts[:, 0].sum()
    if network.startswith("everybody"):
        assert np.log(job.rho) / rate == pytest.approx(1.0 + age, rel=0.15)
    assert (age == 0.0) == (network == "everybody")


MIXED = np.array([[0.7, -0.7], [0.7, 0.7]])


class Pair:
    """x' = MIXED x, of two pieces with a number each, so large at the start that it shows early if they grow."""

    halo = 1

    def __init__(self, steps: int) -> None:
        self.steps = self.level = steps

    def pieces(self, domain):
        return bisected(domain, 2, self.halo)

    def start(self, piece, sensed):
        return np.array([1e300])

    def shows(self, piece, state, step):
        return np.full(len(piece.rim), state[0])

    def step(self, piece, state, around, step):
        own, other = MIXED[piece.number, piece.number], MIXED[piece.number, 1 - piece.number]
        return own * state + other * around[:1]

    def work(self, piece):
        return 3.0

    def answer(self, piece, state):
        return state


def played(now: int, alive: np.ndarray) -> np.ndarray:
    """A schedule: halos come in every third exchange alone, never more than two steps late."""
    return np.full((2, 2), now % 3 == 0)


def test_a_schedule_made_for_it_makes_a_clock_diverge_and_changes_nothing_without_one() -> None:
    """Asynchronous iterations converge on every schedule if and only if rho(|M|) < 1 (Chazan and Miranker 1969)."""
    assert max(abs(np.linalg.eigvals(MIXED))) < 1.0 <= max(abs(np.linalg.eigvals(abs(MIXED))))
    calm = Swarm(Pair(200), 2, keys=CLOCK, limit=200).run()
    assert calm.exact
    assert abs(calm.parcel.answers(calm.alive)[0][0]) < 0.2e300  # 0.99^200
    with pytest.raises(InputError, match=r"jobs: 'heat' is not finite in piece \d after step \d+; expected a stable"):
        Swarm(Pair(200), 2, keys=CLOCK, topology=played, limit=200).run()
    fenced = Swarm(Pair(30), 2, keys={"patience": 40}, topology=played).run()
    assert fenced.exact
    assert fenced.ended > 2 * 30


@pytest.mark.parametrize("robots", [1, 2, 7])
def test_with_a_clock_and_all_halos_in_time_the_answer_does_not_depend_on_how_many_share_it(robots: int) -> None:
    swarm = Swarm(robots=robots, keys=CLOCK).run()
    assert (swarm.ended, swarm.exact) == (20, True)
    assert swarm.parcel.counts[:, 1].sum() == 0.0


def test_robots_apart_tell_that_what_they_read_was_never_heard() -> None:
    swarm = Swarm(keys=CLOCK, topology=lambda now, alive: np.zeros((7, 7), bool)).run()
    assert not swarm.exact
    assert swarm.parcel.counts[:, 1].sum() / swarm.parcel.counts[:, 0].sum() == np.mean(np.arange(20) + 1.0)
    assert (swarm.parcel.silent == 19).all()


def test_an_overlap_with_a_clock_would_be_wrong_for_good_so_it_is_refused(rates) -> None:
    job = job_of(rates, given(context_of(7)), Schwarz(sweeps=120, overlap=1))
    swarm = Swarm(job, keys=CLOCK, topology="ring", limit=60).run()
    assert (
        job.error(swarm.parcel.states) > 0.01
    )  # after 60 sweeps; by its rate 1e-8 takes 13 where all is heard in time
    with pytest.raises(InputError, match=r'method.overlap: 2 with a clock: .*; expected 0, or fence = "data"'):
        solve(2, "clock").build(context_of(7))
    for overlap, fence in ((0, "clock"), (2, "data")):
        assert solve(overlap, fence).build(context_of(7)).steps == 20


def solve(overlap: int, fence: str) -> Solve:
    method = Part("method", {"use": "schwarz", "overlap": overlap})
    return Solve(model=Part("model", {"use": "diffusion"}), method=method, dt=1.0, duration=1.0, fence=fence)
