"""How fast a building could be explored by robots that know it: what nobody can beat, and what somebody can do."""

from __future__ import annotations

from msgspec import Struct

from swarmsim.engine.build import BuiltRun


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
    tour: float  # iterations of its longest way at top speed
    replay: Times  # of the tour, by the simulator and its own measure of coverage
    covered: float  # share of the domain at the end of the replay
    digest: str  # of the replay, as `swarmsim verify` computes it
    ways: tuple[str, ...]  # of the tour, one for each robot


class Effort(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How long to search for a good tour; in counts, so that the same tour comes out on any machine."""

    searches: int = 3  # how often guided local search starts again from what then covers everything
    steps: int = 200  # new solutions of one such search
    repairs: int = 4  # replays after which cells that were missed are added to the tour


def reference(built: BuiltRun, effort: Effort = Effort()) -> Reference:  # noqa: B008 - it is frozen
    """The bounds, and a tour replayed by the simulator, for the building, the robots and the seed of a run.

    Of the run's scenario count the world, grid, robots with their starts, sensor, physics and period; its network,
    mind, faults and limit do not. The run itself is not advanced. Raises InputError without OR-tools, and for a
    scenario whose sensor gives no tiles.
    """
    raise NotImplementedError


def replayed(built: BuiltRun, ways: tuple[str, ...]) -> tuple[Times, float, str]:
    """The times, the share covered at the end and the digest of a tour's replay; needs no OR-tools."""
    raise NotImplementedError
