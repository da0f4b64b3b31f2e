"""Values of keys as functions take them: by key, or in words as for `--set`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from swarmsim.core.durations import seconds_of
from swarmsim.core.errors import InputError
from swarmsim.core.parts import Fault
from swarmsim.core.scenario.part import Part
from swarmsim.core.scenario.toml import parsed
from swarmsim.faults.in_words import fault_in_words

Overrides = Mapping[str, object] | Sequence[str]  # {"robots.count": 20}, or as for --set: ["robots.count=20"]


def told_apart(overrides: Overrides | None) -> tuple[Sequence[str], Mapping[str, object]]:
    """The overrides as texts and as values; one of the two is empty."""
    if isinstance(overrides, Mapping):
        return (), overrides
    return ([overrides] if isinstance(overrides, str) else overrides or ()), {}


def keys_of(overrides: Overrides | None) -> dict[str, object]:
    """The keys of one table by name; in words a value is TOML, or else a text. Raises InputError."""
    texts, changes = told_apart(overrides)
    found = dict(changes)
    for text in texts:
        key, equals, value = (part.strip() for part in text.partition("="))
        if not equals or not key:
            raise InputError(f"--set {text}: expected key=value, as in at=20")
        try:
            found[key] = parsed(f"value = {value}")["value"]
        except ValueError as problem:
            if not value or value[0] in "\"'[{":
                raise InputError(f"--set {text}: {value!r} is not a TOML value: {problem}") from problem
            found[key] = value
    return found


def fault_of(text: str) -> Part[Fault]:
    """A fault in words. Raises InputError, which names the option."""
    try:
        return fault_in_words(text)
    except InputError as problem:
        raise InputError(f"--fault {text!r}: {problem}") from problem


def seconds_in(option: str, time: str | float) -> float:
    """A time in seconds. Raises InputError, which names the option."""
    try:
        return seconds_of(time)
    except ValueError as problem:
        raise InputError(f"{option} {problem}") from problem
