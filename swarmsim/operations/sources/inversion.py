"""Inversion: the place and the strength of one source that explain samples best."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, optimize

from swarmsim.operations.sources.candidates import SourceCandidates
from swarmsim.operations.sources.greens import Greens, PulseReading

BEST: Final = 3  #: candidates of a level near which finer ones are tried
EVIDENCE: Final = 40.0  #: how much less a source leaves unexplained than none does, in variances of the noise, at least
LIKELY: Final = 1e-3  #: the least weight of a candidate that counts in `variance`

Whole = NDArray[np.int64]
Values = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """What was measured where and when."""

    cells: Whole  # (m,): numbers of free cells
    times: Values  # (m,): s
    values: Values  # (m,): in the field's unit


@dataclass(frozen=True, slots=True, eq=False)
class CandidateFit:
    """One candidate's best strengths."""

    cell: int
    strengths: Values  # (k,): unit m^2/s, in each pulse until the last sample
    upper: Values  # (k, k): U, where U'U is the inverse of the strengths' covariance, if they may be negative
    left: float  # the least sum of squares, in variances of the noise
    unlikely: float  # -2 ln of the probability of the samples, up to a constant


@dataclass(frozen=True, slots=True, eq=False)
class FoundSource:
    """A source, and the other candidates that may be it."""

    fits: tuple[CandidateFit, ...]  # the likely ones, the best first
    weights: Values  # (f,): how likely each is; their sum is 1
    tried: frozenset[int]  # the cells whose Green's functions it took
    spread: float  # m: standard deviation of the place, over all candidates tried

    @property
    def cell(self) -> int:
        """The best candidate."""
        return self.fits[0].cell

    @property
    def strengths(self) -> Values:
        """The best candidate's strength in each pulse until the last sample (k,), unit m^2/s."""
        return self.fits[0].strengths

    def forecast(self, greens: Greens, time: float, cells: Whole, lasting: float | None = None) -> Values:
        """The mean field (c,) at some cells and a time (s), if the source ends some time.

        It is still on after t seconds with the chance T / (T + t), where T is `lasting` (s), by default how long it has
        been on: the time in which its largest strength gives off all that it has (Gott 1993). With `lasting` infinite
        it goes on for ever, with 0 it ends now.
        """
        known, pulses = self.strengths, min(int(time / greens.pulse) + 1, greens.pulses)
        if lasting is None:
            lasting = greens.pulse * float(known.sum() / max(known.max(), 1e-300))
        later = greens.pulse * (np.arange(max(pulses - len(known), 0)) + 0.5)
        still = np.ones(len(later)) if math.isinf(lasting) else lasting / (lasting + later)
        strengths = np.concatenate([known, known[-1] * still])[:pulses]
        found = greens.reading(cells, np.full(len(cells), time), pulses).of(greens.of(self.cell)) @ strengths
        return np.asarray(found)

    def variance(self, greens: Greens, times: Values, cells: Whole) -> Values:
        """How far the likely candidates disagree (c,) at cells (c,) and times (c,) in s, in the field's unit squared.

        It is the variance over candidates, with that of the best one's strengths. The last strength is taken to go on.
        """
        count = len(self.strengths)
        pulses = min(max(int(times.max() / greens.pulse) + 1, count), greens.pulses)
        reading = greens.reading(cells, times, pulses)
        fields = []
        for fit in self.fits:
            found = reading.of(greens.of(fit.cell))
            found[:, count - 1] += found[:, count:].sum(axis=1)
            fields.append(found[:, :count] @ fit.strengths)
            if len(fields) == 1:
                within = (linalg.solve_triangular(fit.upper, found[:, :count].T, trans="T") ** 2).sum(axis=0)
        table = np.array(fields)
        return np.asarray(self.weights @ (table - self.weights @ table) ** 2 + within)


@dataclass(frozen=True, slots=True, eq=False)
class Inversion:
    """Non-negative least squares on Green's functions (Lawson and Hanson 1974), for one source at an unknown place.

    For a candidate cell the strengths s >= 0 of all pulses minimise |(G s - y) / noise|^2 + |D s / change|^2, where D
    takes differences of successive pulses, the first from 0: strengths are a random walk. The most likely candidate
    wins; finer candidates are tried near the best ones, down to single cells. -2 ln of the probability of the samples
    is the minimum plus ln det(I + change^2 D^-T G'G D^-1 / noise^2), up to a constant, if strengths may be negative
    (MacKay 1992): a candidate that can explain anything explains little.
    """

    greens: Greens
    candidates: SourceCandidates
    noise: float  # standard deviation of a sample
    change: float  # unit m^2/s: standard deviation of the change of strength between two pulses

    def find(self, samples: Samples) -> FoundSource | None:
        """The source; None if samples can be explained about as well without one."""
        right = samples.values / self.noise
        if right @ right < EVIDENCE:  # no samples, or so small that nothing can be found
            return None
        pulses = min(int(samples.times.max() / self.greens.pulse) + 1, self.greens.pulses)
        reading = self.greens.reading(samples.cells, samples.times, pulses)
        tried: dict[int, CandidateFit] = {}
        cells = self.candidates.coarse
        for level in range(self.candidates.levels):
            for cell in cells.tolist():
                if cell not in tried:
                    tried[cell] = self._fit(cell, reading, right)
            best = sorted(cells.tolist(), key=lambda cell: (tried[cell].unlikely, cell))[:BEST]
            if level + 1 < self.candidates.levels:
                cells = self.candidates.finer(level, np.array(best))
        fits = sorted(tried.values(), key=lambda fit: (fit.unlikely, fit.cell))
        if float(right @ right) - fits[0].left < EVIDENCE:
            return None
        weights = np.exp(-0.5 * (np.array([fit.unlikely for fit in fits]) - fits[0].unlikely))
        weights /= weights.sum()
        likely = int(np.count_nonzero(weights >= LIKELY))
        spread = self._spread(np.array([fit.cell for fit in fits]), weights)
        return FoundSource(tuple(fits[:likely]), weights[:likely] / weights[:likely].sum(), frozenset(tried), spread)

    def _fit(self, cell: int, reading: PulseReading, right: Values) -> CandidateFit:
        matrix = reading.of(self.greens.of(cell)) / self.noise
        pulses = matrix.shape[1]
        steps = (np.eye(pulses) - np.eye(pulses, k=-1)) / self.change
        normal = matrix.T @ matrix + steps.T @ steps
        upper = linalg.cholesky(normal)  # |U s - z|^2 has the same minimum, and is smaller
        reduced = linalg.solve_triangular(upper, matrix.T @ right, trans="T")
        strengths, rest = optimize.nnls(upper, reduced)
        left = float(rest**2 + right @ right - reduced @ reduced)
        determinant = 2.0 * float(np.log(upper.diagonal() * self.change).sum())
        return CandidateFit(cell, strengths, upper, left, left + determinant)

    def _spread(self, cells: Whole, weights: Values) -> float:
        """The standard deviation of the place (m): that of cells with these weights, and that within a cell."""
        places = self.candidates.places[cells]
        within = self.candidates.cell**2 / 6.0
        return float(np.sqrt(weights @ ((places - weights @ places) ** 2).sum(axis=1) + within))
