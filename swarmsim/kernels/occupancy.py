"""Occupancy grids of the whole swarm: learning, forgetting, changes and counts.

Grids are indexed (robot, row, column).
"""

from __future__ import annotations

import numpy as np

from swarmsim.kernels.compiling import njit


@njit(cache=True)
def _learn(log_odds, observed, row, column, gain, low, high):
    """Add log-odds to a cell of one map, within bounds; gives 1 if it was unknown, else 0."""
    fresh = not observed[row, column]
    observed[row, column] = True
    log_odds[row, column] = min(max(log_odds[row, column] + gain, low), high)
    return 1 if fresh else 0


@njit(cache=True)
def _fuse_tile(log_odds, observed, tile, row0, column0, hit, miss, low, high):
    rows, columns = tile.shape
    fresh = 0
    for r in range(max(0, -row0), min(rows, observed.shape[0] - row0)):
        for c in range(max(0, -column0), min(columns, observed.shape[1] - column0)):
            seen = tile[r, c]
            if seen != 0:
                gain = hit if seen == 2 else miss
                fresh += _learn(log_odds, observed, row0 + r, column0 + c, gain, low, high)
    return fresh


@njit(cache=True)
def _fuse_evidence(log_odds, observed, tile, said, row0, column0, hit, miss, low, high):
    """As `_fuse_tile`, but cells gain the sensor's evidence `said`, where that is a number."""
    rows, columns = tile.shape
    fresh = 0
    for r in range(max(0, -row0), min(rows, observed.shape[0] - row0)):
        for c in range(max(0, -column0), min(columns, observed.shape[1] - column0)):
            seen = tile[r, c]
            if seen != 0:
                gain = hit if seen == 2 else miss
                if said[r, c] == said[r, c]:
                    gain = said[r, c]
                fresh += _learn(log_odds, observed, row0 + r, column0 + c, gain, low, high)
    return fresh


@njit(cache=True)
def note_observed(tiles, origins, observed):
    """Mark in `observed` (rows, columns) the cells that any of the `tiles` (n, r, c) at `origins` (n, 2) shows."""
    for i in range(min(len(tiles), len(origins))):
        row0, column0 = origins[i]
        for r in range(max(0, -row0), min(tiles.shape[1], observed.shape[0] - row0)):
            for c in range(max(0, -column0), min(tiles.shape[2], observed.shape[1] - column0)):
                if tiles[i, r, c] != 0:
                    observed[row0 + r, column0 + c] = True


@njit(cache=True)
def fuse(
    log_odds, observed, alive, tiles, evidence, origins, receivers, heard, heard_origins, hit, miss, low, high, fresh
):
    """Update every occupancy grid with the robot's own tile, then with each tile it heard, in that order.

    `log_odds` and `observed` (n, rows, columns), `tiles` (n, r, c), `heard` (m, r, c) for `receivers`
    (m,). A cell seen occupied gains `hit`, one seen free gains `miss` (< 0), clamped to [low, high]; of the robot's
    own tile it gains `evidence` (n, r, c) instead, unless that has no rows or is NaN.
    Writes to `fresh` (n + m,) how many cells each tile was the first to show its robot.
    """
    robots = len(alive)
    for i in range(robots):
        fresh[i] = 0
        if alive[i] and len(evidence) > 0:
            fresh[i] = _fuse_evidence(
                log_odds[i], observed[i], tiles[i], evidence[i], origins[i, 0], origins[i, 1], hit, miss, low, high
            )
        elif alive[i]:
            fresh[i] = _fuse_tile(
                log_odds[i], observed[i], tiles[i], origins[i, 0], origins[i, 1], hit, miss, low, high
            )
    for m in range(len(receivers)):
        i = receivers[m]
        fresh[robots + m] = _fuse_tile(
            log_odds[i], observed[i], heard[m], heard_origins[m, 0], heard_origins[m, 1], hit, miss, low, high
        )


@njit(cache=True)
def _spare_tile(tile, row0, column0, v, u, reach):
    """Take back what a tile calls occupied within `reach` cells of the point at row v and column u."""
    for r in range(tile.shape[0]):
        for c in range(tile.shape[1]):
            if tile[r, c] == 2:
                away_v = row0 + r + 0.5 - v
                away_u = column0 + c + 0.5 - u
                if away_v * away_v + away_u * away_u <= reach * reach:
                    tile[r, c] = 0


@njit(cache=True)
def spare(tiles, origins, receivers, heard, heard_origins, fresh, reach):
    """Mark occupied cells at a robot's known place as unknown.

    A robot is in the middle of its tile, give or take half a cell. Robot i knows its own place, and those of robots
    whose present tiles it heard: `heard` (m, r, c) for `receivers` (m,), if they are `fresh` (m,). Changes `tiles`
    (n, r, c) at `origins` (n, 2) and `heard` at `heard_origins` (m, 2), within `reach` cells.
    """
    half_v = 0.5 * tiles.shape[1]
    half_u = 0.5 * tiles.shape[2]
    for m in range(len(receivers)):
        i = receivers[m]
        _spare_tile(
            heard[m], heard_origins[m, 0], heard_origins[m, 1], origins[i, 0] + half_v, origins[i, 1] + half_u, reach
        )
        if not fresh[m]:
            continue
        v = heard_origins[m, 0] + 0.5 * heard.shape[1]
        u = heard_origins[m, 1] + 0.5 * heard.shape[2]
        _spare_tile(tiles[i], origins[i, 0], origins[i, 1], v, u, reach)
        first = m
        while first > 0 and receivers[first - 1] == i:
            first -= 1
        other = first
        while other < len(receivers) and receivers[other] == i:
            if other != m:
                _spare_tile(heard[other], heard_origins[other, 0], heard_origins[other, 1], v, u, reach)
            other += 1


@njit(cache=True)
def fill(log_odds, observed, receivers, pieces, origins, hit, miss, low, high, fresh):
    """Copy others' estimates of cells that a robot has not observed, as if seen once.

    `log_odds` and `observed` (n, rows, columns), `pieces` (m, r, c) of maps at `origins` (m, 2) for `receivers`
    (m,), in that order. Writes to `fresh` (m,) how many cells each piece was the first to show its robot.
    """
    rows, columns = observed.shape[1:]
    for m in range(len(receivers)):
        i = receivers[m]
        fresh[m] = 0
        for r in range(pieces.shape[1]):
            for c in range(pieces.shape[2]):
                believed = pieces[m, r, c]
                row, column = origins[m, 0] + r, origins[m, 1] + c
                if believed == 0 or not (0 <= row < rows and 0 <= column < columns) or observed[i, row, column]:
                    continue
                observed[i, row, column] = True
                log_odds[i, row, column] = min(max(hit if believed == 2 else miss, low), high)
                fresh[m] += 1


@njit(cache=True)
def fade(log_odds, observed, alive, kept, least):
    """Age every live robot's map by one iteration: its cells become less certain.

    The log-odds (n, cells) are multiplied by `kept` (0 to 1). Where their absolute value falls below `least`, the
    cell becomes unobserved.
    """
    for i in range(len(alive)):
        if not alive[i]:
            continue
        mine, known = log_odds[i], observed[i]
        for cell in range(len(mine)):
            faded = mine[cell] * kept
            sure = abs(faded) >= least
            mine[cell] = faded if sure else np.float32(0.0)
            known[cell] = known[cell] & sure


@njit(cache=True)
def _see_tile(seen, tile, row0, column0, when):
    rows, columns = tile.shape
    for r in range(max(0, -row0), min(rows, seen.shape[0] - row0)):
        for c in range(max(0, -column0), min(columns, seen.shape[1] - column0)):
            if tile[r, c] != 0:
                seen[row0 + r, column0 + c] = max(seen[row0 + r, column0 + c], when)


@njit(cache=True)
def see(seen, now, alive, tiles, origins, receivers, heard, heard_origins, sources, sensed):
    """Note in `seen` (n, rows, columns) when each robot's cells were last seen, by itself or by others it heard.

    Iterations count from 1 in `seen` and `now`, from 0 in `sensed` (m,); otherwise as in `fuse`. A piece of a map
    (`sources` -1) does not say when its cells were seen, and changes nothing.
    """
    for i in range(len(alive)):
        if alive[i]:
            _see_tile(seen[i], tiles[i], origins[i, 0], origins[i, 1], now)
    for m in range(len(receivers)):
        if sources[m] >= 0:
            _see_tile(seen[receivers[m]], heard[m], heard_origins[m, 0], heard_origins[m, 1], sensed[m] + 1)


@njit(cache=True)
def _note(log_odds, observed, held, robot, cell, found):
    """Append the cell's state (0 unknown, 1 free, 2 occupied) to `found` (c, 3) if it differs from `held`."""
    state = (1 + (log_odds[robot, cell] > 0.0)) * observed[robot, cell]
    if held[robot, cell] == state:
        return 0
    held[robot, cell] = state
    found[0] = robot
    found[1] = cell
    found[2] = state
    return 1


@njit(cache=True)
def _note_under(log_odds, observed, held, robot, row0, column0, shape, columns, found, count):
    rows = observed.shape[1] // columns
    for r in range(max(0, row0), min(rows, row0 + shape[0])):
        for c in range(max(0, column0), min(columns, column0 + shape[1])):
            count += _note(log_odds, observed, held, robot, r * columns + c, found[count])
    return count


@njit(cache=True)
def changes_under(log_odds, observed, held, robots, origins, receivers, heard_origins, shape, columns, found):
    """The cells of the maps that differ from `held` (n, cells), only under tiles; updates `held`.

    `log_odds` and `observed` (n, cells) are row-major with `columns` columns; tiles of `shape` (rows, columns) lie at
    `origins` (n, 2) of the maps of `robots` (n,) and at `heard_origins` (m, 2) of those of `receivers` (m,). Writes
    robot, cell and state to `found` (c, 3); gives their number.
    """
    count = np.int64(0)
    for t in range(len(robots)):
        count = _note_under(
            log_odds, observed, held, robots[t], origins[t, 0], origins[t, 1], shape, columns, found, count
        )
    for t in range(len(receivers)):
        count = _note_under(
            log_odds, observed, held, receivers[t], heard_origins[t, 0], heard_origins[t, 1], shape, columns, found,
            count,
        )  # fmt: skip
    return count


@njit(cache=True)
def _mark_tile(shown, tile, row0, column0):
    rows, columns = tile.shape
    for r in range(max(0, -row0), min(rows, shown.shape[0] - row0)):
        for c in range(max(0, -column0), min(columns, shown.shape[1] - column0)):
            if tile[r, c] != 0:
                shown[row0 + r, column0 + c] = True


@njit(cache=True)
def mark(shown, alive, tiles, origins, receivers, heard, heard_origins):
    """Note in `shown` (n, rows, columns) which cells each robot's own tile and those it heard show; as in `fuse`."""
    for i in range(len(alive)):
        if alive[i]:
            _mark_tile(shown[i], tiles[i], origins[i, 0], origins[i, 1])
    for m in range(len(receivers)):
        _mark_tile(shown[receivers[m]], heard[m], heard_origins[m, 0], heard_origins[m, 1])


@njit(cache=True)
def recount(changes, held, holders, domain, each):
    """Update the counts of known cells by `changes` (c, 3) of maps: robot, cell, state.

    `held` (n, cells) says which cells each robot's map held before, `holders` (cells,) how many maps hold each; both
    are updated. `each` (n,) counts the cells of the `domain` (cells,) in each map. Gives the growth of the number of
    cells of the domain that any map holds.
    """
    grown = 0
    for k in range(len(changes)):
        i, cell, known = changes[k, 0], changes[k, 1], changes[k, 2] != 0
        if held[i, cell] == known:
            continue
        held[i, cell] = known
        step = 1 if known else -1
        before = holders[cell]
        holders[cell] = before + step
        if domain[cell]:
            each[i] += step
            grown += int(before + step > 0) - int(before > 0)
    return grown


@njit(cache=True)
def changes_anywhere(log_odds, observed, held, found):
    """As `changes_under`, but in every cell; `found` has room for all of them."""
    count = 0
    for robot in range(len(observed)):
        for cell in range(observed.shape[1]):
            count += _note(log_odds, observed, held, robot, cell, found[min(count, len(found) - 1)])
    return count
