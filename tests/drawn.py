"""Floor plans from drawings written in tests."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from swarmsim.core.scenario.decoding import convert
from swarmsim.core.scenario.file import World
from swarmsim.world import svg
from swarmsim.world.plan import FloorPlan
from swarmsim.world.reading import plan_of


def read_floor_plan(
    source: str,
    name: str,
    scale: float = 1.0,
    across: float | None = None,
    layers: Mapping[str, Sequence[str]] | None = None,
    **keys: object,
) -> FloorPlan:
    """The solids of an SVG text, before its floor is chosen."""
    more = {"layers": {layer: list(names) for layer, names in layers.items()}} if layers else {}
    size = {"width": across} if across is not None else {} if scale == 1.0 else {"scale": scale}
    world = convert({"file": name, **size, **more, **keys}, World)
    return plan_of(svg.read(source, name, world), world)
