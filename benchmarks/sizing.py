"""How often a swarm is done in time, over seeds that `swarmsim size` does not use: a check of what it says.

    python benchmarks/sizing.py scenarios/room.toml --seconds 60 --counts 10 11 12

The number of runs is fixed, so the interval is Clopper and Pearson's. Runs are kept in `--store`.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory

import tomli_w
from scipy import stats

import swarmsim as sw

FIRST = 1_000_001  # seed


def main() -> None:
    """Print a line for each count."""
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("scenario", type=Path)
    asked.add_argument("--seconds", type=float, required=True, help="the time allowed")
    asked.add_argument("--counts", type=int, nargs="+", required=True)
    asked.add_argument("--runs", type=int, default=5000, help="of each count")
    asked.add_argument("--store", type=Path, default=Path("runs/sizing.sqlite"))
    asked.add_argument("--workers", type=int)
    args = asked.parse_args()
    study = {
        "title": "Done in time, by the number of robots",
        "scenario": str(args.scenario.absolute()),
        "seeds": list(range(FIRST, FIRST + args.runs)),
        "keep": "summary",
        "set": {"stop": {"seconds": args.seconds}},
        "vary": [{"key": "robots.count", "values": args.counts}],
    }
    with TemporaryDirectory() as folder:
        path = Path(folder) / "sizing.toml"
        path.write_text(tomli_w.dumps(study))
        found = sw.study(path, store=args.store, workers=args.workers)
        for name, result in found.results.items():
            done, runs = sum(row.status == "finished" for row in result.rows), len(result.rows)
            low, high = stats.binomtest(done, runs).proportion_ci()
            print(f"{name}: {done} of {runs} done, {done / runs:.2%} ({low:.2%} to {high:.2%})")


if __name__ == "__main__":
    main()
