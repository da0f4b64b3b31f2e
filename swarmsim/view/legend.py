"""The legend of a picture."""

from __future__ import annotations

import numpy as np
import pygame

from swarmsim.core.drawing import Polygons
from swarmsim.view.camera import Camera
from swarmsim.view.layers import LayerStack
from swarmsim.view.lettering import Lettering
from swarmsim.view.painter import Painter
from swarmsim.view.scene import Scene
from swarmsim.view.signs import Sign
from swarmsim.view.style import Style
from swarmsim.view.theme import Theme


def signs(scene: Scene, look: Style, enlarged: float) -> list[Sign]:
    """Every sign in the pictures of a scene; robots are drawn `enlarged` times their size."""
    size = f", up to {enlarged:.2g} x its size" if enlarged > 1.0 else ""
    found = LayerStack(scene).signs(scene, look)
    found = [sign._replace(means=sign.means + size * (sign.kind == "robot")) for sign in found]
    line = Polygons(np.array([(-1.0, -7.0), (1.0, -7.0), (1.0, 7.0), (-1.0, 7.0)]), np.array([4]), "mark", None)
    return [*found, *[Sign("mark", "event", [line])] * bool(scene.marks)]


def draw_sign(
    surface: pygame.Surface, theme: Theme, letters: Lettering, sign: Sign, at: tuple[int, int], unit: float
) -> None:
    """Draw one sign of the legend around a place, `unit` times its usual size."""
    painter = Painter(theme, Camera(unit, *at), unit, letters)
    for mark in sign.marks:
        painter.paint(surface, mark, np.full(2, sign.radius * unit))
