"""Checks of whole runs: all contracts in every iteration, determinism, one robot alone, and silence."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Final

import numpy as np

from swarmsim.core.errors import PartError
from swarmsim.core.messages import Broadcast, MessageBatch
from swarmsim.core.parts import Parts
from swarmsim.core.scenario import registry, shipped
from swarmsim.core.scenario.file import load
from swarmsim.core.scenario.toml import read_toml
from swarmsim.core.state import Knowledge, Moment, Senses
from swarmsim.engine import contracts
from swarmsim.engine.build import BuiltRun, build
from swarmsim.recording.digests import DIGESTED, Digests
from swarmsim.robots.kinematics import drives_of
from swarmsim.testing.broken import BrokenError

Say = Callable[[Senses], Broadcast[MessageBatch]]
ITERATIONS: Final = 25  # of a checked run, by default
SLACK: Final = 1e-9  # m/s: rounding allowed over the wheels' limit


def opened(
    scenario: Path | str,
    overrides: Sequence[str],
    strict: bool = False,
    allow_code: bool = False,
    watch: Callable[[Parts], Parts] | None = None,
) -> BuiltRun:
    """The run of a scenario file with `key=value` overrides; `watch` as in `build`. Raises InputError."""
    with registry.own_code(allow_code):
        path = Path(scenario)
        return build(load(path, overrides), str(path), strict=strict, watch=watch)


def limited(overrides: Sequence[str], iterations: int) -> tuple[str, ...]:
    """The overrides, extended to make a run last exactly this many iterations."""
    return (*overrides, f'stop={{iterations={iterations}, when_done="continue"}}')


def check_strictly(
    scenario: Path | str, overrides: Sequence[str] = (), iterations: int = ITERATIONS, allow_code: bool = False
) -> None:
    """Every part keeps its contract in every iteration, messages have their announced size, wheels keep their limits.

    Outputs are checked as for third-party parts in a run; messages must also survive packing and unpacking. Probes
    are sampled as for a recording.
    """
    run = opened(scenario, limited(overrides, iterations), True, allow_code)
    parts, problems = run.simulation.parts, list[tuple[str, str]]()
    speeds = drives_of(run.context).units == "m/s"

    class Check:
        def sample(self, moment: Moment[Knowledge]) -> None:
            run.sampled(moment)
            fastest = float(np.abs(moment.state.wheels[speeds]).max(initial=0.0))
            if fastest > run.scenario.robots.speed + SLACK:
                problems.append((f"wheels: {fastest:g} m/s; the limit is {run.scenario.robots.speed:g}", "motion"))
            if not np.isfinite(moment.state.pose).all():
                problems.append(("pose: not finite", "physics"))
            for wrong, seam in problems:
                raise BrokenError(f"{scenario}, iteration {moment.state.iteration}: {wrong}", seam)

    with _weighed(parts, run.context.rounds, problems):
        try:
            run.simulation.run([Check()])
        except PartError as problem:
            raise BrokenError(f"{scenario}: {problem}", problem.seam) from problem


@contextmanager
def _weighed(parts: Parts, rounds: int, problems: list[tuple[str, str]]) -> Iterator[None]:
    """Within this context, every message of each of the `rounds` exchanges in an iteration is packed and unpacked."""
    exchange = 0

    def weighed(say: Say, first: bool) -> Say:
        def said(senses: Senses) -> Broadcast[MessageBatch]:
            nonlocal exchange
            exchange = senses.iteration * rounds if first else exchange + 1
            found = say(senses)
            wrong = contracts.message_sizes(found, parts.computation.codec, exchange)
            if wrong is not None:
                problems.append((wrong, "computation" if first else "job"))
            return found

        return said

    with ExitStack() as patches:
        for holder, name, first in ((parts.computation, "say", True), (parts.jobs, "say_more", False)):
            if holder is not None:
                say = getattr(holder, name)
                setattr(holder, name, weighed(say, first))
                patches.callback(setattr, holder, name, say)
        yield


def check_determinism(
    scenario: Path | str, overrides: Sequence[str] = (), iterations: int = ITERATIONS, allow_code: bool = False
) -> None:
    """Two runs with the same seed are equal in every field of every iteration."""
    digests = []
    for _ in range(2):
        observer = Digests()
        opened(scenario, limited(overrides, iterations), False, allow_code).simulation.run([observer])
        digests.append(observer)
    for iteration, (first, second) in enumerate(zip(digests[0].rows, digests[1].rows, strict=True)):
        if first != second:
            size = len(first) // len(DIGESTED)
            field = next(one for i, one in enumerate(DIGESTED) if first[i * size :][:size] != second[i * size :][:size])
            raise BrokenError(f"{scenario}: two runs with the same seed differ in iteration {iteration}, in {field}")


def check_alone(
    scenario: Path | str, overrides: Sequence[str] = (), iterations: int = ITERATIONS, allow_code: bool = False
) -> None:
    """A single robot without messages runs through; in a swarm of groups, one of each."""
    robots = read_toml(shipped.found(scenario), "a scenario file").get("robots")
    single = [f"robots.{number}.count=1" for number in range(len(robots))] if isinstance(robots, list) else ()
    alone = (*(single or ("robots.count=1",)), 'network.topology={use="none"}', "faults=[]")
    check_strictly(scenario, (*overrides, *alone), iterations, allow_code)


def check_silence(
    scenario: Path | str, overrides: Sequence[str] = (), iterations: int = ITERATIONS, allow_code: bool = False
) -> None:
    """Robots that receive no messages run through."""
    check_strictly(scenario, (*overrides, 'network.topology={use="none"}'), iterations, allow_code)
