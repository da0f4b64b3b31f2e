"""Thymio II, by Aseba's protocol over USB, its wireless dongle, or TCP. Tried against a stand-in, not on a robot."""

from __future__ import annotations

import asyncio
import contextlib
import io
import socket
import threading
import time
from typing import TYPE_CHECKING, Annotated, Final, final

from msgspec import Meta, Struct

from swarmsim.core.errors import InputError
from swarmsim.fleet.adapter import Felt
from swarmsim.fleet.addresses import Address
from swarmsim.fleet.transport import LinkError

if TYPE_CHECKING:
    from thymiodirect.connection import Connection
    from typing_extensions import Buffer

_LOOK: Final = 0.05  # s between two readings
_SILENCE: Final = 2.0  # s without a reading, after which the robot counts as gone
_FASTEST: Final = 500  # the largest target of a motor
_SENSES: Final = ("prox.horizontal", "prox.ground.delta")
_SPEEDS: Final = ("motor.left.speed", "motor.right.speed")
_TARGETS: Final = ("motor.left.target", "motor.right.target")


class ThymioAdapter(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Thymio II by the library thymiodirect: motors, and the proximity sensors as they are, 0 to about 4500.

    `scale` and `base` turn velocities into motor targets. They are nominal, for 500 is about 20 cm/s, and differ from
    robot to robot: measure yours. Not tried on hardware.
    """

    port: str = ""  # serial port, such as /dev/ttyACM0, or HOST:PORT; by default the first serial port
    node: Annotated[int, Meta(ge=0, le=65_535)] | None = None  # number in a network of several; None: the first seen
    scale: Annotated[float, Meta(gt=0.0, le=1.0)] = 0.0004  # m/s of a wheel at a motor target of 1
    base: Annotated[float, Meta(gt=0.0, le=1.0)] = 0.095  # m between the wheels
    patience: Annotated[float, Meta(gt=0.0, le=60.0)] = 5.0  # s, in which the robot has to answer

    def open(self, robot: int) -> ThymioBody:
        """Reach it. Raises InputError if nothing answers."""
        try:
            from thymiodirect.connection import Connection
        except ImportError as problem:
            raise InputError(
                "adapter thymio: needs thymiodirect; install it with: pip install thymiodirect"
            ) from problem
        return ThymioBody(self, Connection(self._line(), refreshing_rate=_LOOK), robot)

    def _line(self) -> io.RawIOBase:
        try:
            if ":" in self.port:
                place = Address.of(self.port, "adapter thymio")
                return TcpLine(socket.create_connection((place.host, place.port), self.patience))
            return self._serial()
        except OSError as problem:
            where = self.port or "any serial port"
            raise InputError(f"adapter thymio: nothing answers at {where} ({problem}); expected a Thymio") from problem

    def _serial(self) -> io.RawIOBase:
        import serial
        from thymiodirect.connection import Connection

        port: io.RawIOBase = serial.Serial(self.port or Connection.serial_default_port(), timeout=1)
        return port


@final
class TcpLine(io.RawIOBase):
    """A TCP connection read as serial ports are: as many bytes as asked for, or none for a while."""

    def __init__(self, connection: socket.socket) -> None:
        super().__init__()
        self._connection, self._arrived, self.ended = connection, b"", False
        connection.settimeout(0.2)

    def read(self, size: int = -1) -> bytes:
        """So many bytes, or none if they take longer than is usual within a message."""
        ends = time.monotonic() + 1.0
        while len(self._arrived) < size and not self.ended and time.monotonic() < ends:
            with contextlib.suppress(TimeoutError):
                try:
                    piece = self._connection.recv(4096)
                except TimeoutError:
                    continue
                except OSError:
                    piece = b""
                self._arrived, self.ended = self._arrived + piece, not piece
        if len(self._arrived) < size:
            time.sleep(0.05 * self.ended)  # the library asks again at once
            return b""
        found, self._arrived = self._arrived[:size], self._arrived[size:]
        return found

    def write(self, told: Buffer) -> int:
        self._connection.sendall(told)
        return memoryview(told).nbytes

    def close(self) -> None:
        self._connection.close()
        super().close()


@final
class ThymioBody:
    """A Thymio that has answered."""

    def __init__(self, keys: ThymioAdapter, connection: Connection, robot: int) -> None:
        self._keys, self._connection = keys, connection
        self._seen = time.monotonic()
        connection.on_variables_received = self._received
        connection.on_comm_error = lambda problem: None  # which `send` raises, too
        self._loop = threading.Thread(target=self._run, daemon=True, name=f"thymio {robot}")
        self._loop.start()
        try:
            self._node = self._found()
            self.stop()
        except BaseException:
            self._end()
            raise

    def sense(self) -> Felt:
        if time.monotonic() - self._seen > _SILENCE:
            raise LinkError(f"adapter thymio: nothing heard of the robot for {_SILENCE:g} s")
        left, right = (self._keys.scale * self._values(name)[0] for name in _SPEEDS)
        velocity = (0.5 * (left + right), (right - left) / self._keys.base)
        return Felt(velocity=velocity, values={name: self._values(name) for name in _SENSES})

    def drive(self, ahead: float, turn: float) -> None:
        """Faster than its motors can, both slow down alike, so that it keeps to its bend."""
        half = 0.5 * self._keys.base * turn
        wheels = [(ahead - half) / self._keys.scale, (ahead + half) / self._keys.scale]
        most = max(1.0, max(map(abs, wheels)) / _FASTEST)
        self._target([round(one / most) for one in wheels])

    def stop(self) -> None:
        self._target([0, 0])

    def close(self) -> None:
        with contextlib.suppress(LinkError):
            self.stop()
        self._end()

    def _target(self, wheels: list[int]) -> None:
        try:
            for name, speed in zip(_TARGETS, wheels, strict=True):
                self._connection.set_var(self._node, name, speed & 0xFFFF)
        except (OSError, KeyError) as problem:
            raise LinkError(f"adapter thymio: the robot cannot be reached ({problem})") from problem

    def _values(self, name: str) -> tuple[float, ...]:
        """A variable, with its sign."""
        try:
            words = self._connection.get_var_array(self._node, name)
        except KeyError as problem:
            raise LinkError(f"adapter thymio: the robot is gone, or has no {name}") from problem
        return tuple(float(word - 65_536 if word > 32_767 else word) for word in words)

    def _found(self) -> int:
        """The number of the robot in its network, once it has told of all its variables."""
        ends = time.monotonic() + self._keys.patience
        self._connection.handshake()
        while time.monotonic() < ends:
            known = self._connection.remote_node_set
            for node in known if self._keys.node is None else known & {self._keys.node}:
                if self._connection.remote_nodes[node].var_received:
                    return int(node)
            time.sleep(0.02)
        which = "a Thymio" if self._keys.node is None else f"node {self._keys.node}"
        raise InputError(
            f"adapter thymio: no Thymio tells of itself at {self._keys.port or 'the serial port'} within "
            f"{self._keys.patience:g} s; expected {which}"
        )

    async def _received(self, node: int) -> None:
        self._seen = time.monotonic()

    def _run(self) -> None:
        loop = self._connection.loop
        loop.create_task(self._awake())
        self._connection.run_forever()
        self._connection.input_thread.join(3.0)  # which adds tasks
        for task in asyncio.all_tasks(loop):
            task.cancel()
        loop.run_until_complete(asyncio.sleep(0.0))  # in which they end
        loop.close()

    async def _awake(self) -> None:
        """The library hands over messages from another thread, which does not wake the loop."""
        while not self._connection.terminating:
            await asyncio.sleep(0.01)

    def _end(self) -> None:
        self._connection.shutdown()
        with contextlib.suppress(RuntimeError):  # of a loop that has ended by itself
            self._connection.loop.call_soon_threadsafe(self._connection.loop.stop)
        self._loop.join(3.0)
        self._connection.close()
