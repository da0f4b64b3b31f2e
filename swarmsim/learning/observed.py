"""Sensor channels as observations: finite numbers within bounds, and whether each was measured."""

from __future__ import annotations

import math

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from swarmsim.core.errors import InputError
from swarmsim.core.readings import Channel, Channels, Readings

TAKEN = frozenset({"tile", "pose", "heard", "tiles", "offsets"})  # observations of every agent


def spaces_of(channels: Channels, names: tuple[str, ...]) -> dict[str, spaces.Space[NDArray[np.generic]]]:
    """The spaces of channels by name, and of NAME_known: 1 for measured values.

    Raises InputError for a channel that is unknown, has no bounds, or has another observation's name.
    """
    found: dict[str, spaces.Space[NDArray[np.generic]]] = {}
    for name in names:
        try:
            channel = channels[name]
        except InputError as problem:
            raise InputError(f"observe: {problem}") from problem
        if channel.dtype != "?" and not (math.isfinite(channel.low) and math.isfinite(channel.high)):
            raise InputError(f"observe: {name!r} has no bounds; expected a channel that declares low and high")
        if name in TAKEN or name in found:
            raise InputError(f"observe: {name!r} is an observation already; expected others, each once")
        low, high = (0, 1) if channel.dtype == "?" else _ends(channel)
        kind = np.dtype("u1" if channel.dtype == "?" else channel.dtype).type
        found[name] = spaces.Box(low, high, channel.shape, kind)
        found[f"{name}_known"] = spaces.Box(0, 1, channel.shape, np.uint8)
    return found


def _ends(channel: Channel) -> tuple[float, float]:
    """The bounds of an observation: the channel's, extended to its value for missing readings."""
    return min(channel.low, channel.missing), max(channel.high, channel.missing)


def observed(readings: Readings, names: tuple[str, ...], robots: NDArray[np.int64]) -> dict[str, NDArray[np.generic]]:
    """Observations of channels (robots, ...), clipped to their bounds; NaN becomes the value for missing readings."""
    found: dict[str, NDArray[np.generic]] = {}
    for name in names:
        channel, row = readings.channels[name], readings[name][robots]
        if channel.dtype == "?":
            found |= {name: row.astype(np.uint8), f"{name}_known": np.ones(row.shape, np.uint8)}
            continue
        known = ~np.isnan(row)
        told = np.where(known, np.clip(row, channel.low, channel.high), channel.missing).astype(row.dtype)
        found |= {name: told, f"{name}_known": known.astype(np.uint8)}
    return found
