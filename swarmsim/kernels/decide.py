"""Exploring robots' next steps, for the whole swarm: keep a way, choose a goal, give way, walk off."""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmsim.kernels import search
from swarmsim.kernels.compiling import compiles, njit
from swarmsim.kernels.search import (
    DCOLUMNS,
    DROWS,
    PAUSED,
    a_star,
    fits,
    is_frontier,
    nearest_frontier,
    nearest_stale,
    scramble,
    traced,
)  # fmt: skip


class Plans(NamedTuple):
    """The robots' plans; row i is robot i. Cells are row-major indices, -1 for none."""

    goal: NDArray[np.int32]  # (n,): the frontier cell to explore
    path: NDArray[np.int32]  # (n, cells): the way there, first cell first
    steps: NDArray[np.int32]  # (n,): cells of the path, 0 for none
    cursor: NDArray[np.int32]  # (n,): the step of the path that the robot has reached
    anchor: NDArray[np.float64]  # (n, 2): where it last made progress, x and y in m
    waited: NDArray[np.int32]  # (n,): iterations since then
    idle: NDArray[np.int32]  # (n,): until when an idle robot waits for news
    planned: NDArray[np.bool_]  # (n,): whether the path is new in this iteration


@njit(cache=True)
def _give_way(maps, i, now, rules, start, draw, path):
    """A random walk of at most 8 cells over free neighbours, never straight back; gives its cells."""
    columns = maps.observed.shape[2]
    path[0] = start
    count = 1
    for _ in range(1 + int(draw % np.uint64(8))):
        draw = scramble(draw)
        for turn in range(4):
            d = (int(draw % np.uint64(4)) + turn) % 4
            r = path[count - 1] // columns + DROWS[d]
            c = path[count - 1] % columns + DCOLUMNS[d]
            there = r * columns + c
            if fits(maps, i, now, rules, r, c) and not (count > 1 and there == path[count - 2]):
                path[count] = there
                count += 1
                break
    return count if count > 1 else 0


@njit(cache=True)
def _is_open(maps, i, now, rules, path, first, last):
    """Whether robot i still fits into every cell of path[first:last]."""
    columns = maps.observed.shape[2]
    for step in range(first, last):
        if not fits(maps, i, now, rules, path[step] // columns, path[step] % columns):
            return False
    return True


@njit(cache=True)
def _advance(plans, i, rules, u, v, columns):
    """Move the cursor to the step of the path, from the present one on, whose centre is nearest to (u, v)."""
    best = math.inf
    first = plans.cursor[i]
    for step in range(first, min(plans.steps[i], first + rules.window)):
        du = plans.path[i, step] % columns + 0.5 - u
        dv = plans.path[i, step] // columns + 0.5 - v
        if du * du + dv * dv < best:
            best = du * du + dv * dv
            plans.cursor[i] = step


@njit(cache=True)
def _is_stuck(plans, i, rules, x, y):
    """Whether robot i, having a path, has not moved by half a cell for `patience` iterations."""
    moved = math.hypot(x - plans.anchor[i, 0], y - plans.anchor[i, 1])
    if plans.steps[i] == 0 or moved >= 0.5 * rules.cell:
        plans.anchor[i, 0] = x
        plans.anchor[i, 1] = y
        plans.waited[i] = 0
        return False
    plans.waited[i] += 1
    if plans.waited[i] < rules.patience:
        return False
    plans.waited[i] = 0
    return True


@njit(cache=True)
def _drop(plans, i):
    plans.goal[i] = -1
    plans.steps[i] = 0
    plans.cursor[i] = 0


@njit(cache=True)
def _is_done(maps, patrol, i, columns, goal):
    """Whether robot i's goal is done: seen since on patrol, else no frontier any more."""
    if patrol.since[i] > 0:
        return patrol.seen[i, goal // columns, goal % columns] > patrol.since[i]
    return not is_frontier(maps, i, goal // columns, goal % columns)


@njit(cache=True)
def _reconsider(now, i, arrived, stuck, draw, maps, plans, patrol, rules):
    """Drop robot i's plan if its goal is done, if it has arrived, or if it is stuck (rules 1 to 3 of `decide`)."""
    columns = maps.observed.shape[2]
    goal = plans.goal[i]
    if goal >= 0 and _is_done(maps, patrol, i, columns, goal):
        _drop(plans, i)
    elif arrived:
        if goal >= 0 and patrol.since[i] == 0:
            maps.shunned[i, goal // columns, goal % columns] = now + 10 * rules.patience
        _drop(plans, i)
    elif stuck:
        ahead = plans.path[i, min(plans.cursor[i] + 1, plans.steps[i] - 1)]
        pause = rules.patience + int(draw % np.uint64(3 * rules.patience))
        maps.barred[i, ahead // columns, ahead % columns] = now + pause
        _drop(plans, i)
    if patrol.since[i] > 0 and plans.goal[i] < 0:
        patrol.since[i] = 0
        plans.idle[i] = now  # it looks for the next at once


@njit(cache=True)
def _explore(now, i, here, maps, plans, patrol, rules, salt, work):
    """Give robot i a plan for the nearest frontier; gives 1, 0 if there is none, or PAUSED.

    A bounded robot takes the way that this search has found, one of the shortest, and does without a second search.
    """
    goal, stand = nearest_frontier(maps, i, now, rules, here, salt, work)
    if stand == PAUSED:
        return PAUSED
    if stand < 0:
        return 0
    _drop(plans, i)
    patrol.since[i] = 0
    if rules.bounded:
        plans.steps[i] = traced(stand, work, plans.path[i])
    else:
        plans.steps[i] = a_star(maps, i, now, rules, here, stand, work, plans.path[i])
    plans.goal[i] = goal
    return 1


@njit(cache=True)
def _revisit(now, i, here, maps, plans, patrol, rules, salt, work):
    """Give robot i a plan for a stale cell, if robots patrol; gives whether there is one."""
    goal = nearest_stale(maps, patrol, i, now, rules, here, salt, work) if patrol.seen.shape[1] > 0 else -1
    if goal < 0:
        return False
    plans.steps[i] = a_star(maps, i, now, rules, here, goal, work, plans.path[i])
    plans.goal[i] = goal
    patrol.since[i] = now
    return True


@njit(cache=True)
def _look_up(now, i, pose, news, maps, plans, patrol, rules, salts):
    """Find robot i's cell, and drop its plan if it is done.

    Gives the cell, whether the robot is due to look for something to explore, whether it is stuck, and its draw.
    """
    columns = maps.observed.shape[2]
    u = (pose[i, 0] - rules.x0) / rules.cell
    v = (pose[i, 1] - rules.y0) / rules.cell
    here = int(math.floor(v)) * columns + int(math.floor(u))
    _advance(plans, i, rules, u, v, columns)
    stuck = _is_stuck(plans, i, rules, pose[i, 0], pose[i, 1])
    draw = scramble(salts[i] + np.uint64(now))
    arrived = plans.steps[i] > 0 and here == plans.path[i, plans.steps[i] - 1]
    _reconsider(now, i, arrived, stuck, draw, maps, plans, patrol, rules)
    return here, news[i] > 0 or now >= plans.idle[i], stuck, draw


@njit(cache=True)
def _keep_on(now, i, here, maps, plans, patrol, rules, work):
    """Keep robot i's goal, by another way if this one is no longer open; gives whether it has a way."""
    goal = plans.goal[i]
    count = plans.steps[i]
    keeps = rules.keep or patrol.since[i] > 0
    is_open = count > 0 and _is_open(maps, i, now, rules, plans.path[i], plans.cursor[i] + 1, count)
    if is_open and (goal < 0 or keeps):
        return True
    stand = plans.path[i, count - 1] if goal >= 0 and keeps else -1
    _drop(plans, i)
    if stand >= 0 and not rules.bounded:
        plans.steps[i] = a_star(maps, i, now, rules, here, stand, work, plans.path[i])
        plans.goal[i] = goal if plans.steps[i] > 0 else -1
        plans.planned[i] = plans.steps[i] > 0
    return plans.steps[i] > 0


@njit(cache=True)
def _fall_back(now, i, here, stuck, draw, maps, plans, rules):
    """Robot i has nothing to explore: it stands until its patience ends or, if stuck, gives way."""
    if stuck:
        plans.steps[i] = _give_way(maps, i, now, rules, here, scramble(draw), plans.path[i])
        plans.planned[i] = plans.steps[i] > 0
    else:
        plans.idle[i] = now + rules.patience


@njit(cache=True)
def decide(now, pose, alive, news, maps, plans, patrol, rules, salts, tie_salts, work):
    """Choose every live robot's goal and path for this iteration; robot i reads and writes only row i.

    `pose` (n, 3) in m and rad; `news` (n,) counts the cells new on each robot's map; `salts` and `tie_salts`
    (n,) are the robots' own random numbers. The rules:

    1. A goal is kept while it is a frontier and can be reached (`rules.keep`); when the path to it is no
       longer open, another one is planned.
    2. A frontier that remains one after its robot's arrival yields nothing: it is shunned for a while.
    3. A robot without progress for `rules.patience` iterations is stuck: it bars the next cell of its path
       to itself for a random time and chooses again.
    4. If nothing is left to choose, it gives way by a short random walk.
    5. A robot that finds no frontier stands, and looks again when its map grows or its patience ends.
    6. If searches are bounded, a robot stands while one goes on, and then takes the way that it has found.
    7. If robots patrol, it goes instead to the nearest cell at least half as old as the one seen longest ago, until it
    or any robot it hears has seen it; on the way it looks for frontiers as in 5, and a frontier comes first.
    """
    for i in range(len(alive)):
        plans.planned[i] = False
        if not alive[i]:
            _drop(plans, i)
            patrol.since[i] = 0
            continue
        here, due, stuck, draw = _look_up(now, i, pose, news, maps, plans, patrol, rules, salts)
        patrols = patrol.since[i] > 0
        looks = due or patrols
        if patrols and due:
            if _explore(now, i, here, maps, plans, patrol, rules, tie_salts[i], work) == 1:
                plans.planned[i] = True
                continue
            plans.idle[i] = now + rules.patience
            looks = False
        if _keep_on(now, i, here, maps, plans, patrol, rules, work):
            continue
        patrol.since[i] = 0
        found = _explore(now, i, here, maps, plans, patrol, rules, tie_salts[i], work) if looks else 0
        if found == 1:
            plans.planned[i] = True
        elif found == PAUSED:
            plans.idle[i] = now
        elif due or patrols:
            if _revisit(now, i, here, maps, plans, patrol, rules, tie_salts[i], work):
                plans.idle[i] = now + rules.patience
                plans.planned[i] = True
            else:
                _fall_back(now, i, here, stuck, draw, maps, plans, rules)


@njit(cache=True)
def look(now, pose, alive, news, maps, plans, patrol, rules, salts, work):
    """The same up to the choice: gives each robot's cell, whether it has to choose, was stuck, its draw and old goal.

    `go` or `stay` completes the plans: rules 1 to 3 of `decide` are done, and no robot patrols.
    """
    count = len(alive)
    here = np.full(count, -1, np.int32)
    chooses = np.zeros(count, np.bool_)
    stuck = np.zeros(count, np.bool_)
    draws = np.zeros(count, np.uint64)
    before = np.full(count, -1, np.int32)
    for i in range(count):
        plans.planned[i] = False
        if not alive[i]:
            _drop(plans, i)
            continue
        here[i], due, stuck[i], draws[i] = _look_up(now, i, pose, news, maps, plans, patrol, rules, salts)
        before[i] = plans.goal[i]
        chooses[i] = not _keep_on(now, i, here[i], maps, plans, patrol, rules, work) and due
    return here, chooses, stuck, draws, before


@njit(cache=True)
def go(now, i, here, goal, stand, maps, plans, rules, work):
    """Plan robot i's way from its cell to the cell from which it explores a goal."""
    plans.steps[i] = a_star(maps, i, now, rules, here, stand, work, plans.path[i])
    plans.goal[i] = goal
    plans.planned[i] = True


@njit(cache=True)
def stay(now, i, here, stuck, draw, maps, plans, rules):
    """Robot i found nothing to explore: rules 4 and 5 of `decide`."""
    _fall_back(now, i, here, stuck, draw, maps, plans, rules)


@njit(cache=True)
def way_ahead(plans, rules, columns, waypoints):
    """Write the centres (x, y in m) of the cells still ahead of each robot into `waypoints` (n, longest, 2).

    The step reached is left out unless it is the last. Gives the counts (n,).
    """
    counts = np.zeros(len(plans.steps), np.int32)
    for i in range(len(counts)):
        first = min(plans.cursor[i] + 1, plans.steps[i] - 1)
        for step in range(max(first, 0), plans.steps[i]):
            waypoints[i, counts[i], 0] = rules.x0 + (plans.path[i, step] % columns + 0.5) * rules.cell
            waypoints[i, counts[i], 1] = rules.y0 + (plans.path[i, step] // columns + 0.5) * rules.cell
            counts[i] += 1
    return counts


def _forget_what_is_stale() -> None:
    """Drop numba's cache of this file if `search` is newer: the cache does not notice its edits."""
    if not compiles():  # and caches
        return
    edited = Path(search.__file__).stat().st_mtime
    for index in Path(decide.stats.cache_path).glob(f"{Path(__file__).stem}.*.nbi"):
        if index.stat().st_mtime < edited:
            index.unlink(missing_ok=True)


_forget_what_is_stale()
