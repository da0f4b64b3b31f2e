"""What recorded runs of mapping are compared by, beyond what all tasks are."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.state import OCCUPIED, UNKNOWN
from swarmsim.operations.mapping.measures.quality import Quality, quality
from swarmsim.operations.mapping.replay import MapReplay
from swarmsim.recording.reader import Recording


def course(run: Recording) -> NDArray[np.float64]:
    """How much of the task was done after each iteration (t,), 0 to 1; of mapping all that there is counts."""
    return run["coverage"] if "changes" in run and run.curve.name == "coverage" else run.progress


def quality_of(run: Recording) -> Quality:
    """How the collective map compares with the truth at the end; nothing is defined where nobody maps."""
    if "changes" not in run:
        return Quality(None, None, None, None, 0)
    maps = MapReplay(run)
    maps.advance(run.iterations - 1)
    union, domain = maps.collective(), run["domain"]
    return quality(union == OCCUPIED, run["truth"], domain & (union != UNKNOWN))
