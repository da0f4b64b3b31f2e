"""A light on each robot; others can see its colour."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from msgspec import Meta, Struct

from swarmsim.core.context import BuildContext
from swarmsim.core.readings import COLOUR, Called, Channel, Channels, Readings
from swarmsim.core.state import State


class Led(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A light: the brightness of red, green and blue, 0 to 255 each; black is off, the default."""

    name: Called | None = None  # of one of several on a robot: its channel is called NAME_led
    levels: Annotated[int, Meta(ge=2, le=256)] = 256  # of brightness of each colour, off included

    def build(self, context: BuildContext) -> LedLight:
        """The actuator."""
        return LedLight(self.levels)


class LedLight:
    """Shines in the nearest available colour."""

    channels = Channels(Channel("led", "u1", (3,), COLOUR, 0, 255, columns=("red", "green", "blue")))

    def __init__(self, levels: int) -> None:
        shades = np.rint(np.linspace(0.0, 255.0, levels))
        nearest = np.abs(np.arange(256)[:, None] - shades).argmin(axis=1)
        self._shown = shades[nearest].astype(np.uint8)  # by wanted level

    def act(self, commands: Readings, state: State) -> Readings:
        """The colours (n, 3)."""
        return Readings(self.channels, (self._shown[commands["led"]],))
