"""Green's functions: what a source in one cell, on for a while, does to all cells from then on."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import linalg

from swarmsim.core.errors import InputError
from swarmsim.core.jobs import Domain
from swarmsim.operations.models.equations import Equations

MOST: Final = 1 << 27  #: numbers kept: 512 MB


class Greens:
    """The responses of a linear model to a strength of 1 in one cell in [0, pulse), by Euler's implicit method.

    The model does not change with time, so the response to a later pulse is the same, later. A response is a solve of
    the whole domain. It is computed when it is first asked for, and kept for all robots: it depends on floor and model
    alone.
    """

    def __init__(self, equations: Equations, domain: Domain, dt: float, pulse: float, duration: float) -> None:
        """Of steps `dt` (s) up to `duration` (s). Raises InputError, which starts with the key at fault."""
        _check(equations, dt, pulse, duration)
        factors = linalg.splu((sparse.eye_array(len(equations.inflow)) - dt * equations.operators[0]).tocsc())
        self._solve, self._fill = factors.solve, int(factors.L.nnz + factors.U.nnz)
        self._gain = dt / domain.lattice.cell**2
        self.dt, self.pulse, self.duration = dt, pulse, duration
        self._steps = round(duration / dt)
        #: Of free cells.
        self.cells = int(np.count_nonzero(domain.free))
        #: How many responses can be kept.
        self.most = MOST // (self.cells * (self._steps + 1))
        if self.most < 8:
            raise InputError(
                f"duration: {self._steps} steps of dt = {dt:g} s on {self.cells} cells are too many numbers to keep of "
                f"8 Green's functions; expected {MOST // 8 // self.cells - 1} steps at most"
            )
        #: The response (cells, steps + 1) to a pulse in a cell, by number.
        self.of = lru_cache(self.most)(self._of)

    @property
    def pulses(self) -> int:
        """The number of pulses in the whole duration."""
        return round(self.duration / self.pulse)

    @property
    def work(self) -> float:
        """Floating-point operations of one response."""
        return 2.0 * self._steps * self._fill

    def _of(self, cell: int) -> NDArray[np.float32]:
        state = np.zeros(self.cells)
        state[cell] = self._gain  # what one step gives off, so this first is the response to a pulse of one step
        found = np.zeros((self._steps + 1, self.cells))
        for step in range(self._steps):
            found[step + 1] = state = self._solve(state)
        total = np.cumsum(found, axis=0)
        lasts = round(self.pulse / self.dt)
        total[lasts:] -= total[:-lasts].copy()
        kept = np.ascontiguousarray(total.T, np.float32)
        kept.setflags(write=False)
        return kept

    def reading(self, cells: NDArray[np.int64], times: NDArray[np.float64], pulses: int) -> PulseReading:
        """Where in responses it is told what the first pulses (k,) give at cells (m,) at times (m,) in s."""
        since = (times[:, None] - self.pulse * np.arange(pulses)) / self.dt
        since = np.clip(since, 0.0, self._steps)  # nothing before a pulse begins
        step = np.minimum((since + 1e-9).astype(np.int64), self._steps)
        part = np.maximum(since - step, 0.0)
        part[part < 1e-9] = 0.0
        return PulseReading(cells[:, None] * (self._steps + 1) + step, part if part.any() else None)


@dataclass(frozen=True, slots=True, eq=False)
class PulseReading:
    """Places in responses, the same for all sources; between two steps they change linearly."""

    first: NDArray[np.int64]  # (m, k)
    part: NDArray[np.float64] | None  # (m, k): of the way to the next one; None: nowhere any

    def of(self, response: NDArray[np.float32]) -> NDArray[np.float64]:
        """What each pulse of the source gives (m, k)."""
        flat = response.ravel()
        found = flat.take(self.first).astype(np.float64)
        if self.part is not None:
            then = flat.take(self.first + (self.part > 0.0))
            found += self.part * (then - found)
        return found


def _check(equations: Equations, dt: float, pulse: float, duration: float) -> None:
    if equations.order != 1 or equations.reaction is not None:
        raise InputError(
            "model: responses to sources add up only if the equation is linear and of first order in time; expected "
            "diffusion or advection-diffusion"
        )
    if np.any(equations.inflow):
        raise InputError("model.value: the field has to be 0 without a source; expected walls without a value, or 0")
    for name, time in (("pulse", pulse), ("duration", duration)):
        unit, of = (dt, "dt") if name == "pulse" else (pulse, "pulse")
        if round(time / unit) < 1 or abs(round(time / unit) * unit - time) > 1e-9 * time:
            raise InputError(f"{name}: {time:g} s; expected a whole number of times {of}, {unit:g} s")
