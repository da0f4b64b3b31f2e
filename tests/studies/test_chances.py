"""Tables of chances and quantiles, and what they say where nothing is known."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from swarmsim.studies.chances import chances, quantiles
from swarmsim.studies.survival import Endings


def result(times, period: float = 1.0, limit: float = 600.0):
    """The runs of a condition with these iterations, cut at the limit."""
    values = np.array(times, np.float64)
    ends = Endings(np.minimum(values, limit), values <= limit, limit)
    condition = SimpleNamespace(scenario=SimpleNamespace(period=period))
    return SimpleNamespace(
        endings=ends, seconds=ends.scaled(period), rows=list(times), finished=ends.finished, condition=condition
    )


def test_a_table_says_how_sure_and_by_when_and_where_it_cannot() -> None:
    results = {"quick": result(range(100, 140)), "cut": result([*range(200, 220), *[9999] * 20]), "none": result([])}
    head, rows = chances(results, [120.0, 900.0])
    assert head == ["condition", "n", "finished", "by 2 min", "95 % interval", "by 15 min", "95 % interval"]
    assert rows == [
        ["quick", "40", "40", "52 %", "36 to 68 %", "100 %", "91 to 100 %"],
        ["cut", "40", "20", "0 %", "0 to 9 %", "beyond the limit", "over 34 %"],
        ["none", "0", "0", "-", "-", "-", "-"],
    ]
    head, rows = quantiles(results, [0.25, 0.95])
    assert head[3:] == ["25 % done", "95 % interval", "in time", "95 % done", "95 % interval", "in time"]
    assert rows[0][3:] == ["109", "104 to 116", "1 min 49 s", "137", "over 134", "2 min 17 s"]
    assert rows[1][3:] == ["209", "204 to 216", "3 min 29 s", "not reached", "over 600", "-"]
    assert rows[2] == ["none", "0", "0", *["-"] * 6]


def test_conditions_with_several_periods_have_quantiles_in_time_alone() -> None:
    results = {"a": result(range(100, 140)), "b": result(range(100, 140), 0.5)}
    head, rows = quantiles(results, [0.25])
    assert head[3:] == ["25 % done", "95 % interval"]
    assert [row[3:] for row in rows] == [
        ["1 min 49 s", "1 min 44 s to 1 min 56 s"],
        ["54 s", "52 s to 58 s"],
    ]
