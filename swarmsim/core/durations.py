"""Durations as people write them: "20min", "90 s", "1.5h"."""

from __future__ import annotations

import math
import re
from typing import Final

UNITS: Final = {"s": 1.0, "min": 60.0, "h": 3600.0}  # seconds
WRITTEN: Final = re.compile(r"\s*([0-9]+(?:\.[0-9]*)?|\.[0-9]+)\s*(s|min|h)?\s*")
EXPECTED: Final = 'expected a time above 0, such as "8min", "90s", "1.5h" or a number of seconds'


def seconds_of(text: str | float) -> float:
    """A duration's seconds; a number, or a text without a unit, is in seconds. Raises ValueError."""
    if isinstance(text, str):
        found = WRITTEN.fullmatch(text)
        seconds = float(found[1]) * UNITS[found[2] or "s"] if found else math.nan
    else:
        seconds = math.nan if isinstance(text, bool) else float(text)
    if not 0.0 < seconds < math.inf:
        raise ValueError(f"{text!r} is no duration; {EXPECTED}")
    return seconds


def told(seconds: float) -> str:
    """A duration in words, to the second: "8 min", "45 s", "1 h 20 min"; below 10 s with a decimal."""
    if seconds < 9.95:
        return f"{seconds:.1f}".removesuffix(".0") + " s"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    parts = [f"{count} {unit}" for count, unit in ((hours, "h"), (minutes, "min"), (rest, "s")) if count]
    return " ".join(parts)


def iterations_in(seconds: float, period: float) -> int:
    """The whole iterations of `period` s that fit into a time, whose quotient may be short of one by rounding."""
    return math.floor(seconds / period * (1.0 + 1e-12))
