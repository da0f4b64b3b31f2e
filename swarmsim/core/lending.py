"""Arrays that others may look at, and what they give, made their own no more.

It guards against mistakes: who wants to can still make a view of a writable array writable.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, is_dataclass
from functools import lru_cache
from types import MemberDescriptorType
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

#: Metadata of a field of a dataclass whose value is passed on as it is.
AS_IT_IS: Final = {"lent": False}

T = TypeVar("T")
Change = Callable[[NDArray[np.generic]], NDArray[np.generic]]


class Lender:
    """Lends values for as long as an iteration lasts: the same one twice in the same form."""

    def __init__(self) -> None:
        self._lent: dict[int, tuple[object, object]] = {}  # what was lent and as what, by identity
        self._back: dict[
            int, tuple[NDArray[np.generic], NDArray[np.generic]]
        ] = {}  # views and what they show, by the view's

    def clear(self) -> None:
        """Forget what was lent before."""
        self._lent.clear()
        self._back.clear()

    def lent(self, value: T) -> T:
        """The same to look at: with views in the place of its arrays that cannot be written to."""
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
        """What a part gives, with copies of its arrays, but for what was lent to it, which it gives back.

        Those that can be kept as they are stay what they are.
        """
        back = self._back

        def own(array: NDArray[np.generic]) -> NDArray[np.generic]:
            known = back.get(id(array))
            return known[1] if known is not None else array if keep(array) else array.copy()

        found: T = _anew(value, own)
        return found


def lent(value: T) -> T:
    """The same to look at, for good."""
    return Lender().lent(value)


def copied(value: T) -> T:
    """The same with copies of its arrays, for what kernels are asked often: they take read-only arrays slowly."""
    found: T = _anew(value, np.copy)
    return found


def frozen(value: T) -> T:
    """The same, of whose arrays those that are no views can be written to no more by anybody."""
    _anew(value, _freeze)
    return value


def _freeze(array: NDArray[np.generic]) -> NDArray[np.generic]:
    if array.base is None:
        array.setflags(write=False)
    return array


def _anew(value: Any, change: Change) -> Any:  # noqa: ANN401 - of any class, and of the same again
    """Frozen dataclasses, tuples, lists and dicts anew, at any depth, with something else for each plain array."""
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
    if kind.__dictoffset__:  # what else it holds
        vars(made).update(vars(value))
    for name, changes, put in names:  # the loop that takes the time: no call more than there has to be
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
    """The names of all that instances of a frozen dataclass hold, whether it is lent, and what puts it into a new one.

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
