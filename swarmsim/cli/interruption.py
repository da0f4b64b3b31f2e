"""What is said when somebody stops a command: what has been kept, and how to go on."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import typer

INTERRUPTED = 130  # exit code, as shells give it for Ctrl-C


@contextmanager
def told_if_interrupted(kept: Callable[[], str]) -> Iterator[None]:
    """Upon Ctrl-C print a sentence that ends with `kept`, to standard error even if all else is quiet, and exit."""
    try:
        yield
    except KeyboardInterrupt:
        print(f"swarmsim: interrupted; {kept()}", file=sys.stderr)
        raise typer.Exit(INTERRUPTED) from None
