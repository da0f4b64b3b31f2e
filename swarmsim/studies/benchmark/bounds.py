"""What no swarm can beat: lower bounds of the iterations that covering a building takes, proved for its starts.

The proofs assume: a robot is a disc that stays clear of walls, its centre moves along a continuous line, and in its
first k iterations no farther than k iterations at top speed. (Single iterations can be longer, where another robot
pushes from the side, but the sum counts, and replays measure it.) A cell is observed only if its centre lies in the
tile's rectangle around the robot, and if some straight line from the robot to the cell meets no wall. Nothing is
assumed of minds, networks or of sensing between iterations. Robots sense before they move, so T iterations hold T - 1
of motion.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from msgspec import Struct

from swarmsim.engine.build import BuiltRun
from swarmsim.studies.benchmark.covering import covering
from swarmsim.studies.benchmark.first_sight import distances, first_sights
from swarmsim.studies.benchmark.places import places_of

SHARES: Final = (0.5, 0.9, 0.99, 1.0)  # of the domain, whose times are bounded
ROUNDING: Final = 1e-6  # of an iteration


class Bounds(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Iterations that no swarm of these robots can do without, from these starts."""

    first_sight: tuple[int, ...]  # by SHARES of the domain: until so many cells have come into somebody's view
    covering: tuple[int, ...]  # by SHARES: until the robots together have driven far enough

    @property
    def best(self) -> tuple[int, ...]:
        """The larger of both, by SHARES."""
        return tuple(map(max, self.first_sight, self.covering))


def bounds_of(built: BuiltRun) -> Bounds:
    """The lower bounds of a run's building, robots and starts. Raises InputError for sensors without tiles."""
    places = places_of(built)
    ways = distances(places)
    pace = float(built.context.robots.each("speed").max()) * built.scenario.period / places.lattice.cell  # cells
    needed = [needed_cells(share, len(places.domain)) for share in SHARES]
    seen = np.sort(first_sights(places, ways, 0))
    entered = first_sights(places, ways, 1)
    driven = covering(places, entered, needed, len(places.starts))
    return Bounds(
        first_sight=tuple(_iterations(float(seen[count - 1]), pace) for count in needed),
        covering=tuple(_iterations(way, pace) for way in driven),
    )


def needed_cells(share: float, cells: int) -> int:
    """The least number of cells that is a share of all of them, as the task of coverage compares them."""
    count = math.floor(share * cells)
    return count if count / cells >= share else count + 1


def _iterations(way: float, pace: float) -> int:
    """The least number of iterations after which a robot can have sensed at the end of a way (cells)."""
    return 1 + math.ceil(way / pace - ROUNDING)
