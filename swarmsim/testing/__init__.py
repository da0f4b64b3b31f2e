"""What every part promises, as checks of a whole scenario, for the tests of parts: ours and other people's.

```python
from swarmsim.testing import check_contracts

def test_my_mind_keeps_its_contracts():
    check_contracts("my_scenario.toml", allow_code=True)
```

Each check raises AssertionError, which says what was broken, or InputError for a scenario that cannot be.
"""

from swarmsim.testing.every import check_contracts
from swarmsim.testing.locality import check_locality, check_one_robot, check_permutation
from swarmsim.testing.runs import ITERATIONS, check_alone, check_determinism, check_silence, check_strictly

__all__ = [
    "ITERATIONS",
    "check_alone",
    "check_contracts",
    "check_determinism",
    "check_locality",
    "check_one_robot",
    "check_permutation",
    "check_silence",
    "check_strictly",
]
