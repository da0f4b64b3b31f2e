"""Cells of rasters as viewers take them: red, green, blue and opacity."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.drawing import Raster
from swarmsim.view.theme import Theme


def coloured(raster: Raster, theme: Theme) -> NDArray[np.uint8]:
    """The colours (rows, columns, 4) of a raster, the lowest row first."""
    return table(raster, theme).view("V4").ravel()[raster.values].view(np.uint8).reshape(*raster.values.shape, 4)


def table(raster: Raster, theme: Theme) -> NDArray[np.uint8]:
    """The colour (256, 4) of each value that a cell of a raster may have."""
    found = np.zeros((256, 4), np.uint8)
    found[:, :3] = theme.shades(raster.palette)
    found[1:, 3] = 255
    return found
