"""What stands between a mind and a body: it follows ways, and a robot stands that is not told anew, or that is out.

It runs in a process of its own, so that a mind which is killed, paused or stuck cannot keep its body going.
"""

from __future__ import annotations

import contextlib
import os
import select
import struct
import subprocess
import sys
import time
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from subprocess import PIPE
from typing import IO, Annotated, Final, Generic, TypeVar, final

import msgspec
from msgspec import Meta, Struct

from swarmsim.core.errors import InputError
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.part import Part
from swarmsim.fleet.adapter import Adapter, Felt, Pose, RobotBody
from swarmsim.fleet.gait import Gait, PursuedWay, Reckoning
from swarmsim.fleet.transport import LinkError

T = TypeVar("T")
_LENGTH: Final = struct.Struct(">I")


class Limits(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What a guard allows."""

    period: Annotated[float, Meta(gt=0.0)] = 1.0  # s, in which a mind decides once
    patience: Annotated[float, Meta(gt=0.0)] = 3.0  # periods without a fresh command, after which the robot stands
    rate: Annotated[float, Meta(gt=0.0, le=1000.0)] = 20.0  # Hz, at which the guard looks
    fence: tuple[float, float, float, float] | None = None  # m: left, lower, right, upper edge; outside, robots stand
    blind: bool = False  # whether a robot with a fence may go on while its pose is unknown


class Order(Struct, frozen=True, omit_defaults=True):
    """What a mind's process tells a guard."""

    drive: tuple[float, float] | None = None  # m/s, rad/s
    way: tuple[tuple[float, float], ...] | None = None  # m: waypoints
    halt: bool | None = None  # whether to stand; False ends that


class Account(Struct, frozen=True, omit_defaults=True):
    """What a guard tells the mind's process, first that the body has answered and then what it knows."""

    felt: Felt | None = None
    pose: Pose | None = None  # as it is felt, or reckoned from velocities
    why: str = ""  # the body stands; empty: it moves as told
    problem: str = ""  # there is none, or none any more


class _Asked(Struct, frozen=True):
    """What a guard is started for."""

    adapter: dict[str, object]  # the part's table
    robot: int
    limits: Limits
    gait: Gait | None  # None: it is told velocities alone
    code: bool  # whether the part may be the user's own


@final
class BodyGuard:
    """Passes commands on to a body, and stops it where it has to. Times are given, in s, so that it needs no clock.

    `why` says why the body stands: `halted`, `no fresh command`, `outside the fence`, `pose unknown`; empty if it moves
    as it is told.
    """

    def __init__(self, body: RobotBody, limits: Limits, gait: Gait | None = None) -> None:
        self._body, self._limits, self._gait = body, limits, gait or Gait()
        self._reckoning = Reckoning(self._gait.start)
        self._wanted: tuple[float, float] | PursuedWay | None = None
        self._told = -float("inf")  # when
        self._halted = False
        self.why = "no fresh command"
        #: Its pose at the last look: felt, or reckoned from its velocities; None: unknown.
        self.pose: Pose | None = None
        body.stop()

    def follow(self, way: Sequence[tuple[float, float]], now: float) -> None:
        """Waypoints of the mind's, in m; none: to stand."""
        self._wanted, self._told = PursuedWay(way, self._gait, self._gait.speed * self._limits.period), now

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
        self.pose = self._reckoning.at(felt, now)
        self.why = self._why(felt, now)
        if self.why or self._wanted is None:
            self._body.stop()
        elif isinstance(self._wanted, tuple):
            self._body.drive(*self._wanted)
        elif self.pose is not None:
            self._body.drive(*self._wanted.velocity(self.pose))
        return felt

    def _why(self, felt: Felt, now: float) -> str:
        limits = self._limits
        if self._halted:
            return "halted"
        if self._wanted is None or now - self._told > limits.patience * limits.period:
            return "no fresh command"
        if self.pose is None and isinstance(self._wanted, PursuedWay):
            return "pose unknown"
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

    def __init__(
        self,
        adapter: Mapping[str, object],
        robot: int,
        limits: Limits,
        gait: Gait | None = None,
        allow_code: bool = False,
    ) -> None:
        """`adapter` is the part's table; a body that shall follow ways needs a `gait`.

        Raises InputError if the body does not answer.
        """
        asked = _Asked(dict(adapter), robot, limits, gait, allow_code)
        words = [sys.executable, "-m", "swarmsim.fleet.guard", msgspec.msgpack.encode(asked).hex()]
        # A session of its own keeps Ctrl-C from it; it ends, and its body stands, when its input does.
        self._process = subprocess.Popen(words, stdin=PIPE, stdout=PIPE, start_new_session=True)
        self._to = _Values(self._process.stdin, Order)
        self._from = _Values(self._process.stdout, Account)
        self._felt, self.why = Felt(), "no fresh command"
        #: Its pose when the guard looked last: felt, or reckoned from its velocities; None: unknown.
        self.pose: Pose | None = None
        first = self._from.next()
        if first is None or first.problem:
            self.close()
            raise InputError(first.problem if first else f"the guard of robot {robot} ended at once")

    @property
    def pid(self) -> int:
        """The guard's process."""
        return self._process.pid

    def sense(self) -> Felt:
        """What the body knew when the guard looked last. Raises LinkError once that has ended."""
        for told in self._from.waiting():
            if told.problem:
                raise LinkError(told.problem)
            if told.felt is not None:
                self._felt, self.pose, self.why = told.felt, told.pose, told.why
        return self._felt

    def follow(self, way: Sequence[tuple[float, float]]) -> None:
        """Go along waypoints (m), and stand at the last; none: stand."""
        self._to.put(Order(way=tuple(way)))

    def drive(self, ahead: float, turn: float) -> None:
        self._to.put(Order(drive=(ahead, turn)))

    def stop(self) -> None:
        self._to.put(Order(drive=(0.0, 0.0)))

    def halt(self) -> None:
        """The emergency stop."""
        self._to.put(Order(halt=True))

    def release(self) -> None:
        """End the emergency stop."""
        self._to.put(Order(halt=False))

    def close(self) -> None:
        self._to.close()
        self._process.wait()
        self._from.close()


@final
class _Values(Generic[T]):
    """Values of one kind through a pipe, each after its length; MessagePack, which unlike JSON has infinite ones."""

    def __init__(self, pipe: IO[bytes] | None, kind: type[T]) -> None:
        if pipe is None:
            raise ValueError("no pipe")
        self._pipe, self._partly, self._whole, self.ended = pipe, b"", deque[T](), False
        self._decoder = msgspec.msgpack.Decoder(kind)
        self._rest = b""
        os.set_blocking(pipe.fileno(), False)

    def put(self, told: T) -> None:
        """Send one, unless an earlier one still waits to be read. Raises LinkError if nobody reads any more."""
        packed = msgspec.msgpack.encode(told)
        try:
            for piece in (b"", _LENGTH.pack(len(packed)) + packed):
                self._rest = self._rest or piece
                with contextlib.suppress(BlockingIOError):
                    self._rest = self._rest[os.write(self._pipe.fileno(), self._rest) :]
        except (OSError, ValueError) as problem:
            raise LinkError("the guard of a robot has ended") from problem

    def waiting(self, seconds: float = 0.0) -> Iterator[T]:
        """All that have arrived, after waiting for the first at most so long."""
        while not self.ended and select.select([self._pipe], [], [], seconds)[0]:
            seconds = 0.0
            piece = os.read(self._pipe.fileno(), 65_536)
            self.ended = not piece
            self._partly += piece
            while len(self._partly) >= (ends := _LENGTH.size + self._expected()):
                self._whole.append(self._decoder.decode(self._partly[_LENGTH.size : ends]))
                self._partly = self._partly[ends:]
        while self._whole:
            yield self._whole.popleft()

    def _expected(self) -> int:
        """How many bytes the next value has; more than any pipe holds if its length is not there yet."""
        return int(_LENGTH.unpack_from(self._partly)[0]) if len(self._partly) >= _LENGTH.size else sys.maxsize

    def next(self) -> T | None:
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
    """BodyGuard one body until the other side ends, and then let it stand."""
    asked = msgspec.msgpack.decode(bytes.fromhex(told), type=_Asked)
    mind, out = _Values(sys.stdin.buffer, Order), _Values(sys.stdout.buffer, Account)
    if asked.gait is not None:  # what has to be compiled is, before there is a body to look after
        PursuedWay([(1.0, 0.0), (2.0, 0.0)], asked.gait).velocity((0.0, 0.0, 0.0))
    try:
        with registry.own_code(asked.code):
            body = Part[Adapter]("adapter", asked.adapter).build(None).open(asked.robot)
    except InputError as problem:
        out.put(Account(problem=str(problem)))
        return
    with contextlib.closing(body), contextlib.suppress(LinkError):  # of a mind that has ended
        out.put(Account())
        try:
            _watch(BodyGuard(body, asked.limits, asked.gait), asked.limits, mind, out)
        except LinkError as problem:  # of a body, too
            out.put(Account(problem=str(problem)))


def _watch(guard: BodyGuard, limits: Limits, mind: _Values[Order], out: _Values[Account]) -> None:
    while not mind.ended:
        due = time.monotonic() + 1.0 / limits.rate
        while (left := due - time.monotonic()) > 0.0 and not mind.ended:
            for told in mind.waiting(left):
                if told.drive is not None:
                    guard.drive(*told.drive, time.monotonic())
                elif told.way is not None:
                    guard.follow(told.way, time.monotonic())
                elif told.halt:
                    guard.halt()
                else:
                    guard.release()
        felt = guard.tick(time.monotonic())
        out.put(Account(felt, guard.pose, guard.why))


if __name__ == "__main__":
    main(sys.argv[1])
