"""The keys of one part at random: whatever its parameters allow, by their types and bounds."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import lru_cache
from random import Random
from typing import Any

import msgspec
from msgspec import inspect as types

OMITTED = object()  #: what stands for a key that is left out

Own = Mapping[str, Callable[[], Any]]  # what to draw for keys that depend on others, or on the swarm


def drawn(dice: Random, kind: type[msgspec.Struct], own: Own, often: float = 0.4) -> dict[str, Any]:
    """A table of valid keys: all that `own` draws and that are required, and each other one as `often` as said."""
    found = {}
    for field in _fields(kind):
        if field.encode_name in own:
            value = own[field.encode_name]()
        elif field.required:
            value = _value(dice, field.type, 1)
        else:
            value = _value(dice, field.type, field.default) if dice.random() < often else OMITTED
        if value is not OMITTED:
            found[field.encode_name] = value
    return found


@lru_cache(maxsize=256)
def _fields(kind: type[msgspec.Struct]) -> tuple[types.Field, ...]:
    found = types.type_info(kind)
    assert isinstance(found, types.StructType)
    return found.fields


def _value(dice: Random, kind: types.Type, default: Any) -> Any:
    """Anything of a type; numbers without bounds on both sides are about as large as the default."""
    match kind:
        case types.BoolType():
            return dice.random() < 0.5
        case types.LiteralType(values=values):
            return dice.choice(values)
        case types.UnionType(types=kinds):
            return _value(dice, next(one for one in kinds if not isinstance(one, types.NoneType)), default)
        case types.IntType() | types.FloatType():
            return _number(dice, kind, default)
    return OMITTED


def _number(dice: Random, kind: types.IntType | types.FloatType, default: Any) -> Any:
    whole = isinstance(kind, types.IntType)
    least, most = _bound(kind.ge, kind.gt, 1 if whole else 1e-3), _bound(kind.le, kind.lt, -1 if whole else -1e-3)
    if least is None or most is None or most - least > 10:  # such bounds are those of the imaginable
        if not isinstance(default, int | float) or default == 0:
            return OMITTED
        near = sorted((0.5 * default, 1.5 * default))
        least, most = (
            (near[0] if least is None else max(least, near[0])),
            (near[1] if most is None else min(most, near[1])),
        )
    return dice.randint(math.ceil(least), math.floor(most)) if whole else float(f"{dice.uniform(least, most):.4g}")


def _bound(included: float | None, excluded: float | None, inwards: float) -> float | None:
    return included if excluded is None else excluded + inwards
