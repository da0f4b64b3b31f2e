"""The colours of pictures, for dark rooms and for paper, safe for colour-blind people."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.drawing import Ink

Colour = tuple[int, int, int]  # red, green, blue

#: Okabe and Ito's colours without black (Okabe and Ito 2008, Color Universal Design).
ROBOTS: Sequence[Colour] = (
    (230, 159, 0), (86, 180, 233), (0, 158, 115), (204, 121, 167), (213, 94, 0), (0, 114, 178), (240, 228, 66),
)  # fmt: skip


@dataclass(frozen=True)
class Theme:
    """The colours of everything drawn."""

    background: Colour
    unexplored: Colour  # floor in no map
    solids: Mapping[str, Colour]  # of solid areas, by layer
    few: Colour  # floor that one robot knows ...
    all: Colour  # ... and that all robots know: one hue
    hot: Colour  # where a field is greatest; `floor` is where it is least
    floor: Colour  # of buildings that no robot maps
    seen: Colour  # cells where a beam ended
    edge: Colour  # around everything
    text: Colour
    muted: Colour  # explanatory text
    rule: Colour  # axes
    link: Colour  # a message that is heard
    lost: Colour  # a message that is lost
    curve: Colour  # of the swarm
    mean: Colour  # mean over robots
    worst: Colour  # of the worst robot
    mark: Colour  # events and faults
    joined: Colour  # robots that came late
    dead: Colour
    person: Colour

    @property
    def others(self) -> Colour:
        """Floor that other robots know, but not the focused one: half way to the colour of one robot."""
        red, green, blue = ((a + b) // 2 for a, b in zip(self.unexplored, self.few, strict=True))
        return red, green, blue

    @property
    def halo(self) -> Colour:
        """Around links."""
        return self.edge if sum(self.link) > 384 else self.background

    def ink(self, name: Ink) -> Colour:
        """The colour of an ink of `core.drawing`."""
        if name.startswith("on "):
            return ink_on(self.ink(name[3:]))
        if name.startswith("robot "):
            return colour_of(int(name[6:]))
        if name.startswith("#"):
            return int(name[1:3], 16), int(name[3:5], 16), int(name[5:], 16)
        colour: Colour = self.solids[name] if name in self.solids else getattr(self, name)
        return colour

    def between(self, low: Ink, high: Ink, shares: NDArray[np.float64]) -> NDArray[np.uint8]:
        """The colours (..., 3) at these shares (0 to 1) of the way from one ink to another."""
        start, end = np.array(self.ink(low), np.float64), np.array(self.ink(high), np.float64)
        return np.rint(start + np.asarray(shares)[..., None] * (end - start)).astype(np.uint8)

    def shades(self, palette: Sequence[tuple[int, int, Ink, Ink]]) -> NDArray[np.uint8]:
        """The colours (256, 3) of a raster's values."""
        found = np.zeros((256, 3), np.uint8)
        for first, last, low, high in palette:
            found[first : last + 1] = self.between(low, high, np.arange(last - first + 1) / max(last - first, 1))
        return found


def colour_of(robot: int) -> Colour:
    """The colour of a robot; several may share it."""
    return ROBOTS[robot % len(ROBOTS)]


def ink_on(colour: Colour) -> Colour:
    """Black or white, whichever is easier to read on the colour."""
    brightness = 0.299 * colour[0] + 0.587 * colour[1] + 0.114 * colour[2]
    return (0, 0, 0) if brightness > 120 else (255, 255, 255)


THEMES: Final[Mapping[str, Theme]] = {
    "dark": Theme(
        background=(17, 20, 27),
        unexplored=(37, 43, 54),
        solids={"walls": (74, 82, 97), "pillars": (90, 98, 113), "furniture": (98, 92, 84), "unknown": (50, 56, 66)},
        few=(58, 98, 112),
        all=(214, 238, 240),
        hot=(176, 62, 38),
        floor=(238, 234, 224),
        seen=(176, 132, 72),
        edge=(24, 27, 34),
        text=(232, 235, 240),
        muted=(150, 158, 172),
        rule=(58, 65, 79),
        link=(255, 255, 255),
        lost=(255, 112, 67),
        curve=(240, 228, 66),
        mean=(86, 180, 233),
        worst=(204, 121, 167),
        mark=(230, 110, 40),
        joined=(120, 230, 160),
        dead=(136, 140, 148),
        person=(196, 164, 220),
    ),
    "light": Theme(
        background=(252, 252, 250),
        unexplored=(226, 229, 234),
        solids={
            "walls": (164, 171, 182),
            "pillars": (146, 154, 167),
            "furniture": (184, 176, 162),
            "unknown": (206, 209, 214),
        },
        few=(198, 224, 228),
        all=(62, 138, 150),
        hot=(176, 62, 38),
        floor=(246, 242, 232),
        seen=(150, 104, 44),
        edge=(44, 49, 60),
        text=(24, 28, 36),
        muted=(92, 100, 114),
        rule=(204, 208, 216),
        link=(16, 36, 84),
        lost=(200, 50, 10),
        curve=(0, 92, 160),
        mean=(0, 136, 100),
        worst=(176, 72, 134),
        mark=(206, 80, 12),
        joined=(0, 130, 70),
        dead=(124, 128, 136),
        person=(120, 84, 156),
    ),
}
DARK: Final = THEMES["dark"]
