"""What pictures show of a run, as shapes: one list for films, windows, pages and viewers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from swarmsim.core.drawing import Mark
from swarmsim.view.layers.building import BoxLayer, BuildingLayer
from swarmsim.view.layers.doing import BeamLayer, LinkLayer, TileLayer, WayLayer
from swarmsim.view.layers.jobs import job_layers
from swarmsim.view.layers.known import FieldLayer, MapLayer
from swarmsim.view.layers.own import own_layers
from swarmsim.view.layers.robots import BeliefLayer, FaultLayer, LightLayer, PeopleLayer, RobotLayer
from swarmsim.view.scene import Frame, Scene
from swarmsim.view.signs import Sign
from swarmsim.view.style import LAYERS, Style


class OurLayer(Protocol):
    """A built-in layer: it sees more of a moment than third-party layers, and explains its signs."""

    @property
    def name(self) -> str:
        """What it is called."""
        ...

    def draw(self, shot: Frame) -> Sequence[Mark]:
        """The shapes of a moment."""
        ...

    def signs(self, scene: Scene, look: Style) -> list[Sign]:
        """The signs that this run's legend needs."""
        ...


class LayerStack:
    """Every layer of a scene."""

    def __init__(self, scene: Scene) -> None:
        #: In the order of their signs.
        self.all: tuple[OurLayer, ...] = (
            RobotLayer(), TileLayer(scene), BeamLayer(scene), WayLayer(), LinkLayer(),
            BeliefLayer(), FaultLayer(), LightLayer(), PeopleLayer(), BoxLayer(),
            FieldLayer(scene), MapLayer(scene), BuildingLayer(scene), *job_layers(scene),
        )  # fmt: skip
        self._own = own_layers(scene.scenario, scene.at(0))
        self.all += tuple(self._own)

    def signs(self, scene: Scene, look: Style) -> list[Sign]:
        """The signs of a look's layers."""
        return [sign for layer in self._shown(look) for sign in layer.signs(scene, look)]

    def draw(self, shot: Frame, look: Style) -> list[Mark]:
        """The shapes of a look's layers, the lowest first."""
        return sorted((mark for layer in self._shown(look) for mark in layer.draw(shot)), key=lambda mark: mark.z)

    def _shown(self, look: Style) -> list[OurLayer]:
        own: list[OurLayer] = [*self._own] if "own" in look.layers else []
        ours = self.all[: len(self.all) - len(self._own)]
        return [*(layer for layer in ours if layer.name in look.layers or layer.name not in LAYERS), *own]
