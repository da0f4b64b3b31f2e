"""What a fault cost: one run beside another."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import made

from swarmsim.core.durations import told
from swarmsim.recording.measures import mean_value
from swarmsim.recording.reader import Recording
from swarmsim.studies.comparison import _lag, _recovery, costs, head, lines


def test_lag_is_how_much_later_half_of_the_rest_was_mapped() -> None:
    sound, slow = np.array([0.2, 0.4, 0.6, 0.8, 1.0]), np.array([0.2, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0])
    assert _lag(slow, sound, (2,)) == 5 - 4  # 0.7 is half of what was left at 0.4
    assert _lag(slow, sound, ()) is None
    assert _lag(slow, sound, (6,)) is None  # the sound run was over by then


@pytest.mark.parametrize(
    ("curve", "iterations"),
    [([0.5, 0.6, 0.7], 0), ([0.5, 0.3, 0.4, 0.5, 0.6], 2), ([0.5, 0.3, 0.4], None)],
    ids=["it never fell", "it is back", "it never comes back"],
)
def test_recovery_is_when_coverage_is_for_good_what_it_was(curve: list[float], iterations: int | None) -> None:
    assert _recovery(np.array(curve), (1,)) == iterations


def test_runs_are_compared_with_the_first_over_the_longest_of_all(tmp_path: Path) -> None:
    runs = {}
    for name, faults in (("sound", ""), ("faulty", '{use="remove", at=5, count=1, map="lost"}')):
        run = made(f"faults=[{faults}]")
        with run.recorder(tmp_path / f"{name}.h5") as recorder:
            run.simulation.run([recorder])
        runs[name] = Recording(tmp_path / f"{name}.h5")
    sound, faulty = costs(runs)
    assert (sound.slowdown, sound.ratio, sound.faults, sound.lag) == (1.0, 1.0, (), None)
    assert faulty.faults == (5,)
    assert faulty.slowdown == runs["faulty"].iterations / runs["sound"].iterations
    assert faulty.ratio == pytest.approx(faulty.mean / sound.mean)
    assert faulty.recovery > 0
    assert head(runs["sound"].curve)[1:5] == ("iterations", "time", "slowdown", "mean coverage")
    assert lines([sound])[0][1:3] == (str(runs["sound"].iterations), told(runs["sound"].iterations))
    assert all(len(line) == len(head(runs["sound"].curve)) for line in lines([sound, faulty]))


def test_runs_with_other_periods_are_compared_by_seconds(tmp_path: Path) -> None:
    runs = {}
    for name, period in (("slow", 1.0), ("quick", 0.5)):
        run = made(f"period={period}")
        with run.recorder(tmp_path / f"{name}.h5") as recorder:
            run.simulation.run([recorder])
        runs[name] = Recording(tmp_path / f"{name}.h5")
    _, quick = costs(runs)
    assert quick.slowdown == pytest.approx(0.5 * runs["quick"].iterations / runs["slow"].iterations)
    horizon = max(runs["slow"].iterations, 0.5 * runs["quick"].iterations)
    assert quick.mean == pytest.approx(mean_value(quick.values, round(2 * horizon)))
    assert _lag(np.repeat([0.2, 0.4, 0.5, 0.7, 1.0], 2), np.array([0.2, 0.4, 0.5, 0.7, 1.0]), (4,), 0.5) == -1
