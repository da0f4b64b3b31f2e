"""The error of checks: a part breaks its contract."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from swarmsim.core.own import told


class BrokenError(AssertionError):
    """A part breaks its seam's contract; the message names scenario, iteration and what is wrong."""

    def __init__(self, message: str, seam: str = "") -> None:
        """The `seam` is the part's; empty for the whole run."""
        super().__init__(message)
        self.seam = seam


@contextmanager
def breaking(seam: str, where: str) -> Iterator[None]:
    """Within this context, an exception from this seam's code breaks its contract."""
    try:
        yield
    except Exception as problem:
        raise BrokenError(f"{where}: {told(problem)}", seam) from problem
