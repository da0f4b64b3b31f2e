"""Methods over many tasks: ratios, intervals and probabilities against numbers worked out by hand and by loops."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import ROOT, called
from scipy import integrate

from swarmsim.core.errors import InputError
from swarmsim.studies import methods
from swarmsim.studies.plan import open_study
from swarmsim.studies.survival import Endings
from swarmsim.view import plots

STUDY = f"""
title = "Two ways to map two rooms"
scenario = "{ROOT}/scenarios/exploring.toml"
seeds = 3
keep = "summary"
set = {{"robots.count" = 3, "stop.iterations" = 400, "network.topology.k" = 2}}
[[vary]]
key = "mind.strategy"
together = "method"
values = [{{use = "nearest-frontier"}}, {{use = "dispersed-frontier", weight = 5.0}}]
[[vary]]
key = "world.generate"
together = "world"
values = [
    {{use = "rooms", width = 4.5, height = 3.0}},
    {{use = "cave", width = 4.5, height = 4.5}},
    {{use = "rooms", width = 4.5, height = 3.0}},
]
[[vary]]
key = "world.seed"
together = "world"
values = [1, 2, 3]
"""


def plan_of(cells: dict[tuple[str, int], list[float]], limit: float = 1000.0, limits: Mapping[str, float] = {}):
    """A study of these times in s by method and world, and its results; a run that takes its limit is unfinished."""
    axes = (SimpleNamespace(key="mind", together="method"), SimpleNamespace(key="world", together=None))
    plan = SimpleNamespace(path=Path("x.toml"), study=SimpleNamespace(vary=axes))
    results = {
        f"{name} {world}": SimpleNamespace(
            condition=SimpleNamespace(name=f"{name} {world}", changes={"mind": name, "world": world}),
            seconds=Endings(
                np.array(times), np.array(times) < limits.get(name, limit), limits.get(name, limit)
            ),
            missing=0, failed=(),
        )
        for (name, world), times in cells.items()
    }  # fmt: skip
    return plan, results


def test_ratio_is_the_geometric_mean_over_worlds_and_better_the_mean_share_of_pairs() -> None:
    plan, results = plan_of(
        {("a", 1): [100.0, 200.0], ("a", 2): [50.0, 50.0], ("b", 1): [75.0, 75.0], ("b", 2): [100.0, 50.0]}
    )
    first, second = methods.compare(plan, results).groups[""]
    assert (first.method, first.ratio, first.better, first.interval) == ("a", 1.0, 0.5, (1.0, 1.0))
    assert second.ratio == pytest.approx(np.sqrt(0.5 * 1.5))
    assert second.better == pytest.approx((1.0 + 0.25) / 2)  # 4 of 4 pairs, then two ties and two losses
    assert second.across is None  # two worlds say nothing of others
    at = int(np.flatnonzero(methods.TAUS >= 0.5)[0])
    assert second.profile[at] == 0.5  # the two runs of 75 against a mean of 150
    assert second.profile[-1] == 1.0


def test_ratios_with_unfinished_runs_are_of_times_up_to_the_limit_and_marked() -> None:
    plan, results = plan_of({("a", 1): [100.0, 200.0], ("b", 1): [75.0, 1000.0], ("c", 1): [80.0, 90.0]})
    standings = methods.compare(plan, results).groups[""]
    told = methods.lines(standings)
    assert [line[1:3] for line in told] == [("2 of 2", "1.000"), ("1 of 2", "3.583 to the limit"), ("2 of 2", "0.567")]
    assert methods.notes(standings) == ["to the limit: of the means of min(time, limit), since not all runs finished"]
    plan, results = plan_of({("a", 1): [100.0, 1000.0], ("b", 1): [75.0, 1000.0], ("c", 1): [80.0, 90.0]})
    told = methods.lines(methods.compare(plan, results).groups[""])
    assert [line[1:3] for line in told] == [
        ("1 of 2", "1.000"), ("1 of 2", "0.977 to the limit"), ("2 of 2", "0.155 to the limit"),
    ]  # fmt: skip


def test_a_ratio_is_unknown_if_in_some_world_nothing_finished() -> None:
    """Where both methods are cut at the limit, a ratio of 1 would be the limit's, not theirs."""
    cut = [1000.0, 1000.0]
    plan, results = plan_of({("a", 1): [100.0, 200.0], ("a", 2): cut, ("b", 1): [75.0, 80.0], ("b", 2): cut})
    standings = methods.compare(plan, results).groups[""]
    assert math.isnan(standings[1].ratio)
    assert methods.lines(standings)[1][1:5] == ("2 of 4", "unknown", "-", "-")
    assert methods.notes(standings) == ["unknown: in some task neither this method nor the first finished a run"]
    assert standings[1].better == 0.75  # equals in the second world


def test_methods_with_other_limits_are_compared_up_to_the_shortest() -> None:
    times = {("a", 1): [100.0, 1500.0, 2000.0, 2000.0], ("b", 1): [100.0, 500.0, 500.0, 500.0]}
    plan, results = plan_of(times, limits={"a": 2000.0, "b": 500.0})
    first, second = methods.compare(plan, results).groups[""]
    assert (first.finished, second.finished, second.ratio, second.better) == (1, 1, 1.0, 0.5)


def test_profiles_end_where_unfinished_runs_leave_them_unknown() -> None:
    plan, results = plan_of({("a", 1): [400.0, 600.0], ("b", 1): [900.0, 1000.0]})
    first, second = methods.compare(plan, results).groups[""]
    assert first.profile[-1] == 1.0
    known = methods.TAUS * 500.0 <= 1000.0 * (1 + 1e-9)
    assert np.isnan(second.profile[~known]).all()
    assert second.profile[known][-1] == 0.5


# Known survival curves in three worlds: scales and a shape of Weibull times, cut at 1000.
SCALES = {"a": (400.0, 700.0, 1200.0), "b": (300.0, 700.0, 800.0), "c": (600.0, 1000.0, 1500.0)}


@pytest.mark.thorough
@pytest.mark.parametrize("shape", [1.0, 2.5])
def test_ratios_of_known_curves_are_within_their_intervals_and_in_order(shape: float) -> None:
    def mean(scale: float) -> float:
        return integrate.quad(lambda t: math.exp(-((t / scale) ** shape)), 0, 1000.0)[0]

    truth = {
        name: math.exp(np.mean([math.log(mean(s) / mean(t)) for s, t in zip(scales, SCALES["a"], strict=True)]))
        for name, scales in SCALES.items()
    }
    covered, in_order, repeats, rng = 0, 0, 40, np.random.default_rng(7)
    for _ in range(repeats):
        cells = {
            (name, world): np.minimum(scale * rng.weibull(shape, 40), 1000.0)
            for name, scales in SCALES.items()
            for world, scale in enumerate(scales)
        }
        first, *others = methods.compare(*plan_of(cells)).groups[""]
        covered += sum(one.interval[0] <= truth[one.method] <= one.interval[1] for one in others)
        in_order += others[0].interval[0] <= first.ratio <= others[1].interval[1]
        assert all(one.restricted for one in others)
    assert covered >= 69  # of 80 intervals at 95 %: fewer by chance in 1 of 1000 tests
    assert in_order == repeats  # none is shown to be in the wrong order


def test_intervals_agree_with_a_bootstrap_by_loops() -> None:
    rng = np.random.default_rng(3)
    cells = {("a", w): rng.normal(100 + 10 * w, 9, 12) for w in range(4)}
    cells |= {("b", w): rng.normal(80 + 9 * w, 15, 12) for w in range(4)}
    plan, results = plan_of(cells)
    found = methods.compare(plan, results).groups[""][1]
    logs, wins = [], []
    for _ in range(3000):
        drawn = {key: rng.choice(times, len(times)) for key, times in cells.items()}
        logs.append(np.mean([np.log(drawn["b", w].mean() / drawn["a", w].mean()) for w in range(4)]))
        wins.append(np.mean([(drawn["b", w][:, None] < drawn["a", w]).mean() for w in range(4)]))
    assert found.interval == pytest.approx(np.exp(np.quantile(logs, [0.025, 0.975])), abs=0.01)
    assert found.better_interval == pytest.approx(np.quantile(wins, [0.025, 0.975]), abs=0.02)
    assert found.across[0] < found.interval[0] < found.ratio < found.interval[1] < found.across[1]


def test_what_did_not_finish_is_beaten_by_what_did() -> None:
    plan, results = plan_of({("a", 1): [900.0, 1000.0], ("b", 1): [950.0, 1000.0]})
    _, second = methods.compare(plan, results).groups[""]
    assert (second.finished, second.runs) == (1, 2)
    assert second.better == pytest.approx((0.0 + 1.0 + 0.0 + 0.5) / 4)
    assert np.nanmax(second.profile) == 0.5


def test_studies_that_compare_nothing_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "study.toml"
    path.write_text(STUDY)
    plan = open_study(path)
    with pytest.raises(InputError, match=r"no axis has together = 'mind'"):
        methods.compare(plan, {}, "mind")
    with pytest.raises(InputError, match=r"--within robots\.count: expected the key of another axis"):
        methods.compare(plan, {}, within="robots.count")
    done = called("study", "rank", path, "--store", tmp_path / "s.sqlite")
    assert done.returncode == 2
    assert "runs are missing; run it first" in " ".join(done.stderr.split())


@pytest.mark.thorough
def test_a_study_of_methods_from_file_to_figures(tmp_path: Path) -> None:
    path, store = tmp_path / "study.toml", ["--store", tmp_path / "s.sqlite"]
    path.write_text(STUDY)
    assert called("study", "run", path, "--quiet", *store).returncode == 0
    done = called("study", "rank", path, "--out", tmp_path / "figures", *store)
    assert done.returncode == 0, done.stderr
    assert "3 tasks" in done.stdout
    assert "6 of 6" not in done.stdout  # three worlds with three seeds each
    assert {p.name for p in (tmp_path / "figures").iterdir()} == {
        "ratios.png", "ratios.svg", "profiles.png", "profiles.svg",
    }  # fmt: skip


def test_two_equal_values_of_an_axis_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "study.toml"
    path.write_text(STUDY.replace('{use = "dispersed-frontier", weight = 5.0}', '{use = "nearest-frontier"}'))
    with pytest.raises(InputError, match="is listed twice"):
        open_study(path)


def test_profiles_leave_no_empty_panel() -> None:
    one = plots.Ratios("a", 1.0, (1.0, 1.0), methods.TAUS, np.linspace(0.0, 1.0, len(methods.TAUS)))
    figure = plots.profiles({"k=0": [one], "k=2": [one], "k=5": [one]}, "Profiles")
    assert len(figure.axes) == 3
