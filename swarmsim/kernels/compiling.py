"""What compiles kernels, its cache, and those being compiled: the first run on a machine compiles many.

Without numba kernels are plain Python: slower, and equal to the bit.
"""

from __future__ import annotations

import os
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

try:
    from numba import njit as njit
    from numba.core import config, event
    from numba.core.caching import InTreeCacheLocator, UserProvidedCacheLocator, UserWideCacheLocator
    from numba.extending import intrinsic as intrinsic
except ModuleNotFoundError:  # a robot without a compiler
    config = None

    def njit(**options):
        """Plain Python in the place of numba's decorator."""
        return lambda function: function

    def intrinsic(function):
        """Nothing that plain Python could call."""
        return function


def compiles() -> bool:
    """Whether kernels are compiled."""
    return config is not None and not config.DISABLE_JIT


def wrapping(function):
    """The same function of integers that wrap around, as compiled ones do: plain Python warns of that."""
    return function if compiles() else np.errstate(over="ignore")(function)


def _places():
    return (UserProvidedCacheLocator, InTreeCacheLocator, UserWideCacheLocator)  # in numba's order


def find_a_place() -> None:
    """Let numba keep kernels in a temporary folder if it can write to none of its places.

    Those are NUMBA_CACHE_DIR, the package's own folder and the user's cache. Raises OSError if there is no temporary
    folder either.
    """
    if config is None:
        return
    if not any(place.from_function(find_a_place, __file__) for place in _places()):
        config.CACHE_DIR = str(_own_folder())


def is_new() -> bool:
    """Whether no compiled kernel is kept from an earlier run on this machine."""
    if config is None:
        return False
    found = (place.from_function(find_a_place, __file__) for place in _places())
    folder = next((Path(one.get_cache_path()) for one in found if one is not None), None)
    return folder is None or not any(folder.glob("*.nbi"))


def makeshift() -> str | None:
    """The temporary folder in which kernels are kept, or None if they have a lasting place."""
    if config is None:
        return None
    return config.CACHE_DIR if os.environ.get("NUMBA_CACHE_DIR", "") != config.CACHE_DIR else None


def _own_folder() -> Path:
    """A temporary folder private to this user, as its contents are executed; the same one for later runs."""
    try:
        folder = Path(tempfile.gettempdir()) / f"swarmsim-kernels-{os.getuid() if os.name == 'posix' else 'here'}"
        folder.mkdir(mode=0o700, exist_ok=True)
        status = folder.lstat()
        ours = os.name != "posix" or (status.st_uid == os.getuid() and not status.st_mode & 0o077)
        if stat.S_ISDIR(status.st_mode) and ours and os.access(folder, os.W_OK):
            return folder
        return Path(tempfile.mkdtemp(prefix="swarmsim-kernels-"))
    except OSError as problem:
        told = "compiled kernels cannot be kept; expected a folder that can be written, for there is no temporary one"
        raise OSError(problem.errno, told, "NUMBA_CACHE_DIR") from problem


@contextmanager
def watched(told) -> Iterator[None]:
    """Within the block, call `told` with the name of each kernel whose compilation begins."""
    if config is None:
        yield
        return

    class Compiling(event.Listener):
        def on_start(self, event):
            kernel = event.data["dispatcher"].py_func
            if kernel.__module__.startswith(__package__):  # and not one of numba's own
                told(kernel.__name__)

        def on_end(self, event):
            pass

    watch = Compiling()
    event.register("numba:compile", watch)
    try:
        yield
    finally:
        event.unregister("numba:compile", watch)
