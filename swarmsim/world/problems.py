"""All errors in a file, reported at once."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

from swarmsim.core.errors import InputError

_MOST: Final = 10  # problems in one message


class Problems:
    """Collects the errors in one file, each with its place."""

    def __init__(self, name: str) -> None:
        """`name`: of the file in messages."""
        self._name = name
        self._told: list[str] = []

    def add(self, problem: str) -> None:
        """Add one; repeats are dropped."""
        if problem not in self._told:
            self._told.append(problem)

    @contextmanager
    def collected(self) -> Iterator[None]:
        """Keeps an InputError of the block."""
        try:
            yield
        except InputError as problem:
            self.add(str(problem).removeprefix(f"{self._name}: "))

    def complain(self) -> None:
        """Raises InputError with all problems, if there are any."""
        if len(self._told) == 1:
            raise InputError(f"{self._name}: {self._told[0]}")
        if self._told:
            more = f"\n  and {len(self._told) - _MOST} more" if len(self._told) > _MOST else ""
            listed = "".join(f"\n  {one}" for one in self._told[:_MOST])
            raise InputError(f"{self._name}: {len(self._told)} problems:{listed}{more}")
