"""Checks declarations of readings: a sensor's before a run, and a foreign one in a recording."""

from __future__ import annotations

import json
import math
from typing import Final

import msgspec
import numpy as np

from swarmsim.core.readings import Channel, Channels, tile_channels

MOST: Final = 200  # channels of a swarm
LARGEST: Final = 1 << 30  # bytes of a channel in one iteration


def wrong_channels(channels: Channels, robots: int) -> str | None:
    """What is wrong with the channels of this many robots, or None."""
    if len(channels) > MOST:
        return f"{len(channels)} channels; expected {MOST} at most"
    if len(channels.places) < len(channels):
        return f"{channels.listed()}: two channels of one name; expected each once"
    for channel in channels:
        wrong = _wrong_form(channel) or _wrong_size(channel, robots) or _wrong_place(channel, channels)
        if wrong is not None:
            return f"{channel.name!r}: {wrong}"
    for group, places in channels.groups.items():
        found = [channel for channel in channels if channel.group == group]
        rows, columns = (*found[0].shape, 0, 0)[:2]
        tiles = tile_channels((rows, columns), len(places) > 2)
        if not group.endswith("tiles") or found != [one.prefixed(group[:-6]) for one in tiles]:
            return f"{found[0].name!r}: is in the group {group!r}; expected what tile_channels gives, all together"
    return None


def _wrong_form(channel: Channel) -> str | None:
    """What is wrong with the types and lengths of a declaration."""
    try:
        msgspec.convert(msgspec.to_builtins(channel), Channel)
    except (msgspec.ValidationError, TypeError) as problem:
        return str(problem)
    return None


def _wrong_size(channel: Channel, robots: int) -> str | None:
    """What is wrong with the shape and the bounds of a channel."""
    whole = math.prod(channel.shape) * np.dtype(channel.dtype).itemsize * robots
    if whole > LARGEST:
        return f"{whole} bytes an iteration; expected {LARGEST} at most"
    if not channel.low <= channel.high or not math.isfinite(channel.missing):
        return f"bounds {channel.low} and {channel.high}, or {channel.missing} for what is missing; expected numbers"
    if channel.axis and channel.shape[:1] != (len(channel.axis),):
        return f"an axis of {len(channel.axis)} for shape {channel.shape}; expected one for its first side"
    if channel.columns and channel.shape[-1:] != (len(channel.columns),):
        return f"{len(channel.columns)} columns for shape {channel.shape}; expected the names of its last side"
    standard = {"ranges": ("f8", (len(channel.axis) or 1,)), "field": ("f8", ())}.get(channel.name.partition(".")[0])
    if standard and (channel.dtype, channel.shape) != standard:
        return "is the name of what beams or a field give; expected their form, or another name"
    return None


def _wrong_place(channel: Channel, channels: Channels) -> str | None:
    """What is wrong with the frame of a channel, and with what it is counted by."""
    if channel.frame == "cells" and (channel.dtype != "i4" or channel.shape[-1:] != (2,)):
        return f"{channel.dtype} of shape {channel.shape} lies on cells; expected i4 of rows and columns, (..., 2)"
    if channel.frame == "world" and (channel.dtype[0] != "f" or (channel.shape and channel.shape[-1] not in (2, 3))):
        return f"{channel.dtype} of shape {channel.shape} lies in the world; expected numbers (), (..., 2) or (..., 3)"
    if channel.count:
        by = next((one for one in channels if one.name == channel.count), None)
        if by is None or (by.dtype, by.shape, by.structure) != ("i4", (), True) or not channel.shape:
            return f"is counted by {channel.count!r}; expected a channel of type i4 and shape () that is structure"
        if not (by.low == 0 and by.high <= channel.shape[0]):
            return f"{channel.count!r} goes from {by.low} to {by.high}; expected 0 to {channel.shape[0]}"
    return None


def text_of(channels: Channels) -> str:
    """The declaration as recordings keep it: JSON, with Infinity as Python has it."""
    return json.dumps(msgspec.to_builtins(tuple(channels)))


def read(text: str, robots: int) -> Channels:
    """The declaration in a recording of this many robots. Raises ValueError for an invalid one."""
    listed = json.loads(text)
    if not isinstance(listed, list) or len(listed) > MOST:
        raise ValueError(f"the declaration of readings is no list of {MOST} channels at most")
    channels = Channels(*msgspec.convert(listed, tuple[Channel, ...]))
    wrong = wrong_channels(channels, robots)
    if wrong is not None:
        raise ValueError(f"the declaration of readings: {wrong}")
    return channels
