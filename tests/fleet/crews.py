"""Fleets of scenarios, for tests."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

from fleet.places import transport

from swarmsim.core.scenario.file import load
from swarmsim.fleet import running
from swarmsim.fleet.processes import Processes
from swarmsim.fleet.robot_end import RobotEnd
from swarmsim.fleet.running import Fleet, Up
from swarmsim.fleet.terms import Links
from swarmsim.fleet.transport import WORLD


def fleet_of(path: Path, *overrides: str, iterations: int | None = None) -> Fleet:
    """A scenario's fleet, at most so long."""
    return running.assembled(load(path, [*overrides, *_limit(iterations)]), str(path))


def free_fleet(path: Path, *overrides: str, pace: float, links: Links = "simulated", iterations: int) -> Fleet:
    """A fleet at a free pace, whose robots are not processes of this machine."""
    return running.assembled(load(path, [*overrides, *_limit(iterations)]), str(path), pace, links, local=False)


def _limit(iterations: int | None) -> list[str]:
    return [] if iterations is None else [f'stop={{iterations={iterations}, when_done="continue"}}']


@contextmanager
def in_threads(fleet: Fleet, place: str, logs: Path | None = None) -> Iterator[tuple[Up, list[RobotEnd]]]:
    """A fleet over `memory` whose robots are threads of this process."""
    charges = fleet.charges()
    with closing(transport("memory").open(place, WORLD)) as world:
        links = [transport("memory").open(place, number) for number in range(len(charges))]
        log = [None if logs is None else logs / f"robot-{number}.log" for number in range(len(charges))]
        robots = [RobotEnd(link, number, log[number]) for number, link in enumerate(links)]
        threads = [threading.Thread(target=one.run) for one in robots]
        for one in threads:
            one.start()
        with running.met(fleet, world, charges, Processes([]), logs) as there:
            yield there, robots
        for one in threads:
            one.join()
        for link in links:
            link.close()
