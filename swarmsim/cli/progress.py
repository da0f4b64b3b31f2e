"""Progress bars: of a run by its task, of a study by its runs."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from swarmsim.cli.interruption import end_if_asked, told_if_interrupted

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

    from swarmsim.core.state import Knowledge, Moment
    from swarmsim.engine.build import Run
    from swarmsim.studies.engine import Job
    from swarmsim.studies.store import Store


def progress_bar(quiet: bool) -> Progress:
    """A bar of rich's with a text of ours behind it."""
    from rich.progress import BarColumn, Progress, TextColumn

    from swarmsim.cli.console import VisibleConsole

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %  {task.fields[text]}"),
    )
    return Progress(*columns, console=VisibleConsole(quiet))


KERNELS = 53  # as many are compiled by the first run of a swarm that maps


@contextmanager
def compiling(progress: Progress) -> Iterator[None]:
    """While kernels are compiled, which the first run on a machine has to wait for, a bar says so."""
    from swarmsim.kernels.compiling import makeshift, watched

    task, names = None, 0

    def told(name: str) -> None:
        nonlocal task, names
        if task is None:
            progress.console.print("the first run on a machine compiles its kernels, for about a quarter of a minute")
            if (folder := makeshift()) is not None:
                progress.console.print(
                    f"notice: compiled kernels are kept in {folder}, for neither the package's folder nor the home can "
                    "be written; NUMBA_CACHE_DIR names a lasting one",
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


class RunBar:
    """An observer that moves the progress bar, every tenth iteration and at the end.

    Its clock starts with the first iteration done, which on a new machine includes compiling.
    """

    def __init__(self, progress: Progress, task: TaskID, made: Run) -> None:
        self._progress, self._task, self._made = progress, task, made
        self._begun: float | None = None

    def sample(self, moment: Moment[Knowledge]) -> None:
        """Move the bar."""
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


def perform_all(tasks: Sequence[Job], store: Store, workers: int | None, scheduler: str | None, quiet: bool) -> None:
    """Do all tasks and keep each row as it comes, with a bar of rate, time left and failures."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    from swarmsim.cli.console import VisibleConsole
    from swarmsim.studies.engine import execute

    if not tasks:
        return
    columns = (TextColumn("running"), BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[text]}"))
    with Progress(*columns, TimeRemainingColumn(), console=VisibleConsole(quiet)) as progress:
        bar = progress.add_task("", total=len(tasks), text="")
        begun, failed = time.perf_counter(), 0
        count = 0
        kept = told_if_interrupted(
            lambda: f"{count} of {len(tasks)} runs are kept; the same command goes on from there"
        )
        with kept:
            for count, row in enumerate(execute(tasks, workers or os.cpu_count() or 1, scheduler), 1):
                end_if_asked()
                store.add(row)
                failed += row.status == "failed"
                rate = count / (time.perf_counter() - begun)
                progress.update(bar, completed=count, text=f"{rate:.1f} runs/s, {failed} failed")
