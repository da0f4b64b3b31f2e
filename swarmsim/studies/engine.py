"""Runs by the hundred: Dask spreads them over processes or machines and returns each as it ends."""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from itertools import islice
from multiprocessing import resource_tracker
from pathlib import Path
from typing import Any

import numpy as np
from dask.distributed import Client, LocalCluster, as_completed

from swarmsim.core.code import distributions, snapshot
from swarmsim.core.errors import InputError, StorageError
from swarmsim.core.parts import Observer
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.file import Scenario
from swarmsim.core.scenario.identity import OURS, Code, differences
from swarmsim.core.state import Knowledge, Moment
from swarmsim.engine.build import build
from swarmsim.recording.digests import Digests, versions
from swarmsim.recording.measures import RunMeasures
from swarmsim.studies.store import Row
from swarmsim.studies.watching import Watch, Watcher

ANSWER = 20.0  # s within which a user's scheduler must answer
AHEAD = 4  # runs in hand per core: enough to keep all busy, few enough to lose little


@dataclass(frozen=True, slots=True)
class Job:
    """One run to be done, on any machine."""

    identity: str
    condition: str
    seed: int
    scenario: Scenario
    world: str  # the floor plan's text
    curves: bool  # keep the curve of the task's measure
    recording: Path | None  # file to record the run in
    command: str  # that repeats this run
    allow_code: bool = False  # whether the scenario may run its own code
    asks: str = ""  # a hash of the request
    code: Code = field(default_factory=Code)  # that must make it; the user's own is sent along
    watched: tuple[Watch, ...] = ()  # what else its row says of the iterations


class CurveKeeper:
    """An observer that keeps one measure of every iteration."""

    def __init__(self, name: str) -> None:
        self._name = name
        self.values: list[float] = []

    def sample(self, moment: Moment[Knowledge]) -> None:
        """Record one iteration."""
        self.values.append(moment.measured.values[self._name])


def run_job(task: Job) -> Row:
    """Simulate one run here; an error becomes a failed row, so that the others go on.

    Raises StorageError for a full disk, which is no run's result.
    """
    begun = time.perf_counter()
    try:
        with registry.own_code(task.allow_code), snapshot.given(task.code.files):
            row = _simulate(task)
    except StorageError:
        raise
    except Exception as problem:  # a study outlives any error of one run
        text = f"{type(problem).__name__}: {problem}; to repeat: {task.command}"
        row = _failed(task, text)
    return replace(row, seconds=time.perf_counter() - begun)


def _failed(task: Job, text: str) -> Row:
    found = Row(task.identity, task.condition, task.seed, "failed", None, {}, None, None, versions(), 0.0, text)
    return replace(found, asks=task.asks, code=dict(task.code.hashes))


def _check(task: Job, found: Mapping[str, str]) -> None:
    if refusal := _refusal(task, found):
        raise InputError(refusal)


def _refusal(task: Job, found: Mapping[str, str]) -> str | None:
    """Why this code's results are refused for the task, or None."""
    others = differences(task.code.hashes, found, "there")
    return f"refused: a worker has other code: {others}; restart the workers and the study" if others else None


def _simulate(task: Job) -> Row:
    _check(task, {**task.code.hashes, OURS: distributions.ours()})  # before any unexpected code runs
    made = build(task.scenario, task.condition, task.world)
    _check(task, made.code.hashes)
    simulation, digests = made.simulation, Digests()
    asked = simulation.parts.task
    summaries = [RunMeasures(task.scenario.robots, task.scenario.period, asked.curve), *asked.summaries()]
    watcher = Watcher(task.watched, task.scenario.robots.radius)
    curve = CurveKeeper(asked.curve.name)
    observers: list[Observer] = [digests, curve, watcher, *summaries]
    with ExitStack() as stack:
        if task.recording is not None:
            task.recording.parent.mkdir(parents=True, exist_ok=True)
            task.recording.unlink(missing_ok=True)  # left by a killed attempt
            observers.append(stack.enter_context(made.recorder(task.recording)))
        finished = made.simulate(observers)
    return Row(
        identity=task.identity,
        condition=task.condition,
        seed=task.seed,
        status="finished" if finished else "not finished",
        iterations=simulation.finished_after or simulation.state.iteration,
        summary={name: value for one in (*summaries, watcher) for name, value in one.summary().items()},
        curve=np.array(curve.values, np.float32) if task.curves else None,
        digest=digests.total(),
        versions=versions(),
        seconds=0.0,
        message=None,
        asks=task.asks,
        code=dict(made.code.hashes),
    )


@contextmanager
def worker_pool(workers: int, scheduler: str | None = None) -> Iterator[Callable[[Sequence[Job]], Iterator[Row]]]:
    """A reusable function that performs tasks on workers and gives each row as its run ends, in no fixed order.

    It starts a cluster of `workers` processes here unless the address of a `scheduler` is given. Raises
    InputError if that does not answer.
    """
    with ExitStack() as stack:
        client = stack.enter_context(_client(stack, workers, scheduler))
        yield lambda tasks: _performed(client, tasks)


@contextmanager
def pool_when_needed(
    workers: int | None = None, scheduler: str | None = None
) -> Iterator[Callable[[Sequence[Job]], Iterator[Row]]]:
    """The same, but it starts with the first run; by default with a process for each core."""
    with ExitStack() as stack:
        started: list[Callable[[Sequence[Job]], Iterator[Row]]] = []

        def perform(jobs: Sequence[Job]) -> Iterator[Row]:
            if not started:
                started.append(stack.enter_context(worker_pool(workers or os.cpu_count() or 1, scheduler)))
            return started[0](jobs)

        yield perform


def execute(tasks: Sequence[Job], workers: int, scheduler: str | None = None) -> Iterator[Row]:
    """Perform all tasks once, as `worker_pool` does; for none, nothing is started."""
    if tasks:
        with worker_pool(workers, scheduler) as perform_all:
            yield from perform_all(tasks)


def _performed(client: Client, tasks: Sequence[Job]) -> Iterator[Row]:
    waiting = iter(tasks)
    under_way: dict[Any, Job] = {}
    done = as_completed()

    def hand_out(count: int) -> None:
        for task in islice(waiting, count):
            future = client.submit(run_job, task, pure=False)
            under_way[future.key] = task
            done.add(future)

    hand_out(AHEAD * max(1, sum(client.ncores().values())))
    for future in done:
        task = under_way.pop(future.key)
        problem = future.exception()
        if isinstance(problem, StorageError):
            raise problem
        if problem is not None:
            yield _failed(task, f"{problem}; to repeat: {task.command}")
        else:
            yield accepted(task, future.result())
        hand_out(1)


def accepted(task: Job, row: Row) -> Row:
    """A worker's row, or a failed one if other code than the task's made it."""
    refusal = _refusal(task, getattr(row, "code", {}))  # rows of old workers lack it
    return row if refusal is None else _failed(task, refusal)


def _client(stack: ExitStack, workers: int, scheduler: str | None) -> Client:
    if scheduler is not None:
        try:
            return Client(scheduler, timeout=ANSWER)
        except (OSError, ValueError, TimeoutError) as problem:
            raise InputError(
                f"--scheduler {scheduler}: does not answer ({problem}); expected the address of a Dask scheduler, "
                f"as in tcp://host:8786"
            ) from problem
    return Client(stack.enter_context(_started(workers)))


def _started(workers: int) -> LocalCluster:
    """A cluster of started processes.

    They start in a separate thread: an interruption in the main thread waits until all have started, so that they
    can be ended in order and Dask is never stopped half way.
    """
    with ThreadPoolExecutor(1) as apart:
        starting = apart.submit(_start, workers)
        try:
            return starting.result()
        except KeyboardInterrupt:
            starting.result().close()
            raise


def _start(workers: int) -> LocalCluster:
    if sys.platform != "win32":  # Ctrl-C goes to all processes of a terminal; the parent ends these
        resource_tracker.ensure_running()  # it unblocks signals, so start it before blocking them
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    return LocalCluster(
        n_workers=workers,
        threads_per_worker=1,
        processes=True,
        dashboard_address="127.0.0.1:0",  # any free port, so that studies can run side by side
        silence_logs="CRITICAL",  # we report failures; Dask complains of connections that end with the study
    )
