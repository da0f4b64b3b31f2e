"""What is printed: text from files never steers the terminal, and output that cannot be written ends the command."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from typing import Final, TextIO

from swarmsim.core.errors import StorageError

#: Control characters, C0 and C1, by which text could move a cursor, hide lines or send a terminal's answers.
STEERING: Final = {code: None for code in (*range(32), *range(127, 160)) if chr(code) not in "\t\n"}


def visible(text: str) -> str:
    """A text without control characters."""
    return text.translate(STEERING)


class Printed(io.TextIOBase):
    """A stream that gets what is printed, changed by `shown`, and says in a StorageError what cannot be written."""

    def __init__(self, stream: TextIO, shown: Callable[[str], str] = visible) -> None:
        self._stream, self._shown = stream, shown

    def unchanged(self) -> Printed:
        """The same for those who have made their text visible themselves, and steer the terminal."""
        return Printed(self._stream, str)

    def write(self, text: str) -> int:
        with _told():
            return self._stream.write(self._shown(text))

    def flush(self) -> None:
        """Print what was held back."""
        with _told():
            self._stream.flush()

    @property
    def encoding(self) -> str:  # type: ignore[override]
        """That of the stream."""
        return self._stream.encoding

    def isatty(self) -> bool:
        """Whether it is a terminal."""
        return self._stream.isatty()

    def fileno(self) -> int:
        """The number of the file that is written."""
        return self._stream.fileno()

    def writable(self) -> bool:
        """It is."""
        return True


@contextmanager
def _told() -> Iterator[None]:
    try:
        yield
    except BrokenPipeError:  # the reader has seen enough, which is no fault
        raise
    except OSError as problem:
        raise StorageError(f"standard output: cannot be written ({problem.strerror})") from problem


@contextmanager
def printed() -> Iterator[None]:
    """Meanwhile all that is printed is made visible."""
    with redirect_stdout(Printed(sys.stdout)), redirect_stderr(Printed(sys.stderr)):
        yield


def drop_unwritten() -> None:
    """Drop what could not be printed, lest the interpreter tries it again when it ends, and complains."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, stream.fileno())
            os.close(nowhere)
