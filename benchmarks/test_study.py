"""Parallel efficiency of a study on two cores."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from swarmsim.studies import results
from swarmsim.studies.engine import execute
from swarmsim.studies.plan import open_study
from swarmsim.studies.store import Store

STUDY = Path(__file__).parent.parent / "scenarios" / "studies" / "kit2018" / "network.toml"


@pytest.mark.bench
def test_two_workers_do_at_least_1_7_times_the_work_of_one(tmp_path: Path) -> None:
    plan = open_study(STUDY, 8)
    with Store(tmp_path / "empty.sqlite") as store:
        tasks = results.missing(plan, store)
    seconds, digests = {}, {}
    for workers in (1, 2):
        rows = execute(tasks, workers)
        found = [next(rows)]  # the cluster is up, with kernels loaded
        begun = time.perf_counter()
        found.extend(rows)
        seconds[workers] = time.perf_counter() - begun
        digests[workers] = sorted((row.identity, row.digest) for row in found)
    efficiency = seconds[1] / (2.0 * seconds[2])
    print(
        f"\n{len(tasks)} runs: {seconds[1]:.1f} s with one worker, {seconds[2]:.1f} s with two; "
        f"parallel efficiency {efficiency:.2f}"
    )
    assert digests[1] == digests[2]
    assert efficiency >= 0.85
