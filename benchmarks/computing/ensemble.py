"""A local ensemble filter beside the inversion, from the same samples, over seeds.

Usage: python benchmarks/computing/ensemble.py [SCENARIO] [SEEDS]; seeds as in `source.py`. The samples are those that
all robots take: nothing is lost or late.

It is the ensemble square-root filter of Whitaker and Hamill (2002), one sample after another, localised by the taper of
Gaspari and Cohn (1999). A member is a field, a place of the source and its strength, a random walk as in the inversion;
below 0 it gives off nothing. The taper for place and strength is twice as wide, around the mean place.
Members are independent of each other between samples, so a bag could share them.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import linalg
from source import FIRST, resampled

from swarmsim.api.runs import prepared
from swarmsim.core.scenario.file import load
from swarmsim.core.state import Moment
from swarmsim.engine.build import BuiltRun
from swarmsim.jobs.pieces import given
from swarmsim.operations.models.truth import nearest_cells
from swarmsim.operations.sources.inversion import Inversion, Samples
from swarmsim.operations.sources.locate import LocateSource

Step = Callable[[NDArray[np.float64]], NDArray[np.float64]]
TIMES, AHEAD = (120, 160, 240), (30.0, 60.0, 120.0)  # s
MEMBERS, REACH = 60, 3.0  # REACH in m: where the taper is 0.2; it ends at twice that


def taper(away: NDArray[np.float64]) -> NDArray[np.float64]:
    """Gaspari and Cohn's function of distances (k,) in units of REACH: 1 at 0, 0 from 2 on."""
    near, far = np.minimum(away, 1.0), np.clip(away, 1.0, 2.0)
    inside = 1.0 - 5.0 / 3.0 * near**2 + 0.625 * near**3 + 0.5 * near**4 - 0.25 * near**5
    outside = far**5 / 12.0 - 0.5 * far**4 + 0.625 * far**3 + 5.0 / 3.0 * far**2 - 5.0 * far + 4.0 - 2.0 / 3.0 / far
    return np.where(away < 1.0, inside, np.maximum(outside, 0.0) * (away < 2.0))


class Filter:
    """The members, and how they go on."""

    def __init__(self, inversion: Inversion, solve: Step, dice: np.random.Generator) -> None:
        """`solve` is a step in time of fields (n, members)."""
        self._inversion, self._solve, self._dice = inversion, solve, dice
        self._places, self._step = inversion.candidates.places, inversion.greens.dt
        count = len(self._places)
        self.state = np.zeros((count + 3, MEMBERS))  # field, x, y, strength
        self.state[-3:-1] = self._places[dice.integers(count, size=MEMBERS)].T
        self.time = 0.0

    def advance(self) -> None:
        """A step in time."""
        away = np.abs(self._places[:, None] - self.state[-3:-1].T).sum(axis=2)
        gain = self._step / self._inversion.candidates.cell**2
        self.state[away.argmin(axis=0), np.arange(MEMBERS)] += gain * np.maximum(self.state[-1], 0.0)
        self.state[:-3] = self._solve(self.state[:-3])
        walk = self._inversion.change * np.sqrt(self._step / self._inversion.greens.pulse)
        self.state[-1] += walk * self._dice.standard_normal(MEMBERS)
        self.time += self._step

    def take(self, samples: Samples, those: NDArray[np.int64]) -> None:
        """Take in some samples (s,)."""
        for cell, value in zip(samples.cells[those].tolist(), samples.values[those].tolist(), strict=True):
            mean = self.state.mean(axis=1)
            apart = self.state - mean[:, None]
            variance, noise = float(apart[cell].var(ddof=1)), self._inversion.noise**2
            if variance < 1e-12:
                continue
            gains = apart @ apart[cell] / (MEMBERS - 1) / (variance + noise)
            gains[:-3] *= taper(np.hypot(*(self._places - self._places[cell]).T) / REACH)
            gains[-3:] *= taper(np.hypot(*(mean[-3:-1] - self._places[cell])[:, None]) / REACH / 2.0)
            shrink = 1.0 / (1.0 + np.sqrt(noise / (variance + noise)))
            self.state = (mean + gains * (value - mean[cell]))[:, None] + apart - shrink * np.outer(gains, apart[cell])
        low, high = self._places.min(axis=0), self._places.max(axis=0)
        self.state[-3:-1] = np.clip(self.state[-3:-1].T, low, high).T

    def ahead(self, seconds: float) -> NDArray[np.float64]:
        """The mean field (n,) so much later."""
        kept, then = self.state.copy(), self.time
        while self.time < then + seconds - 1e-9:
            self.advance()
        found = self.state[:-3].mean(axis=1)
        self.state, self.time = kept, then
        return found


class Sampling:
    """An observer that takes the samples that all robots would take."""

    def __init__(self, keys: LocateSource, run: BuiltRun, dice: np.random.Generator) -> None:
        self._every, self._noise, self._run, self._dice = keys.every, keys.noise, run, dice
        self._lattice, self._nearest = run.context.lattice, nearest_cells(given(run.context))
        self.rows: list[tuple[int, float, float]] = []  # cell, s, value

    def sample(self, moment: Moment) -> None:
        """Note one iteration."""
        now, places = moment.state.iteration, moment.state.pose[:, :2]
        if now % self._every == 0:
            values = self._run.context.scalar_field.value(float(now), places)
            cells = self._nearest[tuple(self._lattice.cells(places).T)].tolist()
            noisy = values + self._noise * self._dice.standard_normal(len(values))
            self.rows += zip(cells, [float(now)] * len(cells), noisy.tolist(), strict=True)


def of_seed(path: str, seed: int) -> Iterator[tuple[int, float, list[float], list[float]]]:
    """At times, for s ahead: the distances (m) of both places, and the errors of both predictions and persistence."""
    run, dice = (
        prepared(path, seed, ["jobs=[]", 'task={use="travelled", distance=1e6}'], ()),
        np.random.default_rng(seed),
    )
    keys = load(Path(path)).jobs[0].parameters
    sampling = Sampling(keys, run, dice)
    run.simulation.run([sampling])
    every = Samples(*(np.array(column) for column in zip(*sampling.rows, strict=True)))
    inversion = keys.build(run.context).plan.inversion
    operator = keys.model.build(run.context, "model").on(given(run.context)).operators[0]
    solve = linalg.splu((sparse.eye_array(operator.shape[0]) - keys.dt * operator).tocsc()).solve
    members, truth, places = Filter(inversion, solve, dice), run.context.scalar_field, inversion.candidates.places
    (emitter,), cells = truth.emitters, np.arange(len(places))
    for now in range(int(keys.dt), max(TIMES) + 1, int(keys.dt)):
        members.advance()
        members.take(every, np.flatnonzero(every.times == now))
        if now not in TIMES:
            continue
        known = every.times <= now
        finding = inversion.find(Samples(every.cells[known], every.times[known], every.values[known]))
        if finding is None:
            continue
        found = places[finding.cell], members.state[-3:-1].mean(axis=1)
        away = [float(np.hypot(*(place - (emitter.x, emitter.y)))) for place in found]
        for ahead in AHEAD:
            then = truth.value(now + ahead, places)
            guesses = [finding.forecast(inversion.greens, now + ahead, cells), members.ahead(ahead)]
            guesses += [finding.forecast(inversion.greens, float(now), cells), members.state[:-3].mean(axis=1)]
            yield now, ahead, away, [float(((guess - then) ** 2).mean() / then.var()) for guess in guesses]


def main(path: str = "scenarios/computing/buoys.toml", seeds: str = "20") -> None:
    """Print means over seeds with intervals."""
    found = [row for seed in range(FIRST, FIRST + int(seeds)) for row in of_seed(path, seed)]
    print(
        "| at, for | n | distance: inversion | filter | error: inversion | filter | persistence: inversion | filter |"
    )
    for now, ahead in sorted({row[:2] for row in found}):
        table = np.array([(*away, *errors) for at, later, away, errors in found if (at, later) == (now, ahead)])
        cells = " | ".join(f"{mean:.2f} ({low:.2f} to {high:.2f})" for mean, low, high in resampled(table))
        print(f"| {now} s, {ahead:g} s ahead | {len(table)} | {cells} |")


if __name__ == "__main__":
    main(*sys.argv[1:])
