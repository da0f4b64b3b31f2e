"""What a swarm's messages take on radios that exist."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swarmsim.api.overrides import Overrides, told_apart
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.file import Scenario, load
from swarmsim.core.scenario.part import NONE, Part
from swarmsim.engine.build import build
from swarmsim.network.radios import RADIOS


@dataclass(frozen=True, slots=True)
class OnRadio:
    """One kind of messages on one radio."""

    sharing: str  # what robots tell
    median: int  # bytes
    longest: int  # bytes
    radio: str
    mtu: int  # bytes
    airtime: float  # s, of the median message
    longest_airtime: float | None  # s; None: it does not fit into a frame


def radio_airtime(
    scenario: str | Path, *, iterations: int = 200, overrides: Overrides | None = None, allow_code: bool = False
) -> list[OnRadio]:
    """Bytes of a scenario's messages, and their time on radios: `swarmsim radio airtime`.

    If its computation has a part for what robots tell, as mapping has `sharing`, each that is installed is simulated
    with its defaults, for so many `iterations` at most. `overrides` and `allow_code` are as those of `run`, `scenario`
    too. Raises InputError, PartError.
    """
    with registry.own_code(allow_code):
        told = [(name, _sizes(scenario, made, iterations)) for name, made in _alternatives(Path(scenario), overrides)]
    return [row for name, sizes in told if len(sizes) for row in _rows(name, sizes)]


def _alternatives(scenario: Path, overrides: Overrides | None) -> Iterator[tuple[str, Scenario]]:
    """The scenario with each part that its computation could have for what robots tell, or as it is."""
    texts, changes = told_apart(overrides)
    own = load(scenario, texts, changes)
    parameters = own.mind.computation.parameters
    inner = {key: getattr(parameters, key) for key in parameters.__struct_fields__}
    key, part = next(((key, one) for key, one in inner.items() if isinstance(one, Part) and one), ("", NONE))
    if not part:
        yield own.mind.computation.use, own
    for name in registry.entries(part.seam) if part else ():
        chosen = {**changes, f"mind.computation.{key}": part.table if name == part.use else {"use": name}}
        yield name, load(scenario, texts, chosen)


def _sizes(path: str | Path, scenario: Scenario, iterations: int) -> NDArray[np.int32]:
    """The bytes of every message that somebody could have heard."""
    simulation = build(scenario, str(path)).simulation
    found = [np.empty((0, 2), np.int32)]
    while not simulation.over and len(found) <= iterations:
        delivery = simulation.tick().delivery
        packets = np.concatenate([delivery.heard, *(lost for _, lost in delivery.lost)])
        found.append(np.unique(packets[packets[:, 2] == simulation.state.iteration - 1][:, [1, 3]], axis=0))
    return np.concatenate(found)[:, 1]


def _rows(sharing: str, sizes: NDArray[np.int32]) -> Iterator[OnRadio]:
    median, longest = int(np.percentile(sizes, 50, method="higher")), int(sizes.max())
    for name, radio in RADIOS.items():
        airtime, fits = radio.airtime(median), longest <= radio.mtu
        yield OnRadio(sharing, median, longest, name, radio.mtu, airtime, radio.airtime(longest) if fits else None)
