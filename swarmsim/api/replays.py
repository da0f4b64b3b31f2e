"""Lets one robot live through its part of a recorded run again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from swarmsim.api.verification import verified
from swarmsim.core.errors import InputError
from swarmsim.core.parts import Parts
from swarmsim.engine.build import build
from swarmsim.fleet.diaries import LogReplay, replayed
from swarmsim.fleet.remote import RemoteMinds
from swarmsim.fleet.running import Fleet
from swarmsim.fleet.terms import Terms
from swarmsim.recording.reader import Recording
from swarmsim.testing.apart import BytesCrew, Diary


def lived_again(
    recording: Recording, name: str, robot: int, out: Path | None, progress: Callable[[int, int], None]
) -> LogReplay:
    """What `Run.replay` gives; `name` is the run's in messages."""
    diary = _diary(recording, name, robot, progress)
    with TemporaryDirectory() as folder:
        log = out or Path(folder) / f"robot-{robot}.log"
        diary.write(log)
        return replayed(log)


def _diary(recording: Recording, name: str, robot: int, progress: Callable[[int, int], None]) -> Diary:
    """What a robot sensed, heard, said and did in a recorded run. Raises InputError."""
    if not 0 <= robot < recording.scenario.robots.count:
        last = recording.scenario.robots.count - 1
        raise InputError(f"--id {robot}: {name} has robots 0 to {last}; expected one of these")
    minds: list[RemoteMinds] = []

    def watch(parts: Parts) -> Parts:
        minds.append(RemoteMinds(parts))
        return replace(parts, computation=minds[0], strategy=minds[0].strategy)

    made = build(recording.scenario, name, recording.world, watch=watch)
    diaries = BytesCrew(Fleet(made, minds[0], Terms())).diaries
    found = verified(recording, name, progress, made)
    if not found.equal:
        raise InputError(
            f"{name}: simulated again it is different ({found.difference}); expected a recording that `swarmsim "
            "verify` finds equal here"
        )
    return diaries[robot]
