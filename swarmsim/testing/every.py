"""All checks of a scenario, at once or as one test per check and part."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Final

from swarmsim.core.errors import InputError
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.file import Scenario, all_parts, load
from swarmsim.core.seams import PLACED
from swarmsim.testing.broken import BrokenError
from swarmsim.testing.locality import check_locality, check_one_robot, check_permutation
from swarmsim.testing.runs import ITERATIONS, check_alone, check_determinism, check_silence, check_strictly

if TYPE_CHECKING:
    import pytest

Check = Callable[[Path | str, Sequence[str], int, bool], None]

_RUNNING: Final = tuple(seam for seam in PLACED if seam != "generator")
_MIND: Final = ("computation", "strategy", "job")
#: Every check by name, with the seams whose parts it tells apart; empty for the whole run.
CHECKS: Final[dict[str, tuple[Check, Sequence[str]]]] = {
    "contracts": (check_strictly, _RUNNING),
    "determinism": (check_determinism, ()),
    "alone": (check_alone, tuple(seam for seam in _RUNNING if seam not in ("topology", "fault"))),
    "silence": (check_silence, tuple(seam for seam in _RUNNING if seam != "topology")),
    "locality": (check_locality, _MIND),
    "one-robot": (check_one_robot, _MIND),
    "permutation": (check_permutation, _MIND),
}


def check_contracts(
    scenario: Path | str, overrides: Sequence[str] = (), iterations: int = ITERATIONS, allow_code: bool = False
) -> None:
    """Run all checks of this package, up to the first that fails."""
    for check, _ in CHECKS.values():
        check(scenario, overrides, iterations, allow_code)


def parametrize_with_checks(
    scenario: Path | str, overrides: Sequence[str] = (), iterations: int = ITERATIONS, allow_code: bool = False
) -> pytest.MarkDecorator:
    """Make one pytest test for every check and every part of a scenario.

    The decorated test takes a `check` and calls it. Tests are named by check and part, as in
    `test_mine[locality-strategy.shy]`; `determinism` is of the whole run. Each check runs once, for all parts
    together. While a part breaks its contract, only the tests called `contracts` run, since no others are
    conclusive. Those called `alone` are skipped if one robot cannot do the scenario.

    Raises InputError for a scenario that cannot be read.
    """
    import pytest

    with registry.own_code(allow_code):
        parts = _parts(load(Path(scenario), overrides))
    outcomes = _Outcomes(scenario, overrides, iterations, allow_code)
    tests = []
    for check, (_, told_apart) in CHECKS.items():
        seams = [seam for seam in told_apart if seam in parts]
        tests += [
            pytest.param(_Test(outcomes, check, seam, seams), id=f"{check}-{seam}.{parts[seam]}") for seam in seams
        ]
        if not told_apart:
            tests.append(pytest.param(_Test(outcomes, check), id=check))
    return pytest.mark.parametrize("check", tests)


def _parts(scenario: Scenario) -> dict[str, str]:
    """The names of a scenario's parts, by seam; several of one seam are joined by +, in order."""
    found: dict[str, list[str]] = {}
    for part in all_parts(scenario):
        name = part.use.rpartition(":")[2]
        if name not in found.setdefault(part.seam, []):
            found[part.seam].append(name)
    return {seam: "+".join(names) for seam, names in found.items()}


@dataclass(frozen=True, slots=True, eq=False)
class _Outcomes:
    """The results of a scenario's checks, each done at first use."""

    scenario: Path | str
    overrides: Sequence[str]
    iterations: int
    allow_code: bool
    _known: dict[str, BrokenError | InputError | None] = field(default_factory=dict)

    def of(self, check: str) -> BrokenError | InputError | None:
        """Why a check failed or cannot be done; None if it passed."""
        if check not in self._known:
            try:
                CHECKS[check][0](self.scenario, self.overrides, self.iterations, self.allow_code)
            except (BrokenError, InputError) as problem:
                self._known[check] = problem
            else:
                self._known[check] = None
        return self._known[check]


@dataclass(frozen=True, slots=True)
class _Test:
    """One check of one seam's parts, among those that it tells apart."""

    outcomes: _Outcomes
    check: str
    seam: str = ""
    seams: Sequence[str] = ()

    def __call__(self) -> None:
        import pytest

        broken = self.outcomes.of("contracts")
        if isinstance(broken, BrokenError) and self.check != "contracts":
            pytest.skip(f"first fix what breaks its contract: {broken}")
        problem = self.outcomes.of(self.check)
        if isinstance(problem, InputError):
            if self.check == "alone":
                pytest.skip(f"one robot alone cannot do this scenario: {problem}")
        elif problem is None or (problem.seam != self.seam and problem.seam in self.seams):
            return
        pytest.fail(str(problem), pytrace=False)
