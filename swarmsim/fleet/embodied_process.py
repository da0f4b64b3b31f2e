"""The process of a robot with a body of its own: it lives without a world, until it is told to end."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

from swarmsim.core.charge import Charge
from swarmsim.core.errors import InputError, StorageError
from swarmsim.core.robot import warm
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.decoding import convert
from swarmsim.fleet import diaries
from swarmsim.fleet.embodied import EmbodiedRobot
from swarmsim.fleet.gait import Gait
from swarmsim.fleet.guard import GuardedBody, Limits
from swarmsim.fleet.logbook import Logbook, NoLogbook
from swarmsim.fleet.opening import opened, table_of
from swarmsim.fleet.robot_process import BAD_INPUT, LOST
from swarmsim.fleet.transport import LinkError


@dataclass(frozen=True, slots=True, kw_only=True)
class BodyAsked:
    """What such a process is started for."""

    charge: Charge
    adapter: str  # what reaches its body
    body: Sequence[str] = ()  # keys of the adapter, as KEY=VALUE
    guard: Sequence[str] = ()  # keys of the limits that its guard has
    transport: str
    join: str  # the address at which robots meet
    link: Sequence[str] = ()  # keys of the transport
    nearest: int = 0  # how many of those that it hears it listens to; 0: all
    iterations: int | None = None  # None: until it is told to end
    log: Path | None = None
    recall: bool = False  # whether it begins with what its log says that it knew
    allow_code: bool = False


def run(asked: BodyAsked) -> int:
    """Be this robot; the exit code."""
    try:
        with registry.own_code(asked.allow_code), _ended_by_signals():
            _lived(asked)
    except KeyboardInterrupt:
        return 0
    except (InputError, LinkError, StorageError) as problem:
        sys.stderr.write(f"swarmsim: robot {asked.charge.robot}: {problem}\n")
        return LOST if isinstance(problem, LinkError) else BAD_INPUT
    return 0


def _lived(asked: BodyAsked) -> None:
    charge = asked.charge
    try:
        limits = convert({"period": charge.period, **table_of(asked.guard, "--guard")}, Limits)
    except InputError as problem:
        raise InputError(str(problem) if "--guard" in str(problem) else f"--guard {problem}") from problem
    warm(charge)
    recalled = diaries.recalled(asked.log, charge) if asked.recall and asked.log is not None else None
    adapter = table_of(asked.body, "--body", use=asked.adapter)
    with (
        closing(NoLogbook() if asked.log is None else Logbook(asked.log)) as log,
        closing(opened(asked.transport, asked.join, charge.robot, asked.link)) as link,
        closing(GuardedBody(adapter, charge.robot, limits, Gait.of(charge), asked.allow_code)) as body,
    ):
        robot = EmbodiedRobot(link, charge, body, asked.nearest, log)
        try:
            robot.run(recalled, asked.iterations)
        finally:
            dropped = ", ".join(f"{count} {why}" for why, count in sorted(robot.counts.items()) if count)
            sys.stderr.write(f"swarmsim: robot {charge.robot}: {robot.late} late iterations; dropped: {dropped or 0}\n")


@contextmanager
def _ended_by_signals() -> Iterator[None]:
    """Within the block, SIGTERM ends as Ctrl-C does."""

    def end(number: int, frame: object) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
