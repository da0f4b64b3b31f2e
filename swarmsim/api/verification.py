"""Compares a recording with a repetition of its run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from swarmsim.core.scenario.identity import differences
from swarmsim.engine.build import BuiltRun, build
from swarmsim.fleet import merging, running
from swarmsim.fleet.logged import MissingError, WorldLog
from swarmsim.recording.digests import Digests, versions
from swarmsim.recording.reader import Recording


@dataclass(frozen=True, slots=True)
class Verification:
    """The result of repeating a recorded run."""

    iterations: int  # recorded
    digest: str  # of the recording
    difference: str | None  # the first iteration and field that differ; None: all are equal
    libraries: dict[str, tuple[str, str | None]]  # with other versions: the recorded and the present one
    code: str  # differences of the code, in words; empty without any

    @property
    def equal(self) -> bool:
        """Whether every field of every iteration is equal."""
        return self.difference is None


def verified(
    recording: Recording, name: str, progress: Callable[[int, int], None], run: BuiltRun | None = None
) -> Verification:
    """Repeat a recorded run, up to the first difference; `name` is the run's in messages, `run` one made for this.

    A fleet's at a free pace is repeated with what its robots have said and decided by their logs, which are checked.
    """
    logs, difference = recording.path.parent / "logs", None
    freely = None if run is not None else _freely(logs)
    if freely is None:
        made = run or build(recording.scenario, name, recording.world)
    else:
        made, difference = freely.fleet.run, next(iter(merging.checked(logs).problems), None)
    simulation, digests, last = made.simulation, Digests(), recording.iterations
    progress(0, last)
    while difference is None and simulation.state.iteration < last and not simulation.over:
        try:
            moment = simulation.tick([digests])
        except MissingError as lacking:
            difference = str(lacking)
            break
        difference = recording.difference(moment.state.iteration, digests.rows[-1], made.sampled(moment))
        progress(simulation.state.iteration, last)
    if difference is None and simulation.state.iteration < last:
        difference = f"the run is over after {simulation.state.iteration} iterations, not {last}"
    now = versions()
    return Verification(
        last,
        recording.digest(),
        difference,
        {library: (was, now.get(library)) for library, was in recording.versions.items() if now.get(library) != was},
        differences(recording.code, made.code.hashes) if recording.code else "",
    )


def _freely(logs: Path) -> merging.FromLogs | None:
    """The fleet with these logs, if it ran at a free pace."""
    if not (logs / running.WORLD_LOG).exists() or WorldLog(logs / running.WORLD_LOG).told.terms.lockstep:
        return None
    return merging.replayed(logs)
