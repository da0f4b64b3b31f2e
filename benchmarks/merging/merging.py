"""How often maps of robots that do not know each other's places are merged correctly, wrongly or not at all.

Two robots have each mapped a part of a generated building; the parts overlap by a share of the smaller one. The other
robot's map is rotated and shifted at random and, with noise, has wrong cells. Then come whole runs of robots that do
not know each other's places at the start. Run: `make merging`.
"""

from __future__ import annotations

import argparse
from collections import deque
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
from scipy import ndimage

from swarmsim.core.scenario.file import load
from swarmsim.core.state import FREE, OCCUPIED, UNKNOWN
from swarmsim.engine.build import build
from swarmsim.operations.mapping.sharing.merging import FrameMeasures
from swarmsim.operations.mapping.sharing.registration import Meetings, register

SCENARIO = Path(__file__).parents[2] / "scenarios" / "exploring.toml"
MERGING = SCENARIO.with_name("merging.toml")
KINDS = {
    "rooms": {"use": "rooms", "width": 12.0, "height": 7.5},
    "office": {"use": "office", "width": 13.5, "height": 9.0},
    "maze": {"use": "maze", "width": 7.65, "height": 5.4},
    "cave": {"use": "cave", "width": 12.0, "height": 9.0},
}
WITHIN = 7.0  # cells: the greatest distance of robots that meet, about 1 m
FALSE = 5.0  # cells: the error of some place in the building at which a frame counts as mistaken
RIGHT = 2.0  # cells: the error that no cell of the overlap may reach


def building(kind: str, seed: int) -> np.ndarray:
    """The complete and correct map."""
    run = build(load(SCENARIO, changes={"world.generate": KINDS[kind], "world.seed": seed}), kind)
    return np.where(run.explorable, np.where(run.arena.occupied, OCCUPIED, FREE), UNKNOWN).astype(np.uint8)


def part(truth: np.ndarray, share: float, start: tuple[int, int]) -> np.ndarray:
    """The map of a robot that started there: the cells nearest to it along paths."""
    wanted, seen, queue = int(share * np.count_nonzero(truth)), np.zeros(truth.shape, bool), deque([start])
    found = np.zeros_like(truth)
    seen[start] = True
    while queue and wanted > 0:
        row, column = queue.popleft()
        found[row, column] = truth[row, column]
        wanted -= 1
        if truth[row, column] == OCCUPIED:
            continue
        for there in ((row, column + 1), (row + 1, column), (row, column - 1), (row - 1, column)):
            if truth[there] != UNKNOWN and not seen[there]:
                seen[there] = True
                queue.append(there)
    return found


def trial(asked: tuple[str, int, float | None, float]) -> tuple[float, bool, bool, float, float] | None:
    """One pair: its overlap, whether it was merged, whether correctly, and the errors in cells and rad."""
    kind, seed, wanted, noise = asked
    random = np.random.default_rng([seed, int(100 * (wanted or 0)), int(1000 * noise)])
    truth = building(kind, 5000 + seed % 10)
    if wanted is None:  # a false meeting: the robots are in two different buildings
        others = building(kind, 6000 + seed % 10)
        first, second = (part(one, 0.5, some(one, random)) for one in (truth, others))
        both, overlap = np.ones(truth.shape, bool), 0.0
    else:
        for _ in range(200):
            first, second = (part(truth, 0.5, some(truth, random)) for _ in range(2))
            both = (first != UNKNOWN) & (second != UNKNOWN)
            overlap = both.sum() / min(np.count_nonzero(first), np.count_nonzero(second))
            if abs(overlap - wanted) < 0.03:
                break
        else:
            return None
    first, second = (disturbed(one, noise, random) for one in (first, second))
    turn, side = random.uniform(-np.pi, np.pi), int(np.ceil(np.hypot(*truth.shape))) + 4
    matrix = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    middle, centre = (np.array(second.shape) - 1) / 2.0, np.full(2, (side - 1) / 2.0) + random.uniform(-1.0, 1.0, 2)
    other = ndimage.affine_transform(second, matrix, middle - matrix @ centre, (side, side), order=0, cval=UNKNOWN)
    met = meet(both, random, wanted is None, (first == FREE, second == FREE))
    if met is None:
        return None
    there = (np.array(met[1]) - middle) @ matrix + centre
    match = register(first, other, Meetings(np.array([met[0]]), there[None], WITHIN))
    if match is None or not match.accepted():
        return overlap, False, False, np.nan, np.nan
    if wanted is None:
        return overlap, True, False, np.nan, np.nan
    places = np.argwhere(both).astype(float)  # true and estimated places
    turned = (places - middle) @ matrix + centre
    apart = match.transform.apply(turned + 0.5) - 0.5 - places
    wrong = (match.transform.turn + turn + np.pi) % (2.0 * np.pi) - np.pi
    error = float(np.hypot(*apart.T).max())
    return overlap, True, error <= RIGHT, error, abs(wrong)


def some(truth: np.ndarray, random: np.random.Generator) -> tuple[int, int]:
    """A free cell."""
    free = np.argwhere(truth == FREE)
    return tuple(free[random.integers(len(free))])


def meet(
    both: np.ndarray, random: np.random.Generator, apart: bool, free: tuple[np.ndarray, np.ndarray]
) -> tuple | None:
    """Two places less than a metre apart that both have mapped; any place of each in a false meeting."""
    first, second = (np.argwhere(one & both) for one in free)
    if not len(first) or not len(second):
        return None
    here = first[random.integers(len(first))]
    near = second if apart else second[np.hypot(*(second - here).T) <= WITHIN]
    if not len(near):
        return None
    return tuple(map(float, here)), tuple(map(float, near[random.integers(len(near))]))


def disturbed(cells: np.ndarray, noise: float, random: np.random.Generator) -> np.ndarray:
    """The map with this share of its known cells wrong."""
    wrong = (random.random(cells.shape) < noise) & (cells != UNKNOWN)
    return np.where(wrong, np.where(cells == FREE, OCCUPIED, FREE), cells).astype(np.uint8)


def whole_run(asked: tuple[str, int]) -> dict[str, float | None]:
    """The result of a swarm that starts without known places, when it takes all frames for known."""
    kind, seed = asked
    changes = {"world.generate": KINDS[kind], "world.seed": 7000 + seed, "seed": seed}
    run = build(load(MERGING, changes=changes), kind)
    probe, known = FrameMeasures(run.explorable), False
    while not known and not run.simulation.over:
        knowledge = run.simulation.tick([probe]).knowledge
        known = bool(knowledge.observed.any(axis=0)[run.explorable].all())
    return {"known": known, **probe.summary()}


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=60, help="of each kind of building in each row")
    parser.add_argument("--runs", type=int, default=10, help="in buildings of each kind")
    parser.add_argument("--workers", type=int, default=2)
    arguments = parser.parse_args()
    rows = [(overlap, 0.0) for overlap in (0.2, 0.3, 0.5, 0.7)] + [(0.3, 0.01), (0.3, 0.03), (None, 0.0), (None, 0.01)]
    print("buildings  overlap  noise  pairs  right  wrong  none  error, cells  error, rad")
    with ProcessPoolExecutor(arguments.workers) as pool:
        for overlap, noise in rows:
            for kinds in (("rooms", "office", "maze"), ("cave",)):
                asked = [(kind, seed, overlap, noise) for kind in kinds for seed in range(arguments.pairs)]
                found = [one for one in pool.map(trial, asked, chunksize=4) if one is not None]
                if not found:
                    continue
                merged, right = np.array([one[1] for one in found]), np.array([one[2] for one in found])
                errors = np.array([one[3:] for one in found])[right]
                mean = errors.mean(axis=0) if len(errors) else (np.nan, np.nan)
                print(
                    f"{'walls' if len(kinds) > 1 else 'cave':9}  {'none' if overlap is None else f'{overlap:.0%}':>7}  "
                    f"{noise:5.0%}  {len(found):5}  {right.mean():5.1%}  {(merged & ~right).mean():5.1%}  "
                    f"{(~merged).mean():5.1%}  {mean[0]:12.2f}  {mean[1]:10.4f}",
                    flush=True,
                )
        print("\nbuildings  runs  all known  one frame  frames found  off by > 2 cells  off by > 5  mean, cells")
        for kind in KINDS:
            runs = list(pool.map(whole_run, [(kind, seed) for seed in range(1, arguments.runs + 1)]))
            found, off = (sum(run[f"frames_{name}"] for run in runs) for name in ("found", "off"))
            errors = [run["frames_error"] for run in runs if run["frames_found"]]
            worst = sum((run["frames_worst"] or 0.0) > FALSE for run in runs)
            print(
                f"{kind:9}  {len(runs):4}  {sum(run['known'] for run in runs):9}  "
                f"{sum(run['frames_joined'] is not None for run in runs):9}  {found:12}  {off:16}  "
                f"{worst:4} runs  {np.mean(errors):11.2f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
