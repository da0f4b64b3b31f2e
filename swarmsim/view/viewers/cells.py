"""The cells of a map as viewers take them, after ROS's OccupancyGrid."""

from __future__ import annotations

from typing import Final

from swarmsim.core.state import FREE, OCCUPIED

CELLS: Final = {FREE: 0, OCCUPIED: 100}
UNKNOWN_CELL: Final = 255
