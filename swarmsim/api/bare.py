"""Scenarios about a building alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

CELL: Final = 0.15  # m, of buildings that are looked at without a scenario


def bare(world: Mapping[str, object], cell: float = CELL) -> dict[str, object]:
    """A scenario with nothing in it but its world and what a scenario cannot do without."""
    return {
        "world": world, "grid": {"cell": cell}, "robots": {"count": 10}, "network": {"topology": {"use": "none"}}
    }  # fmt: skip
