"""Progress bars: for a run by its task, for a study by its runs."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from swarmsim.cli.interruption import end_if_asked, told_if_interrupted

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

    from swarmsim.core.state import Knowledge, Moment
    from swarmsim.engine.build import BuiltRun
    from swarmsim.studies.engine import Job
    from swarmsim.studies.store import Store


def progress_bar(quiet: bool) -> Progress:
    """A bar of rich's followed by our text."""
    from rich.progress import BarColumn, Progress, TextColumn

    from swarmsim.cli.console import VisibleConsole

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %  {task.fields[text]}"),
    )
    return Progress(*columns, console=VisibleConsole(quiet))


KERNELS = 53  # compiled by the first run of a mapping swarm


@contextmanager
def compiling(progress: Progress) -> Iterator[None]:
    """Show a bar while the first run on a machine compiles its kernels."""
    from swarmsim.kernels.compiling import is_new, makeshift, watched

    task, names, new = None, 0, is_new()

    def told(name: str) -> None:
        nonlocal task, names
        if task is None:
            if new:
                progress.console.print("the first run on a machine compiles its kernels, which takes about 15 s")
            if (folder := makeshift()) is not None:
                progress.console.print(
                    f"notice: compiled kernels are kept in {folder}: neither the package's folder nor the home can "
                    "be written; set NUMBA_CACHE_DIR to a permanent folder",
                    markup=False,
                    highlight=False,
                )
            task = progress.add_task("compiling", total=KERNELS, text="")
        names += 1
        progress.update(task, completed=min(names, KERNELS), text=name)

    with watched(told):
        yield
    if task is not None:
        progress.remove_task(task)


class Counted:
    """Moves a bar by the work done out of the total, and begins a new bar when the count restarts."""

    def __init__(self, progress: Progress, doing: str, words: str = "") -> None:
        """`words` follow the bar, with {} for the work done and another {} for the total."""
        self._progress, self._doing, self._words = progress, doing, words
        self._task: TaskID | None = None
        #: The work done.
        self.done = 0

    def __call__(self, done: int, of: int) -> None:
        """Move the bar."""
        if self._task is None or done < self.done:
            self._task = self._progress.add_task(self._doing, total=of, text="")
        self.done = done
        self._progress.update(self._task, completed=min(done, of), total=of, text=self._words.format(done, of))


class RunBar:
    """An observer that moves the progress bar, every tenth iteration and at the end.

    Its clock starts after the first iteration, which on a new machine includes compiling.
    """

    def __init__(self, progress: Progress, task: TaskID, made: BuiltRun) -> None:
        self._progress, self._task, self._made = progress, task, made
        self._begun: float | None = None

    def sample(self, moment: Moment[Knowledge]) -> None:
        end_if_asked()
        self._begun = self._begun or time.perf_counter()
        done = moment.state.iteration + 1
        if done % 10 and not self._made.simulation.over:
            return
        seconds = max(time.perf_counter() - self._begun, 1e-9)
        faster = moment.state.iteration * self._made.scenario.period / seconds
        alive = f"{moment.state.alive.sum()}/{moment.state.robots} alive"
        curve, measured = self._made.simulation.parts.task.curve, moment.measured
        name, _, unit = curve.label.partition(", ")
        value = f"{name} {curve.scale * measured.values[curve.name]:{curve.format}} {unit}".rstrip()
        text = f"iteration {done}, {value}, {alive}, {faster:.0f} x real time"
        self._progress.update(self._task, completed=measured.progress, text=text)


class StudyBar:
    """A bar with rate, time left and failures for each batch of runs; the counter of runs calls it."""

    def __init__(self, quiet: bool) -> None:
        self._quiet = quiet
        self._progress: Progress | None = None
        self._begun = 0.0
        self._done = self._of = 0
        #: Runs done in all batches.
        self.jobs = 0

    def __call__(self, done: int, of: int, failed: int) -> None:
        """Move the bar; a new one begins when no run is done."""
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        from swarmsim.cli.console import VisibleConsole

        self._done, self._of = done, of
        if self._progress is None:
            columns = (TextColumn("running"), BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[text]}"))
            self._progress = Progress(*columns, TimeRemainingColumn(), console=VisibleConsole(self._quiet))
            self._progress.start()
            self._progress.add_task("", total=of, text="")
            self._begun = time.perf_counter()
        end_if_asked()
        if done:
            self.jobs += 1
            rate = done / (time.perf_counter() - self._begun)
            self._progress.update(
                self._progress.task_ids[0], completed=done, text=f"{rate:.1f} runs/s, {failed} failed"
            )
        if done == of:
            self.stop()

    def stop(self) -> None:
        """End the current batch's bar."""
        if self._progress is not None:
            self._progress.stop()
        self._progress = None

    def kept(self) -> str:
        """What is kept after an interruption."""
        return f"{self._done} of {self._of} runs are kept; the same command goes on from there"


@contextmanager
def study_bar(quiet: bool) -> Iterator[StudyBar]:
    """A bar for each batch of a study's runs; on interruption, print how many are kept."""
    bar = StudyBar(quiet)
    try:
        with told_if_interrupted(bar.kept):
            yield bar
    finally:
        bar.stop()


def perform_all(tasks: Sequence[Job], store: Store, workers: int | None, scheduler: str | None, quiet: bool) -> None:
    """Do all tasks with a bar, and store each row as it comes."""
    from swarmsim.api.studies import run_jobs

    with study_bar(quiet) as bar:
        run_jobs(tasks, store, workers, scheduler, bar)
