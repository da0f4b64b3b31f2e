from __future__ import annotations

import io
import pickle
import signal
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
import threadpoolctl
import typer.main
from hypothesis import HealthCheck, settings
from offspring import Offspring

from swarmsim.cli import main
from swarmsim.core.building import Building, Survey
from swarmsim.core.context import BuildContext
from swarmsim.core.lattice import Lattice
from swarmsim.core.readings import Channels, Readings, Tiles, tile_channels
from swarmsim.core.scenario.file import load
from swarmsim.core.scenario.robots import Robots
from swarmsim.core.state import Moment, Senses
from swarmsim.core.streams import Streams
from swarmsim.engine.build import BuiltRun, build
from swarmsim.view.wording import cause_of
from swarmsim.view.wording import worded as worded_as

if TYPE_CHECKING:
    from swarmsim.studies.engine import Job
    from swarmsim.studies.store import Row

ROOT = Path(__file__).parent.parent
settings.register_profile("any machine", deadline=None, suppress_health_check=[HealthCheck.too_slow])  # even a busy one
settings.load_profile("any machine")
threadpoolctl.threadpool_limits(1)  # of numpy, which comes before the package here
typer.main.get_command = cache(typer.main.get_command)  # each call would make all commands anew, in 60 ms


@pytest.fixture(scope="session")
def root() -> Path:
    return ROOT


NOTHING = np.zeros((0, 0), bool)


def building(walls=(), explorable=NOTHING, occupied=NOTHING) -> Building:
    """These walls (s, 4), with this explorable area."""
    found = Survey(np.asarray(walls, float).reshape(-1, 4), occupied, np.zeros((0, 2)), lambda: explorable)
    return Building(found, lambda boxes: found)


def setting_of(
    count=1, shape=(16, 16), seed=5, cell=0.15, period=1.0, walls=(), start=None, tile=(6, 7), **robots
) -> BuildContext:
    """The setting for parts: this many robots on a lattice of this shape, in a building of these walls alone."""
    start = np.zeros((count, 3)) if start is None else np.asarray(start, float)
    of = Robots(count=count, spawn="anywhere", **robots)
    lattice = Lattice(0.0, 0.0, cell, *shape)
    return BuildContext.of(
        of, lattice, period, Streams(seed), building(walls), start, Channels(*tile_channels(tile, False))
    )


def made(*overrides: str, scenario: str = "room") -> BuiltRun:
    path = ROOT / "scenarios" / f"{scenario}.toml"
    return build(load(path, overrides), str(path))


def moments_of(run: BuiltRun) -> list[Moment]:
    """Every moment of a whole run."""
    moments: list[Moment] = []

    class Keep:
        def sample(self, moment: Moment) -> None:
            moments.append(moment)

    run.simulation.run([Keep()])
    return moments


@pytest.fixture(scope="session")
def room(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The recording of a whole run in the small room."""
    path = tmp_path_factory.mktemp("room") / "recording.h5"
    run = made()
    with run.recorder(path) as recorder:
        assert run.simulation.run([recorder])
    return path


@contextmanager
def jobs_here() -> Iterator[None]:
    """Within the block, runs of studies are done in this process, to which they and their rows go as bytes."""
    from swarmsim.studies import engine

    def perform(tasks: Sequence[Job]) -> Iterator[Row]:
        for task in tasks:
            row = engine.run_job(pickle.loads(pickle.dumps(task)))
            yield engine.accepted(task, pickle.loads(pickle.dumps(row)))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(engine, "worker_pool", lambda workers, scheduler=None: nullcontext(perform))
        yield


@pytest.fixture(scope="module")
def no_workers() -> Iterator[None]:
    """Studies start no processes, which takes seconds; `studies/test_study.py` and others look after those."""
    with jobs_here():
        yield


@pytest.fixture(scope="session")
def offspring() -> Iterator[Offspring]:
    """Runs commands in processes of their own that start soon."""
    with Offspring() as started:
        yield started


@dataclass(frozen=True)
class Worded:
    """An event of one robot, or with robot -1 of the building or the run, in words."""

    iteration: int
    robot: int
    kind: str
    cause: str


def worded(events, scenario) -> list[Worded]:
    """Events in words, one for each robot."""
    return [
        Worded(event.iteration, robot, worded_as(event, scenario), cause_of(event, scenario))
        for event in events
        for robot in (getattr(event, "robots", ()) or (-1,))
    ]


def worded_of(moments, run: BuiltRun) -> list[Worded]:
    """The events of moments in words, one for each robot."""
    return worded([event for moment in moments for event in moment.events], run.scenario)


def readings_of(tiles: Tiles | None = None) -> Readings:
    """The readings of robots with tiles, or without sensor."""
    if tiles is None:
        return Readings()
    said = () if tiles.evidence is None else (tiles.evidence,)
    return Readings(Channels(*tile_channels(tiles.values.shape[1:], bool(said))), (tiles.values, tiles.origins, *said))


def seen_as(iteration, pose, alive, tiles) -> Senses:
    """The knowledge of robots that sense tiles."""
    return Senses(iteration, pose, np.zeros_like(pose), alive, readings_of(tiles))


def called(*words: object, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    """The command line's exit code and output, called in this process: starting another takes a second."""
    told, complained = io.StringIO(), io.StringIO()
    handlers = {one: signal.getsignal(one) for one in (signal.SIGINT, signal.SIGTERM)}
    code: int | str | None = 0
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(told), redirect_stderr(complained):
        patch.setattr("sys.argv", ["swarmsim", *map(str, words)])
        if cwd is not None:
            patch.chdir(cwd)
        try:
            main()
        except SystemExit as ended:
            code = ended.code
        finally:
            for one, handler in handlers.items():
                signal.signal(one, handler)
    return subprocess.CompletedProcess(words, int(code or 0), told.getvalue(), complained.getvalue())
