"""Trains a small policy to explore unseen rooms, and draws its learning curve beside random exploration.

The policy has 16 weights, from eight features of a robot's readings and messages to a speed and a turn. CMA-ES (Hansen
2016, by the library pycma) maximises the area that six robots have seen after 150 iterations. Some generated buildings
are for training, others for judging. Run it with `make learning`; it takes about ten minutes.
"""

from __future__ import annotations

import argparse
import json
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import cma
import numpy as np
from matplotlib.figure import Figure

from swarmsim.core.scenario.file import load
from swarmsim.engine.build import build
from swarmsim.learning import SwarmEnv
from swarmsim.view.plots.fault_marks import line_key
from swarmsim.view.plots.sheet import save, settled, sheet
from swarmsim.view.plots.style import BLUE, GREEN, GREY, VERMILLION, styled

SCENARIO = Path(__file__).parents[2] / "scenarios" / "exploring.toml"
ITERATIONS, ROBOTS, POPULATION, GENERATIONS, SEEDS = 150, 6, 12, 40, 5
TRAINED, JUDGED = (101, 102, 103, 104), (201, 202, 203, 204, 205, 206, 207, 208)  # world seeds
FEATURES = 8


def keys(world: int) -> dict:
    """The scenario's changes."""
    return {
        "world.seed": world, "robots.count": ROBOTS, "stop.iterations": ITERATIONS, "stop.when_done": "continue",
        "mind.computation.sharing": {"use": "current-tile"},
    }  # fmt: skip


class Policy:
    """Tile, pose and inbox in, a twist out; the same weights for every robot."""

    def __init__(self, weights: np.ndarray, seed: int = 0) -> None:
        self.weights = weights.reshape(2, FEATURES)
        self.noise = np.random.default_rng(seed)
        self.drift: dict[str, float] = {}

    def __call__(self, observed: dict[str, dict]) -> dict[str, np.ndarray]:
        """An action for each agent."""
        names = list(observed)
        tiles = np.array([observed[name]["tile"] for name in names])
        yaw = np.array([observed[name]["pose"][2] for name in names])
        offsets = np.array([observed[name]["offsets"] for name in names])
        heard = np.array([observed[name]["heard"] for name in names])
        rows, columns = tiles.shape[1:]
        y, x = np.indices((rows, columns), float)
        y, x = (y - (rows - 1) / 2) * 0.15, (x - (columns - 1) / 2) * 0.15
        near = np.exp(-np.hypot(x, y) / 0.3)
        walls, unknown = (np.where(tiles == value, near, 0.0) for value in (2, 0))
        apart = np.hypot(offsets[..., 0], offsets[..., 1])
        pushes = np.where(np.arange(offsets.shape[1]) < heard[:, None], np.exp(-apart / 1.0), 0.0)
        units = offsets / np.maximum(apart, 1e-6)[..., None]
        sums = [np.stack([(field * x).sum((1, 2)), (field * y).sum((1, 2))], axis=1) for field in (walls, unknown)]
        sums.append((pushes[..., None] * units).sum(axis=1))
        cos, sin = np.cos(yaw), np.sin(yaw)
        body = [(s[:, 0] * cos + s[:, 1] * sin, s[:, 1] * cos - s[:, 0] * sin) for s in sums]
        for name in names:
            self.drift[name] = 0.95 * self.drift.get(name, 0.0) + 0.3 * self.noise.standard_normal()
        features = np.stack(
            [*body[0], *body[1], *body[2], np.ones(len(names)), [self.drift[name] for name in names]], axis=1
        )
        acted = np.tanh(features @ self.weights.T)
        return dict(zip(names, acted.astype(np.float32), strict=True))


class Random:
    """Random exploration: a random twist, kept for ten iterations."""

    def __init__(self, seed: int = 0) -> None:
        self.random, self.kept, self.asked = np.random.default_rng(seed), {}, 0

    def __call__(self, observed: dict[str, dict]) -> dict[str, np.ndarray]:
        """An action for each agent."""
        if self.asked % 10 == 0:
            self.kept = {name: self.random.uniform((0.0, -1.0), (1.0, 1.0)).astype(np.float32) for name in observed}
        self.asked += 1
        return {name: self.kept.get(name, np.zeros(2, np.float32)) for name in observed}


_environments: dict[int, SwarmEnv] = {}


def coverage(policy: Policy | Random, world: int, seed: int) -> float:
    """The share that the swarm has seen at the end of an episode, 0 to 1."""
    if world not in _environments:
        _environments[world] = SwarmEnv(SCENARIO, keys(world))
    env = _environments[world]
    observed, _ = env.reset(seed=seed)
    total = 0.0
    while env.agents:
        observed, rewards, *_ = env.step(policy(observed))
        total += next(iter(rewards.values()))
    return total


def trained(seed: int) -> list[dict]:
    """The generations of one training run: environment steps so far, and the best guess's score."""
    search = cma.CMAEvolutionStrategy(
        np.zeros(2 * FEATURES), 0.7, {"popsize": POPULATION, "seed": seed, "verbose": -9, "maxiter": GENERATIONS}
    )
    history, steps = [], 0
    for generation in range(GENERATIONS):
        asked = search.ask()
        world = TRAINED[generation % len(TRAINED)], TRAINED[(generation + 1) % len(TRAINED)]
        scores = [
            np.mean([coverage(Policy(weights, generation), one, 1000 * seed + generation) for one in world])
            for weights in asked
        ]
        search.tell(asked, [-score for score in scores])
        steps += len(asked) * len(world) * ITERATIONS
        is_due = generation % 3 == 0 or generation == GENERATIONS - 1
        judged = float(np.mean([coverage(Policy(search.mean, 1), one, 7) for one in JUDGED])) if is_due else None
        history.append(
            {"steps": steps, "trained": float(np.mean(scores)), "judged": judged,
             "weights": search.mean.tolist()}
        )  # fmt: skip
        print(seed, generation, history[-1]["trained"], history[-1]["judged"], flush=True)
    return history


def frontier(world: int, strategy: str) -> float:
    """The share that a frontier strategy has seen by then."""
    run = build(load(SCENARIO, changes={**keys(world), "mind.strategy": {"use": strategy}, "seed": 7}), "x")
    last = 0.0
    while not run.simulation.over:
        last = run.simulation.tick().measured.values["coverage"]
    return last


@styled
def curve(histories: list[list[dict]], levels: dict[str, float]) -> Figure:
    """The learning curve of every seed and their mean, beside other strategies."""
    figure = sheet(8.0, 4.6, "Learning to explore: 6 robots, buildings that were not trained in")
    axes = figure.subplots()
    for history in histories:
        points = [(one["steps"], 100.0 * one["judged"]) for one in history if one["judged"] is not None]
        axes.plot(*np.array(points).T, color=BLUE, lw=0.8, alpha=0.5)
    means = np.mean([[one["judged"] for one in history if one["judged"] is not None] for history in histories], axis=0)
    steps = [one["steps"] for one in histories[0] if one["judged"] is not None]
    axes.plot(steps, 100.0 * means, "o-", color=BLUE, lw=2.0, ms=4)
    handles = [line_key(f"learned, mean of {len(histories)} seeds and each", BLUE, "o", "-")]
    for (name, level), colour in zip(levels.items(), (VERMILLION, GREEN, GREY), strict=False):
        axes.axhline(100.0 * level, color=colour, lw=1.4, ls="--")
        handles.append(line_key(name, colour, "", "--"))
    axes.set(xlabel="iterations simulated for training", ylabel="seen after 150 iterations, %", ylim=(0.0, 100.0))
    return settled(figure, handles)


def main() -> None:
    """Train, judge, draw and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("runs/learning"))
    parser.add_argument("--workers", type=int, default=2)
    arguments = parser.parse_args()
    begun = time.perf_counter()
    with ProcessPoolExecutor(arguments.workers) as pool:
        histories = list(pool.map(trained, range(1, SEEDS + 1)))
    random = float(np.mean([coverage(Random(seed), world, 7) for world in JUDGED for seed in (1, 2, 3)]))
    levels = {"random twists": random}
    for strategy in ("random-frontier", "nearest-frontier"):
        levels[strategy] = float(np.mean([frontier(world, strategy) for world in JUDGED]))
    last = [history[-1]["judged"] for history in histories]
    arguments.out.mkdir(parents=True, exist_ok=True)
    (arguments.out / "learning.json").write_text(json.dumps({"levels": levels, "histories": histories}))
    print(f"learned, mean of {SEEDS} seeds: {np.mean(last):.3f} ({min(last):.3f} to {max(last):.3f})")
    print(", ".join(f"{name}: {level:.3f}" for name, level in levels.items()))
    print(f"{time.perf_counter() - begun:.0f} s with {arguments.workers} workers")
    for path in save(curve(histories, levels), arguments.out / "learning"):
        print(path)


if __name__ == "__main__":
    main()
