"""The task of collective mapping: how much of the building the swarm's maps cover."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Final

import numpy as np
from msgspec import Meta, Struct

from swarmsim.core import memory
from swarmsim.core.building import Building
from swarmsim.core.context import BuildContext
from swarmsim.core.parts import Curve, Summary
from swarmsim.core.state import Done, Knowledge, Measured
from swarmsim.kernels import occupancy
from swarmsim.operations.mapping.maps import Frames, Maps
from swarmsim.operations.mapping.measures.changes import ChangeMeasures
from swarmsim.operations.mapping.measures.frames import FrameMeasures
from swarmsim.operations.mapping.measures.provenance import MapProvenance
from swarmsim.operations.mapping.measures.quality import MapMeasures
from swarmsim.operations.mapping.measures.sightings import Sightings
from swarmsim.operations.mapping.sharing.policies import cells_of

CURVE: Final = Curve("coverage", "coverage, %", scale=100.0, low=0.0, high=100.0, robots="covered", format=".1f")


class Coverage(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The union of all maps, dead robots' included, has to cover a share of the coverage domain.

    The domain is all that can be explored: every free cell that robots can observe, and the wall cells beside those; it
    changes with the building. Robots never learn this measure.

    Robots that place others' maps by an estimate may err. Then a cell counts only if a map shows there what some robot
    has truly seen; `correct` is the share of such cells in the union. Maps that nobody can put together are not one map
    either, so the union is that of the robots whose frames one robot knows, where it covers most. And the task is not
    done while robots that hear each other have compared their maps without finding how these fit together.
    """

    share: Annotated[float, Meta(gt=0.0, le=1.0)] = 1.0  # of the domain
    provenance: bool = False  # also measure the age and origin of knowledge; takes memory for each map

    def build(self, context: BuildContext) -> CoverageTask:
        return CoverageTask(self, context)


class CoverageTask:
    """Counts cells by the changes of the maps, which recordings keep too; where maps can be misplaced, by the truth."""

    requires_knowledge: type[Knowledge] = Maps
    curve = CURVE

    def __init__(self, parameters: Coverage, context: BuildContext) -> None:
        count, cells = context.swarm, context.lattice.rows * context.lattice.columns
        self._context, self._wanted, self._traces = context, parameters.share, parameters.provenance
        self._held = memory.zeros((count, cells), np.bool_)  # which cells each map holds
        self._holders = np.zeros(cells, np.int32)  # how many maps hold each cell
        self._each = np.zeros(count, np.int64)  # cells of the domain in each map ...
        self._union = 0  # ... and in any that can be put together
        self._take_up(context.building)
        self._sightings = Sightings(context.lattice)

    def measure(self, done: Done[Maps]) -> Measured:
        """The shares of the domain that the union and each robot's own map cover."""
        if self._version != done.building.version:
            self._count_anew(done.building)
        more: dict[str, float] = {}
        decided = True
        if done.knowledge.frames is None:
            changes = done.knowledge.changes
            self._union += occupancy.recount(changes, self._held, self._holders, self._domain, self._each)
        else:
            more["correct"] = self._count_what_is_right(done, done.knowledge.frames)
            decided = not done.knowledge.frames.undecided[tuple(done.links.T)].any()
        share = self._union / self._cells
        return Measured(
            {"coverage": share, **more}, {"covered": self._each / self._cells}, min(1.0, share / self._wanted),
            decided and share >= self._wanted,
        )  # fmt: skip

    def _count_what_is_right(self, done: Done[Maps], frames: Frames) -> float:
        """Count the cells where maps show what was truly seen there; gives their share of the union of all maps."""
        self._sightings.add(done)
        maps = cells_of(done.knowledge)
        right = self._sightings.agree(maps).reshape(len(maps), -1) & self._domain
        self._each[:] = np.count_nonzero(right, axis=1)
        groups = np.unique(frames.known, axis=0)  # of robots whose maps one robot can put together
        self._union = max(int(np.count_nonzero(right[group].any(axis=0))) for group in groups)
        share = self._sightings.share(maps.max(axis=0))  # OCCUPIED where it is on any map
        return 1.0 if share is None else share

    def _take_up(self, building: Building) -> None:
        self._version, self._domain = building.version, building.explorable.reshape(-1)
        self._cells = int(np.count_nonzero(self._domain))

    def _count_anew(self, building: Building) -> None:
        self._take_up(building)
        self._each[:] = [np.count_nonzero(held & self._domain) for held in self._held]
        self._union = int(np.count_nonzero((self._holders > 0) & self._domain))

    def summaries(self) -> Sequence[Summary[Maps]]:
        """The maps' quality, and how well they follow a changing building."""
        robots, building, lattice = self._context.swarm, self._context.building, self._context.lattice
        domain = building.explorable
        always = MapMeasures(robots, domain, lattice), ChangeMeasures(building), FrameMeasures(domain)
        return (*always, MapProvenance(robots, lattice)) if self._traces else always
