"""What stands between a mind and a body: a robot that is not told anew where to go stands, and so does one that is out.

It runs in a process of its own, so that a mind which is killed, paused or stuck cannot keep its body going.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import subprocess
import sys
import time
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from subprocess import PIPE
from typing import IO, Annotated, Any, final

import msgspec
from msgspec import Meta, Struct

from swarmsim.core.errors import InputError
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.part import Part
from swarmsim.fleet.adapter import Adapter, Body, Felt
from swarmsim.fleet.transport import LinkError


class Limits(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What a guard allows."""

    period: Annotated[float, Meta(gt=0.0)] = 1.0  # s, in which a mind decides once
    patience: Annotated[float, Meta(gt=0.0)] = 3.0  # periods without a fresh command, after which the robot stands
    rate: Annotated[float, Meta(gt=0.0, le=1000.0)] = 20.0  # Hz, at which the guard looks
    fence: tuple[float, float, float, float] | None = None  # m: left, lower, right, upper edge; outside, robots stand
    blind: bool = False  # whether a robot with a fence may go on while its pose is unknown


@final
class Guard:
    """Passes commands on to a body, and stops it where it has to. Times are given, in s, so that it needs no clock.

    `why` says why the body stands: `halted`, `no fresh command`, `outside the fence`, `pose unknown`; empty if it moves
    as it is told.
    """

    def __init__(self, body: Body, limits: Limits) -> None:
        self._body, self._limits = body, limits
        self._wanted: tuple[float, float] | None = None
        self._told = -float("inf")  # when
        self._halted = False
        self.why = "no fresh command"
        body.stop()

    def drive(self, ahead: float, turn: float, now: float) -> None:
        """A command of the mind's."""
        self._wanted, self._told = (ahead, turn), now

    def halt(self) -> None:
        """The emergency stop: the robot stands until it is released, whatever it is told."""
        self._halted = True
        self._body.stop()
        self.why = "halted"

    def release(self) -> None:
        """End the emergency stop; the robot moves with the next command, not with an old one."""
        self._halted, self._wanted = False, None

    def tick(self, now: float) -> Felt:
        """Sense, and let the body do what is wanted and allowed."""
        felt = self._body.sense()
        self.why = self._why(felt, now)
        if self.why or self._wanted is None:
            self._body.stop()
        else:
            self._body.drive(*self._wanted)
        return felt

    def _why(self, felt: Felt, now: float) -> str:
        limits = self._limits
        if self._halted:
            return "halted"
        if self._wanted is None or now - self._told > limits.patience * limits.period:
            return "no fresh command"
        if limits.fence is not None:
            if felt.pose is None:
                return "" if limits.blind else "pose unknown"
            left, lower, right, upper = limits.fence
            if not (left <= felt.pose[0] <= right and lower <= felt.pose[1] <= upper):
                return "outside the fence"
        return ""


@final
class GuardedBody:
    """A body behind a guard in a process of its own, as the mind's process has it."""

    def __init__(self, adapter: Mapping[str, Any], robot: int, limits: Limits, allow_code: bool = False) -> None:
        """`adapter` is the part's table. Raises InputError if the body does not answer."""
        told = {"adapter": adapter, "robot": robot, "limits": msgspec.to_builtins(limits), "code": allow_code}
        words = [sys.executable, "-m", "swarmsim.fleet.guard", json.dumps(told)]
        # A session of its own keeps Ctrl-C from it; it ends, and its body stands, when its input does.
        self._process = subprocess.Popen(words, stdin=PIPE, stdout=PIPE, start_new_session=True)
        self._to, self._from = _Lines(self._process.stdin), _Lines(self._process.stdout)
        self._felt, self.why = Felt(), "no fresh command"
        first = self._from.next()
        if first is None or "problem" in first:
            self.close()
            raise InputError(str(first["problem"]) if first else f"the guard of robot {robot} ended at once")

    @property
    def pid(self) -> int:
        """The guard's process."""
        return self._process.pid

    def sense(self) -> Felt:
        """What the body knew when the guard looked last. Raises LinkError once that has ended."""
        for told in self._from.waiting():
            if "problem" in told:
                raise LinkError(str(told["problem"]))
            self._felt, self.why = msgspec.convert(told["felt"], Felt), told["why"]
        return self._felt

    def drive(self, ahead: float, turn: float) -> None:
        self._to.put({"drive": [ahead, turn]})

    def stop(self) -> None:
        self._to.put({"drive": [0.0, 0.0]})

    def halt(self) -> None:
        """The emergency stop."""
        self._to.put({"halt": True})

    def release(self) -> None:
        """End the emergency stop."""
        self._to.put({"halt": False})

    def close(self) -> None:
        self._to.close()
        self._process.wait()
        self._from.close()


@final
class _Lines:
    """JSON values through a pipe, one a line."""

    def __init__(self, pipe: IO[bytes] | None) -> None:
        if pipe is None:
            raise ValueError("no pipe")
        self._pipe, self._partly, self._whole, self.ended = pipe, b"", deque[dict[str, Any]](), False
        self._rest = b""
        os.set_blocking(pipe.fileno(), False)

    def put(self, told: Mapping[str, object]) -> None:
        """Send one, unless an earlier one still waits to be read. Raises LinkError if nobody reads any more."""
        try:
            for piece in (b"", json.dumps(told).encode() + b"\n"):
                self._rest = self._rest or piece
                with contextlib.suppress(BlockingIOError):
                    self._rest = self._rest[os.write(self._pipe.fileno(), self._rest) :]
        except (OSError, ValueError) as problem:
            raise LinkError("the guard of a robot has ended") from problem

    def waiting(self, seconds: float = 0.0) -> Iterator[dict[str, Any]]:
        """All that have arrived, after waiting for the first at most so long."""
        while not self.ended and select.select([self._pipe], [], [], seconds)[0]:
            seconds = 0.0
            piece = os.read(self._pipe.fileno(), 65_536)
            self.ended = not piece
            *whole, self._partly = (self._partly + piece).split(b"\n")
            self._whole += [json.loads(line) for line in whole]
        while self._whole:
            yield self._whole.popleft()

    def next(self) -> dict[str, Any] | None:
        """The next one; None at the end."""
        while not self.ended:
            for one in self.waiting(1.0):
                return one
        return None

    def close(self) -> None:
        """Say no more."""
        with contextlib.suppress(OSError):
            self._pipe.close()


def main(told: str) -> None:
    """Guard one body until the other side ends, and then let it stand."""
    asked = json.loads(told)
    mind, out = _Lines(sys.stdin.buffer), _Lines(sys.stdout.buffer)
    limits = msgspec.convert(asked["limits"], Limits)
    try:
        with registry.own_code(asked["code"]):
            body = Part[Adapter]("adapter", asked["adapter"]).build(None).open(asked["robot"])
    except InputError as problem:
        out.put({"problem": str(problem)})
        return
    with contextlib.closing(body), contextlib.suppress(LinkError):  # of a mind that has ended
        out.put({})
        try:
            _watch(Guard(body, limits), limits, mind, out)
        except LinkError as problem:  # of a body, too
            out.put({"problem": str(problem)})


def _watch(guard: Guard, limits: Limits, mind: _Lines, out: _Lines) -> None:
    while not mind.ended:
        due = time.monotonic() + 1.0 / limits.rate
        while (left := due - time.monotonic()) > 0.0 and not mind.ended:
            for told in mind.waiting(left):
                if "drive" in told:
                    ahead, turn = told["drive"]
                    guard.drive(ahead, turn, time.monotonic())
                elif told.get("halt"):
                    guard.halt()
                else:
                    guard.release()
        felt = guard.tick(time.monotonic())
        out.put({"felt": asdict(felt), "why": guard.why})


if __name__ == "__main__":
    main(sys.argv[1])
