"""What robots know of the floor: their maps, and their estimates of a field."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.drawing import Mark, Raster
from swarmsim.core.state import FREE, OCCUPIED
from swarmsim.view.scene import Frame, Scene
from swarmsim.view.signs import Sign, ramp
from swarmsim.view.style import Style

FLOOR = 10.0  # z
MOST = 250  # distinct counts
SEEN = 254


class MapLayer:
    """How many robots know each cell, or the focused robot's own map."""

    name = "map"

    def __init__(self, scene: Scene) -> None:
        self._scene, self._robots = scene, scene.robots
        self._row, self._counts = -1, np.empty((0, 0), np.uint8)

    def draw(self, shot: Frame) -> Sequence[Mark]:
        """The map of all robots and, over it, the focused robot's."""
        if not self._scene.has_maps:
            return []
        most = min(self._robots, MOST)
        whole = ((1, most, "few", "all"), (SEEN, SEEN, "seen", "seen"))
        if shot.focus is None:
            return [self._raster(self._known(shot.row), whole, "known", each=True)]
        dim = ((1, SEEN, "others", "others"),)
        own = ((FREE, FREE, "all", "all"), (OCCUPIED, OCCUPIED, "seen", "seen"))
        mine = self._scene.own_cells(shot.focus, shot.row).copy()
        return [self._raster(self._known(shot.row), dim, "others"), self._raster(mine, own, "own")]

    def signs(self, scene: Scene, look: Style) -> list[Sign]:
        """The colours of cells."""
        focus = look.focus
        if not scene.has_maps:
            return []
        seen = Sign("seen", "occupied, in some map" if focus is None else "occupied, in its map", ramp("seen", "seen"))
        if focus is None:
            return [Sign("known", f"floor that 1 to {scene.robots} robots know", ramp("few", "all")), seen]
        own = Sign("own", f"floor that robot {focus} knows", ramp("all", "all"))
        return [own, Sign("others", "floor that others know", ramp("others", "others")), seen]

    def _known(self, row: int) -> NDArray[np.uint8]:
        if row != self._row:
            known = self._scene.known(row)
            counts = known if self._robots <= MOST else -(-MOST * known // self._robots)
            occupied: NDArray[np.bool_] = self._scene.cells(row) == OCCUPIED
            self._row, self._counts = row, np.where(occupied, SEEN, counts).astype(np.uint8)
            self._counts.flags.writeable = False
        return self._counts

    def _raster(
        self, values: NDArray[np.uint8], palette: Sequence[tuple[int, int, str, str]], name: str, each: bool = False
    ) -> Raster:
        lattice = self._scene.lattice
        return Raster(values, (lattice.x0, lattice.y0), lattice.cell, palette, each, name, FLOOR)


class FieldLayer:
    """The robots' mean estimate of the field."""

    name = "field"

    def __init__(self, scene: Scene) -> None:
        self._scene, self._row, self._values = scene, -1, np.empty((0, 0), np.uint8)

    def draw(self, shot: Frame) -> Sequence[Mark]:
        """Floor in the colours of heat."""
        if not self._scene.has_field:
            return []
        if shot.row != self._row:
            shares = self._scene.estimate(shot.row)
            values = np.nan_to_num(1.0 + np.rint(254.0 * shares), nan=0.0) if shares is not None else np.zeros((1, 1))
            self._row, self._values = shot.row, values.astype(np.uint8)
        lattice = self._scene.lattice
        heat = ((1, 255, "floor", "hot"),)
        return [Raster(self._values, (lattice.x0, lattice.y0), lattice.cell, heat, name="field", z=FLOOR)]

    def signs(self, scene: Scene, look: Style) -> list[Sign]:
        """The colours of heat."""
        return [Sign("field", "the field, as robots estimate it", ramp("floor", "hot"))] * scene.has_field
