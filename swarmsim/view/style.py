"""What a picture of a run shows, and how."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, TypedDict

from swarmsim.core.errors import InputError
from swarmsim.view.scene import Scene
from swarmsim.view.theme import THEMES, Theme

#: Layers besides the building, the map and the robots, with descriptions.
LAYERS: Final = {
    "beams": "the beams of the chosen robots",
    "tiles": "the tile that each robot senses",
    "links": "who hears whom",
    "ways": "the way ahead and the goal of each robot",
    "people": "people who walk about",
    "events": "what has just happened",
    "panel": "numbers, curves and the legend",
    "jobs": "what jobs compute, and who computes it",
    "own": "layers that the scenario or its parts add",
}


@dataclass(frozen=True)
class Style:
    """The layers drawn, the robots selected and the colours."""

    theme: str = "dark"  # dark or light
    layers: frozenset[str] = frozenset(LAYERS)
    focus: int | None = None  # the robot whose own map is shown and that is magnified
    robots: tuple[int, ...] = ()  # robots with tiles, ways and beams drawn; empty: all robots, but no beams

    def __post_init__(self) -> None:
        """Raise InputError for a theme or a layer that does not exist."""
        if self.theme not in THEMES:
            raise InputError(f"--theme {self.theme}: no such theme; expected {' or '.join(THEMES)}")
        if unknown := sorted(self.layers - set(LAYERS)):
            raise InputError(f"--show {unknown[0]}: no such layer; expected some of {', '.join(LAYERS)}")

    @property
    def colours(self) -> Theme:
        """The colours of its theme."""
        return THEMES[self.theme]

    def shows(self, robot: int) -> bool:
        """Whether a robot's tile and way are drawn."""
        return not self.chosen or robot in self.chosen

    @property
    def chosen(self) -> tuple[int, ...]:
        """The selected robots, empty for all."""
        return self.robots or (() if self.focus is None else (self.focus,))

    def check(self, scene: Scene) -> None:
        """Raise InputError if a selected robot is not in the scene."""
        for option, robot in [("--focus", self.focus), *(("--robots", robot) for robot in self.robots)]:
            if robot is not None and not 0 <= robot < scene.robots:
                raise InputError(f"{option} {robot}: no such robot; expected 0 to {scene.robots - 1}")


class LookKeys(TypedDict, total=False):
    """The fields of a look, all optional."""

    theme: str
    layers: frozenset[str]
    focus: int | None
    robots: tuple[int, ...]


def look(theme: str, show: str | None, hide: str | None, focus: int | None, robots: str | None) -> Style:
    """A look from text: layers and robots as lists such as `tiles,links` and `0,3`. Raises InputError."""
    layers = frozenset(_words(show)) if show is not None else frozenset(LAYERS)
    without = frozenset(_words(hide))
    if unknown := sorted(without - set(LAYERS)):
        raise InputError(f"--hide {unknown[0]}: no such layer; expected some of {', '.join(LAYERS)}")
    words = _words(robots)
    if not all(word.isdecimal() for word in words):
        raise InputError(f"--robots {robots}: not a list of robots; expected numbers, as in 0,1")
    return Style(theme, layers - without, focus, tuple(dict.fromkeys(map(int, words))))


def _words(text: str | None) -> list[str]:
    return [word.strip() for word in (text or "").split(",") if word.strip()]
