"""Tells which kernels are being compiled, of which the first run on a machine has many."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from numba.core import event


class _Watch(event.Listener):
    def __init__(self, told):
        self._told = told

    def on_start(self, event):
        kernel = event.data["dispatcher"].py_func
        if kernel.__module__.startswith(__package__):  # and not one of numba's own
            self._told(kernel.__name__)

    def on_end(self, event):
        pass


@contextmanager
def watched(told) -> Iterator[None]:
    """While this lasts, call `told` with the name of each kernel whose compilation begins."""
    watch = _Watch(told)
    event.register("numba:compile", watch)
    try:
        yield
    finally:
        event.unregister("numba:compile", watch)
