"""The message when a command is stopped: what was kept, and how to go on."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import typer

INTERRUPTED, TERMINATED = 130, 143  # exit codes, as shells give them for Ctrl-C and for SIGTERM


class Terminated(KeyboardInterrupt):
    """SIGTERM arrived."""


class Ending:
    """Raises the exception that ends a command, and keeps it: libraries' callbacks swallow exceptions."""

    def __init__(self) -> None:
        self.asked: type[KeyboardInterrupt] | None = None

    def __call__(self, number: int, frame: object) -> None:
        """Ctrl-C, or SIGTERM."""
        self.asked = Terminated if number == signal.SIGTERM else KeyboardInterrupt
        raise self.asked


def end_upon_signals() -> None:
    """From now on SIGTERM ends this process like Ctrl-C, unless Ctrl-C is ignored."""
    ending = Ending()
    signal.signal(signal.SIGTERM, ending)
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, ending)


def _answer() -> None:
    ending = signal.getsignal(signal.SIGTERM)
    if isinstance(ending, Ending):
        ending.asked = None


def end_if_asked() -> None:
    """Raise an earlier exception again: it was swallowed, since work goes on."""
    ending = signal.getsignal(signal.SIGTERM)
    if isinstance(ending, Ending) and ending.asked is not None:
        raise ending.asked


@contextmanager
def told_if_interrupted(kept: Callable[[], str] | None = None) -> Iterator[None]:
    """On Ctrl-C or SIGTERM, print a sentence ending with `kept` to standard error, even if quiet, and exit."""
    try:
        yield
    except KeyboardInterrupt as end:
        _answer()
        ended = isinstance(end, Terminated)
        told = "terminated" if ended else "interrupted"
        print(f"swarmsim: {told}{f'; {kept()}' if kept else ''}", file=sys.stderr)
        raise typer.Exit(TERMINATED if ended else INTERRUPTED) from None
