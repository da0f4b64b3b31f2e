"""Scenarios with just a building."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

CELL: Final = 0.15  # m, for buildings without a scenario


def bare(world: Mapping[str, object], cell: float = CELL) -> dict[str, object]:
    """A scenario with its world and the required keys only."""
    return {
        "world": world, "grid": {"cell": cell}, "robots": {"count": 10}, "network": {"topology": {"use": "none"}}
    }  # fmt: skip
