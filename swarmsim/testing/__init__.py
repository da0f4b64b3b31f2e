"""Checks of every part's contract in a whole scenario, for tests of our own and third-party parts.

```python
from swarmsim.testing import parametrize_with_checks

@parametrize_with_checks("my_scenario.toml", allow_code=True)
def test_my_mind(check):
    check()
```

Each check raises BrokenError, an AssertionError that says what was broken, or InputError for an invalid scenario.
"""

from swarmsim.testing.apart import check_apart
from swarmsim.testing.broken import BrokenError
from swarmsim.testing.every import check_contracts, parametrize_with_checks
from swarmsim.testing.jobs import check_job
from swarmsim.testing.locality import check_locality, check_one_robot, check_permutation
from swarmsim.testing.runs import ITERATIONS, check_alone, check_determinism, check_silence, check_strictly
from swarmsim.testing.transports import check_transport

__all__ = [
    "ITERATIONS",
    "BrokenError",
    "check_alone",
    "check_apart",
    "check_contracts",
    "check_determinism",
    "check_job",
    "check_locality",
    "check_one_robot",
    "check_permutation",
    "check_silence",
    "check_strictly",
    "check_transport",
    "parametrize_with_checks",
]
