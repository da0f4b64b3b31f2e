"""Live runs, which can be viewed and struck by faults; their recordings are like any others."""

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
    """A live run, one iteration at a time.

    A fault that strikes it is added to its scenario, and the run is repeated from its seed up to that moment: the
    recording always belongs to a scenario, so that `swarmsim verify` can repeat it.
    """

    live = True
    recording: Recording  # of the run so far; a new one after every strike

    def __init__(self, scenario: Scenario, name: str, folder: Path) -> None:
        """`name` is the scenario's file, for messages; `folder` is the recording's. Raises InputError."""
        self._given, self._name, self.folder = scenario, name, folder
        self._struck: list[tuple[int, Part[Fault]]] = []  # by iteration
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
        """The scenario with all faults that struck."""
        return self._run.scenario

    def advance(self) -> None:
        """Simulate and record one more iteration, unless the run is over."""
        if not self.over and self._recorder is not None:
            self._run.simulation.tick([self._recorder])
            self._recorder.flush()
            self.recording.refresh()

    def strike(self, fault: Table, iteration: int) -> None:
        """Let a fault, a table without `at`, strike at an iteration: a past one, the next, or the one after it.

        Later records and strikes are dropped: the run depends only on fault and iteration, not on how far it had
        come. Raises InputError for an invalid fault, and changes nothing then.
        """
        done = self.recording.iterations
        if self.over and iteration >= done:
            raise InputError(f"the run ended after {done} iterations; go back in time to strike")
        if not 1 <= iteration <= done + 1:
            raise InputError(f"iteration {iteration}: expected 1 to {done + 1}")
        kept = [one for one in self._struck if one[0] <= iteration]
        self._start((*kept, (iteration, Part("fault", {**fault, "at": iteration}).decoded())), iteration + 1)

    def undo(self) -> None:
        """Undo the latest strike; the run continues from its iteration."""
        if self._struck:
            self._start(tuple(self._struck[:-1]), self._struck[-1][0])

    def close(self) -> Path:
        """End the recording and return its file, `recording.h5` in the session's folder."""
        if self._recorder is not None:
            self._recorder.close()
        self.recording.path = self.recording.path.replace(self.folder / "recording.h5")
        return self.recording.path

    def _start(self, struck: tuple[tuple[int, Part[Fault]], ...], iterations: int) -> None:
        """Repeat the run with these faults from its seed, in a new recording."""
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
    """A finished recording, as a session."""

    live, over = False, True

    def __init__(self, recording: Recording) -> None:
        self.recording = recording

    def advance(self) -> None:
        """Does nothing: the run is over."""

    def strike(self, fault: Table, iteration: int) -> None:
        """Raises InputError: a recording cannot be struck."""
        raise InputError("this is a recording: faults strike live runs only; open its scenario with: swarmsim view")

    def undo(self) -> None:
        """Nothing has struck."""
