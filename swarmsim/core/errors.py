"""What went wrong, said once and in full."""

from __future__ import annotations

import difflib
import errno
from collections.abc import Mapping
from typing import Final

#: Errors of the machine: no other name, folder or permission would mend them.
OF_THE_MACHINE: Final = (errno.ENOSPC, errno.EFBIG, errno.EDQUOT, errno.EIO)


class InputError(Exception):
    """Bad input: the message names the file, the place in it, what is wrong and what would be right.

    The command line prints the message alone and ends with exit code 2.
    """

    def inside(self, place: str) -> InputError:
        """The same of a key in this place of a scenario."""
        return InputError(f"{place}.{self}")


class PlacedError(InputError):
    """Bad input whose message names its place in the scenario already, whatever part has found it out."""

    def inside(self, place: str) -> InputError:
        """The same error."""
        return self


class PartError(Exception):
    """A part that is not ours failed or broke its contract while a run went on.

    The message names the part, the iteration and, where the part's own code raised, the lines of it that did. The
    command line prints it alone and ends with exit code 3.
    """

    def __init__(self, message: str, seam: str = "") -> None:
        super().__init__(message)
        #: That of the part; empty where it is not known.
        self.seam = seam


class StorageError(Exception):
    """A disk is full, or a file can no longer be written: the message names the file, why, and what has been kept.

    The command line prints it alone and ends with exit code 4.
    """


def is_of_the_machine(problem: BaseException) -> bool:
    """Whether the system says that a disk is full or broken, and not that a file or a folder is the wrong one."""
    return isinstance(problem, OSError) and problem.errno in OF_THE_MACHINE


def unwritten(what: object, problem: OSError, expected: str = "a place for a file") -> InputError | StorageError:
    """What to raise where a file, `what`, could not be written: bad input, unless the machine is at fault.

    A library that gives no number of the system's was let down while it wrote.
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
