"""Judge a rule of exploration between another and the online oracle, in worlds that neither was chosen on.

    python benchmarks/exploring/judge.py REGIME [--rule shared] [--first 20000] [--rounds 6]

Each round has one world of each of six kinds, with 4, 10 or 30 robots in turn. All methods run in each world from the
same starts. Ratios are of geometric means, intervals 95 % by the bootstrap over worlds; a run that has not ended after
2000 iterations counts as 2000, and is told.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from swarmsim.core.scenario.file import load
from swarmsim.engine.build import build

SCENARIO = Path(__file__).parents[2] / "scenarios" / "exploring.toml"
LIMIT, SHARES = 2000, (0.90, 0.99, 1.0)
KINDS = {
    "rooms": '{use="rooms", width=9.0, height=6.0}',
    "office": '{use="office", width=9.0, height=6.0}',
    "maze": '{use="maze", width=8.4, height=5.4}',
    "cave": '{use="cave", width=10.5, height=7.5, filled=0.4}',
    "obstacles": '{use="obstacles", width=8.4, height=6.6, filled=0.25}',
    "halls": '{use="rooms", width=9.0, height=6.0, room=3.0, door=1.2, loops=1.0}',
}
REGIMES = {
    "nearest": ('network.topology={use="knn", k=2}',),
    "sight": ('network.topology={use="line-of-sight", radius=3.0}',),
}
METHODS = {  # strategy, sharing, and whether all hear all
    "dispersed": ("dispersed-frontier", "gossip", False),
    "shared": ("shared-frontier", "gossip", False),
    "learned": (
        'shared-frontier", weight=22.8, reach=13.1, stays=2.15, revenue=2.93, replan="every-iteration',
        "gossip",
        False,
    ),
    "assigned": ('assigned-frontier", replan="every-iteration', "gossip", False),
    "oracle": ("oracle-frontier", "tile-and-goal", True),
}


def keys_of(kind: str, seed: int, robots: int, limit: int = LIMIT) -> list[str]:
    """What a task sets, beside who hears whom."""
    return [
        f"world={{generate={KINDS[kind]}, seed={seed}}}",
        f"robots.count={robots}",
        f"stop.iterations={limit}",
    ]


def times(kind: str, seed: int, robots: int, regime: str, method: str) -> tuple[list[int], float]:
    """The iterations to each of SHARES, and the bytes that a robot told in an iteration."""
    strategy, sharing, everything = METHODS[method]
    keys = [
        *keys_of(kind, seed, robots),
        f'mind.strategy={{use="{strategy}"}}',
        f'mind.computation.sharing={{use="{sharing}"}}',
        *(('network.topology={use="full"}',) if everything else REGIMES[regime]),
    ]
    simulation = build(load(SCENARIO, keys), str(SCENARIO)).simulation
    covered, told = list[float](), list[float]()
    say = simulation.parts.computation.say
    simulation.parts.computation.say = lambda senses: (said := say(senses), told.append(said.sizes.mean()))[0]
    while not simulation.over:
        covered.append(simulation.tick().measured.values["coverage"])
    reached = [1 + int(np.searchsorted(covered, share - 1e-12)) for share in SHARES]
    return [LIMIT if at > len(covered) else at for at in reached], float(np.mean(told))


def main() -> None:
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("regime", choices=REGIMES)
    asked.add_argument("--rule", choices=("shared", "learned", "assigned"), default="shared")
    asked.add_argument("--first", type=int, default=20000)
    asked.add_argument("--rounds", type=int, default=6)
    args = asked.parse_args()
    tasks = [
        (kind, args.first + i, (4, 10, 30)[(i + j) % 3]) for i in range(args.rounds) for j, kind in enumerate(KINDS)
    ]
    done = {
        method: [times(*task, args.regime, method) for task in tasks] for method in ("dispersed", args.rule, "oracle")
    }
    logs = {method: np.log([run for run, _ in runs]) for method, runs in done.items()}
    drawn = np.random.default_rng(1).integers(len(tasks), size=(10_000, len(tasks)))
    told = {method: round(float(np.mean([size for _, size in runs])), 1) for method, runs in done.items()}
    unfinished = {method: sum(run[-1] == LIMIT for run, _ in runs) for method, runs in done.items()}
    print(f"{args.regime}: {len(tasks)} worlds; not finished {unfinished}; bytes per robot and iteration {told}")
    for k, share in enumerate(SHARES):
        base, rule, oracle = (np.exp(log[drawn, k].mean(axis=1)) for log in logs.values())
        b, r, o = (float(np.exp(log[:, k].mean())) for log in logs.values())
        ratio, gap = (
            np.quantile(rule / base, (0.025, 0.975)),
            np.quantile((base - rule) / (base - oracle), (0.025, 0.975)),
        )
        print(
            f"to {share:.0%}: {b:.1f}, {r:.1f}, {o:.1f}; ratio {r / b:.3f} ({ratio[0]:.3f} to {ratio[1]:.3f}); "
            f"share of the gap {(b - r) / (b - o):.2f} ({gap[0]:.2f} to {gap[1]:.2f})"
        )


if __name__ == "__main__":
    main()
