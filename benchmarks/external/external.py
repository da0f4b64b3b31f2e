"""Published results on exploration rules, with their worlds rebuilt and our numbers beside theirs.

Their robots are points that step from square to square of a grid; ours are two-wheeled discs that must turn, push and
fit through. The main comparison is how much faster one rule, or hearing others, is.
Run: `make external`.
"""

from __future__ import annotations

import argparse
import csv
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from swarmsim.core.scenario.file import load
from swarmsim.engine.build import build

HERE = Path(__file__).parent
SHARES = {"T90": 0.9, "T100": 1.0}
SQUARES = {"obstacles": 2.0, "rooms": 1.0}  # iterations that a robot needs to drive one square
NOBODY = {"network.topology": {"use": "none"}}
EVERY = {"replan": "every-iteration"}  # robots of the first table replan in every step


@dataclass(frozen=True)
class Condition:
    """One row of a published table, and our equivalent."""

    source: str
    robots: int
    rule: str
    hears: str
    changes: dict[str, Any]


UTILITY = {"use": "utility-frontier", "weight": 1.0}  # expected view plus nearness, both from 0 to 1
OBSTACLES = {"greedy": {"use": "nearest-frontier"}, "utility": UTILITY}
ROOMS = {"closest": {"use": "nearest-frontier"}, "random": {"use": "random-frontier"}}
CONDITIONS = [
    Condition("obstacles", 3, rule, hears, {"mind.strategy": {**ours, **EVERY}, **network})
    for rule, ours in OBSTACLES.items()
    for hears, network in (("near", {}), ("nobody", NOBODY))
] + [
    Condition("rooms", robots, rule, "all", {"robots.count": robots, "mind.strategy": ours})
    for robots in (4, 12)
    for rule, ours in ROOMS.items()
]

#: Comparisons: how much longer the first takes than the second.
RATIOS = [
    ("obstacles", "hearing no one instead of those in sight, greedy", (3, "greedy", "nobody"), (3, "greedy", "near")),
    (
        "obstacles",
        "hearing no one instead of those in sight, utility",
        (3, "utility", "nobody"),
        (3, "utility", "near"),
    ),
    ("obstacles", "utility instead of greedy, in sight", (3, "utility", "near"), (3, "greedy", "near")),
    ("obstacles", "utility instead of greedy, hearing no one", (3, "utility", "nobody"), (3, "greedy", "nobody")),
    ("rooms", "random instead of closest, 4 robots", (4, "random", "all"), (4, "closest", "all")),
    ("rooms", "random instead of closest, 12 robots", (12, "random", "all"), (12, "closest", "all")),
    ("rooms", "4 robots instead of 12, closest", (4, "closest", "all"), (12, "closest", "all")),
    ("rooms", "4 robots instead of 12, random", (4, "random", "all"), (12, "random", "all")),
]


def run(asked: tuple[Condition, int]) -> dict[str, float]:
    """The iterations until shares of the floor were known, or the limit."""
    condition, seed = asked
    changes = {**condition.changes, "world.seed": seed, "seed": seed}
    made = build(load(HERE / f"{condition.source}.toml", changes=changes), condition.source)
    curve: list[float] = []

    class Keep:
        def sample(self, moment: Any) -> None:
            curve.append(moment.measured.values["coverage"])

    made.simulate([Keep()])
    covered = np.array(curve)
    return {
        name: float(np.argmax(covered >= share) + 1) if covered[-1] >= share else float(len(covered))
        for name, share in SHARES.items()
    }


def mean_ratio(first: np.ndarray, second: np.ndarray, random: np.random.Generator) -> tuple[float, float, float]:
    """The ratio of two means, with its 95 % interval from resampling their common worlds."""
    rows = random.integers(len(first), size=(5000, len(first)))
    low, high = np.quantile(first[rows].mean(axis=1) / second[rows].mean(axis=1), (0.025, 0.975))
    return float(first.mean() / second.mean()), float(low), float(high)


def published_ratio(one: dict[str, str], other: dict[str, str]) -> tuple[float, float, float]:
    """The same for published means, with an interval from their deviations (delta method)."""
    ratio = float(one["mean"]) / float(other["mean"])
    error = np.sqrt(sum((float(row["sd"]) / float(row["mean"])) ** 2 / int(row["runs"]) for row in (one, other)))
    return ratio, float(ratio * np.exp(-1.96 * error)), float(ratio * np.exp(1.96 * error))


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--worlds", type=int, default=40)
    parser.add_argument("--workers", type=int, default=2)
    arguments = parser.parse_args()
    with (HERE / "published.csv").open() as file:
        published = {
            (row["source"], int(row["robots"]), row["rule"], row["hears"], row["measure"]): row
            for row in csv.DictReader(file)
        }
    times: dict[tuple[str, int, str, str], dict[str, np.ndarray]] = {}
    print("world      robots  rule     hears   measure  published  runs  ours, squares  ours / published")
    with ProcessPoolExecutor(arguments.workers) as pool:
        for one in CONDITIONS:
            key = (one.source, one.robots, one.rule, one.hears)
            found = list(pool.map(run, [(one, seed) for seed in range(1, arguments.worlds + 1)]))
            times[key] = {name: np.array([each[name] for each in found]) / SQUARES[one.source] for name in SHARES}
            for name in SHARES:
                if row := published.get((*key, name)):
                    ours, theirs = times[key][name].mean(), float(row["mean"])
                    words = f"{one.source:9}  {one.robots:6}  {one.rule:7}  {one.hears:6}  {name:7}  {theirs:9.1f}"
                    print(f"{words}  {row['runs']:>4}  {ours:13.1f}  {ours / theirs:16.2f}", flush=True)
    random = np.random.default_rng(0)
    print("\nby how much longer                                   measure  published             ours")
    for source, words, first, second in RATIOS:
        for name in SHARES:
            rows = [published.get((source, *key, name)) for key in (first, second)]
            if None in rows:
                continue
            theirs = published_ratio(*rows)
            ours = mean_ratio(times[source, *first][name], times[source, *second][name], random)
            told = "  ".join(f"{ratio:.2f} ({low:.2f} to {high:.2f})" for ratio, low, high in (theirs, ours))
            print(f"{words:51}  {name:7}  {told}", flush=True)


if __name__ == "__main__":
    main()
