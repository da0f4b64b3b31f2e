"""Occupancy grids of robots that do not trust all messages."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmsim.kernels.compiling import njit


class Votes(NamedTuple):
    """Which robots vouch for each cell; arrays are (n, rows, columns), the sets empty, (n, 0, 0), for a quorum of 1.

    A set of senders is a word of 64 bits: the bit of a sender is its id modulo 64, so that in larger swarms
    two senders may count as one, never one as two.
    """

    own: NDArray[np.bool_]  # whether the robot has sensed the cell itself
    free: NDArray[np.uint64]  # senders that called it free ...
    occupied: NDArray[np.uint64]  # ... and that it is occupied
    quorum: int  # how many must say the same


@njit(cache=True)
def fuse_warily(
    log_odds, observed, witnesses, alive, tiles, evidence, origins, receivers, senders, pieces, heard, heard_origins,
    hit, miss, low, high, fresh,
):  # fmt: skip
    """Update every occupancy grid with the robot's own tile, then with the messages that it accepts.

    As `occupancy.fuse` and then, for the `heard` tiles that are `pieces` (m,) of maps, `occupancy.fill`, but: messages
    change no cell that the robot has sensed itself; the first time it senses one, all that it heard of it is void; a
    message counts once `witnesses.quorum` senders have said the same.
    """
    robots = len(alive)
    for i in range(robots):
        fresh[i] = 0
        if alive[i]:
            said = evidence[i] if len(evidence) > 0 else np.full(tiles.shape[1:], np.nan, np.float32)
            fresh[i] = _sense(
                log_odds[i], observed[i], witnesses.own[i], tiles[i], said, origins[i, 0], origins[i, 1], hit, miss,
                low, high,
            )  # fmt: skip
    for beliefs in (False, True):
        for m in range(len(receivers)):
            if pieces[m] == beliefs:
                fresh[robots + m] = _hear(
                    log_odds, observed, witnesses, receivers[m], senders[m], beliefs, heard[m], heard_origins[m, 0],
                    heard_origins[m, 1], hit, miss, low, high,
                )  # fmt: skip


@njit(cache=True)
def _sense(log_odds, observed, own, tile, said, row0, column0, hit, miss, low, high):
    fresh = 0
    for r in range(max(0, -row0), min(tile.shape[0], observed.shape[0] - row0)):
        for c in range(max(0, -column0), min(tile.shape[1], observed.shape[1] - column0)):
            if tile[r, c] == 0:
                continue
            row, column = row0 + r, column0 + c
            fresh += not observed[row, column]
            if not own[row, column]:
                log_odds[row, column] = 0.0
            observed[row, column] = True
            own[row, column] = True
            gain = hit if tile[r, c] == 2 else miss
            if said[r, c] == said[r, c]:
                gain = said[r, c]
            log_odds[row, column] = min(max(log_odds[row, column] + gain, low), high)
    return fresh


@njit(cache=True)
def _hear(log_odds, observed, witnesses, i, sender, believed, tile, row0, column0, hit, miss, low, high):
    fresh = 0
    bit = np.uint64(1) << np.uint64(sender % 64)
    for r in range(max(0, -row0), min(tile.shape[0], observed.shape[1] - row0)):
        for c in range(max(0, -column0), min(tile.shape[1], observed.shape[2] - column0)):
            if tile[r, c] == 0:
                continue
            row, column = row0 + r, column0 + c
            known = observed[i, row, column]
            if known and witnesses.own[i, row, column]:
                continue
            if witnesses.quorum > 1:
                if not known:
                    _forget(witnesses, i, row, column)
                sayers = witnesses.occupied if tile[r, c] == 2 else witnesses.free
                sayers[i, row, column] |= bit
                if not _reaches(sayers[i, row, column], witnesses.quorum):
                    continue
            witnesses.own[i, row, column] = False
            if known and believed:
                continue
            observed[i, row, column] = True
            fresh += not known
            changed = log_odds[i, row, column] + (hit if tile[r, c] == 2 else miss)
            log_odds[i, row, column] = min(max(changed, low), high)
    return fresh


@njit(cache=True)
def _forget(witnesses, i, row, column):
    """Drop the senders of an unknown cell that was known before: it has been forgotten since."""
    sensed = witnesses.own[i, row, column]
    told = _reaches(witnesses.free[i, row, column], witnesses.quorum)
    if sensed or told or _reaches(witnesses.occupied[i, row, column], witnesses.quorum):
        witnesses.own[i, row, column] = False
        witnesses.free[i, row, column] = np.uint64(0)
        witnesses.occupied[i, row, column] = np.uint64(0)


@njit(cache=True)
def _reaches(senders, quorum):
    """Whether a set has at least `quorum` members."""
    count = 0
    while senders != np.uint64(0) and count < quorum:
        senders &= senders - np.uint64(1)  # without its lowest bit
        count += 1
    return count >= quorum
