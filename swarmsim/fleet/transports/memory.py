"""The transport within one process: for tests, and for robots that are threads."""

from __future__ import annotations

import threading
from collections import defaultdict
from typing import Annotated, Final

from msgspec import Meta, Struct

from swarmsim.fleet.mailbox import AIR, CONTROL, BoxedLink, Mailbox

_LARGEST: Final = 2**24


class Memory(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Frames within one process: all links with the same address, any word, hear one another at once."""

    mtu: Annotated[int, Meta(ge=1, le=_LARGEST)] = 65_535  # bytes of the longest frame
    rate: Annotated[float, Meta(gt=0.0)] = 1e6  # bit/s, for the airtime that is told

    def open(self, address: str, robot: int) -> BoxedLink:
        """Join the links with this address."""
        return _medium(address).join(self, robot)


class _Medium:
    """All links with one address: their numbers, and their boxes by topic; the air is the topic without a name."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._boxes: defaultdict[str, list[Mailbox]] = defaultdict(list)
        self._there: list[int] = []

    def join(self, keys: Memory, robot: int) -> BoxedLink:
        with self._lock:
            self._there.append(robot)
        return self._link(keys, robot, "")

    def _link(self, keys: Memory, robot: int, topic: str) -> BoxedLink:
        box = Mailbox(CONTROL, f"transport memory: channel {topic}") if topic else Mailbox(AIR)
        with self._lock:
            self._boxes[topic].append(box)

        def send(frame: bytes) -> None:
            with self._lock:  # also keeps one order for all who listen
                for one in self._boxes[topic]:
                    if one is not box:
                        one.put(bytes(frame))

        def leave() -> None:
            with self._lock:
                self._boxes[topic].remove(box)
                if not topic:
                    self._there.remove(robot)

        return BoxedLink(
            "memory", _LARGEST if topic else keys.mtu, box, send, lambda length: 8.0 * length / keys.rate,
            lambda: self._others(robot), lambda name: self._link(keys, robot, name), leave,
        )  # fmt: skip

    def _others(self, robot: int) -> set[int]:
        with self._lock:
            return set(self._there) - {robot}


_LOCK: Final = threading.Lock()
_MEDIA: Final[dict[str, _Medium]] = {}


def _medium(address: str) -> _Medium:
    with _LOCK:
        return _MEDIA.setdefault(address, _Medium())
