"""The processors of a run, and whether what robots have to hold fits into their memory."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from msgspec import UNSET
from numpy.typing import NDArray

from swarmsim.core.context import BuildContext, Gauge
from swarmsim.core.errors import PlacedError
from swarmsim.core.processors import MIND, Processors
from swarmsim.core.scenario.file import Scenario, minds_of


def processors_of(scenario: Scenario, context: BuildContext) -> Processors:
    """The processors of the robots served, which hold what their minds declare."""
    crew, exchange = context.robots, context.period / context.rounds
    processors = Processors(crew.processors, crew.kind, exchange, context.rounds)
    for one in minds_of(scenario):
        size = one.mind.computation.declares("cell_bytes", 0) * context.lattice.rows * context.lattice.columns
        rows = np.isin(crew.kind, one.groups) if one.groups else np.ones(len(crew.kind), np.bool_)
        for row in np.flatnonzero(rows).tolist() if size else ():
            processors.hold(row, MIND, size)
    return processors


def check_memory(
    processors: Processors, scenario: Scenario, context: BuildContext, needs: Mapping[str, NDArray[np.float64]]
) -> None:
    """Raise InputError for robots whose minds and jobs need more memory than they have.

    `needs` has the bytes (rows,) of each job, by name.
    """
    minds = processors.held(MIND)
    wanted = minds + sum(needs.values(), np.zeros(len(context.ids)))
    too_much = np.flatnonzero(wanted > processors.memory)
    if not len(too_much):
        return
    row = int(too_much[0])
    cells = context.lattice.rows * context.lattice.columns
    of_mind = [f"its mind {minds[row]:.0f} ({cells} cells of {minds[row] / cells:.0f} bytes)"] if minds[row] else []
    told = ", ".join([*of_mind, *(f"the job {name!r} {size[row]:.0f}" for name, size in needs.items())])
    raise PlacedError(
        f"{_key(scenario, int(context.robots.kind[row]))}.memory: {processors.memory[row]:.0f} bytes on robot "
        f"{context.ids[row]}, which has to hold {wanted[row]:.0f}: {told}; expected more memory, or "
        + " or ".join([*(["larger cells"] if of_mind else []), *(["smaller pieces"] if needs else [])])
    )


def _key(scenario: Scenario, kind: int) -> str:
    """Where a group's processor is in the scenario."""
    groups = scenario.robots.groups
    own = bool(groups) and groups[kind].processor is not UNSET
    return f"robots[{kind}].processor" if own else "robots.processor"


def gauges_of(processors: Processors) -> tuple[Gauge, ...]:
    """What probes can read of processors."""
    return (
        Gauge("processor used", "1", processors.used),
        Gauge("processor late", "iterations", processors.late),
        Gauge("computing energy", "J", processors.spent),
        Gauge("memory held", "bytes", processors.peak),
    )
