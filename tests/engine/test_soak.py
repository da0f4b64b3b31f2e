"""Long checks, outside of the default run: `make test-slow`."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, made

from swarmsim.studies import results as res
from swarmsim.studies.plan import open_study
from swarmsim.studies.statistics import bootstrap_mean, prediction_interval
from swarmsim.studies.store import Store


def iterations(seed: int) -> int | None:
    simulation = made(f"seed={seed}", scenario="basilica").simulation
    return simulation.state.iteration if simulation.run() else None


@pytest.mark.slow
def test_seeds_1_to_100_of_the_basilica_all_finish() -> None:
    with get_context("spawn").Pool(2) as pool:
        needed = pool.map(iterations, range(1, 101), chunksize=5)
    assert None not in needed
    print(
        f"\nbasilica, seeds 1 to 100, iterations: mean {np.mean(needed):.1f}, sd {np.std(needed, ddof=1):.1f}, "
        f"min {min(needed)}, max {max(needed)}"
    )
    assert max(needed) < 5000


@pytest.mark.slow
def test_twenty_kills_of_a_study_of_sixty_runs_change_nothing(tmp_path: Path) -> None:
    study = tmp_path / "sixty.toml"
    study.write_text(
        f'title = "Sixty"\nscenario = "{ROOT}/scenarios/kit2018.toml"\nseeds = 20\n[set]\n"stop.iterations" = 400\n'
        '[[vary]]\nkey = "network.topology.k"\nvalues = [1, 3, 6]\n'
    )

    def command(store: str) -> list[str]:
        return [
            sys.executable,
            "-m",
            "swarmsim",
            "study",
            "run",
            str(study),
            "--store",
            str(tmp_path / store),
            "--quiet",
        ]

    def table(store: str) -> list[tuple[str, ...]]:
        plan = open_study(study)
        with Store(tmp_path / store) as kept:
            found = res.gather(plan, kept)
            assert len(kept.rows(plan.identity(c, s) for c, s in plan.runs)) == 60
            return [*res.lines(found), (res.digest(list(found.values())),)]

    assert subprocess.run(command("whole.sqlite"), check=False).returncode == 0
    rng = np.random.default_rng(2018)
    kills = 0
    while kills < 20:
        process = subprocess.Popen(command("killed.sqlite"), start_new_session=True)
        time.sleep(float(rng.uniform(2.0, 6.0)))
        if process.poll() is not None:
            (tmp_path / "killed.sqlite").unlink()  # done before the kill: begin again
            continue
        if kills % 2:
            os.killpg(process.pid, signal.SIGKILL)  # everybody at once
            process.wait()
        else:
            worker = rng.choice(children(process.pid))
            os.kill(worker, signal.SIGKILL)  # one process of the cluster; then the coordinator
            time.sleep(float(rng.uniform(0.0, 1.0)))
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        kills += 1
    assert subprocess.run(command("killed.sqlite"), check=False).returncode == 0
    print(f"\n{kills} kills; the table with and without them:", *table("killed.sqlite"), sep="\n")
    assert table("killed.sqlite") == table("whole.sqlite")


def children(process: int) -> list[int]:
    """The processes that a process has started, and those that they have."""
    found = Path(f"/proc/{process}/task/{process}/children").read_text().split()
    return [process, *(inner for child in found for inner in children(int(child)))]


@pytest.mark.slow
def test_95_percent_intervals_cover_in_95_of_100_cases() -> None:
    rng = np.random.default_rng(7)
    trials, n = 2000, 60
    normal = sum(low <= 500.0 <= high for low, high in (bootstrap_mean(rng.normal(500, 100, n)) for _ in range(trials)))
    skewed = sum(
        low <= np.exp(0.045) <= high
        for low, high in (bootstrap_mean(np.exp(rng.normal(0.0, 0.3, n))) for _ in range(trials))
    )
    single = 0
    for _ in range(trials):
        low, high = prediction_interval(rng.normal(500, 100, n))
        single += low <= rng.normal(500, 100) <= high
    shares = {"normal": normal / trials, "log-normal": skewed / trials, "prediction": single / trials}
    print(f"\ncoverage of 95 % intervals in {trials} trials of {n}: {shares}")
    assert all(0.93 <= share <= 0.97 for share in shares.values())
