"""The contracts of all parts, as checks that say what is wrong: always run on third-party parts, on ours in tests."""

from __future__ import annotations

import math
import sys
from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.bundle import whole
from swarmsim.core.declarations import wrong_channels
from swarmsim.core.errors import nearest
from swarmsim.core.messages import Broadcast, Codec, Delivery, MessageBatch
from swarmsim.core.own import brief
from swarmsim.core.parts import Curve
from swarmsim.core.readings import Channel, Channels, Column, Readings
from swarmsim.core.state import Intents, Knowledge, Measured, Record, Senses, State
from swarmsim.kernels import checks
from swarmsim.recording import layout


def array(name: str, found: object, dtype: type[np.generic], *shape: int | None, finite: bool = True) -> str | None:
    """What is wrong with an array that should have this type and shape (None: any length), or None."""
    if type(found) is np.ndarray:
        kind = found.dtype
        whole = kind.type is dtype and kind.isnative and (found.shape == shape or _fits(found.shape, shape))
        if whole and (not finite or kind.kind != "f" or math.isfinite(np.vdot(found, found))):
            return None
    wanted = f"{np.dtype(dtype)} of shape ({', '.join('any' if side is None else str(side) for side in shape)})"
    if type(found) is not np.ndarray:  # masks would be lost, and kernels take no subclasses
        kind = "a plain array" if isinstance(found, np.ndarray) else "an array"
        return f"{name}: {type(found).__name__}; expected {kind}, {wanted}"
    if found.dtype != np.dtype(dtype) or not _fits(found.shape, shape):
        return f"{name}: {found.dtype} of shape {found.shape}; expected {wanted}"
    if finite and found.dtype.kind == "f" and not np.isfinite(found).all():
        return f"{name}: {_first(~np.isfinite(found))} is not finite; expected numbers to compute with"
    return None


def _fits(found: tuple[int, ...], wanted: tuple[int | None, ...]) -> bool:
    return len(found) == len(wanted) and all(side is None or side == n for side, n in zip(wanted, found, strict=True))


def _first(wrong: NDArray[np.bool_]) -> str:
    return f"[{', '.join(map(str, np.argwhere(wrong)[0].tolist()))}]"


def first_of(*problems: str | None) -> str | None:
    """The first problem, or None."""
    return next((problem for problem in problems if problem is not None), None)


def links(found: object, state: State) -> str | None:
    """Links (m, 2) among live robots, sorted by receiver, then sender; no self link, each pair at most once."""
    wrong = array("links", found, np.int32, None, 2)
    if wrong is not None or not isinstance(found, np.ndarray) or checks.links_hold(found, state.alive):
        return wrong
    receivers, senders = found[:, 0], found[:, 1]
    if found.min() < 0 or found.max() >= state.robots:
        at = int(np.flatnonzero((found < 0).any(axis=1) | (found >= state.robots).any(axis=1))[0])
        return f"links[{at}]: {found[at].tolist()}; expected ids from 0 to {state.robots - 1}"
    keys = receivers.astype(np.int64) * state.robots + senders
    step = np.diff(keys)
    rules = (
        (receivers == senders, "a robot hears itself"),
        (~state.alive[receivers] | ~state.alive[senders], "one of the two is dead"),
        (np.append(False, step == 0), "it repeats the link before"),
        (np.append(False, step < 0), "links have to be sorted by receiver, then sender"),
    )
    for bad, why in rules:
        if bad.any():
            at = int(np.flatnonzero(bad)[0])
            return f"links[{at}]: {found[at].tolist()}: {why}"
    return None


def delivery(found: object, state: State, sent: int) -> str | None:
    """Packets heard (m, 4), sorted, with valid ids; none from the future."""
    if not isinstance(found, Delivery):
        return f"deliver: {type(found).__name__}; expected a Delivery"
    wrong = array("heard", found.heard, np.int32, None, 4)
    if wrong is not None or checks.letters_hold(found.heard, state.robots, state.iteration):
        return wrong
    ids = found.heard[:, :2]
    if ids.min() < 0 or ids.max() >= state.robots:
        return f"heard: an unknown robot; expected ids from 0 to {state.robots - 1}"
    if (found.heard[:, 2] > state.iteration).any():
        return "heard: a message that has not been sent yet"
    return "heard: letters have to be sorted by receiver, sender and iteration sent"


def declared(found: object, robots: int) -> str | None:
    """What is wrong with a sensor's declaration, or None."""
    if not isinstance(found, Channels):
        return f"channels: {brief(found)}; expected Channels"
    return wrong_channels(found, robots)


def acting(found: object, robots: int) -> str | None:
    """What is wrong with an actuator's declaration, or None: plain columns, with a number at rest."""
    wrong = declared(found, robots)
    for channel in found if wrong is None and isinstance(found, Channels) else ():
        if "." in channel.name or channel.structure or channel.count or channel.group or channel.frame != "body":
            return f"{channel.name!r}: of a frame, a group or a structure; expected a plain channel, as minds name it"
        if not channel.low <= channel.empty <= channel.high:
            wanted = f"expected a blank within {channel.low:g} and {channel.high:g}"
            return f"{channel.name!r}: rests at {channel.empty:g}; {wanted}"
    return wrong


def commands(found: object, robots: int, channels: Channels) -> str | None:
    """A dict with columns of the actuators' declared types and shapes, a row per robot; any may be left out."""
    if type(found) is not dict:
        return f"commands: {brief(found)}; expected a dict of arrays by channel"
    for name, column in found.items():
        channel = next((one for one in channels if one.name == name), None)
        if channel is None:
            wanted = nearest(str(name), channels.places)
            return f"commands: {brief(name)}, which no actuator of these robots takes; {wanted}"
        wrong = array(f"commands[{name!r}]", column, np.dtype(channel.dtype).type, robots, *channel.shape)
        if wrong is not None:
            return wrong
    return None


def readings(found: object, state: State, channels: Channels, verb: str = "sense") -> str | None:
    """Readings with the declared columns, types, shapes and bounds, a row per robot."""
    if not isinstance(found, Readings):
        return f"{verb}: {type(found).__name__}; expected Readings"
    if found.channels is not channels and found.channels != channels:
        return f"{verb}: gives {found.channels.listed()}; expected what it declares, {channels.listed()}"
    if len(found.columns) != len(channels):
        return f"{verb}: {len(found.columns)} columns; expected one for each of {len(channels)} channels"
    for channel, column in zip(channels, found.columns, strict=True):
        kind = np.dtype(channel.dtype).type
        wrong = array(channel.name, column, kind, state.robots, *channel.shape, finite=verb == "act")
        wrong = wrong or _out_of_bounds(channel, column)
        if wrong is not None:
            return wrong
    return None


def _out_of_bounds(channel: Channel, column: Column) -> str | None:
    """What is wrong with a channel's numbers, or None; unmeasured ones are blank or NaN."""
    if channel.dtype == "?" or (channel.low, channel.high) == (-math.inf, math.inf):
        return None
    strange: NDArray[np.bool_] = ~((column >= channel.low) & (column <= channel.high)) & (column != channel.empty)
    if column.dtype.kind == "f":
        strange &= ~np.isnan(column)
    if not strange.any():
        return None
    return f"{channel.name}: {column[strange][0]} at {_first(strange)}; expected {channel.low:g} to {channel.high:g}"


def located(found: object, state: State) -> str | None:
    """Estimated poses (n, 3)."""
    return array("locate", found, np.float64, state.robots, 3)


def said(found: object, senses: Senses) -> str | None:
    """One message per robot, with items counted without gaps."""
    if not isinstance(found, Broadcast) or not isinstance(found.content, MessageBatch):
        return f"say: {type(found).__name__}; expected Said, with Columns as its content"
    n, items = len(senses.alive), len(found.content)
    wrong = first_of(array("ends", found.ends, np.int64, n), array("sizes", found.sizes, np.int32, n))
    if wrong is not None:
        return wrong
    lengths = {len(column) for column in found.content.arrays()}
    if len(lengths) > 1 and not found.content.RAGGED:
        return f"content: columns of {' and '.join(map(str, sorted(lengths)))} items; expected one length"
    if checks.messages_hold(found.ends, found.sizes, items):
        return None
    if (found.sizes < 0).any():
        return "sizes: below 0 bytes"
    return f"ends: {found.ends.tolist()[:8]} for {items} items; expected them to rise to that number"


def knowledge(found: object, kind: type[Knowledge]) -> str | None:
    """Knowledge of the declared kind, in plain arrays of numbers."""
    if not isinstance(found, kind):
        return f"hear: {type(found).__name__}; expected {kind.__name__}"
    return next((wrong for one in found.arrays() if (wrong := _plain(kind.__name__, one)) is not None), None)


def _plain(name: str, found: object) -> str | None:
    """What is wrong with an array of any shape and number type, or None."""
    if type(found) is not np.ndarray:
        return f"{name}: {brief(found)}; expected a plain array of numbers"
    return None if found.dtype.kind in "fiub" else f"{name}: an array of {found.dtype}; expected numbers"


#: Each table's row type and shape, and whether it has one row per iteration.
Form = dict[str, tuple[np.dtype[np.generic], tuple[int, ...], str]]


def record(found: Record, seam: str, robots: int, before: Form | None) -> tuple[Form, str | None]:
    """The form of a part's recorded data, and what is wrong with it, if anything.

    Names may not be taken, and the form must equal `before`, that of the previous iteration; None: in the first.
    """
    form: Form = {}
    verb = "measure" if seam == "task" else "hear"
    for rows, table in ((layout.EACH, found.rows), (layout.MANY, found.lists)):
        for name, given in table.items():
            row = np.asarray(given)
            wrong = None if np.isscalar(given) else _plain(f"{name!r}", given)
            wrong = first_of(wrong, layout.wrong_name(name, seam))
            if wrong is None and rows == layout.MANY and row.ndim > 0:
                row = np.empty(row.shape[1:], row.dtype)
            wrong = wrong or layout.wrong_form(name, row, rows, robots)
            if wrong is not None:
                return form, f"{verb}: {wrong}"
            form[name] = row.dtype, row.shape, rows
    if before is not None and form != before:
        name = next(name for name in (*before, *form) if before.get(name) != form.get(name))
        first, now = (f"{one[name][0]} of shape {one[name][1]}" if name in one else "nothing" for one in (before, form))
        wanted = "expected the same names, types and shapes in every iteration"
        return form, f"{verb}: {name!r} is {now} after {first}; {wanted}"
    return form, None


def intents(found: object, senses: Senses, actuators: Channels) -> str | None:
    """Paths, velocities and commands with a row for each robot, all finite; goals are points, or NaN."""
    if not isinstance(found, Intents):
        return f"step: {type(found).__name__}; expected Intents"
    n = len(senses.alive)
    wrong = first_of(
        array("goals", found.goals, np.float64, n, 2, finite=False),
        array("waypoints", found.waypoints, np.float64, n, None, 2),
        array("counts", found.counts, np.int32, n),
        array("planned", found.planned, np.bool_, n),
    )
    if wrong is None:
        far = ~(np.isfinite(found.goals).all(axis=1) | np.isnan(found.goals).all(axis=1))
        if far.any():
            robot = int(np.flatnonzero(far)[0])
            wrong = f"goals[{robot}]: {found.goals[robot].tolist()}; expected x, y in m, or NaN twice for none"
    elif getattr(found.goals, "dtype", np.dtype("f8")).kind in "iu":
        wrong = f"{wrong}: points in m, not cells, whose middles `lattice.centres(cells)` are; NaN for none"
    if wrong is None and found.twists is not None:
        width = 3 if found.twists.ndim == 2 and found.twists.shape[1] == 3 else 2
        wrong = array("twists", found.twists, np.float64, n, width, finite=False)
        if wrong is None and not np.isfinite(found.twists).all():
            follows = np.isnan(found.twists).all(axis=1) & (found.counts > 0)
            strange = np.flatnonzero(~np.isfinite(found.twists).all(axis=1) & ~follows & senses.alive)
            if len(strange):
                robot = int(strange[0])
                wrong = (
                    f"twists[{robot}]: robot {robot} at {found.twists[robot].tolist()}; expected finite m/s and rad/s, "
                    "0 to stand, or NaN twice for a robot that follows waypoints"
                )
    if wrong is None and not checks.counts_hold(found.counts, found.waypoints.shape[1]):
        wrong = f"counts: {found.counts.max()} of {found.waypoints.shape[1]} waypoints"
    return wrong if wrong is not None else commands(found.commands, n, actuators)


def measured(found: object, robots: int, curve: Curve) -> str | None:
    """Numeric measures, the curve's among them, also per robot; the progress, and whether it is finished."""
    if not isinstance(found, Measured) or not found.values:
        return f"measure: {brief(found)}; expected Measured, with one value at least"
    for name, value in found.values.items():
        real = isinstance(value, float | int | np.number) and not isinstance(value, np.complexfloating)
        if not real or (isinstance(value, int) and abs(value) > sys.float_info.max):
            return f"values[{name!r}]: {brief(value)}; expected a number"
    for name, row in found.robots.items():
        wrong = _plain(f"robots[{name!r}]", row)
        if wrong is None and row.shape[:1] != (robots,):
            wrong = f"robots[{name!r}]: {brief(row)}; expected a row for each of {robots} robots"
        if wrong is not None:
            return wrong
    if not isinstance(found.progress, float | int | np.number) or not 0.0 <= found.progress <= 1.0:
        return f"progress: {brief(found.progress)}; expected a number from 0 to 1"
    if not isinstance(found.finished, bool | np.bool_):
        return f"finished: {brief(found.finished)}; expected True or False"
    if curve.name not in found.values:
        return f"values: {nearest(curve.name, found.values)}; expected {curve.name!r}, which the task's curve is about"
    if curve.robots is not None and curve.robots not in found.robots:
        return f"robots: {nearest(curve.robots, found.robots)}; expected {curve.robots!r}, which the task's curve names"
    return None


def summary(found: object, taken: Collection[str]) -> str | None:
    """Numbers, or None where undefined, under names that are not taken."""
    if not isinstance(found, Mapping):
        return f"summary: {brief(found)}; expected numbers by name"
    for name, value in found.items():
        if name in taken:
            listed = ", ".join(sorted(taken))
            return (
                f"summary: {name!r} is measured of every run; expected another name, as 'own_{name}' (taken: {listed})"
            )
        if value is not None and (
            not isinstance(value, float | int | np.number) or isinstance(value, np.complexfloating)
        ):
            return f"summary: {name!r}: {brief(value)}; expected a number, or None"
    return None


def message_sizes(said: Broadcast[Any], codec: Codec[Any], iteration: int) -> str | None:
    """Whether every message has its announced size, and survives packing and unpacking unchanged."""
    for robot, size in enumerate(said.sizes.tolist()):
        items = whole(said, robot)
        if len(items) == 0 and size == 0:
            continue
        packed = codec.pack(robot, iteration, items)
        if len(packed) != size:
            return f"robot {robot}: {size} bytes announced, {len(packed)} packed"
        sender, sent, back = codec.unpack(packed)
        same = all(
            np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
            for a, b in zip(items.arrays(), back.arrays(), strict=True)
        )
        if (sender, sent) != (robot, iteration) or not same:
            return f"robot {robot}: packing and unpacking changes the message"
    return None
