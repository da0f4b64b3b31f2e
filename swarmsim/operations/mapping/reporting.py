"""What mapping robots in processes of their own report of their maps, and the maps of a swarm put together from that.

A report tells the cells whose state has changed and what was taken in: as much as recordings and measures need.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.messages import FrameError, Inbox
from swarmsim.core.readings import Column, Tiles
from swarmsim.core.reports import Report
from swarmsim.core.state import OCCUPIED, UNKNOWN
from swarmsim.operations.mapping.maps import Frames, Maps, TileItems

#: The columns of a report: its head, the changes, five of frames of reference, and then those of what was taken in.
HEAD, CHANGES, FRAMES, ACCEPTED = 0, 1, 2, 7
ODDS: Final = np.array([0.0, -1.0, 1.0], np.float32)  # by state UNKNOWN, FREE, OCCUPIED: of log-odds only the sign


def told(maps: Maps, tiles: Tiles, everywhere: bool, all_taken: bool, columns: int) -> Report:
    """The report of one robot with its own `tiles`, on maps with so many `columns`.

    The head tells how many of the changes lie in its own tile (-1: changes are sorted by cell), how many cells it
    first learned of, and whether it took in all that it heard.
    """
    changes = maps.changes[:, 1:]
    row, column = np.divmod(changes[:, 0], columns)
    first, shape = tiles.origins[0], tiles.values.shape[1:]
    own = (row >= first[0]) & (row < first[0] + shape[0]) & (column >= first[1]) & (column < first[1] + shape[1])
    head = np.array([-1 if everywhere else own.sum(), maps.new_cells[0], all_taken], np.int32)
    known = maps.frames
    frames = () if known is None else (known.known, known.errors, known.places, known.withdrawn, known.spoilt)
    accepted = () if all_taken else maps.accepted.arrays()[1:]
    return head, changes, *([one[0] for one in frames] or [np.empty(0, np.bool_)] * 5), *accepted


def combined(before: Report, came: Sequence[Report]) -> Report:
    """One report for several of a robot, or for none: of each cell the latest change, and frames as they are now."""
    if len(came) == 1:
        return came[0]
    last = came[-1] if came else before
    changes = np.concatenate([np.empty((0, 2), np.int32), *(report[CHANGES] for report in came)])
    cells, newest = np.unique(changes[::-1, 0], return_index=True)
    changes = np.column_stack([cells, changes[::-1, 1][newest]]).astype(np.int32)
    new_cells = sum(int(report[HEAD][1]) for report in came)
    return np.array([-1, new_cells, 1], np.int32), changes, *last[FRAMES:ACCEPTED]


def with_forgotten(
    changes: NDArray[np.int32], shown: NDArray[np.uint8], observed: NDArray[np.bool_]
) -> NDArray[np.int32]:
    """The changes (c, 3), and of the cells `shown` (n, cells) those to UNKNOWN that are observed no more."""
    there = shown.copy()
    there[changes[:, 0], changes[:, 1]] = changes[:, 2]
    robots, cells = np.nonzero((there != UNKNOWN) & ~observed)
    forgotten = np.column_stack([robots, cells, np.full(len(cells), UNKNOWN)]).astype(np.int32)
    found = np.concatenate([changes, forgotten])
    return found[np.lexsort((found[:, 1], found[:, 0]))]


def changes_of(reports: Sequence[Report], cells: int, by_cell: bool) -> NDArray[np.int32]:
    """All changes (c, 3), in the order of a computation that serves all: `by_cell` if one robot's are.

    Raises FrameError for a change that cannot be.
    """
    own, others = [], []
    for robot, report in enumerate(reports):
        found = np.column_stack([np.full(len(report[CHANGES]), robot), report[CHANGES]]).astype(np.int32)
        count = int(report[HEAD][0]) if report[HEAD][0] >= 0 else len(found)
        own.append(found[:count])
        others.append(found[count:])
    changes = np.concatenate([*own, *others])
    if len(changes) and (changes[:, 1:].min() < 0 or changes[:, 1].max() >= cells or changes[:, 2].max() > OCCUPIED):
        raise FrameError("a change of a cell, or to a state, that does not exist")
    if by_cell or any(report[HEAD][0] < 0 for report in reports):
        changes = changes[np.lexsort((changes[:, 1], changes[:, 0]))]
    return changes


def accepted_of(reports: Sequence[Report], inbox: Inbox[TileItems]) -> Inbox[TileItems]:
    """What all robots have taken in; those that took in all do not repeat it."""
    if all(report[HEAD][2] for report in reports):
        return inbox
    parts = []
    for robot, report in enumerate(reports):
        if report[HEAD][2]:
            parts.append(inbox.take(np.flatnonzero(inbox.receivers == robot)))
            continue
        senders, sent, *columns = report[ACCEPTED:]
        receivers = np.full(len(senders), robot, np.int32)
        parts.append(replace(inbox, receivers=receivers, senders=senders, sent=sent, content=_like(inbox, columns)))
    receivers, senders, sent = (np.concatenate(one) for one in zip(*(part.dates() for part in parts), strict=True))
    content = type(inbox.content).joined([one.content for one in parts])
    return Inbox(receivers, senders, sent, content, inbox.oldest)


def _like(inbox: Inbox[TileItems], columns: Sequence[Column]) -> TileItems:
    kinds = [(one.dtype, one.ndim) for one in inbox.content.arrays()]
    if [(one.dtype, one.ndim) for one in columns] != kinds:
        raise FrameError("tiles taken in, of other columns than those heard")
    return type(inbox.content)(*columns)


def take_frames(reports: Sequence[Report], frames: Frames | None) -> None:
    """Write what robots know of each other's frames of reference into those of the swarm."""
    if frames is None:
        return
    held: list[Column] = [frames.known, frames.errors, frames.places, frames.withdrawn, frames.spoilt]
    for robot, report in enumerate(reports):
        for mine, column in zip(held, report[FRAMES:ACCEPTED], strict=True):
            mine[robot] = column


def write(changes: NDArray[np.int32], observed: NDArray[np.bool_], log_odds: NDArray[np.float32]) -> None:
    """Write changes (c, 3) into grids (n, cells)."""
    robot, cell, state = changes.T
    observed[robot, cell] = state != UNKNOWN
    log_odds[robot, cell] = ODDS[state]
