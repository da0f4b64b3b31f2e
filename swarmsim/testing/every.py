"""All checks of a scenario, at once or as one test for each check and part."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Final

from swarmsim.core.errors import InputError
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.file import Scenario, all_parts, load
from swarmsim.core.seams import SEAMS
from swarmsim.testing.broken import BrokenError
from swarmsim.testing.locality import check_locality, check_one_robot, check_permutation
from swarmsim.testing.runs import ITERATIONS, check_alone, check_determinism, check_silence, check_strictly

if TYPE_CHECKING:
    import pytest

Check = Callable[[Path | str, Sequence[str], int, bool], None]

_RUNNING: Final = tuple(seam for seam in SEAMS if seam not in ("generator", "sharing"))
_MIND: Final = ("computation", "strategy")
#: Every check by its name, with the seams whose parts it tells apart; none if it is of the whole run.
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
    """All checks of this package, one after the other, up to the first that fails."""
    for check, _ in CHECKS.values():
        check(scenario, overrides, iterations, allow_code)


def parametrize_with_checks(
    scenario: Path | str, overrides: Sequence[str] = (), iterations: int = ITERATIONS, allow_code: bool = False
) -> pytest.MarkDecorator:
    """Make one test of every check and every part of a scenario, for pytest.

    What is decorated takes a `check` and calls it. Tests are named by the check and the part, as in
    `test_mine[locality-strategy.shy]`, and `determinism`, which is of the whole run. Each check runs once, for all
    parts together. While a part breaks its contract, all but the tests called `contracts` are skipped, since nothing
    else can be told; so are those called `alone` of a scenario that one robot cannot do.

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
    """What the parts of a scenario are called, by seam; several of one seam, in their order, joined by +."""
    found: dict[str, list[str]] = {}
    for part in all_parts(scenario):
        name = part.use.rpartition(":")[2]
        if name not in found.setdefault(part.seam, []):
            found[part.seam].append(name)
    return {seam: "+".join(names) for seam, names in found.items()}


@dataclass(frozen=True, slots=True, eq=False)
class _Outcomes:
    """What came of each check of a scenario, each done once it is asked for."""

    scenario: Path | str
    overrides: Sequence[str]
    iterations: int
    allow_code: bool
    _known: dict[str, BrokenError | InputError | None] = field(default_factory=dict)

    def of(self, check: str) -> BrokenError | InputError | None:
        """Why a check has failed, or cannot be done; None if all is well."""
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
    """One check of the parts of one seam, out of those that it tells apart."""

    outcomes: _Outcomes
    check: str
    seam: str = ""
    seams: Sequence[str] = ()

    def __call__(self) -> None:
        import pytest

        broken = self.outcomes.of("contracts")
        if isinstance(broken, BrokenError) and self.check != "contracts":
            pytest.skip(f"first mend what breaks its contract: {broken}")
        problem = self.outcomes.of(self.check)
        if isinstance(problem, InputError):
            if self.check == "alone":
                pytest.skip(f"one robot alone cannot do this scenario: {problem}")
        elif problem is None or (problem.seam != self.seam and problem.seam in self.seams):
            return
        pytest.fail(str(problem), pytrace=False)
