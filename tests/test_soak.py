"""Long checks, outside of the default run: `make test-slow`."""

from __future__ import annotations

from multiprocessing import get_context

import numpy as np
import pytest
from conftest import made


def iterations(seed: int) -> int | None:
    simulation = made(f"seed={seed}", scenario="basilica").simulation
    return simulation.state.iteration if simulation.run() else None


@pytest.mark.slow
def test_seeds_1_to_100_of_the_basilica_all_finish() -> None:
    with get_context("spawn").Pool(2) as pool:
        needed = pool.map(iterations, range(1, 101), chunksize=5)
    assert None not in needed
    print(
        f"\nbasilica, seeds 1 to 100, iterations: mean {np.mean(needed):.1f}, sd {np.std(needed, ddof=1):.1f}, "
        f"min {min(needed)}, max {max(needed)}"
    )
    assert max(needed) < 5000
