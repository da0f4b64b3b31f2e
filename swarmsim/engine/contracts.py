"""What every part promises, as checks that say what is wrong: run on the parts of others always, on ours in tests."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.messages import Codec, Columns, Delivery, Said
from swarmsim.core.state import Intents, Knowledge, Measured, Observations, Readings, State
from swarmsim.kernels import checks


def array(name: str, found: Any, dtype: Any, *shape: int | None, finite: bool = True) -> str | None:
    """What is wrong with an array that should have this type and shape (None: any length), or None."""
    if isinstance(found, np.ndarray):
        kind = found.dtype
        whole = kind.type is dtype and kind.isnative and (found.shape == shape or _fits(found.shape, shape))
        if whole and (not finite or kind.kind != "f" or math.isfinite(np.vdot(found, found))):
            return None
    wanted = f"{np.dtype(dtype)} of shape ({', '.join('any' if side is None else str(side) for side in shape)})"
    if not isinstance(found, np.ndarray):
        return f"{name}: {type(found).__name__}; expected an array, {wanted}"
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
    """The first thing that is wrong, or None."""
    return next((problem for problem in problems if problem is not None), None)


def links(found: Any, state: State) -> str | None:
    """Links (m, 2) among live robots, sorted by receiver, then sender; no self link, each pair at most once."""
    wrong = array("links", found, np.int32, None, 2)
    if wrong is not None or checks.links_hold(found, state.alive):
        return wrong
    receivers, senders = found.T
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


def delivery(found: Any, state: State, sent: int) -> str | None:
    """Letters heard (m, 4), sorted, with ids of robots; nothing from the future."""
    if not isinstance(found, Delivery):
        return f"deliver: {type(found).__name__}; expected a Delivery"
    wrong = array("heard", found.heard, np.int32, None, 4)
    if wrong is not None or checks.letters_hold(found.heard, state.robots, state.iteration):
        return wrong
    ids = found.heard[:, :2]
    if ids.min() < 0 or ids.max() >= state.robots:
        return f"heard: a robot that there is not; expected ids from 0 to {state.robots - 1}"
    if (found.heard[:, 2] > state.iteration).any():
        return "heard: a message that has not been sent yet"
    return "heard: letters have to be sorted by receiver, sender and iteration sent"


def readings(found: Any, state: State) -> str | None:
    """Readings with a row for each robot."""
    if not isinstance(found, Readings):
        return f"sense: {type(found).__name__}; expected Readings"
    n, tiles, wrong = state.robots, found.tiles, None
    if tiles is not None:
        wrong = first_of(
            array("tiles.values", tiles.values, np.uint8, n, None, None),
            array("tiles.origins", tiles.origins, np.int32, n, 2),
        )
        if wrong is None and tiles.evidence is not None:
            wrong = array("tiles.evidence", tiles.evidence, np.float32, *tiles.values.shape, finite=False)
        if wrong is None and not checks.cells_hold(tiles.values):
            wrong = f"tiles.values: {tiles.values.max()}; expected UNKNOWN, FREE or OCCUPIED"
    if wrong is None and found.beams is not None:
        wrong = array("beams.ranges", found.beams.ranges, np.float64, n, None, finite=False)
    if wrong is None and found.field is not None:
        wrong = array("field", found.field, np.float64, n, finite=False)
    return wrong


def pose(found: Any, state: State) -> str | None:
    """Estimated poses (n, 3)."""
    return array("pose", found, np.float64, state.robots, 3)


def said(found: Any, observations: Observations) -> str | None:
    """One message of each robot, whose items are counted without a gap."""
    if not isinstance(found, Said) or not isinstance(found.content, Columns):
        return f"say: {type(found).__name__}; expected Said, with Columns as its content"
    n, items = len(observations.alive), len(found.content)
    wrong = first_of(array("ends", found.ends, np.int64, n), array("sizes", found.sizes, np.int32, n))
    if wrong is not None:
        return wrong
    lengths = {len(column) for column in found.content.arrays()}
    if len(lengths) > 1:
        return f"content: columns of {' and '.join(map(str, sorted(lengths)))} items; expected one length"
    if checks.messages_hold(found.ends, found.sizes, items):
        return None
    if (found.sizes < 0).any():
        return "sizes: below 0 bytes"
    return f"ends: {found.ends.tolist()[:8]} for {items} items; expected them to rise to that number"


def knowledge(found: Any, kind: type[Knowledge]) -> str | None:
    """Knowledge of the kind announced."""
    return None if isinstance(found, kind) else f"hear: {type(found).__name__}; expected {kind.__name__}"


def intents(found: Any, observations: Observations) -> str | None:
    """Ways and velocities with a row for each robot, all finite."""
    if not isinstance(found, Intents):
        return f"step: {type(found).__name__}; expected Intents"
    n = len(observations.alive)
    wrong = first_of(
        array("goals", found.goals, np.int32, n, 2),
        array("waypoints", found.waypoints, np.float64, n, None, 2),
        array("counts", found.counts, np.int32, n),
        array("planned", found.planned, np.bool_, n),
    )
    if wrong is None and found.twists is not None:
        wrong = array("twists", found.twists, np.float64, n, 2, finite=False)
        if wrong is None and np.isinf(found.twists).any():
            wrong = "twists: infinite; expected m/s and rad/s, or NaN where a robot follows its waypoints"
    if wrong is None and not checks.counts_hold(found.counts, found.waypoints.shape[1]):
        wrong = f"counts: {found.counts.max()} of {found.waypoints.shape[1]} waypoints"
    return wrong


def measured(found: Any, robots: int) -> str | None:
    """Measures that are numbers, one of them at least."""
    if not isinstance(found, Measured) or not found.values:
        return f"measure: {type(found).__name__}; expected Measured, with one value at least"
    strange = [name for name, value in found.values.items() if not isinstance(value, float | int | np.number)]
    if strange:
        return f"values[{strange[0]!r}]: {type(found.values[strange[0]]).__name__}; expected a number"
    rows = [name for name, row in found.robots.items() if np.shape(row)[:1] != (robots,)]
    return f"robots[{rows[0]!r}]: expected a row for each of {robots} robots" if rows else None


def message_sizes(said: Said[Any], codec: Codec[Any], iteration: int) -> str | None:
    """Whether every message is as long as its sender says, and comes out of the codec as it went in."""
    for robot, size in enumerate(said.sizes.tolist()):
        items = said.of(robot)
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
            return f"robot {robot}: the message does not come out as it went in"
    return None
