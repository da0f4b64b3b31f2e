"""Errors, each with one complete message."""

from __future__ import annotations

import difflib
import errno
from collections.abc import Mapping
from typing import Final

#: Errors of the machine: no other name, folder or permission would help.
OF_THE_MACHINE: Final = (errno.ENOSPC, errno.EFBIG, errno.EDQUOT, errno.EIO)


class InputError(Exception):
    """Bad input: the message names the file, the place in it, what is wrong and what is expected.

    The command line prints only the message and exits with code 2.
    """

    def inside(self, place: str) -> InputError:
        """The same error, with its place in the scenario in front."""
        return InputError(f"{place}.{self}")


class PlacedError(InputError):
    """Bad input whose message already names its place in the scenario, whichever part found it."""

    def inside(self, place: str) -> InputError:
        """The same error."""
        return self


class PartError(Exception):
    """A third-party part failed or broke its contract during a run.

    The message names the part, the iteration and, where the part's own code raised, its lines. The command line
    prints only the message and exits with code 3.
    """

    def __init__(self, message: str, seam: str = "") -> None:
        super().__init__(message)
        #: The part's seam; empty where unknown.
        self.seam = seam


class StorageError(Exception):
    """A disk is full, or a file can no longer be written: the message names the file, the reason, and what was kept.

    The command line prints only the message and exits with code 4.
    """


def is_of_the_machine(problem: BaseException) -> bool:
    """Whether the system reports a full or broken disk, not a wrong file or folder."""
    return isinstance(problem, OSError) and problem.errno in OF_THE_MACHINE


def unwritten(what: object, problem: OSError, expected: str = "a place for a file") -> InputError | StorageError:
    """The error for a file, `what`, that could not be written: bad input, unless the machine is at fault.

    An error without a system error number is taken as the machine's, since libraries raise such while writing.
    """
    told = problem.strerror or str(problem).strip().partition("\n")[0]
    if problem.errno is None or is_of_the_machine(problem):
        return StorageError(f"{what}: cannot be written ({told})")
    return InputError(f"{what}: cannot be written ({told}); expected {expected}")


def nearest(word: str, words: Mapping[str, object]) -> str:
    """A clause that suggests the known word most like `word`, or lists all of them."""
    similar = difflib.get_close_matches(word, words, n=1)
    listed = ", ".join(sorted(words)) or "none"
    return f"did you mean {similar[0]!r}? Known: {listed}" if similar else f"known: {listed}"


def lacks(what: str, problem: ModuleNotFoundError) -> InputError:
    """The error for what needs a package that is not installed."""
    package = str(problem.name).partition(".")[0]
    return InputError(f"{what} needs the package {package}, which is not installed; expected: pip install {package}")
