"""Prints estimates and progress of long work on stderr."""

from __future__ import annotations

import sys
import time
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from swarmsim.core.scenario.budget import Work

EVERY: Final = 10.0  # s between lines


def told_how_long(quiet: bool) -> AbstractContextManager[None]:
    """In this context, print notices of long work unless quiet."""
    from swarmsim.core.scenario.budget import told_to

    return told_to(None if quiet else _Waiting())


class _Waiting:
    """Prints a line before long work, and more during it."""

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
