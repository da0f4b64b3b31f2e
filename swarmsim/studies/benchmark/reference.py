"""How fast a building could be explored by robots that know it: what nobody can beat, and what somebody can do."""

from __future__ import annotations

import math
from pathlib import Path

from msgspec import Struct

from swarmsim.engine.build import BuiltRun
from swarmsim.studies.benchmark.bounds import Bounds, bounds_of
from swarmsim.studies.benchmark.net import Net, Routes
from swarmsim.studies.benchmark.replay import Driven, drive, way_of
from swarmsim.studies.benchmark.tours import Effort, best_routes, covering
from swarmsim.studies.benchmark.views import Stands, ground_of


class Times(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Iterations until shares of the coverage domain are covered, counted as `Simulation.finished_after` does.

    None: not within the run.
    """

    t50: int | None
    t90: int | None
    t99: int | None
    t100: int | None


class Reference(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One building, swarm and seed: the proved lower bounds, and the best tour found with the map known.

    `ways` are the tour itself, one text for each robot, see `replay.way_of`: who has them can replay the tour, and
    verify it, without searching anew.
    """

    robots: int
    seed: int
    cells: int  # of the coverage domain
    bounds: Times  # no swarm of these robots can be faster; never None
    first_sight: int  # the two bounds that t100 is the larger one of: until the farthest cell can be seen ...
    covering: int  # ... and until the robots together can have driven far enough
    tour: float  # iterations of its longest way at top speed
    replay: Times  # of the tour, by the simulator and its own measure of coverage
    covered: float  # share of the domain at the end of the replay
    pace: float  # the fastest robot's mean speed in the replay, as a share of the top speed: bounds assume at most 1
    digest: str  # of the replay: of all that happens in it
    ways: tuple[str, ...]  # of the tour, one for each robot


def reference(built: BuiltRun, effort: Effort = Effort()) -> Reference:  # noqa: B008 - it is frozen
    """The bounds, and a tour replayed by the simulator, for the building, the robots and the seed of a run.

    Of the run's scenario count the world, grid, robots with their starts, sensor, physics and period; its network,
    mind, faults and limit do not. The run itself is not advanced. Raises InputError without OR-tools, and for a
    scenario whose sensor gives no tiles.
    """
    ground = ground_of(built)
    ways, driven = _best_tour(built, ground, effort)
    bounds = bounds_of(built)
    longest = max(driven.planned)
    return Reference(
        robots=len(ways),
        seed=built.scenario.seed,
        cells=len(ground.domain),
        bounds=_bound_times(bounds),
        first_sight=bounds.first_sight[-1],
        covering=bounds.covering[-1],
        tour=1.0 + longest / ground.pace,
        replay=_times(driven),
        covered=driven.watched.coverage[-1],
        pace=driven.pace,
        digest=driven.digest,
        ways=ways,
    )


def replayed(built: BuiltRun, ways: tuple[str, ...], record: Path | None = None) -> tuple[Times, float, str]:
    """The times, the share covered at the end and the digest of a tour's replay; needs no OR-tools.

    `record` is a new file for its recording. Raises InputError for ways that do not fit the building or the robots.
    """
    driven = drive(built, ground_of(built), ways, record)
    return _times(driven), driven.watched.coverage[-1], driven.digest


def _best_tour(built: BuiltRun, ground: Stands, effort: Effort) -> tuple[tuple[str, ...], Driven]:
    """The tour whose replay covers most of the domain soonest, of the best found and its repairs."""
    net = Net(ground)
    routes = best_routes(net, effort)
    found = []
    for _ in range(1 + effort.repairs):
        ways = _ways(net, routes)
        driven = drive(built, ground, ways)
        found.append((ways, driven))
        if not len(driven.missed):
            break
        # From nowhere on the way were these cells seen, whatever was planned: somebody has to go elsewhere for them.
        net.forget(routes, driven.missed)
        routes = covering(net, routes)
    return min(found, key=lambda one: _rank(one[1]))


def _rank(driven: Driven) -> tuple[float, ...]:
    """What is better of two replays comes first: those that cover everything, then by time."""
    t99, t100 = (driven.watched.first(share) for share in (0.99, 1.0))
    return float(t100 is None), *(math.inf if time is None else float(time) for time in (t99, t100))


def _ways(net: Net, routes: Routes) -> tuple[str, ...]:
    return tuple(way_of(net.ground.cells[net.walk(route)]) for route in routes)


def _times(driven: Driven) -> Times:
    first = driven.watched.first
    return Times(t50=first(0.5), t90=first(0.9), t99=first(0.99), t100=first(1.0))


def _bound_times(bounds: Bounds) -> Times:
    t50, t90, t99, t100 = bounds.best
    return Times(t50=t50, t90=t90, t99=t99, t100=t100)
