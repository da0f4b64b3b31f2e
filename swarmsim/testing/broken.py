"""What a check raises: a promise that a part does not keep."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from swarmsim.core.own import told


class BrokenError(AssertionError):
    """A part breaks a promise of its seam; the message names scenario, iteration and what is wrong."""

    def __init__(self, message: str, seam: str = "") -> None:
        """The `seam` is that of the part; empty where the whole run breaks it."""
        super().__init__(message)
        self.seam = seam


@contextmanager
def breaking(seam: str, where: str) -> Iterator[None]:
    """Within this context, what code of this seam raises breaks its promise."""
    try:
        yield
    except Exception as problem:
        raise BrokenError(f"{where}: {told(problem)}", seam) from problem
