"""Fleets of scenarios, for tests."""

from __future__ import annotations

from pathlib import Path

from swarmsim.core.scenario.file import load
from swarmsim.fleet import running
from swarmsim.fleet.running import Fleet


def fleet_of(path: Path, *overrides: str, iterations: int | None = None) -> Fleet:
    """A scenario's fleet, at most so long."""
    limit = () if iterations is None else (f'stop={{iterations={iterations}, when_done="continue"}}',)
    return running.assembled(load(path, [*overrides, *limit]), str(path))
