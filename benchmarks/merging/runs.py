"""Whole runs of robots that do not know each other's places, in buildings whose parts look alike and in ordinary ones.

A run says how many frames were found, whether any was ever false, how many were withdrawn or are undecided at the
end, and how much of the maps is false: cells that no true cell of their kind lies on or beside. The buildings are
others than those of `pairs`. Run: `python benchmarks/merging/runs.py`.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from alike import ORDINARY, write
from scipy import ndimage

from swarmsim.core.scenario.file import load
from swarmsim.core.state import FREE, OCCUPIED
from swarmsim.engine.build import BuiltRun, build
from swarmsim.operations.mapping.maps import Maps
from swarmsim.operations.mapping.measures.frames import FrameMeasures
from swarmsim.operations.mapping.measures.sightings import Sightings
from swarmsim.operations.mapping.sharing.policies import cells_of

MERGING = Path(__file__).parents[2] / "scenarios" / "merging.toml"
ALIKE = "hotel", "comb", "half-turn", "mirror"
GENERATED = {
    "rooms": {"use": "rooms", "width": 12.0, "height": 7.5},
    "office": {"use": "office", "width": 13.5, "height": 9.0},
    "cave": {"use": "cave", "width": 12.0, "height": 9.0},
}
COUNTS = "found", "false", "off", "withdrawn", "undecided"
COLUMNS = (
    "building", "runs", "frames", *COUNTS, "all known", "decided", "finished", "median", "sensed", "false", "worst",
    "union", "CPU, s",
)  # fmt: skip
ROBOTS, LIMIT, FIRST = 4, 800, 2000  # robots, iterations, seed


@dataclass(frozen=True)
class Outcome:
    """What became of one run."""

    frames: dict[str, Any]
    iterations: int
    finished: bool
    sensed: float  # share of the domain that robots' own tiles have truly shown
    false: float  # share of false cells in robots' maps, mean over robots
    union: float  # the same in the union of all maps
    seconds: float  # of processor time


def outcome(kind: str, seed: int, more: dict[str, Any], folder: Path) -> Outcome:
    """One run."""
    world = (
        {"world.generate": GENERATED[kind], "world.seed": seed}
        if kind in GENERATED
        else {"world": {"file": str(write(kind, seed, folder))}}
    )
    run = build(
        load(MERGING, changes={"robots.count": ROBOTS, "stop.iterations": LIMIT, "seed": seed, **world, **more}), kind
    )
    probe, sightings, began = FrameMeasures(run.explorable), Sightings(run.context.lattice), time.process_time()
    while not run.simulation.over:
        moment = run.simulation.tick([probe])
        sightings.add(moment)
    finished = run.simulation.finished
    false, union = false_cells(run, moment.knowledge)
    sensed, seconds = float(sightings.seen[run.explorable].mean()), time.process_time() - began
    return Outcome(probe.summary(), run.simulation.state.iteration, finished, sensed, false, union, seconds)


def false_cells(run: BuiltRun, maps: Maps) -> tuple[float, float]:
    """The shares of false cells in robots' maps (mean), and in their union."""
    wall, free = (ndimage.maximum_filter(one, 3) for one in (run.arena.occupied, ~run.arena.occupied))
    cells = cells_of(maps)
    shares = []
    for one in (*cells, cells.max(axis=0)):
        false = ((one == OCCUPIED) & ~wall) | ((one == FREE) & ~free)
        shares.append(np.count_nonzero(false) / max(np.count_nonzero(one), 1))
    return float(np.mean(shares[:-1])), float(shares[-1])


def row(kind: str, runs: Sequence[Outcome]) -> str:
    """One kind of building."""
    pairs = ROBOTS * (ROBOTS - 1)
    totals = [sum(run.frames[f"frames_{name}"] for run in runs) for name in COUNTS]
    everyone = sum(run.frames["frames_found"] == pairs for run in runs)
    decided = sum(run.frames["frames_undecided"] == 0 for run in runs)
    ended = [run for run in runs if run.finished]
    median = sorted(run.iterations if run.finished else np.inf for run in runs)[len(runs) // 2]
    least = min((run.sensed for run in ended), default=None)
    false, union = (np.array([getattr(run, name) for run in runs]) for name in ("false", "union"))
    columns = (
        kind, len(runs), pairs * len(runs), *totals, everyone, decided, len(ended),
        "not" if np.isinf(median) else median, "-" if least is None else f"{least:.2%}", f"{false.mean():.2%}",
        f"{false.max():.2%}", f"{union.mean():.2%}", f"{sum(run.seconds for run in runs):.0f}",
    )  # fmt: skip
    return "".join(f"{column!s:<11}" for column in columns).rstrip()


def main() -> None:
    """Print a row for each kind of building."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kinds", nargs="+", default=[*ALIKE, *GENERATED, *ORDINARY])
    parser.add_argument("--runs", type=int, default=25, help="of each kind where rooms look alike")
    parser.add_argument("--others", type=int, default=6, help="of each other kind")
    parser.add_argument("--drift", type=float, default=0.0, help="m, standard deviation of odometry's steps")
    parser.add_argument("--noise", type=float, default=0.0, help="share of beams that end anywhere")
    parser.add_argument("--workers", type=int, default=2)
    arguments = parser.parse_args()
    more: dict[str, Any] = {"sensor.outliers": arguments.noise} if arguments.noise else {}
    if arguments.drift:
        more["faults"] = [
            {
                "use": "localisation",
                "failure": "drift",
                "at": 0,
                "count": ROBOTS,
                "sigma": arguments.drift,
                "sigma_yaw": arguments.drift,
            }
        ]
    print("".join(f"{name:<11}" for name in COLUMNS).rstrip())
    with tempfile.TemporaryDirectory() as folder, ProcessPoolExecutor(arguments.workers) as pool:
        for kind in arguments.kinds:
            seeds = range(FIRST, FIRST + (arguments.runs if kind in ALIKE else arguments.others))
            print(row(kind, list(pool.map(partial(outcome, kind, more=more, folder=Path(folder)), seeds))), flush=True)


if __name__ == "__main__":
    main()
