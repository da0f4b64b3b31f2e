"""Links drawn at random, each draw from the two ids, the iteration and a salt alone.

All functions that call each other live in this file: numba's cache does not notice edits elsewhere. Links are
(m, 2) int32: receiver, sender; sorted.
"""

from __future__ import annotations

import numpy as np

from swarmsim.kernels.compiling import njit, wrapping


@njit(cache=True)
@wrapping
def scramble(value):
    """A well-mixed 64-bit hash of a number (the finaliser of splitmix64, Steele et al. 2014)."""
    z = np.uint64(value) + np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


@njit(cache=True)
def _share(draw):
    """A 64-bit draw as a number in [0, 1)."""
    return (draw >> np.uint64(11)) * 2.0**-53


@njit(cache=True)
def random_links(salt, iteration, alive, p):
    """Links among live robots, each ordered pair with probability p, drawn from salt, iteration and the pair alone."""
    live = np.flatnonzero(alive)
    now = scramble(np.uint64(salt) ^ np.uint64(iteration))
    links = np.empty((len(live), 2), np.int32)
    count = 0
    for i in live:
        mine = scramble(now ^ np.uint64(i))
        if count + len(live) > len(links):
            more = np.empty((2 * len(links) + len(live), 2), np.int32)
            more[:count] = links[:count]
            links = more
        for j in live:
            if j != i and _share(scramble(mine ^ np.uint64(j))) < p:
                links[count, 0] = i
                links[count, 1] = j
                count += 1
    return links[:count]


@njit(cache=True)
def random_senders(salt, iteration, alive, k):
    """Links from every live robot to k live others drawn at random; all of them where there are fewer than k.

    Each receiver draws one number for each other robot, from salt, iteration and the two ids alone, and hears the
    robots with the lowest: if one dies, only its listeners change.
    """
    live = np.flatnonzero(alive)
    each = min(k, len(live) - 1)
    if each <= 0:
        return np.empty((0, 2), np.int32)
    now = scramble(np.uint64(salt) ^ np.uint64(iteration))
    links = np.empty((len(live) * each, 2), np.int32)
    draws = np.empty(each, np.uint64)
    who = np.empty(each, np.int32)
    for rank in range(len(live)):
        i = live[rank]
        mine = scramble(now ^ np.uint64(i))
        found = 0
        for j in live:
            draw = scramble(mine ^ np.uint64(j))
            if j == i or (found == each and draw >= draws[each - 1]):
                continue
            found = min(found + 1, each)
            slot = found - 1
            while slot > 0 and draws[slot - 1] > draw:
                draws[slot] = draws[slot - 1]
                who[slot] = who[slot - 1]
                slot -= 1
            draws[slot] = draw
            who[slot] = j
        links[rank * each : (rank + 1) * each, 0] = i
        links[rank * each : (rank + 1) * each, 1] = np.sort(who)
    return links


@njit(cache=True)
def small_world(salt, robots, k, p):
    """Links of a ring lattice in which every robot hears k < `robots` others, each sender redrawn with probability p.

    The lattice: each hears the next higher id, the next lower, the one after the next higher, and so on around. A
    redrawn sender is any robot but the receiver and those it hears (as in Watts & Strogatz 1998); without any other,
    the link stays.
    """
    links = np.empty((robots * k, 2), np.int32)
    who = np.empty(k, np.int32)
    heard = np.zeros(robots, np.bool_)
    for i in range(robots):
        heard[:] = False
        heard[i] = True
        for s in range(k):
            step = s // 2 + 1
            who[s] = (i + step if s % 2 == 0 else i - step) % robots
            heard[who[s]] = True
        mine = scramble(np.uint64(salt) ^ np.uint64(i))
        for s in range(k):
            draw = scramble(mine ^ np.uint64(s))
            if _share(draw) >= p:
                continue
            best = -1
            lowest = np.uint64(0)
            for j in range(robots):
                ticket = scramble(draw ^ np.uint64(j))
                if not heard[j] and (best < 0 or ticket < lowest):
                    best = j
                    lowest = ticket
            if best >= 0:
                heard[who[s]] = False
                heard[best] = True
                who[s] = best
        links[i * k : (i + 1) * k, 0] = i
        links[i * k : (i + 1) * k, 1] = np.sort(who)
    return links
