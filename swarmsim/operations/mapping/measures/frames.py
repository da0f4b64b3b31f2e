"""How many frames of reference robots have found, and how right these are."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.state import Moment
from swarmsim.operations.mapping.maps import Frames, Maps

EXACT: Final = 2.0  # cells: a frame that puts some place of the building farther off is not exact ...
FALSE: Final = 5.0  # ... and beyond this it is a false one


class FrameMeasures:
    """An observer that counts the frames found, and their errors; silent where all are known from the start."""

    def __init__(self, domain: NDArray[np.bool_]) -> None:
        rows, columns = (np.flatnonzero(domain.any(axis=axis)) for axis in (1, 0))
        #: The corners of the building; one of them is displaced most.
        self._corners = np.array([(row, column) for row in rows[[0, -1]] for column in columns[[0, -1]]], float)
        self._joined: int | None = None
        self._last: Frames | None = None
        self._seen = np.zeros((0, 0, 3))  # the errors of the last iteration ...
        self._off = np.zeros((0, 0))  # ... and how far they displace the worst place of the building, cells
        self._false = np.zeros((0, 0), np.bool_)  # pairs whose frame was ever a false one

    def sample(self, moment: Moment[Maps]) -> None:
        """Take note of one iteration."""
        frames = self._last = moment.knowledge.frames
        if frames is None:
            return
        alive = moment.state.alive
        if self._joined is None and frames.known[np.ix_(alive, alive)].all():
            self._joined = moment.state.iteration + 1
        if not np.array_equal(self._seen, frames.errors):
            self._seen, self._off = frames.errors.copy(), self._displaced(frames.errors)
        before = self._false if len(self._false) else np.zeros_like(frames.known)
        self._false = before | (frames.known & (self._off > FALSE))

    def summary(self) -> dict[str, float | int | None]:
        """How many frames are known, when all were, how many are not exact, undecided, withdrawn or were ever false."""
        if self._last is None:
            return {}
        known = self._last.known
        off = self._off[known & ~np.eye(len(known), dtype=np.bool_)]
        return {
            "frames_found": len(off),
            "frames_off": int(np.count_nonzero(off > EXACT)),
            "frames_error": float(np.mean(off)) if len(off) else None,
            "frames_worst": float(off.max()) if len(off) else None,
            "frames_joined": self._joined,
            "frames_undecided": int(np.count_nonzero(self._last.undecided)),
            "frames_withdrawn": int(self._last.withdrawn.sum()),
            "frames_false": int(np.count_nonzero(self._false)),
        }

    def _displaced(self, errors: NDArray[np.float64]) -> NDArray[np.float64]:
        """The displacement (n, N), in cells, of the worst place of the building by errors (n, N, 3)."""
        row, column = self._corners.T
        cos, sin = np.cos(errors[..., :1]), np.sin(errors[..., :1])
        down = row * cos + column * sin + errors[..., 1:2] - row
        right = column * cos - row * sin + errors[..., 2:] - column
        return np.asarray(np.hypot(down, right).max(axis=-1))
