"""Fleets: a scenario whose robots are processes of their own."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path

from swarmsim.api.overrides import Overrides
from swarmsim.api.recorded import Run
from swarmsim.api.runs import record, scenario_of
from swarmsim.core.charge import Charge
from swarmsim.core.errors import InputError
from swarmsim.core.parts import Observer
from swarmsim.core.scenario.files import write_whole
from swarmsim.engine.build import BuiltRun, build
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


def charge(scenario: Path, robot: int, seed: int | None = None, overrides: Overrides | None = None) -> Charge:
    """What one robot of a scenario is told. Raises InputError."""
    made: BuiltRun = build(scenario_of(scenario, seed, overrides), str(scenario))
    if not 0 <= robot < made.context.swarm:
        raise InputError(f"--id {robot}: {scenario} has robots 0 to {made.context.swarm - 1}; expected one of these")
    return Charge.of(robot, made.scenario, made.context)
