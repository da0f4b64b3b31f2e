"""Channels over TCP: the world's process passes telegrams on between all who have opened a channel."""

from __future__ import annotations

import contextlib
import selectors
import socket
import struct
import threading
import time
from collections import Counter, defaultdict
from collections.abc import Iterator
from typing import Final, final

from swarmsim.core.errors import InputError
from swarmsim.fleet.addresses import Address
from swarmsim.fleet.mailbox import CONTROL, Mailbox

LARGEST: Final = 2**24  # bytes of a telegram
_HEAD: Final = struct.Struct(">BBI")  # kind, bytes of the channel's name, bytes of what follows
_OPEN, _OPENED, _TELEGRAM = range(3)
_MOST_PIPES, _MOST_NAMES = 1024, 1024
_AGAIN: Final = 0.05  # s between two tries to reach the world
_AT_ONCE: Final = 64  # pieces that are read from one connection before others have their turn
_FAREWELL: Final = 0.2  # s that the other side has to read to the end


@final
class Pipe:
    """One connection: telegrams in both directions, each after a head that says its channel and length."""

    def __init__(self, connection: socket.socket, names: set[str] | None = None) -> None:
        """`names` are the channels that the other side has opened; None: all, since it passes them on itself."""
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.connection, self.names = connection, names
        self._in, self._out = bytearray(), bytearray()
        self._lock = threading.Lock()

    @property
    def waits(self) -> bool:
        """Whether bytes wait to be sent."""
        return bool(self._out)

    def send(self, kind: int, name: str, telegram: bytes = b"") -> None:
        """Send, or keep to be sent later. Raises OSError if more than CONTROL bytes wait."""
        called = name.encode()
        with self._lock:
            self._out += _HEAD.pack(kind, len(called), len(telegram)) + called + telegram
            if len(self._out) > CONTROL:
                raise OSError("takes none")
        self.flush()

    def flush(self) -> None:
        """Send what waits, as far as the other side takes it. Raises OSError if it has gone."""
        with self._lock, contextlib.suppress(BlockingIOError):
            while self._out:
                del self._out[: self.connection.send(self._out[:65_536])]

    def received(self) -> Iterator[tuple[int, str, bytes]]:
        """What has arrived whole: kind, channel and telegram. Raises OSError at the end, ValueError for other bytes."""
        with contextlib.suppress(BlockingIOError):
            for _ in range(_AT_ONCE):
                piece = self.connection.recv(65_536)
                if not piece:
                    raise OSError("has gone")
                self._in += piece
                yield from self._whole()

    def end(self) -> None:
        """Close so that what was sent arrives: bytes that nobody has read would make the system take it back."""
        with contextlib.suppress(OSError):
            self.connection.shutdown(socket.SHUT_WR)
            self.connection.settimeout(_FAREWELL)
            ends = time.monotonic() + _FAREWELL
            while self.connection.recv(65_536) and time.monotonic() < ends:
                pass
        self.connection.close()

    def _whole(self) -> Iterator[tuple[int, str, bytes]]:
        at = 0
        while len(self._in) >= at + _HEAD.size:
            kind, name, length = _HEAD.unpack_from(self._in, at)
            if kind > _TELEGRAM or length > LARGEST:
                raise ValueError("no telegram")
            begins = at + _HEAD.size + name
            if len(self._in) < begins + length:
                break
            yield kind, self._in[at + _HEAD.size : begins].decode(), bytes(self._in[begins : begins + length])
            at = begins + length
        del self._in[:at]


@final
class Switch:
    """The channels of one link: boxes here, and pipes to other processes.

    The world's listens and passes on; a robot's has one pipe, to the world. What is said reaches all who had opened the
    channel by then: `open` returns when the world knows of it.
    """

    def __init__(self, place: Address, listening: socket.socket | None, selector: selectors.BaseSelector) -> None:
        """`listening` accepts connections; None for a robot. The selector's owner calls `ready` and `flush`."""
        self._place, self._listening, self._selector = place, listening, selector
        self._boxes: defaultdict[str, list[Mailbox]] = defaultdict(list)
        self._pipes: list[Pipe] = []
        self._changed = threading.Condition(threading.RLock())
        self._opened: set[str] = set()
        self.counts = Counter[str]()
        if listening is not None:
            listening.setblocking(False)
            selector.register(listening, selectors.EVENT_READ, lambda: self._accept(listening))

    def open(self, name: str, patience: float) -> Mailbox:
        """A box for a channel. Raises InputError if the world does not answer within `patience` s."""
        ends = time.monotonic() + patience
        box = Mailbox(CONTROL, f"transport udp: channel {name}")
        found = None if self._listening is not None or self._pipes else Pipe(self._connected(ends, patience))
        with self._changed:
            if found is not None:
                self._add(found)
            self._boxes[name].append(box)
            if self._listening is None:
                self._send(self._pipes[0], _OPEN, name)
                if not self._changed.wait_for(lambda: name in self._opened, max(ends - time.monotonic(), 0.0)):
                    raise InputError(f"transport udp: {self._place} answers, but is no world of a swarm over udp")
        return box

    def leave(self, name: str, box: Mailbox) -> None:
        """A box is closed."""
        with self._changed:
            self._boxes[name].remove(box)

    def say(self, name: str, telegram: bytes, origin: Mailbox | Pipe) -> None:
        """Pass a telegram on to all but its origin."""
        with self._changed:
            for box in self._boxes.get(name, ()):
                if box is not origin:
                    box.put(telegram)
            for pipe in [one for one in self._pipes if one is not origin]:
                if pipe.names is None or name in pipe.names:
                    self._send(pipe, _TELEGRAM, name, telegram)

    def flush(self) -> None:
        """Send what waits."""
        with self._changed:
            for pipe in [one for one in self._pipes if one.waits]:
                try:
                    pipe.flush()
                except OSError:
                    self._drop(pipe)

    def close(self) -> None:
        """End all pipes, once what waits is sent as far as it can be at once."""
        self.flush()
        with self._changed:
            for pipe in list(self._pipes):
                self._drop(pipe, gently=True)
            if self._listening is not None:
                self._selector.unregister(self._listening)
                self._listening.close()

    def _connected(self, ends: float, patience: float) -> socket.socket:
        while True:
            try:
                left = max(ends - time.monotonic(), 0.01)
                return socket.create_connection((self._place.host, self._place.port), left)
            except OSError as problem:
                if time.monotonic() + _AGAIN > ends:
                    raise InputError(
                        f"transport udp: nobody answers at {self._place} within {patience:g} s; expected a world that "
                        "has been started there"
                    ) from problem
                time.sleep(_AGAIN)

    def _accept(self, listening: socket.socket) -> None:
        with self._changed, contextlib.suppress(OSError):
            connection, _ = listening.accept()
            if len(self._pipes) < _MOST_PIPES:
                self._add(Pipe(connection, set()))
            else:
                self.counts["refused"] += 1
                connection.close()

    def _add(self, pipe: Pipe) -> None:
        self._pipes.append(pipe)
        self._selector.register(pipe.connection, selectors.EVENT_READ, lambda: self._take(pipe))

    def _take(self, pipe: Pipe) -> None:
        try:
            for kind, name, telegram in pipe.received():
                self._arrived(pipe, kind, name, telegram)
        except (OSError, ValueError) as problem:
            with self._changed:
                self.counts["malformed"] += isinstance(problem, ValueError)
                self._drop(pipe)

    def _arrived(self, pipe: Pipe, kind: int, name: str, telegram: bytes) -> None:
        with self._changed:
            if kind == _OPEN and pipe.names is not None and len(pipe.names) < _MOST_NAMES:
                pipe.names.add(name)
                self._send(pipe, _OPENED, name)
            elif kind == _OPENED and pipe.names is None:
                self._opened.add(name)
                self._changed.notify_all()
            elif kind == _TELEGRAM:
                self.say(name, telegram, pipe)

    def _send(self, pipe: Pipe, kind: int, name: str, telegram: bytes = b"") -> None:
        try:
            pipe.send(kind, name, telegram)
        except OSError:
            self._drop(pipe)

    def _drop(self, pipe: Pipe, gently: bool = False) -> None:
        if pipe in self._pipes:
            self._pipes.remove(pipe)
            self._selector.unregister(pipe.connection)
            pipe.end() if gently else pipe.connection.close()
            if self._listening is None:  # a robot's only one
                for box in [one for boxes in self._boxes.values() for one in boxes]:
                    box.end(f"transport udp: {self._place} has gone")
