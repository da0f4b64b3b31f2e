"""Which robots are near which.

All functions that call each other live in this file: numba's cache does not notice edits elsewhere. Links are
(m, 2) int32: receiver, sender; sorted. Edges are (e, 2) int32: two robots in any order, each pair once.
"""

from __future__ import annotations

import math

import numpy as np

from swarmsim.kernels.compiling import njit

FEW = 48  # robots: up to here, comparing all pairs costs less than sorting first
ROUNDING = 1e-12  # relative: more than the error of a distance or of a sum of two


@njit(cache=True)
def everybody(alive):
    """Links from every live robot to all other live ones."""
    live = np.flatnonzero(alive)
    links = np.empty((len(live) * max(len(live) - 1, 0), 2), np.int32)
    count = 0
    for i in live:
        for j in live:
            if j != i:
                links[count, 0] = i
                links[count, 1] = j
                count += 1
    return links


@njit(cache=True)
def among_live(links, alive):
    """The links whose two robots are alive, in the same order."""
    kept = np.empty_like(links)
    count = 0
    for m in range(len(links)):
        if alive[links[m, 0]] and alive[links[m, 1]]:
            kept[count, 0] = links[m, 0]
            kept[count, 1] = links[m, 1]
            count += 1
    return kept[:count]


@njit(cache=True)
def mutual(links):
    """The links that run both ways, in the same order."""
    kept = np.empty_like(links)
    count = 0
    first = np.searchsorted(links[:, 0], np.arange(links[-1, 0] + 2 if len(links) else 1))
    for m in range(len(links)):
        i, j = links[m]
        if j + 1 < len(first):
            heard = links[first[j] : first[j + 1], 1]
            place = np.searchsorted(heard, i)
            if place < len(heard) and heard[place] == i:
                kept[count, 0] = i
                kept[count, 1] = j
                count += 1
    return kept[:count]


@njit(cache=True)
def both_ways(edges, robots):
    """The links that run along each edge in both directions; sorted by counting, in time linear in their number."""
    start = np.zeros(robots + 1, np.int64)
    for e in range(len(edges)):
        start[edges[e, 0] + 1] += 1
        start[edges[e, 1] + 1] += 1
    start = np.cumsum(start)
    beside = np.empty(2 * len(edges), np.int32)  # the neighbours of each robot, in the order of the edges
    end = start.copy()
    for e in range(len(edges)):
        for i, j in ((edges[e, 0], edges[e, 1]), (edges[e, 1], edges[e, 0])):
            beside[end[i]] = j
            end[i] += 1
    links = np.empty((2 * len(edges), 2), np.int32)
    end = start.copy()
    for j in range(robots):  # each robot enters itself at its neighbours, so that their lists rise
        for m in range(start[j], start[j + 1]):
            i = beside[m]
            links[end[i], 0] = i
            links[end[i], 1] = j
            end[i] += 1
    return links


@njit(cache=True)
def _offer(keys, who, found, key, j):
    """Keep candidate j if it is among the first len(keys) by key, then by id; gives how many are kept."""
    if found == len(keys):
        if key > keys[found - 1] or (key == keys[found - 1] and j > who[found - 1]):
            return found
    else:
        found += 1
    slot = found - 1
    while slot > 0 and (keys[slot - 1] > key or (keys[slot - 1] == key and who[slot - 1] > j)):
        keys[slot] = keys[slot - 1]
        who[slot] = who[slot - 1]
        slot -= 1
    keys[slot] = key
    who[slot] = j
    return found


@njit(cache=True)
def _write(links, first, receiver, who):
    """Write the links of one receiver, senders sorted, from row `first` on."""
    for m in range(len(who)):
        slot = first + m
        while slot > first and links[slot - 1, 1] > who[m]:
            links[slot, 1] = links[slot - 1, 1]
            slot -= 1
        links[slot, 1] = who[m]
        links[first + m, 0] = receiver


@njit(cache=True)
def _apart(positions, i, j):
    dx = positions[j, 0] - positions[i, 0]
    dy = positions[j, 1] - positions[i, 1]
    return math.sqrt(dx * dx + dy * dy)


@njit(cache=True)
def _along(positions, live):
    """The axis along which these robots are spread furthest, and their order along it."""
    axis = 0
    if len(live) > 0:
        x = positions[live, 0]
        y = positions[live, 1]
        axis = 1 if y.max() - y.min() > x.max() - x.min() else 0
    return axis, live[np.argsort(positions[live, axis])]


def nearest(positions, alive, k):
    """Links from every live robot to its k nearest live others; all of them where there are fewer than k.

    `positions` (n, 2 or more): x, y. Ties in distance go to the lower id.
    """
    live = np.count_nonzero(alive)
    if 0 < live - 1 <= k:
        return everybody(alive)
    return _nearest_of_few(positions, alive, k) if live <= FEW else _nearest_of_many(positions, alive, k)


@njit(cache=True)
def _nearest_of_few(positions, alive, k):
    """As `nearest`, by comparing all pairs."""
    live = np.flatnonzero(alive)
    each = min(k, len(live) - 1)
    if each <= 0:
        return np.empty((0, 2), np.int32)
    links = np.empty((len(live) * each, 2), np.int32)
    keys = np.empty(each)
    who = np.empty(each, np.int32)
    for rank in range(len(live)):
        i = live[rank]
        found = np.int64(0)
        for j in live:
            if j != i:
                apart = _apart(positions, i, j)
                if found < each or apart < keys[each - 1]:  # ids rise: of two equally far away the first is kept
                    found = _offer(keys, who, found, apart, j)
        _write(links, rank * each, i, who)
    return links


@njit(cache=True)
def nearest_around(positions, alive, k, width, height):
    """As `nearest`, on a page of this size (m) whose opposite edges coincide: distances are the shortest around it."""
    live = np.flatnonzero(alive)
    each = min(k, len(live) - 1)
    if each <= 0:
        return np.empty((0, 2), np.int32)
    links = np.empty((len(live) * each, 2), np.int32)
    keys = np.empty(each)
    who = np.empty(each, np.int32)
    for rank in range(len(live)):
        i = live[rank]
        found = np.int64(0)
        for j in live:
            if j != i:
                dx = positions[j, 0] - positions[i, 0]
                dy = positions[j, 1] - positions[i, 1]
                dx -= width * np.round(dx / width)
                dy -= height * np.round(dy / height)
                apart = math.sqrt(dx * dx + dy * dy)
                if found < each or apart < keys[each - 1]:  # ids rise: of two equally far away the first is kept
                    found = _offer(keys, who, found, apart, j)
        _write(links, rank * each, i, who)
    return links


@njit(cache=True)
def _nearest_of_many(positions, alive, k):
    """As `nearest`, by searching outwards from every robot along the axis along which the swarm is spread further."""
    live = np.flatnonzero(alive)
    each = min(k, len(live) - 1)
    if each <= 0:
        return np.empty((0, 2), np.int32)
    axis, order = _along(positions, live)
    x = positions[order, axis]
    y = positions[order, 1 - axis]
    links = np.empty((len(live) * each, 2), np.int32)
    keys = np.empty(each)
    who = np.empty(each, np.int32)
    for place in range(len(order)):
        found = np.int64(0)
        limit = math.inf  # m^2: robots farther away are not among the nearest, with a margin for rounding
        for step in (-1, 1):
            other = place + step
            while 0 <= other < len(order):
                along = x[other] - x[place]
                across = y[other] - y[place]
                other += step
                if along * along > limit:
                    break
                if along * along + across * across <= limit:
                    apart = math.sqrt(along * along + across * across)
                    found = _offer(keys, who, found, apart, order[other - step])
                    if found == each:
                        limit = keys[each - 1] * keys[each - 1] * (1.0 + ROUNDING)
        _write(links, np.searchsorted(live, order[place]) * each, order[place], who)
    return links


@njit(cache=True)
def farthest(positions, alive, k):
    """Links from every live robot to its k farthest live others; all of them where there are fewer than k.

    `positions` (n, 2 or more): x, y. Ties in distance go to the lower id.
    """
    live = np.flatnonzero(alive)
    each = min(k, len(live) - 1)
    if each <= 0:
        return np.empty((0, 2), np.int32)
    links = np.empty((len(live) * each, 2), np.int32)
    keys = np.empty(each)
    who = np.empty(each, np.int32)
    middle = np.empty((1, 2))
    middle[0, 0] = positions[live, 0].mean()
    middle[0, 1] = positions[live, 1].mean()
    off = np.empty(len(live))
    for rank in range(len(live)):
        off[rank] = math.hypot(positions[live[rank], 0] - middle[0, 0], positions[live[rank], 1] - middle[0, 1])
    outside_in = np.argsort(-off)
    for rank in range(len(live)):
        i = live[rank]
        found = np.int64(0)
        for other in outside_in:
            j = live[other]
            # no robot further in is farther away than by way of the middle
            if found == each and (off[rank] + off[other]) * (1.0 + ROUNDING) < -keys[each - 1]:
                break
            if j != i:
                found = _offer(keys, who, found, -_apart(positions, i, j), j)
        _write(links, rank * each, i, who)
    return links


@njit(cache=True)
def within(positions, alive, radius):
    """The edges between live robots at most `radius` apart, in m; inf for all pairs."""
    axis, order = _along(positions, np.flatnonzero(alive))
    edges = np.empty((4 * len(order), 2), np.int32)
    count = 0
    for place in range(len(order)):
        i = order[place]
        if count + len(order) > len(edges):
            more = np.empty((2 * len(edges) + len(order), 2), np.int32)
            more[:count] = edges[:count]
            edges = more
        for next_ in range(place + 1, len(order)):
            j = order[next_]
            if positions[j, axis] - positions[i, axis] > radius:
                break
            if _apart(positions, i, j) <= radius:
                edges[count, 0] = i
                edges[count, 1] = j
                count += 1
    return edges[:count]
