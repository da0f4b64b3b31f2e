"""Radios that share the air: who finds it free, and whose frames overlap at a receiver."""

from __future__ import annotations

import heapq
import math

import numpy as np

from swarmsim.kernels.compiling import njit

ROUNDING = 1e-9  # of a frame: frames in slots that follow one another do not overlap


@njit(cache=True)
def _near(places, i, j, reach):
    return math.hypot(places[i, 0] - places[j, 0], places[i, 1] - places[j, 1]) <= reach


@njit(cache=True)
def listen_first(ready, airtime, waits, places, reach, turnaround):
    """When each robot begins to send if it listens first: non-persistent carrier sense.

    A robot listens at `ready` (n,) s. If a frame within `reach` (m) of its place in `places` (n, 2) is on the air, it
    listens again after the next of its `waits` (n, r) s; else its frame, of `airtime` (n,) s, begins `turnaround` s
    later. Robots of no airtime are silent. Gives the beginnings (n,) in s, or NaN for robots that never found it free.
    """
    count = len(ready)
    begins = np.full(count, np.nan)
    waiting = [(0.0, 0, 0) for _ in range(0)]
    for i in range(count):
        if airtime[i] > 0.0:
            heapq.heappush(waiting, (ready[i], i, 0))
    sending = [0 for _ in range(0)]
    while len(waiting) > 0:
        now, i, tries = heapq.heappop(waiting)
        sending = [j for j in sending if begins[j] + airtime[j] > now]
        busy = False
        for j in sending:
            if begins[j] <= now and _near(places, i, j, reach):
                busy = True
                break
        if not busy:
            begins[i] = now + turnaround
            sending.append(i)
        elif tries < waits.shape[1]:
            heapq.heappush(waiting, (now + waits[i, tries], i, tries + 1))
    return begins


@njit(cache=True)
def collided(receivers, senders, begins, airtime, places, reach, around):
    """Which frames, from `senders` (m,) to `receivers` (m,), another one overlaps where they are received.

    Robot i's frame begins at `begins` (n,) s and is on the air for `airtime` (n,) s; those of no airtime, or NaN, are
    not. Others count if they are sent within `reach` (m) of the receiver's place in `places` (n, 2), or by itself: it
    does not hear while it sends. Time runs round in `around` s, or straight on if that is 0.
    """
    lost = np.zeros(len(receivers), np.bool_)
    for m in range(len(receivers)):
        here, i = receivers[m], senders[m]
        if airtime[i] == 0.0:
            continue
        for j in range(len(begins)):
            if j == i or airtime[j] == 0.0 or math.isnan(begins[j]):
                continue
            overlap = False
            for turn in (-around, 0.0, around):
                gap = begins[j] - begins[i] + turn
                overlap |= gap > (ROUNDING - 1.0) * airtime[j] and gap < (1.0 - ROUNDING) * airtime[i]
            if overlap and (j == here or _near(places, here, j, reach)):
                lost[m] = True
                break
    return lost
