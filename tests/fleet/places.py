"""Where tests of links meet, and how they wait."""

from __future__ import annotations

import random
import socket
import time
from collections.abc import Callable
from contextlib import suppress

from swarmsim.core.scenario.part import Part
from swarmsim.fleet.transport import Transport


def free() -> str:
    """An address that nothing listens at, nor at the port above; below those that systems give to connections."""
    while True:
        port = random.SystemRandom().randrange(20_000, 32_000)
        with socket.socket() as one, socket.socket(type=socket.SOCK_DGRAM) as other, suppress(OSError):
            one.bind(("127.0.0.1", port))
            other.bind(("127.0.0.1", port + 1))
            return f"127.0.0.1:{port}"


def transport(use: str, **keys: object) -> Transport:
    return Part[Transport]("transport", {"use": use, **keys}).build(None)


def until(reached: Callable[[], bool], seconds: float = 5.0) -> float:
    """How long it takes until something is so."""
    begun = time.monotonic()
    while not reached():
        assert time.monotonic() < begun + seconds
        time.sleep(0.005)
    return time.monotonic() - begun


def for_a_while(verb: Callable[[], object]) -> None:
    """Do it again and again for 6 s, or until it raises."""
    ends = time.monotonic() + 6.0
    while time.monotonic() < ends:
        verb()
        time.sleep(0.02)
