"""A link whose frames arrive in a box, put there by whatever carries them."""

from __future__ import annotations

import re
import threading
from collections import Counter, deque
from collections.abc import Callable
from typing import Final, final

from swarmsim.core.errors import InputError
from swarmsim.fleet.transport import Heard, LinkError, check_length

AIR: Final = 2**20  # bytes that wait to be heard: enough for seconds of talk
CONTROL: Final = 2**26  # bytes of telegrams: a reader so far behind does not catch up
_EACH: Final = 100  # bytes that Python takes for a frame, besides its own


@final
class Mailbox:
    """Frames that have arrived and not been heard, from any thread. It never holds more than `most` bytes.

    On the air the oldest give way, since news is worth least when it is late. A channel may lose nothing, so it breaks
    off: the frames that wait can still be heard, and then `drain` raises LinkError.
    """

    def __init__(self, most: int, breaks: str = "") -> None:
        """`breaks` is the name of a channel; empty on the air."""
        self.counts = Counter[str]()
        self._most, self._breaks, self._taken = most, breaks, 0
        self._waiting = deque[Heard]()
        self._changed = threading.Condition()
        self._broken = ""

    def put(self, frame: bytes, strength: float | None = None) -> None:
        """Add a frame that has arrived."""
        with self._changed:
            if self._broken:
                self.counts["broken"] += 1
                return
            self._taken += len(frame) + _EACH
            self._waiting.append((frame, strength))
            while self._taken > self._most:
                if self._breaks:
                    self._taken -= len(self._waiting.pop()[0]) + _EACH
                    self._broken = f"{self._breaks}: {self._most} bytes wait to be heard; expected a faster reader"
                else:
                    self._taken -= len(self._waiting.popleft()[0]) + _EACH
                self.counts["full"] += 1
            self._changed.notify_all()

    def end(self, why: str) -> None:
        """Nothing more will come: once what waits is heard, `drain` raises LinkError for this reason."""
        with self._changed:
            self._broken = self._broken or why
            self._changed.notify_all()

    def drain(self) -> list[Heard]:
        """All that waits. Raises LinkError if nothing does and nothing more can come."""
        with self._changed:
            found = list(self._waiting)
            self._waiting.clear()
            self._taken = 0
        if self._broken and not found:
            raise LinkError(self._broken)
        return found

    def wait(self, seconds: float) -> bool:
        """Wait for something to hear, or for the end; whether either is there."""
        with self._changed:
            return self._changed.wait_for(lambda: bool(self._waiting or self._broken), max(seconds, 0.0))


@final
class BoxedLink:
    """A link that hears from a box and says by a function."""

    def __init__(
        self,
        kind: str,
        mtu: int,
        box: Mailbox,
        send: Callable[[bytes], None],
        airtime: Callable[[int], float],
        present: Callable[[], set[int]],
        channel: Callable[[str], BoxedLink],
        leave: Callable[[], None],
    ) -> None:
        """`kind` is the transport's name, for messages; `leave` is called once, on closing."""
        self.mtu, self.counts = mtu, box.counts
        self.airtime, self.present = airtime, present
        self._kind, self._box, self._send, self._open, self._leave = kind, box, send, channel, leave
        self._channels: list[BoxedLink] = []
        self._closed = False

    def say(self, frame: bytes) -> None:
        self._check()
        check_length(frame, self.mtu, self._kind)
        self._send(frame)

    def heard(self) -> list[Heard]:
        return [] if self._closed else self._box.drain()

    def wait(self, seconds: float) -> bool:
        return self._box.wait(seconds) and not self._closed

    def channel(self, name: str) -> BoxedLink:
        self._check()
        if not re.fullmatch(r"[\w/-]{1,200}", name):
            raise InputError(
                f"transport {self._kind}: no channel is called {name!r}; expected letters, digits, _, - and /, as in "
                "world/sense/3"
            )
        self._channels.append(self._open(name))
        return self._channels[-1]

    def close(self) -> None:
        if not self._closed:
            for one in self._channels:
                one.close()
            self._closed = True
            self._box.end("closed")
            self._leave()

    def _check(self) -> None:
        if self._closed:
            raise LinkError(f"transport {self._kind}: the link is closed")
