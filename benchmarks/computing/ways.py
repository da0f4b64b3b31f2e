"""python benchmarks/computing/ways.py run SEEDS OUT.jsonl [CONDITION ...]: a model computed in six ways.

The same robots drive the same ways over the same radio, as `ways.toml` says. Robot 0 stands at its start and is the
base; servers are robots 0, 4 and 8 of 12. `told.py` makes tables and figures of OUT.jsonl. With `sweeps` instead: how
many sweeps a level takes in pieces.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import linalg

from swarmsim.core.scenario.file import load
from swarmsim.engine.build import build
from swarmsim.jobs.alone import alone
from swarmsim.jobs.pieces import bisected, given
from swarmsim.jobs.runtime import Parcel
from swarmsim.operations.methods.problem import Problem
from swarmsim.operations.methods.sweeps import Chebyshev, Schwarz
from swarmsim.operations.models.diffusion import Diffusion
from swarmsim.operations.models.faces import Faces
from swarmsim.operations.models.job import ModelJob

SCENARIO = Path(__file__).with_name("ways.toml")
MODEL = '{use = "diffusion", diffusivity = 0.02, decay = 0.002}'
EVERY, LEVELS, SWEEPS = 20, 5, 16  # iterations of 1 s; levels; see `sweeps`
GATHER = f'use = "gather", model = {MODEL}, levels = {LEVELS}, every = {EVERY}'
SOLVE = (
    f'use = "solve", model = {MODEL}, method = {{use = "schwarz", overlap = 2, sweeps = {SWEEPS}}}, '
    f"dt = {EVERY}.0, duration = {EVERY * LEVELS}.0, value = 4"
)
HOLDERS = f'{{{GATHER}, to = "holders"}}'
SETTLED, COMPUTED = 'task.use="settled"', 'task.use="computed"'
WAYS: dict[str, tuple[str, ...]] = {
    "alone": (f'jobs=[{{{GATHER}, to = "none"}}]', SETTLED),
    "replicated": (f'jobs=[{{{GATHER}, to = "all"}}]', SETTLED),
    "cloud, own piece": (f'jobs=[{{{GATHER}, to = "base"}}]', SETTLED),
    "cloud, field": (f'jobs=[{{{GATHER}, to = "base", down = "field"}}]', SETTLED),
    "edge, own piece": (f'jobs=[{{{GATHER}, to = "servers"}}]', SETTLED),
    "collective": (f"jobs=[{{{SOLVE}}}, {HOLDERS}]", COMPUTED),
    "collective, migrating": (f"jobs=[{{{SOLVE}, migrate = 1.0}}, {HOLDERS}]", COMPUTED),
}
FEW = ("robots.1.count=5",)
DEAD = ('faults=[{use = "crash", at = 50, robots = [0], min_alive = 0}]',)
WALL = ('faults=[{use = "radio", failure = "partition", x = 4.0, at = 30, duration = 60}]',)
JAM = ('faults=[{use = "radio", failure = "jam", area = [2.0, 2.0, 6.0, 6.0], at = 30, duration = 60}]',)
CONDITIONS: dict[str, tuple[str, ...]] = {
    "plain": (),
    "base dies": DEAD,
    "wall of silence": WALL,
    "6 robots": FEW,
    "6 robots, base dies": (*FEW, *DEAD),
    "6 robots, wall of silence": (*FEW, *WALL),
    "6 robots, jam": (*FEW, *JAM),
    "6 robots, loss 0.3": (*FEW, "network.channel.loss=0.3"),
    "6 robots, 8 exchanges": (*FEW, "network.rounds=8"),
    "6 robots, cell 0.3": (*FEW, "grid.cell=0.3"),
}


class Watch:
    """Sums over a run."""

    def __init__(self) -> None:
        self.sent = self.heard = self.iterations = 0
        self.by: dict[str, int] = {}
        self.driven, self.before, self.errors, self.ages = 0.0, None, list[float](), list[float]()
        self.last: Any = None

    def sample(self, moment: Any) -> None:
        """Note one iteration."""
        self.iterations += 1
        self.last = moment
        for one in moment.jobs:
            self.sent += one.sent
            self.heard += one.heard
            self.by[one.name] = self.by.get(one.name, 0) + one.sent
        place = moment.state.pose[:, :2]
        if self.before is not None:
            self.driven += float(np.hypot(*(place - self.before).T).sum())
        self.before = place.copy()
        values = moment.measured.values
        if EVERY <= moment.state.iteration < EVERY * LEVELS and "gather_age_own" in values:
            self.ages.append((values["gather_age_own"], values["gather_age_floor"]))
            self.errors.append((values["gather_error_own"], values["gather_error_floor"]))
        for one in moment.jobs:
            if isinstance(one.knowledge, Parcel) and EVERY <= moment.state.iteration < EVERY * LEVELS:
                step = np.diagonal(np.maximum(one.knowledge.step, one.knowledge.kept))[moment.state.alive]
                age = moment.state.iteration - step // SWEEPS * EVERY
                self.ages.append((float(np.maximum(age, 0).mean()), np.nan))


def one_run(way: str, condition: str, seed: int) -> dict[str, Any]:
    """The numbers of one run."""
    overrides = (*WAYS[way], *CONDITIONS[condition], f"seed={seed}")
    run = build(load(SCENARIO, overrides), str(SCENARIO))
    watch = Watch()
    finished = bool(run.simulation.run([watch]))
    robots = len(watch.last.state.alive)
    found: dict[str, Any] = {
        "way": way, "condition": condition, "seed": seed, "finished": finished, "iterations": watch.iterations,
        "sent": watch.sent / robots / watch.iterations, "heard": watch.heard / robots / watch.iterations,
        "by": {name: one / robots / watch.iterations for name, one in watch.by.items()},
        "driven": watch.driven / robots / watch.iterations,
    }  # fmt: skip
    for one in watch.last.jobs:
        known = one.knowledge
        if one.name == "gather":
            counts = known.counts
            if not way.startswith("collective"):
                found |= {"work": counts[:, 0].sum(), "most_work": counts[:, 0].max()}
                found["share"] = known.share(watch.last.state.alive)
            found["used"] = known.numbers(watch.last.state.alive)["used"]
            found["kinds"] = (counts[:, 3:].sum(axis=0) / robots / watch.iterations).tolist()
        else:
            progress = known.progress(watch.last.state.alive)
            found |= {
                "work": known.counts[:, 4].sum(), "most_work": known.counts[:, 4].max(),
                "steps": known.counts[:, 0].sum(), "lost": int((progress < 0).sum()),
                "share": float(np.maximum(progress, 0).mean() / known.plan.steps),
                "redone": known.counts[:, 3].sum(), "taken": known.counts[:, 2].sum(),
            }  # fmt: skip
    if watch.ages:
        found["age_own"], found["age_floor"] = np.mean(watch.ages, axis=0).tolist()
    if watch.errors:
        found["error_own"], found["error_floor"] = np.mean(watch.errors, axis=0).tolist()
    return found


def run(seeds: int, out: Path, conditions: Sequence[str]) -> None:
    """All ways, seed after seed; runs that `out` has are not done again."""
    done = {(one["way"], one["condition"], one["seed"]) for one in rows(out)} if out.exists() else set()
    for condition in conditions:
        for seed in range(1, seeds + 1):
            for way in WAYS:
                if condition != "plain" and way in ("alone", "cloud, field", "collective, migrating"):
                    continue
                if (way, condition, seed) not in done:
                    with out.open("a") as file:
                        file.write(json.dumps(one_run(way, condition, seed), default=float) + "\n")


def rows(path: Path) -> list[dict[str, Any]]:
    """The runs of a file."""
    return [json.loads(line) for line in path.read_text().splitlines()]


def sweeps(pieces: int = 12) -> None:
    """Print how many sweeps a level takes until the largest error is 1e-6 of the largest value, and what is shown."""
    built = build(load(SCENARIO), str(SCENARIO))
    domain = given(built.context)
    number, centres = Faces.of(domain).number, domain.lattice.centres
    start = built.context.scalar_field.value(0.0, centres(np.argwhere(domain.free)))
    problem = Problem(
        Diffusion(diffusivity=0.02, decay=0.002).on(domain),
        lambda cells, begin, end: np.zeros(len(cells)),
        float(EVERY),
    )
    system = (-problem.dt * problem.equations.operators[0]).tocsc()
    system.setdiag(system.diagonal() + 1.0)
    exact = linalg.spsolve(system.tocsc(), start)
    for name, method in {
        "chebyshev": Chebyshev,
        "schwarz, overlap 2": lambda sweeps: Schwarz(overlap=2, sweeps=sweeps),
    }.items():
        for count in range(8, 60):
            cut = bisected(domain, pieces, method(sweeps=1).halo)
            job = ModelJob.on(problem, method(sweeps=count), domain, cut, count)
            own = [number[tuple(piece.cells.T)] for piece in cut]
            states = alone(job, cut, [start[cells] for cells in own])
            wrong = max(
                np.abs(job.answer(piece, state) - exact[cells]).max()
                for piece, state, cells in zip(cut, states, own, strict=True)
            )
            if wrong < 1e-6 * exact.max():
                shown, work = sum(len(piece.rim) for piece in cut), sum(map(job.work, cut))
                print(
                    f"{len(start)} cells, {pieces} pieces, {name}: {count} sweeps, {shown} values shown in each, "
                    f"{count * work / 1e6:.2f} Mflop a level"
                )
                break


if __name__ == "__main__":
    if sys.argv[1] == "run":
        run(int(sys.argv[2]), Path(sys.argv[3]), sys.argv[4:] or list(CONDITIONS))
    else:
        sweeps()
