"""Localisation: where each robot believes it is."""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from swarmsim.core.parts import Setting
from swarmsim.core.state import Readings, State


class Perfect(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Every robot knows its pose exactly."""

    def build(self, setting: Setting) -> PerfectLocalisation:
        """The localisation."""
        return PerfectLocalisation()


class PerfectLocalisation:
    """Gives the true pose and leaves what was sensed where it was sensed."""

    def locate(self, state: State, readings: Readings) -> tuple[NDArray[np.float64], Readings]:
        """The pose as it is."""
        return state.pose, readings
