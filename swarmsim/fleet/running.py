"""A fleet on this machine: the world in this process, and every robot in one of its own."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Final

from swarmsim.core.charge import Charge
from swarmsim.core.errors import InputError, PartError
from swarmsim.core.messages import FrameError
from swarmsim.core.parts import Parts
from swarmsim.core.robot import warm
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.file import Scenario
from swarmsim.engine.build import BuiltRun, build
from swarmsim.fleet.addresses import LOOPBACK
from swarmsim.fleet.lockstep import WorldEnd
from swarmsim.fleet.remote import RemoteMinds
from swarmsim.fleet.robot_process import opened
from swarmsim.fleet.transport import WORLD, LinkError

_GRACE: Final = 3.0  # s that processes have to end by themselves


@dataclass(frozen=True, slots=True, eq=False)
class Fleet:
    """A run whose minds are elsewhere, at its start."""

    run: BuiltRun
    minds: RemoteMinds

    def charges(self) -> list[Charge]:
        """What each robot is told."""
        context = self.run.context
        return [Charge.of(robot, self.run.scenario, context) for robot in range(context.swarm)]


def assembled(scenario: Scenario, name: str) -> Fleet:
    """A scenario's run with its minds elsewhere; `name` is its file, for messages. Raises InputError."""
    made: list[RemoteMinds] = []

    def watch(parts: Parts) -> Parts:
        made.append(RemoteMinds(parts))
        return replace(parts, computation=made[0], strategy=made[0].strategy)

    return Fleet(build(scenario, name, watch=watch), made[0])


@contextmanager
def up(fleet: Fleet, transport: str, address: str | None = None) -> Iterator[WorldEnd]:
    """Within this context the robots are there, each in a process of its own that ends with it, or with this process.

    Without an address they meet at a free port of this machine. Raises InputError for what cannot work and PartError
    for a robot that fails.
    """
    place = address or f"{LOOPBACK}:{_free_port()}"
    charges = fleet.charges()
    warm(charges[0])  # compiles what is not in the cache once, in place of in every robot
    link = opened(transport, place, WORLD)
    processes: list[subprocess.Popen[bytes]] = []
    try:
        _check_lengths(fleet, link.mtu, transport)
        actuators = fleet.run.context.actuators
        crew = WorldEnd(link, charges, actuators, fleet.minds.frame, lambda: _lost(processes))
        processes.extend(_started(robot, transport, place) for robot in range(len(charges)))
        crew.gather()
        fleet.minds.crew = crew
        yield crew
        crew.end()
    except (LinkError, FrameError) as problem:
        now = fleet.run.simulation.state.iteration
        raise PartError(f"iteration {now}: {problem}", "robot") from problem
    finally:
        _end(processes)
        link.close()


def _check_lengths(fleet: Fleet, mtu: int, transport: str) -> None:
    """Raise InputError for messages that are known to be longer than the transport's frames."""
    size = getattr(fleet.minds.codec, "size", 0)
    if isinstance(size, int) and size > mtu:
        raise InputError(f"--transport {transport}: takes frames of {mtu} bytes; these robots say {size} at once")


def _started(robot: int, transport: str, place: str) -> subprocess.Popen[bytes]:
    words = [sys.executable, "-m", "swarmsim.fleet.robot_process", "--transport", transport, "--join", place]
    words += ["--id", str(robot), *(["--allow-code"] if registry.own_code_is_allowed() else [])]
    # A session of its own keeps Ctrl-C from it; it ends when this process and so the other end of its input does.
    return subprocess.Popen(words, stdin=subprocess.PIPE, start_new_session=True)


def _lost(processes: list[subprocess.Popen[bytes]]) -> str:
    """Who has ended, in words; empty for nobody."""
    for robot, one in enumerate(processes):
        if (code := one.poll()) is not None:
            how = f"by {signal.Signals(-code).name}" if code < 0 else f"with exit code {code}"
            return f"the process of robot {robot} has ended {how}"
    return ""


def _end(processes: list[subprocess.Popen[bytes]]) -> None:
    """Let all processes end; kill those that do not."""
    for one in processes:
        if one.stdin is not None:
            one.stdin.close()
    for one in processes:
        try:
            one.wait(_GRACE)
        except subprocess.TimeoutExpired:
            one.kill()
            one.wait()


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
