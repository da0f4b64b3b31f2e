"""Measures that compare recorded runs of mapping, beyond those of all tasks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.state import OCCUPIED, UNKNOWN
from swarmsim.operations.mapping.measures.quality import Quality, quality
from swarmsim.operations.mapping.replay import MapReplay
from swarmsim.recording.reader import Recording


def course(run: Recording) -> NDArray[np.float64]:
    """The share of the task done after each iteration (t,), 0 to 1; for mapping the whole domain counts."""
    return run["coverage"] if "changes" in run and run.curve.name == "coverage" else run.progress


def quality_of(run: Recording) -> Quality:
    """How the collective map compares with the truth at the end; undefined if no robot maps."""
    if "changes" not in run:
        return Quality(None, None, None, None, 0)
    maps = MapReplay(run)
    maps.advance(run.iterations - 1)
    union, domain = maps.collective(), run["domain"]
    return quality(union == OCCUPIED, run["truth"], domain & (union != UNKNOWN))
