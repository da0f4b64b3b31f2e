"""A run that goes on while somebody looks, and that faults can strike; what it records is a run like any other."""

from __future__ import annotations

from pathlib import Path

import msgspec

from swarmsim.core.errors import InputError
from swarmsim.core.parts import Fault
from swarmsim.core.scenario.file import Scenario
from swarmsim.core.scenario.files import Table
from swarmsim.core.scenario.part import Part
from swarmsim.engine.build import BuiltRun, build
from swarmsim.recording.reader import Recording
from swarmsim.recording.recorder import Recorder


class Session:
    """A run under way, an iteration at a time.

    A fault that strikes it is added to its scenario, and the run is done again from its seed up to that moment: the
    recording is always that of a scenario, and `swarmsim verify` repeats it.
    """

    live = True
    recording: Recording  # what has been recorded by now; another one after every strike

    def __init__(self, scenario: Scenario, name: str, folder: Path) -> None:
        """`name` is the scenario's file, for messages; `folder` is where the recording lies. Raises InputError."""
        self._given, self._name, self.folder = scenario, name, folder
        self._struck: list[tuple[int, Part[Fault]]] = []  # in the order of their iterations
        self._files = 0
        self._world: str | None = None
        self._recorder: Recorder | None = None
        self._start((), 1)

    @property
    def over(self) -> bool:
        """Whether the run has ended."""
        return self._run.simulation.over

    @property
    def scenario(self) -> Scenario:
        """The scenario with all that has struck."""
        return self._run.scenario

    def advance(self) -> None:
        """Simulate and record one more iteration; none if the run is over."""
        if not self.over and self._recorder is not None:
            self._run.simulation.tick([self._recorder])
            self._recorder.flush()
            self.recording.refresh()

    def strike(self, fault: Table, iteration: int) -> None:
        """Let a fault, a table without its `at`, strike at an iteration: one that has been done, the next or the one
        after it.

        What was recorded from then on is dropped, with later strikes: the run depends on fault and iteration alone, not
        on how far it had come. Raises InputError, and nothing has changed, for a fault that cannot be.
        """
        done = self.recording.iterations
        if self.over and iteration >= done:
            raise InputError(f"the run ended after {done} iterations; go back in time to let something strike")
        if not 1 <= iteration <= done + 1:
            raise InputError(f"iteration {iteration}: expected 1 to {done + 1}")
        kept = [one for one in self._struck if one[0] <= iteration]
        self._start((*kept, (iteration, Part("fault", {**fault, "at": iteration}).decoded())), iteration + 1)

    def undo(self) -> None:
        """Take the latest strike back; the run goes on from the iteration at which it struck."""
        if self._struck:
            self._start(tuple(self._struck[:-1]), self._struck[-1][0])

    def close(self) -> Path:
        """End the recording; gives its file, `recording.h5` in the session's folder."""
        if self._recorder is not None:
            self._recorder.close()
        self.recording.path = self.recording.path.replace(self.folder / "recording.h5")
        return self.recording.path

    def _start(self, struck: tuple[tuple[int, Part[Fault]], ...], iterations: int) -> None:
        """Do the run with these faults from the seed on, in a recording of its own."""
        faults = (*self._given.faults, *(fault for _, fault in struck))
        run: BuiltRun = build(msgspec.structs.replace(self._given, faults=faults), self._name, self._world)
        self._files += 1
        path = self.folder / f"recording-{self._files}.h5"
        recorder: Recorder = run.recorder(path)
        try:
            for _ in range(iterations):
                if not run.simulation.over:
                    run.simulation.tick([recorder])
            recorder.flush()
        except BaseException:
            recorder.close()
            path.unlink(missing_ok=True)
            raise
        if self._recorder is not None:
            self._recorder.close()
            self.recording.path.unlink(missing_ok=True)
        self._run, self._recorder, self._world = run, recorder, run.world
        self._struck = list(struck)
        self.recording = Recording(path, recorder.file)


class Replay:
    """A finished recording in the place of a session."""

    live, over = False, True

    def __init__(self, recording: Recording) -> None:
        self.recording = recording

    def advance(self) -> None:
        """Nothing: it is over."""

    def strike(self, fault: Table, iteration: int) -> None:
        """Nothing can strike what has been. Raises InputError."""
        raise InputError("this is a recording: faults strike live runs only; open its scenario with: swarmsim view")

    def undo(self) -> None:
        """Nothing has struck."""
