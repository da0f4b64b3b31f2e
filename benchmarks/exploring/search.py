"""Search a rule's numbers by the cross-entropy method, with as many runs for one rule as for another.

    python benchmarks/exploring/search.py RULE [--first 1000]

Three generations of six candidates, drawn around the two best of the generation before (log-normal; the first around
the shipped values, which are its first candidate). Each generation has six worlds of its own, one of each kind, with 4,
10 or 30 robots; in half of them robots hear their two nearest others, in half those in sight. A candidate's score is
the mean logarithm of its iterations to 99 %, at most LIMIT. The values found last replace the shipped ones if they are
faster in twelve further worlds. All rules have the same worlds, the same means (gossip with goals, a new choice in
every iteration) and 132 runs. The worlds are none of the benchmark's.

Rubinstein and Kroese, "The Cross-Entropy Method" (2004).
"""

from __future__ import annotations

import argparse
import math

import numpy as np
from judge import KINDS, REGIMES, SCENARIO, keys_of
from numpy.typing import NDArray

from swarmsim.core.scenario.file import load
from swarmsim.engine.build import build

LIMIT = 600  # iterations of a run
GENERATIONS, CANDIDATES, BEST = 3, 6, 2
WIDTH, LEAST = 0.7, 0.2  # of the first draw, and at least of further ones: standard deviations of logarithms
RULES: dict[str, dict[str, float]] = {  # where the search starts: the values that are shipped, or a middling one
    "random-frontier": {"near": 7.0},
    "utility-frontier": {"weight": 0.5},
    "coordinated-frontier": {"weight": 0.02, "reach": 7.0},
    "potential-field": {"reach": 50.0},
    "market": {"revenue": 10.0, "reach": 4.0},
    "reserved-frontier": {"reach": 7.0, "stays": 5.0},
    "dispersed-frontier": {"weight": 10.0, "reach": 15.0, "stays": 3.0, "heeds": 4.0},
    "shared-frontier": {"weight": 20.0, "reach": 15.0, "stays": 3.0, "revenue": 4.0},
}
FIXED = {"random-frontier": ", keeps=true"}

Task = tuple[str, int, int, str]


def tasks(first: int, count: int) -> list[Task]:
    """Kind, seed, robots and regime of each development world."""
    kinds, regimes = list(KINDS), list(REGIMES)
    return [
        (kinds[i % 6], first + i // 6, (4, 10, 30)[(i + i // 6) % 3], regimes[(i // 3 + i // 6) % 2])
        for i in range(count)
    ]


def score(strategy: str, worlds: list[Task]) -> float:
    """The mean logarithm of the iterations to 99 %."""
    logs = []
    for kind, seed, robots, regime in worlds:
        keys = [
            *keys_of(kind, seed, robots, LIMIT),
            *REGIMES[regime],
            f"mind.strategy={strategy}",
            'mind.computation.sharing={use="gossip", goals=true}',
        ]
        simulation, iterations = build(load(SCENARIO, keys), str(SCENARIO)).simulation, 0
        while not simulation.over:
            iterations += 1
            if simulation.tick().measured.values["coverage"] >= 0.99 - 1e-12:
                break
        logs.append(math.log(iterations))
    return float(np.mean(logs))


def written(rule: str, names: list[str], values: NDArray[np.float64]) -> str:
    """The strategy, in TOML."""
    numbers = [f"{max(1, round(v))}" if name == "heeds" else f"{v:.3g}" for name, v in zip(names, values, strict=True)]
    keys = "".join(f", {name}={float(n) if name != 'heeds' else n}" for name, n in zip(names, numbers, strict=True))
    return f'{{use="{rule}", replan="every-iteration"{FIXED.get(rule, "")}{keys}}}'


def shipped(rule: str) -> str:
    """The rule with the values that it is shipped with."""
    return f'{{use="{rule}", replan="every-iteration"{FIXED.get(rule, "")}}}'


def main() -> None:
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("rule", choices=RULES)
    asked.add_argument("--first", type=int, default=1000)
    args = asked.parse_args()
    names, random = list(RULES[args.rule]), np.random.default_rng(1)
    middle, width = np.log(list(RULES[args.rule].values())), np.full(len(names), WIDTH)
    worlds = tasks(args.first, 6 * GENERATIONS + 12)
    for generation in range(GENERATIONS):
        drawn = middle + width * random.standard_normal((CANDIDATES, len(names)))
        texts = [written(args.rule, names, np.exp(one)) for one in drawn]
        if generation == 0:
            texts[0], drawn[0] = shipped(args.rule), middle
        scores = [score(text, worlds[6 * generation : 6 * generation + 6]) for text in texts]
        best = np.argsort(scores, kind="stable")[:BEST]
        for i in best.tolist():
            print(f"generation {generation}: {math.exp(scores[i]):.1f} {texts[i]}", flush=True)
        middle, width = drawn[best].mean(axis=0), drawn[best].std(axis=0) + LEAST
    found = written(args.rule, names, np.exp(middle))
    before, after = (math.exp(score(text, worlds[-12:])) for text in (shipped(args.rule), found))
    print(f"shipped {before:.1f}, found {after:.1f}: {found if after < before else 'the shipped values stay'}")


if __name__ == "__main__":
    main()
