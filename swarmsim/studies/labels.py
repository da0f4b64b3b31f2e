"""What the conditions of a study are called."""

from __future__ import annotations

from collections.abc import Mapping, Sequence


def label(cell: dict[str, object], words: Mapping[str, Sequence[tuple[object, str]]] = {}) -> str:
    """A short name such as "k=2, count=15"; `words` are those that keys have for their values."""
    parts = []
    for key, value in cell.items():
        plain = f"{key.rpartition('.')[2]}={shown(value)}"
        parts.append(next((word for one, word in words.get(key, ()) if one == value), plain))
    return ", ".join(parts) or "base"


def shown(value: object) -> object:
    """Parts by their names and other keys, such as "k-random k=2"; anything else unchanged."""
    if isinstance(value, list) and all(isinstance(one, dict) and "use" in one for one in value):
        return " and ".join(str(shown(one)) for one in value) or "none"
    if not isinstance(value, dict) or "use" not in value:
        return value
    return " ".join([str(value["use"]), *(f"{key}={shown(one)}" for key, one in value.items() if key != "use")])
