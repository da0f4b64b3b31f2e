"""Compares a recording with a repetition of its run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from swarmsim.core.scenario.identity import differences
from swarmsim.engine.build import BuiltRun, build
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
    """Repeat a recorded run, up to the first difference; `name` is the run's in messages, `run` one made for this."""
    made = run or build(recording.scenario, name, recording.world)
    simulation, digests, last = made.simulation, Digests(), recording.iterations
    difference = None
    progress(0, last)
    while difference is None and simulation.state.iteration < last and not simulation.over:
        moment = simulation.tick([digests])
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
