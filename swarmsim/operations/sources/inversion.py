"""Inversion: the place and the strength of one source that explain samples best."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, optimize

from swarmsim.operations.sources.candidates import SourceCandidates
from swarmsim.operations.sources.greens import Greens, PulseReading

BEST: Final = 3  #: candidates of a level near which finer ones are tried
EVIDENCE: Final = 40.0  #: how much less a source leaves unexplained than none does, in variances of the noise, at least

Whole = NDArray[np.int64]
Values = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """What was measured where and when."""

    cells: Whole  # (m,): numbers of free cells
    times: Values  # (m,): s
    values: Values  # (m,): in the field's unit


@dataclass(frozen=True, slots=True, eq=False)
class FoundSource:
    """A source: the cell, and its strength in each pulse until the last sample."""

    cell: int
    strengths: Values  # (k,): unit m^2/s
    tried: frozenset[int]  # the cells whose Green's functions it took
    spread: float  # m: standard deviation of the place, over all candidates tried

    def forecast(self, greens: Greens, time: float, cells: Whole) -> Values:
        """The field (c,) at some cells and a time (s), if the source goes on with its last strength."""
        pulses = min(int(time / greens.pulse) + 1, greens.pulses)
        strengths = np.pad(self.strengths, (0, max(pulses - len(self.strengths), 0)), mode="edge")[:pulses]
        found = greens.reading(cells, np.full(len(cells), time), pulses).of(greens.of(self.cell)) @ strengths
        return np.asarray(found)


@dataclass(frozen=True, slots=True, eq=False)
class Inversion:
    """Non-negative least squares on Green's functions (Lawson and Hanson 1974), for one source at an unknown place.

    For a candidate cell the strengths s >= 0 of all pulses minimise |(G s - y) / noise|^2 + |D s / change|^2, where D
    takes differences of successive pulses, the first from 0: strengths are a random walk. The candidate with the least
    minimum wins; finer candidates are tried near the best ones, down to single cells.
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
        tried: dict[int, tuple[float, Values]] = {}
        cells = self.candidates.coarse
        for level in range(self.candidates.levels):
            for cell in cells.tolist():
                if cell not in tried:
                    tried[cell] = self._fit(self.greens.of(cell), reading, right)
            best = sorted(cells.tolist(), key=lambda cell: (tried[cell][0], cell))[:BEST]
            if level + 1 < self.candidates.levels:
                cells = self.candidates.finer(level, np.array(best))
        cell = min(tried, key=lambda cell: (tried[cell][0], cell))
        left, strengths = tried[cell]
        if float(right @ right) - left < EVIDENCE:
            return None
        return FoundSource(cell, strengths, frozenset(tried), self._spread({one: fit[0] for one, fit in tried.items()}))

    def _fit(self, response: NDArray[np.float32], reading: PulseReading, right: Values) -> tuple[float, Values]:
        """The least sum of squares for a source with this response, and its strengths (k,)."""
        matrix = reading.of(response) / self.noise
        pulses = matrix.shape[1]
        steps = (np.eye(pulses) - np.eye(pulses, k=-1)) / self.change
        normal = matrix.T @ matrix + steps.T @ steps
        upper = linalg.cholesky(normal)  # |U s - z|^2 has the same minimum, and is smaller
        reduced = linalg.solve_triangular(upper, matrix.T @ right, trans="T")
        strengths, left = optimize.nnls(upper, reduced)
        return float(left**2 + right @ right - reduced @ reduced), strengths

    def _spread(self, left: dict[int, float]) -> float:
        """The standard deviation of the place (m), where exp(-left / 2) is a candidate's weight."""
        cells, values = np.array(list(left)), np.array(list(left.values()))
        weights = np.exp(-0.5 * (values - values.min()))
        weights /= weights.sum()
        places = self.candidates.places[cells]
        return float(np.sqrt(weights @ ((places - weights @ places) ** 2).sum(axis=1)))
