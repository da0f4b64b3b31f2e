"""Fleets: a scenario whose robots are processes of their own."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from swarmsim.api.overrides import Overrides
from swarmsim.api.recorded import Run
from swarmsim.api.runs import new_folder, record, scenario_of
from swarmsim.core.charge import Charge
from swarmsim.core.errors import InputError, unwritten
from swarmsim.core.parts import Observer
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.files import write_whole
from swarmsim.engine.build import build
from swarmsim.fleet import running
from swarmsim.fleet.running import Fleet


def assembled(scenario: Path, seed: int | None = None, overrides: Overrides | None = None) -> Fleet:
    """A scenario's run, whose robots are elsewhere. Raises InputError."""
    return running.assembled(scenario_of(scenario, seed, overrides), str(scenario))


def flown(
    fleet: Fleet, folder: Path, transport: str, address: str | None = None, observers: Sequence[Observer] = ()
) -> Run:
    """Run a fleet to its end into a folder, in lockstep: every iteration waits for every robot.

    `fleet.json` there names the processes. Raises InputError for what cannot work and PartError for a robot that fails.
    """
    with running.up(fleet, transport, address) as crew:
        told = {"world": os.getpid(), "robots": [crew.pids[robot] for robot in sorted(crew.pids)]}
        write_whole(folder / "fleet.json", json.dumps({"transport": transport, "processes": told}, indent=2) + "\n")
        return record(fleet.run, folder, observers)


def fleet_up(
    scenario: str | Path,
    out: str | Path,
    *,
    pace: Literal["lockstep"] = "lockstep",
    transport: str = "zenoh",
    seed: int | None = None,
    overrides: Overrides | None = None,
    allow_code: bool = False,
) -> Run:
    """Simulate a scenario whose robots are processes of their own, on this machine: `swarmsim fleet up`.

    The recording goes into the new folder `out`. `transport` carries frames: udp, zenoh, or an installed part. At the
    `pace` lockstep every iteration waits for every robot. `seed`, `overrides` and `allow_code` are those of `run`.
    Raises InputError for what cannot work and PartError for a robot that fails.
    """
    with registry.own_code(allow_code):
        return flown(assembled(Path(scenario), seed, overrides), new_folder(Path(out)), transport)


def robot_charge(
    scenario: str | Path,
    out: str | Path,
    *,
    id_: int = 0,
    seed: int | None = None,
    overrides: Overrides | None = None,
    allow_code: bool = False,
) -> Path:
    """Write all that the robot with the number `id` is told to the file `out`: `swarmsim robot charge`.

    `scenario`, `seed`, `overrides` and `allow_code` are those of `run`. Raises InputError, and StorageError for a full
    disk.
    """
    file = Path(out)
    with registry.own_code(allow_code):
        made = build(scenario_of(Path(scenario), seed, overrides), str(scenario))
        if not 0 <= id_ < made.context.swarm:
            last = made.context.swarm - 1
            raise InputError(f"--id {id_}: {scenario} has robots 0 to {last}; expected one of these")
        told = Charge.of(id_, made.scenario, made.context).packed()
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(told)
    except OSError as problem:
        raise unwritten(f"--out {file}", problem) from problem
    return file
