"""All checks of a scenario at once."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from swarmsim.testing.locality import check_locality
from swarmsim.testing.runs import ITERATIONS, check_alone, check_determinism, check_silence, check_strictly


def check_contracts(
    scenario: Path | str, overrides: Sequence[str] = (), iterations: int = ITERATIONS, allow_code: bool = False
) -> None:
    """All checks of this package but that of permutation, which minds that draw by number need not pass."""
    for check in (check_strictly, check_determinism, check_alone, check_silence, check_locality):
        check(scenario, overrides, iterations, allow_code)
