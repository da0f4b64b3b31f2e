"""Scenario files with one thing wrong: a key renamed, a value of another kind or size, a table gone, a text damaged."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from dataclasses import dataclass
from random import Random
from typing import Any

import tomli_w
from generated.scenarios import Scenario

SIZES = (-1, 0, -0.0, 0.5, 10**20, 1e300, float("nan"), float("inf"), -1e-300)
KINDS: tuple[Any, ...] = (True, 3, -2.5, "", "word", [], [1], ["a", 2], {}, {"use": "none"}, [[]], [{}])


@dataclass(frozen=True)
class Mutant:
    """A damaged scenario file."""

    what: str  # was done to it
    text: str
    key: str = ""  # that a refusal has to name; none: any will do
    table: str = ""  # that holds the key: numbers that contradict each other are told by any of its keys


def mutant(whole: Scenario, salt: int) -> Mutant:
    """A damaged copy of a scenario, always the same one of a salt."""
    dice = Random(f"{whole.number} {salt}")
    table = copy.deepcopy(whole.table)
    places = list(_places(table))
    holder, key, place = dice.choice(places)
    value = holder[key]
    damage = dice.choice(("rename", "kind", "size", "remove", "text"))
    if damage == "rename":
        new = dice.choice((f"{key}x", key[:-1] or "x", key.upper(), f"un{key}"))
        holder[new] = holder.pop(key)
        # Without its use, a table is that of the default, which may lack other keys.
        return Mutant(f"{key} is called {new}", tomli_w.dumps(table), "" if key == "use" else new)
    if damage == "kind":
        holder[key] = dice.choice([one for one in KINDS if not isinstance(one, type(value))])
        return Mutant(f"{key} = {holder[key]!r} for {value!r}", tomli_w.dumps(table), key, place)
    if damage == "size":
        holder, key, place = dice.choice([one for one in places if isinstance(one[0][one[1]], int | float)])
        value, holder[key] = holder[key], dice.choice(SIZES)
        return Mutant(f"{key} = {holder[key]!r} for {value!r}", tomli_w.dumps(table), key, place)
    if damage == "remove":
        del holder[key]
        return Mutant(f"{key} is gone", tomli_w.dumps(table))
    at, text = dice.randrange(len(whole.text)), whole.text
    piece = dice.choice(("", '"', "[", "]", "=", "\n", ".", "\\", "{", "\0", "é", "#", "[[faults]]\n"))
    until = at + dice.choice((0, 1, 1, 20, len(text)))
    return Mutant(f"{text[at:until]!r} at {at} became {piece!r}", text[:at] + piece + text[until:])


def _places(table: Any, place: str = "") -> Iterator[tuple[dict[str, Any], str, str]]:
    """Every key of a table, with the table that holds it and that one's dotted place, at any depth."""
    for key, value in table.items():
        yield table, key, place
        for number, inner in enumerate(value) if isinstance(value, list) else [(None, value)]:
            if isinstance(inner, dict):
                deeper = f"{place}.{key}" if place else key
                yield from _places(inner, deeper if number is None else f"{deeper}[{number}]")
