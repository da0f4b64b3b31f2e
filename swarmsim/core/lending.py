"""Lends arrays to parts read-only, and copies what they return.

It guards against mistakes, not malice: a view of a writable array can be made writable again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, is_dataclass
from functools import lru_cache
from types import MemberDescriptorType
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

#: Metadata of a dataclass field whose value is passed on unchanged.
AS_IT_IS: Final = {"lent": False}

T = TypeVar("T")
Change = Callable[[NDArray[np.generic]], NDArray[np.generic]]


class Lender:
    """Lends values for one iteration: the same value twice as the same object."""

    def __init__(self) -> None:
        self._lent: dict[int, tuple[object, object]] = {}  # what was lent and its view, by identity
        self._back: dict[
            int, tuple[NDArray[np.generic], NDArray[np.generic]]
        ] = {}  # views and their originals, by the view's identity

    def clear(self) -> None:
        """Forget what was lent before."""
        self._lent.clear()
        self._back.clear()

    def lent(self, value: T) -> T:
        """The same value with read-only views as its arrays."""
        known = self._lent.get(id(value))
        if known is None:
            known = self._lent[id(value)] = value, _anew(value, self._view)
        found: Any = known[1]
        return found  # type: ignore[no-any-return]

    def _view(self, array: NDArray[np.generic]) -> NDArray[np.generic]:
        if not array.flags.writeable:
            return array
        view = array.view()
        view.flags.writeable = False
        self._back[id(view)] = view, array
        return view

    def taken(self, value: T, keep: Callable[[NDArray[np.generic]], bool] = lambda array: False) -> T:
        """A part's result with copied arrays, except lent ones, which become the originals again.

        Arrays that can be kept stay as they are.
        """
        back = self._back

        def own(array: NDArray[np.generic]) -> NDArray[np.generic]:
            known = back.get(id(array))
            return known[1] if known is not None else array if keep(array) else array.copy()

        found: T = _anew(value, own)
        return found


def lent(value: T) -> T:
    """The same value, read-only for good."""
    return Lender().lent(value)


def copied(value: T) -> T:
    """The same value with copied arrays, for frequent kernel calls: numba takes read-only arrays slowly."""
    found: T = _anew(value, np.copy)
    return found


def frozen(value: T) -> T:
    """The same value, with all arrays that own their data made read-only."""
    _anew(value, _freeze)
    return value


def _freeze(array: NDArray[np.generic]) -> NDArray[np.generic]:
    if array.base is None:
        array.setflags(write=False)
    return array


def _anew(value: Any, change: Change) -> Any:  # noqa: ANN401 - any class in, the same class out
    """Rebuilds frozen dataclasses, tuples, lists and dicts, at any depth, with each plain array changed."""
    kind: Any = type(value)
    if kind is np.ndarray:
        return change(value)
    if kind in _PLAIN:
        return value
    if kind is tuple or kind is list:
        return kind([_anew(one, change) for one in value])
    if kind is dict:
        return {name: _anew(one, change) for name, one in value.items()}
    names = _fields_of(kind)
    if not names:
        return value
    made = object.__new__(kind)
    if kind.__dictoffset__:  # its other attributes
        vars(made).update(vars(value))
    for name, changes, put in names:  # the hot loop: no needless calls
        one = getattr(value, name)
        if changes:
            what = type(one)
            if what is np.ndarray:
                one = change(one)
            elif what not in _PLAIN:
                one = _anew(one, change)
        put(made, one)
    return made


_PLAIN: Final = frozenset((type(None), bool, int, float, str, bytes))


@lru_cache(maxsize=256)
def _fields_of(kind: type) -> tuple[tuple[str, bool, Callable[[object, object], None]], ...]:
    """The attributes of a frozen dataclass's instances: name, whether it is lent, and its setter in a new instance.

    Other classes have none.
    """
    if not is_dataclass(kind) or not getattr(kind, "__dataclass_params__").frozen:  # noqa: B009
        return ()
    return tuple((field.name, field.metadata.get("lent", True), _putting(kind, field.name)) for field in fields(kind))


def _putting(kind: type, name: str) -> Callable[[object, object], None]:
    slot = getattr(kind, name, None)
    if isinstance(slot, MemberDescriptorType):
        return slot.__set__
    return lambda made, value: object.__setattr__(made, name, value)
