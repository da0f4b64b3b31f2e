"""A fleet on this machine: the world in this process, and every robot in one of its own."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import msgspec
from msgspec import Struct

from swarmsim.core.charge import Charge
from swarmsim.core.errors import InputError, PartError
from swarmsim.core.messages import FrameError, longest_of
from swarmsim.core.parts import Fault, Parts
from swarmsim.core.robot import warm
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.file import Scenario
from swarmsim.core.scenario.part import Part
from swarmsim.engine.build import BuiltRun, build
from swarmsim.fleet import logbook
from swarmsim.fleet.addresses import LOOPBACK
from swarmsim.fleet.free import FreeEnd
from swarmsim.fleet.lines import RobotLines
from swarmsim.fleet.lockstep import LockstepEnd
from swarmsim.fleet.logbook import Logbook, ProcessesSeen, WorldTold
from swarmsim.fleet.logged import LoggedEnd
from swarmsim.fleet.opening import opened
from swarmsim.fleet.processes import Processes
from swarmsim.fleet.real_faults import Losses, ProcessWatch, RealFaults
from swarmsim.fleet.real_links import RealLinks, nearest_of
from swarmsim.fleet.remote import RemoteMinds
from swarmsim.fleet.terms import Links, Terms
from swarmsim.fleet.transport import WORLD, LinkError, RobotLink
from swarmsim.fleet.watchdog import Watchdog
from swarmsim.recording.recorder import text_of

WORLD_LOG: Final = "world.log"


@dataclass(frozen=True, slots=True, eq=False)
class Fleet:
    """A run whose minds are elsewhere, at its start."""

    run: BuiltRun
    minds: RemoteMinds
    terms: Terms
    faults: RealFaults | None = None  # carried out on processes
    heard: RealLinks | None = None  # what arrives, in the place of topology and channel

    def charges(self) -> list[Charge]:
        """What each robot is told."""
        context = self.run.context
        return [Charge.of(robot, self.run.scenario, context) for robot in range(context.swarm)]


@dataclass(frozen=True, slots=True, eq=False)
class Up:
    """A fleet whose robots are there."""

    lines: RobotLines
    processes: Processes
    free: FreeEnd | None = None  # None: in lockstep

    def news(self, transport: str, iteration: int) -> FleetNews:
        """How it goes, in an iteration, over a transport."""
        free, pids = self.free, self.processes.pids or self.lines.pids
        pace = None if free is None else FreeNews(
            iterations=free.iterations, late=free.late, behind=free.behind, slipped=round(free.slipped, 3),
            missed=dict(sorted(free.missed.items())),
        )  # fmt: skip
        return FleetNews(
            transport=transport, iteration=iteration, world=os.getpid(), robots=dict(sorted(pids.items())), free=pace,
            dropped=dict(sorted(self.lines.counts.items())),
        )  # fmt: skip


class FreeNews(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How a fleet keeps its pace."""

    iterations: int
    late: int  # iterations at whose end a robot had not decided
    behind: int  # iterations that the world began late
    slipped: float  # s, lost by that
    missed: dict[int, int]  # by robot: how often it had not decided


class FleetNews(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, omit_defaults=True):
    """How a fleet goes, as the file `fleet.json` in the folder of its run holds it."""

    transport: str
    iteration: int
    world: int  # its process
    robots: dict[int, int]  # their processes, by number
    free: FreeNews | None = None  # None: in lockstep
    dropped: dict[str, int]  # by reason
    alive: dict[str, bool] = {}  # whether each process is there, once somebody asks

    @property
    def processes(self) -> dict[str, int]:
        """All processes, by name."""
        return {"world": self.world, **{f"robot {robot}": pid for robot, pid in self.robots.items()}}


def assembled(
    scenario: Scenario,
    name: str,
    pace: float | None = None,
    links: Links = "simulated",
    local: bool = True,
    world: str | None = None,
) -> Fleet:
    """A scenario's run with its minds elsewhere; `name` is its file, for messages.

    At a `pace`, so many times real time, nobody waits for anybody; without one all wait for all. `local` robots have
    processes on this machine, which faults can strike. The floor plan is read from the scenario's file unless its text
    is given as `world`. Raises InputError.
    """
    made: list[RemoteMinds] = []
    real, faults = list[RealLinks](), RealFaults() if pace is not None and local else None

    def watch(parts: Parts) -> Parts:
        made.append(RemoteMinds(parts))
        parts = replace(parts, computation=made[0], strategy=made[0].strategy)
        if links == "simulated":
            return parts
        real.append(RealLinks(made[0]))
        return replace(parts, topology=real[0], channel=real[0])

    if pace is None and links == "real":
        raise InputError("--links real: in lockstep the world says who hears whom; expected a pace, as in --pace 10")

    def carried(part: Part[Fault], fault: Fault) -> Fault:
        return made[0].carries(part, fault if faults is None else faults.carried(part, fault))

    run = build(scenario, name, world, watch=watch, carried=carried)
    nearest = nearest_of(scenario, made[0]) if real else 0
    period = 0.0 if pace is None else scenario.period / pace
    terms = Terms(period=period, links=links, nearest=nearest)
    return Fleet(run, made[0], terms, faults, real[0] if real else None)


@contextmanager
def up(
    fleet: Fleet, transport: str, address: str | None = None, log: Path | None = None, keys: Sequence[str] = ()
) -> Iterator[Up]:
    """Within this context the robots are there, each in a process of its own that ends with it, or with this process.

    Without an address they meet at a free port of this machine. They log into the folder `log`; `keys` are those of
    the transport. Raises InputError for what cannot work and PartError for a robot that fails.
    """
    place = address or f"{LOOPBACK}:{_free_port()}"
    words = ["--transport", transport, "--join", place, *(word for one in keys for word in ("--link", one))]
    words += ["--allow-code"] if registry.own_code_is_allowed() else []
    processes = Processes(words, log)
    charges = fleet.charges()
    warm(charges[0])  # compiles what is not in the cache once, in place of in every robot
    link = opened(transport, place, WORLD, keys)
    try:
        _check_lengths(fleet, link.mtu, transport)
        late = set() if fleet.faults is None else fleet.faults.late
        processes.start(robot for robot in range(len(charges)) if robot not in late)
        with met(fleet, link, charges, processes, log) as there:
            yield there
    finally:
        processes.end()
        link.close()


@contextmanager
def served(
    fleet: Fleet, transport: str, address: str, log: Path | None = None, keys: Sequence[str] = ()
) -> Iterator[Up]:
    """Within this context the robots have come to an address, each by `swarmsim robot run`, wherever it is.

    Raises InputError for what cannot work and PartError for a robot that fails.
    """
    link = opened(transport, address, WORLD, keys)
    try:
        _check_lengths(fleet, link.mtu, transport)
        with met(fleet, link, fleet.charges(), Processes([]), log) as there:
            yield there
    finally:
        link.close()


@contextmanager
def met(
    fleet: Fleet, link: RobotLink, charges: list[Charge], processes: Processes, log: Path | None = None
) -> Iterator[Up]:
    """Within this context the robots have joined; the world logs into the folder `log`.

    Raises InputError, and PartError for a robot that fails.
    """
    lines, book = RobotLines(link, charges, fleet.terms), None
    actuators, run = fleet.run.context.actuators, fleet.run
    if log is not None:
        book = Logbook(log / WORLD_LOG)
        told = WorldTold(run.simulation.name, text_of(run.scenario), run.world, fleet.terms, fleet.faults is not None)
        book.note(logbook.SCENARIO, msgspec.msgpack.encode(told))
        book.flush()
    try:
        if fleet.terms.lockstep:
            crew = LockstepEnd(lines, actuators, fleet.minds.frame, processes.lost)
            crew.gather()
            fleet.minds.crew = crew
            yield Up(lines, processes)
        else:
            yield _freely(fleet, lines, processes, book)
        lines.end()
    except (LinkError, FrameError) as problem:
        now = fleet.run.simulation.state.iteration
        raise PartError(f"iteration {now}: {problem}", "robot") from problem
    finally:
        if book is not None:
            book.close()


def _freely(fleet: Fleet, lines: RobotLines, processes: Processes, log: Logbook | None) -> Up:
    """A fleet at a free pace, once all who shall be there at the start are."""
    dog = Watchdog(lines.charges, fleet.minds.combined)
    crew = FreeEnd(lines, fleet.run.context.actuators, dog, processes.lost, log)
    local, faults = fleet.faults is not None, fleet.faults or RealFaults()
    _dry(fleet.run)
    crew.gather([robot for robot in range(len(lines.charges)) if robot not in faults.late])
    seen = ProcessWatch(crew, processes if local else None, log)
    started(fleet, crew, faults, seen)
    faults.processes = processes if local else None
    return Up(lines, processes, crew)


def _dry(run: BuiltRun) -> None:
    """Go through two iterations of a copy: what has to be compiled or loaded is, before time begins to run."""
    simulation = build(run.scenario, run.simulation.name, run.world).simulation
    for _ in range(2):
        if not simulation.over:
            simulation.tick()


def started(fleet: Fleet, crew: FreeEnd | LoggedEnd, faults: RealFaults, seen: Callable[[int], ProcessesSeen]) -> None:
    """Let a fleet at a free pace begin with these robots, whose processes are `seen`."""
    fleet.minds.crew, faults.seen, faults.forget = crew, seen, crew.forget
    if fleet.heard is not None:
        fleet.heard.crew = crew
    parts = fleet.run.simulation.parts
    parts.schedule.enter(Losses(parts, faults))


def _check_lengths(fleet: Fleet, mtu: int, transport: str) -> None:
    """Raise InputError for messages that may be longer than the transport's frames."""
    if (longest := longest_of(fleet.minds.codec)) > mtu:
        raise InputError(
            f"--transport {transport}: takes frames of {mtu} bytes; these robots may say {longest} at once"
        )


def _free_port() -> int:
    """A port that was free a moment ago, as was the one after it."""
    while True:
        with socket.socket() as first, socket.socket() as second:
            first.bind((LOOPBACK, 0))
            port = int(first.getsockname()[1])
            if port >= 65_534:
                continue
            try:
                second.bind((LOOPBACK, port + 1))
            except OSError:
                continue
            return port
