"""Physics-true 2D simulation of robot swarms whose network is the experiment.

```python
import swarmsim as sw

run = sw.run("scenarios/room.toml", seed=3, overrides={"robots.count": 5})
run.summary["status"], run.curve()[-1]
run.film("room.mp4")
```

`run` simulates and records, `simulate` steps a swarm, `open` reads a recording, `study` does many runs. Everything is
imported when it is first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from swarmsim.api.runs import Run, open, run, simulate  # noqa: A004
    from swarmsim.api.studies import StudyRun, study
    from swarmsim.core.errors import InputError, PartError

__version__ = "0.1.0"
__all__ = ["InputError", "PartError", "Run", "StudyRun", "open", "run", "simulate", "study"]

_PLACES = {
    **dict.fromkeys(("Run", "open", "run", "simulate"), "swarmsim.api.runs"),
    **dict.fromkeys(("StudyRun", "study"), "swarmsim.api.studies"),
    **dict.fromkeys(("InputError", "PartError"), "swarmsim.core.errors"),
}


def __getattr__(name: str) -> object:
    if name in _PLACES:
        return getattr(import_module(_PLACES[name]), name)
    raise AttributeError(f"module 'swarmsim' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
