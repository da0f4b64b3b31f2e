"""What is said when somebody stops a command: what has been kept, and how to go on."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import typer

INTERRUPTED, TERMINATED = 130, 143  # exit codes, as shells give them for Ctrl-C and for SIGTERM


class Terminated(KeyboardInterrupt):
    """SIGTERM asked for the end."""


def end_upon_sigterm() -> None:
    """From now on SIGTERM ends this process as Ctrl-C does."""

    def end(number: int, frame: object) -> None:
        raise Terminated

    signal.signal(signal.SIGTERM, end)


@contextmanager
def told_if_interrupted(kept: Callable[[], str]) -> Iterator[None]:
    """Upon Ctrl-C or SIGTERM print a sentence that ends with `kept`, to standard error even if quiet, and exit."""
    try:
        yield
    except KeyboardInterrupt as end:
        ended = isinstance(end, Terminated)
        print(f"swarmsim: {'terminated' if ended else 'interrupted'}; {kept()}", file=sys.stderr)
        raise typer.Exit(TERMINATED if ended else INTERRUPTED) from None
