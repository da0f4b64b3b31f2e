"""Runs: simulate and record, step, read back, compare."""

from __future__ import annotations

import json
import shutil
import tempfile
import weakref
from collections.abc import Iterator, Sequence
from contextlib import suppress
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from swarmsim.api.overrides import Overrides, fault_of, told_apart
from swarmsim.api.recorded import Run
from swarmsim.core.errors import InputError, StorageError, is_of_the_machine
from swarmsim.core.parts import Observer
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.file import Scenario, load
from swarmsim.core.scenario.files import write_whole
from swarmsim.core.state import Knowledge, Moment
from swarmsim.recording.reader import Recording

if TYPE_CHECKING:
    from swarmsim.engine.build import BuiltRun
    from swarmsim.studies.comparison import Comparison


def run(
    scenario: str | Path,
    *,
    seed: int | None = None,
    overrides: Overrides | None = None,
    faults: Sequence[str] = (),
    out: str | Path | None = None,
    allow_code: bool = False,
) -> Run:
    """Simulate a scenario to its end and record it: `swarmsim run`.

    `seed` replaces the scenario's. `overrides` are values at dotted keys, {"robots.count": 20}, or texts as for --set,
    ["robots.count=20"]; setting a table replaces it entirely. `faults` are added to the scenario's, in words:
    ["crash at=50 count=2"]. Recording and summary go into the new folder `out` or, by default, into a temporary one
    that lives as long as the returned run. `allow_code` lets the scenario run its own code. Raises InputError for what
    cannot work, PartError for third-party parts that fail, StorageError for a full disk, which keeps flushed data.
    """
    with registry.own_code(allow_code):
        made = prepared(scenario, seed, overrides, faults)
        folder = Path(tempfile.mkdtemp(prefix="swarmsim-")) if out is None else new_folder(Path(out))
        try:
            done = record(made, folder)
        except BaseException:
            if out is None:
                shutil.rmtree(folder, ignore_errors=True)
            raise
    if out is None:
        weakref.finalize(done, shutil.rmtree, folder, ignore_errors=True)
    return done


def simulate(
    scenario: str | Path,
    *,
    seed: int | None = None,
    overrides: Overrides | None = None,
    faults: Sequence[str] = (),
    allow_code: bool = False,
) -> Iterator[Moment[Knowledge]]:
    """Step a scenario to its end without a recording: gives everything that happened in each iteration.

    Parameters and errors are those of `run`. The swarm is built before the first step.
    """
    with registry.own_code(allow_code):
        simulation = prepared(scenario, seed, overrides, faults).simulation

    def steps() -> Iterator[Moment[Knowledge]]:
        while not simulation.over:
            yield simulation.tick()

    return steps()


def open(path: str | Path) -> Run:  # noqa: A001
    """Read the recording at `path`, or in a run's folder. Raises InputError for anything else."""
    return Run(Recording(Path(path)), Path(path))


def compare(runs: Sequence[str | Path], *, plot: str | Path | None = None) -> Comparison:
    """Compare each recorded run with the first, such as to see what faults cost: `swarmsim compare`.

    `plot` is the path, without suffix, of a figure of their main measure: PNG and SVG. Raises InputError for fewer
    than two runs, runs of different tasks and runs without iterations.
    """
    from swarmsim.studies.comparison import compared

    return compared([Path(path) for path in runs], None if plot is None else Path(plot))


def prepared(scenario: str | Path, seed: int | None, overrides: Overrides | None, faults: Sequence[str]) -> BuiltRun:
    """A run of a scenario file, at its start. Raises InputError, which names the option at fault."""
    return built(scenario_of(Path(scenario), seed, overrides, faults), scenario, faults)


def built(asked: Scenario, scenario: str | Path, faults: Sequence[str] = ()) -> BuiltRun:
    """A run of what `scenario_of` gives, at its start. Raises InputError, which names the option at fault."""
    from swarmsim.engine.build import build  # here, so that a scenario with a mistake is told at once

    try:
        return build(asked, str(scenario))
    except InputError as problem:
        for number, text in enumerate(faults, len(asked.faults) - len(faults)):
            place = f"{scenario}: faults[{number}]."
            if str(problem).startswith(place):
                raise InputError(f"--fault {text!r}: {str(problem).removeprefix(place)}") from problem
        raise


def scenario_of(path: Path, seed: int | None, overrides: Overrides | None, faults: Sequence[str] = ()) -> Scenario:
    """A scenario file with faults in words besides its own. Raises InputError, which names the option at fault."""
    texts, changes = told_apart(overrides)
    scenario = load(path, texts, changes if seed is None else {**changes, "seed": seed})
    return msgspec.structs.replace(scenario, faults=(*scenario.faults, *map(fault_of, faults)))


def record(made: BuiltRun, folder: Path, observers: Sequence[Observer] = ()) -> Run:
    """Simulate a run to its end into a folder; an interrupted one keeps its recording so far, and its summary."""
    try:
        with made.recorder(folder / "recording.h5") as recorder:
            made.simulate([recorder, *observers])
    except BaseException:
        with suppress(InputError, StorageError):  # the run's own error is told, not those that follow
            summarise(folder)
        raise
    return summarise(folder)


def summarise(folder: Path) -> Run:
    """Write the summary of the run in a folder, even of an interrupted one."""
    done = open(folder)
    write_whole(folder / "summary.json", json.dumps(done.summary, indent=2) + "\n")
    return done


def new_folder(asked: Path | None, stem: str = "run") -> Path:
    """Make a run's folder: the given one, or the first unused runs/STEM-N. Raises InputError."""
    for number in count(1):
        folder = asked or Path("runs") / f"{stem}-{number}"
        try:
            folder.mkdir(parents=True)
        except FileExistsError as problem:
            if asked is not None:
                raise InputError(
                    f"--out {folder}: exists already; expected a new folder, no run is overwritten"
                ) from problem
        except OSError as problem:
            if is_of_the_machine(problem):
                raise
            raise InputError(
                f"--out {folder}: cannot be made ({problem.strerror}); expected a place that can be written"
            ) from problem
        else:
            break
    return folder
