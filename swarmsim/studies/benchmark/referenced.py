"""The references of a set's tasks: computed once, kept beside the set, one task after the other."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final

import msgspec
from msgspec import Struct

from swarmsim.core.errors import InputError
from swarmsim.core.scenario.files import write_whole
from swarmsim.engine.build import BuiltRun, build
from swarmsim.studies.benchmark.listed import lines_of, read_lines
from swarmsim.studies.benchmark.reference import reference, replayed
from swarmsim.studies.benchmark.sets import REFERENCES, ReferenceRow, SetTask, TaskSet, plan_of

TOURS: Final = "tours.csv"


class TourLine(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A line of tours.csv: the tour behind a public task's reference."""

    task: str
    seed: int
    ways: str  # one for each robot, with ; between them


def refer(tasks: TaskSet, progress: Callable[[int, int, int], None]) -> int:
    """Find the bounds and tours of all tasks that lack them, and keep each in the set; gives how many were found.

    Tours of held-out tasks are not kept, since they would show the world. Raises InputError without OR-tools.
    """
    rows, tours = dict(tasks.references), _tours(tasks.folder)
    lacking = [(task, seed) for task in tasks.made for seed in tasks.about.seeds if (task.name, seed) not in rows]
    progress(0, len(lacking), 0)
    for done, (task, seed) in enumerate(lacking, 1):
        row, ways = _referred(tasks, task, seed)
        rows[task.name, seed] = row
        if task.world.part == "public":
            tours[task.name, seed] = TourLine(task=task.name, seed=seed, ways=";".join(ways))
            write_whole(tasks.folder / TOURS, lines_of((tours[key] for key in sorted(tours)), TourLine))
        write_whole(tasks.folder / REFERENCES, lines_of((rows[key] for key in sorted(rows)), ReferenceRow))
        progress(done, len(lacking), 0)
    return len(lacking)


def kept_tours(tasks: TaskSet) -> list[str]:
    """The tasks whose tours the set has."""
    return sorted({task for task, _ in _tours(tasks.folder)})


def unconfirmed(tasks: TaskSet, names: set[str], progress: Callable[[int, int, int], None]) -> list[str]:
    """Replay the named tasks' tours; a sentence for each number of a reference that the replay does not confirm."""
    told, chosen = [], [line for line in _tours(tasks.folder).values() if line.task in names]
    known = {task.name: task for task in tasks.made}
    for done, line in enumerate(chosen, 1):
        row = tasks.references.get((line.task, line.seed))
        if row is None or line.task not in known:
            place = tasks.folder / TOURS
            raise InputError(f"{place}: {line.task}, seed {line.seed}: no task or reference has this name and seed")
        times, covered, digest = replayed(_built(tasks, known[line.task], line.seed), tuple(line.ways.split(";")))
        found = (times.t50, times.t90, times.t99, times.t100, covered, digest)
        if found != (row.t50, row.t90, row.t99, row.t100, row.covered, row.digest):
            told.append(f"{line.task}, seed {line.seed}: the tour replayed gives {found}, the set says {row}")
        progress(done, len(chosen), 0)
    return told


def _tours(folder: Path) -> dict[tuple[str, int], TourLine]:
    path = folder / TOURS
    return {(line.task, line.seed): line for line in read_lines(path, TourLine)} if path.is_file() else {}


def _built(tasks: TaskSet, task: SetTask, seed: int) -> BuiltRun:
    plan = plan_of(tasks, {}, tasks.folder / REFERENCES, [task])
    (condition,) = plan.conditions
    scenario = msgspec.structs.replace(condition.scenario, seed=seed)
    return build(scenario, task.name, plan.world_of(condition))


def _referred(tasks: TaskSet, task: SetTask, seed: int) -> tuple[ReferenceRow, tuple[str, ...]]:
    found = reference(_built(tasks, task, seed))
    bounds, times = found.bounds, found.replay
    row = ReferenceRow(
        task=task.name, seed=seed, cells=found.cells, bound50=bounds.t50 or 0, bound90=bounds.t90 or 0,
        bound99=bounds.t99 or 0, bound100=bounds.t100 or 0, tour=round(found.tour, 3), t50=times.t50, t90=times.t90,
        t99=times.t99, t100=times.t100, covered=found.covered, digest=found.digest,
    )  # fmt: skip
    return row, found.ways
