"""Large arrays of zeros that take memory only where written."""

from __future__ import annotations

import math
import mmap
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.errors import InputError

Kind = TypeVar("Kind", bound=np.generic)

SMALL: Final = 1 << 22  # bytes, below which numpy's own arrays are as good


def zeros(shape: tuple[int, ...], kind: type[Kind]) -> NDArray[Kind]:
    """An array of zeros that takes memory only for written pages (4 KiB).

    numpy asks the system for pages of 2 MiB, which is faster for arrays used as a whole. But with these, every robot's
    map would be fully resident after its first tile. Raises InputError if the system cannot provide the memory.
    """
    size = math.prod(shape) * np.dtype(kind).itemsize
    if size < SMALL:
        return np.zeros(shape, kind)
    try:
        pages = mmap.mmap(-1, size, flags=mmap.MAP_PRIVATE) if hasattr(mmap, "MAP_PRIVATE") else mmap.mmap(-1, size)
    except (OSError, OverflowError) as problem:
        raise InputError(
            f"grid.cell: {size / 2**30:.3g} GiB for a number of each robot's cells are more than this system gives "
            f"({problem}); expected fewer robots or larger cells"
        ) from problem
    if hasattr(mmap, "MADV_NOHUGEPAGE"):
        pages.madvise(mmap.MADV_NOHUGEPAGE)
    return np.frombuffer(pages, kind).reshape(shape)
