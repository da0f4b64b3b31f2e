"""The jobs of a run, beside its robots' computation."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.bundle import Bundle
from swarmsim.core.capabilities import lacking
from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.jobs import AnyJob, PieceJob, Shared
from swarmsim.core.parts import AnyComputation
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.decoding import convert
from swarmsim.core.scenario.file import Network, Scenario
from swarmsim.core.scenario.part import Part
from swarmsim.engine.foreign import make
from swarmsim.engine.guard import Clock, held
from swarmsim.engine.processors import check_memory, processors_of


def bundled(
    computation: AnyComputation, scenario: Scenario, context: BuildContext, clock: Clock | None = None,
    strict: bool = False,
) -> tuple[AnyComputation, Bundle | None]:  # fmt: skip
    """The computation with the scenario's jobs beside it, if there are any, and the bundle that they are.

    With a clock, third-party ones are guarded, or all if `strict`. Raises InputError for jobs that cannot be done.
    """
    processors = processors_of(scenario, context)
    if not scenario.jobs:
        _check_without(scenario)
        check_memory(processors, scenario, context, {})
        return computation, None
    context = replace(context, processors=processors)
    jobs: dict[str, AnyJob] = {}
    needs: dict[str, NDArray[np.float64]] = {}
    for number, part in enumerate(scenario.jobs):
        name = name_of(part)
        if name in jobs:
            raise InputError(f"jobs[{number}].name: {name!r} is that of an earlier job; expected another name")
        jobs[name] = _job(part, name, scenario.network, context, f"jobs[{number}]", clock, strict, needs)
    check_memory(processors, scenario, context, needs)
    if clock is not None and (strict or not registry.is_ours(computation)):
        computation = held("computation", computation, context, clock, not registry.is_ours(computation))
    bundle = Bundle(computation, jobs, processors, context.rounds)
    return bundle, bundle


def _check_without(scenario: Scenario) -> None:
    """Raise InputError for what a scenario without jobs has no use for."""
    if scenario.task.declares("needs_jobs", False):
        raise InputError(f"task.use: {scenario.task.use!r} measures jobs, and there are none; expected [[jobs]]")
    if scenario.network.exchanges > 1:
        raise InputError(
            f"network.rounds: {scenario.network.exchanges} exchanges in an iteration, all but the first for jobs, and "
            "there are none; expected [[jobs]], or 1"
        )


def _check_channel(network: Network, longest: int, context: BuildContext) -> None:
    """Raise InputError for a channel through which what a job says never gets."""
    for channel in network.channel.inside():
        through = channel.declares("longest", None)
        most = math.inf if through is None else through(context.period / context.rounds)
        if longest > most:
            raise InputError(
                f"use: what a piece says takes {longest} bytes at once, and the channel {channel.use!r} lets messages "
                f"of {most:g} through before they expire; expected smaller pieces, or a wider channel"
            )


def name_of(part: Part[AnyJob]) -> str:
    """What a job is called in recordings."""
    given: str = part.declares("name", "")
    return given or re.sub(r"[^a-z0-9]+", "_", part.use.rpartition(":")[2].lower()).strip("_")


def _job(
    part: Part[AnyJob], name: str, network: Network, context: BuildContext, place: str, clock: Clock | None,
    strict: bool, needs: dict[str, NDArray[np.float64]],
) -> AnyJob:  # fmt: skip
    """A job; one in pieces with what shares it among robots, and noted in `needs`. Raises InputError."""
    found: object = make(part, context, place)
    ours = registry.is_ours(found)
    if not lacking(PieceJob, found):
        from swarmsim.jobs.onlooker import ObservedJob

        asked = part.parameters
        keys = {key: getattr(asked, key) for key in Shared.__struct_fields__ if hasattr(asked, key)}
        try:
            shared = convert({**keys, "name": name}, Shared)
            found = ObservedJob(found, shared, context)  # type: ignore[arg-type]
            _check_channel(network, found.inner.longest, context)
            needs[name] = found.inner.needs
        except InputError as problem:
            raise problem.inside(place) from problem
    job: AnyJob = found  # type: ignore[assignment]
    return job if clock is None or (ours and not strict) else held("job", job, context, clock, not ours)
