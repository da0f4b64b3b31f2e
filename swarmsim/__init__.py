"""Physics-true 2D simulation of robot swarms whose network is the experiment.

```python
import swarmsim as sw

run = sw.run("room", seed=3, overrides={"robots.count": 5})
run.summary["status"], run.curve()[-1]
run.film("room.mp4")
```

Every verb of the command line is a function here. Those about recorded runs are methods of the `Run` that `run` and
`open` return, those about studies of the `StudyRun` that `study` and `open_study` return; `swarmsim world check` is
`world_check`. Everything is imported at first use.
"""

from __future__ import annotations

import os
from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from swarmsim.api.benchmark import (
        benchmark_board,
        benchmark_explore,
        benchmark_import,
        benchmark_references,
        benchmark_verify,
    )
    from swarmsim.api.doctor import doctor
    from swarmsim.api.expectations import Expectations, open_expectations, test
    from swarmsim.api.fleets import fleet_merge, fleet_status, fleet_up, robot_charge, world_serve
    from swarmsim.api.imports import world_import
    from swarmsim.api.logs import import_log
    from swarmsim.api.papers import reproduce
    from swarmsim.api.radios import radio_airtime
    from swarmsim.api.recorded import Run
    from swarmsim.api.runs import compare, open, run, simulate  # noqa: A004
    from swarmsim.api.sizes import size
    from swarmsim.api.skeletons import new
    from swarmsim.api.studies import StudyRun, open_study, study
    from swarmsim.api.worlds import world_check, world_convert, world_generate, world_preview
    from swarmsim.api.worst import study_worst
    from swarmsim.core.errors import InputError, PartError, StorageError
    from swarmsim.core.scenario.describe import parts
    from swarmsim.core.scenario.schema import schema
    from swarmsim.core.scenario.shipped import copy as examples_copy
    from swarmsim.core.scenario.shipped import example, examples
    from swarmsim.fleet.keyring import write_keys as radio_keys
    from swarmsim.learning.vector import vector_env
    from swarmsim.view.plots.style import printing

__version__ = "0.1.0"

# Robots' matrices are small: several threads wait for each other, and sums would depend on the number of cores.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
__all__ = [
    "Expectations", "InputError", "PartError", "Run", "StorageError", "StudyRun", "benchmark_board",
    "benchmark_explore", "benchmark_import", "benchmark_references", "benchmark_verify", "compare", "doctor",
    "example", "examples", "examples_copy", "fleet_merge", "fleet_status", "fleet_up", "import_log", "new",
    "open", "open_expectations", "open_study", "parts", "printing", "radio_airtime", "radio_keys", "reproduce",
    "robot_charge", "run", "schema", "simulate", "size", "study", "study_worst", "test", "vector_env", "world_check",
    "world_convert", "world_generate", "world_import", "world_preview", "world_serve",
]  # fmt: skip

_PLACES = {
    "Expectations": "api.expectations:Expectations",
    "InputError": "core.errors:InputError",
    "PartError": "core.errors:PartError",
    "Run": "api.recorded:Run",
    "StorageError": "core.errors:StorageError",
    "StudyRun": "api.studies:StudyRun",
    "benchmark_board": "api.benchmark:benchmark_board",
    "benchmark_explore": "api.benchmark:benchmark_explore",
    "benchmark_import": "api.benchmark:benchmark_import",
    "benchmark_references": "api.benchmark:benchmark_references",
    "benchmark_verify": "api.benchmark:benchmark_verify",
    "compare": "api.runs:compare",
    "doctor": "api.doctor:doctor",
    "example": "core.scenario.shipped:example",
    "examples": "core.scenario.shipped:examples",
    "examples_copy": "core.scenario.shipped:copy",
    "fleet_merge": "api.fleets:fleet_merge",
    "fleet_status": "api.fleets:fleet_status",
    "fleet_up": "api.fleets:fleet_up",
    "import_log": "api.logs:import_log",
    "new": "api.skeletons:new",
    "open": "api.runs:open",
    "open_expectations": "api.expectations:open_expectations",
    "open_study": "api.studies:open_study",
    "parts": "core.scenario.describe:parts",
    "printing": "view.plots.style:printing",
    "radio_airtime": "api.radios:radio_airtime",
    "radio_keys": "fleet.keyring:write_keys",
    "reproduce": "api.papers:reproduce",
    "robot_charge": "api.fleets:robot_charge",
    "run": "api.runs:run",
    "schema": "core.scenario.schema:schema",
    "simulate": "api.runs:simulate",
    "size": "api.sizes:size",
    "study": "api.studies:study",
    "study_worst": "api.worst:study_worst",
    "test": "api.expectations:test",
    "vector_env": "learning.vector:vector_env",
    "world_check": "api.worlds:world_check",
    "world_convert": "api.worlds:world_convert",
    "world_generate": "api.worlds:world_generate",
    "world_import": "api.imports:world_import",
    "world_preview": "api.worlds:world_preview",
    "world_serve": "api.fleets:world_serve",
}


def __getattr__(name: str) -> object:
    if name in _PLACES:
        place, _, attribute = _PLACES[name].partition(":")
        found: object = getattr(import_module(f"swarmsim.{place}"), attribute)
        return found
    raise AttributeError(f"module 'swarmsim' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
