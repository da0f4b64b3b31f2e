"""Printing: text from files never steers the terminal, and unwritable output ends the command."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from typing import Final, TextIO

from swarmsim.core.errors import StorageError

#: Control characters, C0 and C1, with which text could move a cursor, hide lines or make a terminal answer.
STEERING: Final = {code: None for code in (*range(32), *range(127, 160)) if chr(code) not in "\t\n"}


def visible(text: str) -> str:
    """The text without control characters."""
    return text.translate(STEERING)


class Printed(io.TextIOBase):
    """A stream that applies `shown` to printed text, and raises StorageError if it cannot be written."""

    def __init__(self, stream: TextIO, shown: Callable[[str], str] = visible) -> None:
        self._stream, self._shown = stream, shown

    def unchanged(self) -> Printed:
        """The stream for callers that strip text themselves and steer the terminal."""
        return Printed(self._stream, str)

    def write(self, text: str) -> int:
        with _told():
            return self._stream.write(self._shown(text))

    def flush(self) -> None:
        """Print buffered text."""
        with _told():
            self._stream.flush()

    @property
    def encoding(self) -> str:  # type: ignore[override]
        """The stream's encoding."""
        return self._stream.encoding

    def isatty(self) -> bool:
        """Whether the stream is a terminal."""
        return self._stream.isatty()

    def fileno(self) -> int:
        """The stream's file number."""
        return self._stream.fileno()

    def writable(self) -> bool:
        """It is."""
        return True


@contextmanager
def _told() -> Iterator[None]:
    try:
        yield
    except BrokenPipeError:  # the reader has seen enough, which is no error
        raise
    except OSError as problem:
        raise StorageError(f"standard output: cannot be written ({problem.strerror})") from problem


@contextmanager
def printed() -> Iterator[None]:
    """Strip control characters from printed text in this context."""
    with redirect_stdout(Printed(sys.stdout)), redirect_stderr(Printed(sys.stderr)):
        yield


def drop_unwritten() -> None:
    """Drop unprinted text, so that the interpreter does not try again at exit and complain."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, stream.fileno())
            os.close(nowhere)
