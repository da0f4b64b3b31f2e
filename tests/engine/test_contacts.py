"""How deep bodies overlap is measured, told and made less."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import called, made
from hypothesis import given
from hypothesis import strategies as st

from swarmsim.engine.contacts import Contacts
from swarmsim.kernels import discs

CROWD = ("robots.count=40", "task.within=0.05", "stop.iterations=25", "physics.substep=0.05")
MEETING = "operations/rendezvous"


@given(st.integers(0, 2**32 - 1), st.integers(0, 12))
def test_the_deepest_overlap_is_that_of_all_pairs(seed: int, count: int) -> None:
    random = np.random.default_rng(seed)
    pose, radii, solid = random.random((count, 3)), random.uniform(0.02, 0.2, count), random.random(count) < 0.7
    pairs = [
        ((radii[i] + radii[j] - np.hypot(*(pose[i, :2] - pose[j, :2]))) / min(radii[i], radii[j]), i, j)
        for i in range(count) for j in range(i) if solid[i] and solid[j]
    ]  # fmt: skip
    deepest, first, second = discs.deepest(pose, radii, solid)
    assert deepest == pytest.approx(max([0.0, *(share for share, _, _ in pairs)]))
    assert {first, second} in (
        [{-1}] if deepest == 0.0 else [{i, j} for share, i, j in pairs if share > deepest - 1e-9]
    )


def overlap(*keys: str) -> Contacts:
    run = made(*CROWD, *keys, scenario=MEETING)
    run.simulate([contacts := Contacts(run)])
    return contacts


def test_gentler_parting_and_shorter_substeps_keep_a_crowd_apart() -> None:
    long, gentle, short = overlap(), overlap("physics.parting=0.2"), overlap("physics.substep=0.015625")
    assert long.deepest[0] > 1.5 * gentle.deepest[0]
    assert gentle.deepest[0] > short.deepest[0] > 0.0
    assert "overlapped by" in long.notice
    assert short.notice is None


def test_bodies_that_may_overlap_are_not_watched() -> None:
    assert overlap('physics={use="particles"}').deepest[0] == 0.0


def test_a_run_says_that_its_robots_overlapped(tmp_path) -> None:
    asked = [word for key in CROWD for word in ("--set", key)]
    ended = called("run", MEETING, *asked, "--out", tmp_path / "run")
    assert "of a radius" in " ".join(ended.stdout.split())
