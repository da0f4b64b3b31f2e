"""When a run had how much: of what its task's curve can reach, whatever share of that the task asks for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import made

from swarmsim.core.parts import Curve
from swarmsim.operations.consensus import alignment
from swarmsim.operations.fields import reconstruction
from swarmsim.operations.mapping.measures.coverage import CURVE
from swarmsim.recording.measures import SHARES, RunMeasures, times_of
from swarmsim.recording.reader import Recording
from swarmsim.view.page.payload import payload

WANTED = (0.5, 0.6, 0.75, 0.9, 1.0)


def done(folder: Path, *overrides: str) -> tuple[Recording, dict[str, float | int | None]]:
    """A recorded run, and what a study would keep of it."""
    run = made(*overrides)
    kept = RunMeasures(run.scenario.robots, run.scenario.period, run.simulation.parts.task.curve)
    folder.mkdir()
    with run.recorder(folder / "recording.h5") as recorder:
        run.simulation.run([recorder, kept])
    return Recording(folder), kept.summary()


def test_times_are_of_coverage_whatever_share_the_task_asks_for(tmp_path: Path) -> None:
    """A run that is to cover more goes on for longer, and is otherwise the same."""
    runs = {share: done(tmp_path / str(share), f"task.share={share}") for share in WANTED}
    longest, _ = runs[1.0]
    for recording, kept in runs.values():
        ran, told = recording.iterations, recording.summary()["reached"]
        np.testing.assert_array_equal(recording["coverage"], longest["coverage"][:ran])
        np.testing.assert_array_equal(recording["pose"], longest["pose"][:ran])
        for percent in SHARES:
            there = [t + 1 for t, covered in enumerate(longest["coverage"].tolist()) if covered >= percent / 100]
            expected = there[0] if there[0] <= ran else None
            assert kept[f"t{percent}"] == told[f"{percent} %"] == expected
    recording, kept = runs[0.6]
    assert kept["finished"] == 1
    assert kept["t50"] is not None
    assert {kept[name] for name in ("t75", "t90", "t95", "t99", "t100", "tail_ratio")} == {None}
    assert f'"reached":"50 % at {kept["t50"]}"' in payload(recording)["words"]


VALUES = np.array([0.4, 0.5, 0.95, 1.0])


@pytest.mark.parametrize(
    ("curve", "expected"),
    [
        (CURVE, {50: 2, 75: 3, 90: 3, 95: 3, 99: 4, 100: 4}),
        (alignment.CURVE, {50: 2, 75: 3, 90: 3, 95: 3, 99: 4, 100: 4}),
        (Curve("height", "height, m", high=2.0), {50: 4, 75: None, 90: None, 95: None, 99: None, 100: None}),
        (reconstruction.CURVE, {}),
        (Curve("own", "own", low=None), {}),
    ],
    ids=["coverage", "order", "another top", "an error", "no top"],
)
def test_shares_are_of_the_top_of_the_axis_and_there_are_none_without_one(
    curve: Curve, expected: dict[int, int | None]
) -> None:
    assert times_of(VALUES, curve) == expected


def test_a_task_about_an_error_has_no_such_times() -> None:
    run = made("stop.iterations=5", scenario="operations/formation")
    kept = RunMeasures(run.scenario.robots, run.scenario.period, run.simulation.parts.task.curve)
    run.simulation.run([kept])
    assert {kept.summary()[name] for name in (*(f"t{share}" for share in SHARES), "tail_ratio")} == {None}
