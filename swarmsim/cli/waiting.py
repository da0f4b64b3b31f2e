"""Tells people on stderr how long they may have to wait, and how far it is."""

from __future__ import annotations

import sys
import time
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from swarmsim.core.scenario.budget import Work

EVERY: Final = 10.0  # s between two lines of one piece of work


def told_how_long(quiet: bool) -> AbstractContextManager[None]:
    """While this lasts, people are told of work that takes long, if they have not asked for quiet."""
    from swarmsim.core.scenario.budget import told_to

    return told_to(None if quiet else _Waiting())


class _Waiting:
    """Prints a line before long work, and others while it goes on."""

    def __init__(self) -> None:
        self._last = 0.0

    def __call__(self, work: Work, share: float) -> None:
        from swarmsim.core.scenario.budget import lasting

        now = time.monotonic()
        if share == 0.0:
            self._last = now
            if work.seconds >= work.told:
                _say(f"notice: {work.doing}: about {lasting(work.seconds)}")
        elif share < 1.0 and now - self._last >= EVERY:
            self._last = now
            _say(f"{work.doing}: {100.0 * share:.0f} %")


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)
