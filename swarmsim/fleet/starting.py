"""Starts one robot from what a command line says: in a world's run, or in a body of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from swarmsim.core.charge import Charge
from swarmsim.core.errors import InputError
from swarmsim.core.robot import warm
from swarmsim.core.scenario import registry
from swarmsim.fleet import embodied_process, robot_process
from swarmsim.fleet.embodied_process import BodyAsked
from swarmsim.fleet.robot_process import RobotAsked


@dataclass(frozen=True, slots=True, kw_only=True)
class OneRobot:
    """What a command line asks for; it becomes a `RobotAsked` or a `BodyAsked`."""

    join: str
    id_: int | None = None
    charge: Path | None = None
    transport: str = "zenoh"
    link: Sequence[str] = ()
    log: Path | None = None
    recall: bool = False
    after_world: Literal["end", "wait"] = "end"
    adapter: str = ""
    body: Sequence[str] = ()
    guard: Sequence[str] = ()
    nearest: int = 0
    iterations: int | None = None
    allow_code: bool = False


def started(asked: OneRobot) -> int:
    """Be the robot until it has ended; the exit code. Raises InputError for options that do not go together."""
    told = None if asked.charge is None else Charge.open(asked.charge)
    if told is not None and asked.id_ not in (None, told.robot):
        raise InputError(f"--id {asked.id_}: {asked.charge} is of robot {told.robot}; expected one of both options")
    given = {name: getattr(asked, name) for name in ("transport", "join", "link", "log", "recall", "allow_code")}
    bodily = {name: getattr(asked, name) for name in ("body", "guard", "nearest", "iterations")}
    if asked.adapter:
        if told is None:
            raise InputError("--adapter: without a world nobody tells a charge; expected --charge FILE")
        return embodied_process.run(BodyAsked(charge=told, adapter=asked.adapter, **bodily, **given))
    for name in (name for name, one in bodily.items() if one):
        raise InputError(f"--{name}: is for robots with a body of their own; expected --adapter, too")
    if told is not None:
        with registry.own_code(asked.allow_code):
            warm(told)
    number = asked.id_ if told is None else told.robot
    if number is None:
        raise InputError("--id: which robot is it? Expected its number, or --charge FILE")
    return robot_process.run(RobotAsked(id=number, charge=told, after_world=asked.after_world, **given))
