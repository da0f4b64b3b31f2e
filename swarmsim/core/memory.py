"""Large arrays of zeros that take memory only where they are written to."""

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
    """An array of zeros, of which only the pages (4 KiB) that are written to take memory.

    numpy asks the system for pages of 2 MiB, which is faster for arrays that are used as a whole. But of the maps of
    many robots, in a building of which each has seen a part, each would take all its memory at the first tile. Raises
    InputError for more than there can be.
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
