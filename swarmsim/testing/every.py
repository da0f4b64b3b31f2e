"""All checks of a scenario at once."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from swarmsim.testing.locality import check_locality, check_one_robot, check_permutation
from swarmsim.testing.runs import ITERATIONS, check_alone, check_determinism, check_silence, check_strictly


def check_contracts(
    scenario: Path | str, overrides: Sequence[str] = (), iterations: int = ITERATIONS, allow_code: bool = False
) -> None:
    """All checks of this package."""
    whole = check_strictly, check_determinism, check_alone, check_silence
    for check in (*whole, check_locality, check_one_robot, check_permutation):
        check(scenario, overrides, iterations, allow_code)
