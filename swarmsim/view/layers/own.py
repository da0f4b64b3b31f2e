"""Third-party layers of a scenario or its parts: found, called, and checked for what pictures can draw."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from swarmsim.core.drawing import Layer, Mark, Polygons, Shown, inks_of, wrong
from swarmsim.core.errors import InputError, PartError
from swarmsim.core.own import is_failure, told
from swarmsim.core.scenario.file import Scenario, all_parts
from swarmsim.view.scene import Frame, Scene
from swarmsim.view.signs import Sign
from swarmsim.view.style import Style


class OwnLayer:
    """A third-party layer, with the part that it comes from."""

    def __init__(self, layer: Layer, part: str) -> None:
        self._layer, self._part = layer, part
        self.name = str(layer.name)

    def draw(self, shot: Frame) -> Sequence[Mark]:
        """Its shapes. Raises PartError if it fails or returns something that cannot be drawn."""
        at = f"{self._part}, drawing iteration {shot.iteration}"
        try:
            found = self._layer.draw(shot)
        except BaseException as problem:
            if not is_failure(problem):
                raise
            raise PartError(f"{at}: {told(problem)}") from problem
        if misfit := wrong(found, len(shot.alive)):
            raise PartError(f"{at}: {misfit}")
        return found

    def signs(self, scene: Scene, look: Style) -> list[Sign]:
        """A square in the first ink of each of its shapes, half way through the run."""
        found: dict[str, Sign] = {}
        corners, ends = np.array([(-7.0, -5.0), (7.0, -5.0), (7.0, 5.0), (-7.0, 5.0)]), np.array([4])
        for mark in self.draw(scene.at(scene.iterations // 2, look.focus, look.chosen)):
            if (text := mark.name or self.name) not in found and inks_of(mark):
                found[text] = Sign(text, text, [Polygons(corners, ends, inks_of(mark)[0])])
        return list(found.values())


def own_layers(scenario: Scenario, first: Shown) -> list[OwnLayer]:
    """The layers of a scenario and its parts, without those that may not run or are not installed.

    Raises InputError for invalid keys, and PartError for parts that fail.
    """
    found: list[OwnLayer] = []
    for part in all_parts(scenario):
        name = f"{part.seam} {part.use}"
        try:
            parameters = part.parameters
        except InputError:
            continue
        try:
            layers = [part.build(first)] if part.seam == "layer" else getattr(parameters, "drawn", ())
            found += [OwnLayer(layer, name) for layer in layers]  # type: ignore[arg-type]
        except InputError:
            raise
        except BaseException as problem:
            if not is_failure(problem):
                raise
            raise PartError(f"{name}: {told(problem)}") from problem
    return found


def left_out(scenario: Scenario) -> str | None:
    """A notice about layers left out of pictures, if any."""
    absent = []
    for part in scenario.layers:
        try:
            _ = part.parameters
        except InputError:
            absent.append(part.use)
    if not absent:
        return None
    return f"notice: without {', '.join(absent)}: --allow-code lets layers of the scenario's own be drawn"
