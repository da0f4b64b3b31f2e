"""A recorded channel as columns: one row for each iteration and robot."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.errors import InputError, nearest
from swarmsim.core.readings import Channel, Channels
from swarmsim.recording.reader import Recording


def recorded(recording: Recording) -> dict[str, Channel]:
    """The channels that a recording holds, by name."""
    return {one.name: one for one in (*recording.channels, *recording.actuators) if one.recorded_as in recording}


def columns_of(recording: Recording, name: str) -> dict[str, NDArray[np.generic]]:
    """The columns of a channel, named with their units: iteration, time, robot, and its values.

    A ragged channel gives one row for each used row, with its number. Raises InputError for a channel that the
    recording lacks.
    """
    channel = recorded(recording).get(name)
    if channel is None:
        known = recorded(recording)
        why = next((f": {one.unrecorded}" for one in recording.channels if one.name == name), "")
        raise InputError(f"{name!r} is not recorded{why}; {nearest(name, dict.fromkeys(known))}")
    table = recording[channel.recorded_as]
    first, end = channel.robots or (0, table.shape[1])
    table = table[:, first:end]
    rows = len(channel.shape) > 1 or not channel.count  # with several numbers each
    sides = table.shape[:-1] if channel.shape and rows else table.shape
    at = np.indices(sides).reshape(len(sides), -1)
    values = table.reshape(at.shape[1], -1)
    if channel.count:
        counts = recording[_table(recording.channels, channel.count)][:, first:end]
        used: NDArray[np.bool_] = at[2] < counts[at[0], at[1]]
        at, values = at[:, used], values[used]
    found: dict[str, NDArray[np.generic]] = {
        "iteration": at[0] + 1, "time (s)": (at[0] + 1) * recording.scenario.period, "robot": at[1] + first,
    }  # fmt: skip
    found |= {("row", "column", "layer")[side - 2]: at[side] for side in range(2, len(at))}
    titles = _titles(channel, values.shape[1])
    return found | {title: values[:, place] for place, title in enumerate(titles)}


def _table(channels: Channels, name: str) -> str:
    return channels[name].recorded_as


def _titles(channel: Channel, count: int) -> list[str]:
    """The names of a channel's columns, with their units."""
    units = channel.unit.split(", ") if channel.columns else [channel.unit]
    names = list(channel.columns) or [channel.name if count == 1 else f"{channel.name} {i}" for i in range(count)]
    units = units if len(units) == len(names) else [channel.unit] * len(names)
    return [f"{name} ({unit})" if unit else name for name, unit in zip(names, units, strict=True)]


def shown(recording: Recording) -> list[Channel]:
    """The channels that viewers get as numbers: all recorded ones except tiles, which maps show."""
    return [channel for channel in recorded(recording).values() if not channel.group]


def plain(rows: NDArray[np.generic]) -> object:
    """Numbers in lists, with None for non-finite ones, which JSON lacks."""
    given = rows.astype(object)
    if rows.dtype.kind == "f":
        given[~np.isfinite(rows.astype(np.float64))] = None
    return given.tolist()
