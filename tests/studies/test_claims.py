"""Claims put to the test on made-up runs: what is true holds, what is false is refuted, and few runs tell nothing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest
from conftest import ROOT

from swarmsim.core.errors import InputError
from swarmsim.studies.claims import ClaimTest, Runs, bootstrap, judge
from swarmsim.studies.paper import open_paper
from swarmsim.studies.reproduction import decide
from swarmsim.studies.results import Result
from swarmsim.studies.store import Row

LIMIT = 5000
CURVE = SimpleNamespace(name="coverage")


def result(name: str, times: Sequence[float | None], curve: Sequence[float] = (), robots: int = 15) -> Result:
    """Runs that took so many iterations, None for one that did not finish, and all measured the same."""
    scenario = SimpleNamespace(limit=LIMIT, robots=SimpleNamespace(count=robots))
    kept = np.array(curve, np.float32) if len(curve) else None
    rows = [
        Row(f"{name} {seed}", name, seed, "not finished" if time is None else "finished",
            LIMIT if time is None else time, {"error": 2.0 * seed}, kept, "", {}, 0.0, None)
        for seed, time in enumerate(times)
    ]  # fmt: skip
    return Result(SimpleNamespace(name=name, curve=CURVE, scenario=scenario), tuple(rows), (), 0)


def spread(mean: float, count: int = 20) -> list[float]:
    """Times around a mean, a fifth of it apart."""
    return list(mean * np.linspace(0.9, 1.1, count))


def verdict_of(runs: Mapping[str, Result], names: Mapping[str, str] = {}, **keys: object) -> str:
    judged = judge(msgspec.convert({"study": "s", **keys}, ClaimTest), Runs(runs, names))
    assert not (judged.holds and judged.fails)
    return "holds" if judged.holds else "fails" if judged.fails else "open"


def runs_of(**means: float) -> dict[str, Result]:
    return {name: result(name, spread(mean)) for name, mean in means.items()}


def test_a_trend_holds_one_way_fails_the_other_and_is_open_where_there_is_none() -> None:
    falling, level = runs_of(a=300, b=200, c=100), runs_of(a=200, b=200)
    assert verdict_of(falling, kind="trend", conditions=["a", "b", "c"]) == "holds"
    assert verdict_of(falling, kind="trend", conditions=["c", "b", "a"]) == "fails"
    assert verdict_of(falling, kind="trend", conditions=["a", "b", "c"], rises=True) == "fails"
    assert verdict_of(falling, kind="trend", conditions=["a", "b", "c"], rises=True, measure="speed") == "holds"
    assert verdict_of(level, kind="trend", conditions=["a", "b"]) == "open"


def test_a_ratio_is_held_to_a_limit_from_below_or_to_a_factor_both_ways() -> None:
    runs = runs_of(slow=300, fast=100, near=105)
    for first, second, kind, limit, expected in (
        ("slow", "fast", "ratio-above", 2.0, "holds"), ("slow", "fast", "ratio-above", 4.0, "fails"),
        ("slow", "fast", "ratio-above", 3.0, "open"), ("near", "fast", "ratio-within", 1.2, "holds"),
        ("slow", "fast", "ratio-within", 1.2, "fails"), ("fast", "slow", "ratio-within", 1.2, "fails"),
        ("near", "fast", "ratio-within", 1.05, "open"),
    ):  # fmt: skip
        assert verdict_of(runs, kind=kind, conditions=[first, second], limit=limit) == expected, (first, kind, limit)


def test_a_gain_that_falls_holds_and_one_that_cannot_fall_by_what_matters_fails() -> None:
    for third, expected in ((195, "holds"), (100, "fails")):  # the step from 300 to 200 gains 100
        runs = runs_of(five=300, ten=200, fifteen=third)
        assert verdict_of(runs, kind="less-gain", conditions=["five", "ten", "fifteen"], limit=0.25) == expected


def test_all_others_have_to_be_faster_than_the_first_but_those_let_off() -> None:
    runs = runs_of(chain=300, one=301, two=200, slow=400)
    assert verdict_of(runs, kind="faster", conditions=["chain", "two"]) == "holds"
    assert verdict_of(runs, kind="faster", conditions=["chain", "one", "two"]) == "open"
    assert verdict_of(runs, kind="faster", conditions=["chain", "one", "two"], but=["one"]) == "holds"
    assert verdict_of(runs, kind="faster", conditions=["chain", "two", "slow"]) == "fails"


def test_curves_are_compared_after_the_same_iteration() -> None:
    ahead, late, never = [0.1, 0.2, 0.9], [0.1, 0.2, 0.5], [0.0, 0.1]
    runs = {name: result(name, spread(3), curve) for name, curve in
            (("ahead", ahead), ("late", late), ("never", never))}  # fmt: skip
    assert verdict_of(runs, kind="same", conditions=["late", "ahead"], after=2) == "holds"
    assert verdict_of(runs, kind="same", conditions=["late", "ahead"], after=3) == "fails"
    assert verdict_of(runs, kind="behind", conditions=["late", "ahead"], after=3) == "holds"
    assert verdict_of(runs, kind="behind", conditions=["ahead", "never"], after=9) == "fails"
    assert verdict_of(runs, kind="behind", conditions=["ahead", "late"], after=1) == "open"
    with pytest.raises(InputError, match="keeps no curves"):
        verdict_of(runs_of(a=1, b=2), kind="same", conditions=["a", "b"], after=1)


def test_one_unfinished_run_refutes_that_all_finish_and_leaves_no_mean() -> None:
    runs = {"whole": result("whole", spread(100)), "cut": result("cut", [*spread(100, 19), None])}
    assert verdict_of(runs, kind="finished", conditions=["whole"]) == "holds"
    assert verdict_of(runs, kind="finished", conditions=["whole", "cut"]) == "fails"
    judged = judge(ClaimTest(kind="ratio-above", study="s", conditions=("cut", "whole"), limit=0.1), Runs(runs, {}))
    assert judged == (False, False, "no mean: 1 of 40 runs did not finish")
    assert Runs(runs, {}).values("cut", "speed")[-1] == 0.0


def test_a_reading_may_mean_another_condition_by_a_name() -> None:
    runs = runs_of(chain=100, ring=300, two=200)
    assert verdict_of(runs, kind="faster", conditions=["chain", "two"]) == "fails"
    assert verdict_of(runs, {"chain": "ring"}, kind="faster", conditions=["chain", "two"]) == "holds"


def test_measures_of_runs_are_compared_and_unknown_ones_refused() -> None:
    runs = Runs({"a": result("a", spread(100, 3))}, {})
    assert runs.values("a", "error").tolist() == [0.0, 2.0, 4.0]
    with pytest.raises(InputError, match="'height' is not a measure; known: error"):
        runs.values("a", "height")


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"kind": "trend", "conditions": ["a"]}, "'trend' takes 2 or more conditions, got 1"),
        ({"kind": "less-gain", "conditions": ["a", "b"], "limit": 1.0}, "'less-gain' takes 3 conditions, got 2"),
        ({"kind": "ratio-above", "conditions": ["a", "b"]}, "'ratio-above' takes limit"),
        ({"kind": "same", "conditions": ["a", "b"], "limit": 2.0}, "'same' takes after"),
        ({"kind": "finished", "conditions": ["a"], "after": 2}, "'finished' takes neither limit nor after"),
    ],
)
def test_a_test_without_what_its_kind_needs_is_refused(keys: dict[str, object], message: str) -> None:
    with pytest.raises(msgspec.ValidationError, match=message):
        msgspec.convert({"study": "s", **keys}, ClaimTest)


def test_the_bootstrap_has_the_interval_of_the_mean() -> None:
    sample = np.random.default_rng(3).normal(50.0, 10.0, 400)
    low, high = bootstrap(lambda one: float(one.mean()), sample)
    assert low == pytest.approx(sample.mean() - 1.96 * 0.5, abs=0.1)
    assert high == pytest.approx(sample.mean() + 1.96 * 0.5, abs=0.1)


CLAIMS = open_paper(ROOT / "papers" / "shang2014").claims
SIZES, NEIGHBOURS = (30, 100, 200), (3, 4, 5, 6, 7, 8, 10, 14, 20)


def consensus(time_of, count: int = 20) -> dict[str, Runs]:
    """Made-up runs of the second paper: what `time_of` gives for each number of robots and of neighbours."""
    ks = {n: (*NEIGHBOURS, n - 1) for n in SIZES}
    names = {(n, k): f"N={n}, k={k}" for n in SIZES for k in ks[n]}
    return {"speed": Runs({name: result(name, spread(time_of(n, k), count)) for (n, k), name in names.items()}, {})}


def test_the_second_paper_holds_where_ten_neighbours_are_as_good_as_all() -> None:
    runs = consensus(lambda n, k: 100.0 + 400.0 / k**2)
    assert [decide(claim, runs).verdict for claim in CLAIMS] == ["holds"] * 3


def test_each_claim_of_the_second_paper_is_refuted_where_it_is_false() -> None:
    cut = consensus(lambda n, k: 100.0 + 400.0 / k**2)
    cut["speed"].results["N=200, k=3"] = result("N=200, k=3", [*spread(200, 19), None])
    slower = consensus(lambda n, k: 100.0 + k)  # with more neighbours
    steep = consensus(lambda n, k: 1000.0 / k)  # ten are half as fast as twenty
    refuted = [decide(claim, runs).verdict for claim, runs in zip(CLAIMS, (cut, slower, steep), strict=True)]
    assert refuted == ["does not hold"] * 3


def test_ten_neighbours_that_do_in_small_swarms_alone_refute_that_the_size_does_not_matter() -> None:
    runs = consensus(lambda n, k: 100.0 + (400.0 / k**2 if n == 30 else 4000.0 / k))
    assert [decide(claim, runs).verdict for claim in CLAIMS] == ["holds", "holds", "does not hold"]


def test_a_few_runs_decide_nothing() -> None:
    (*_, last) = CLAIMS
    assert decide(last, consensus(lambda n, k: 1000.0 / k, 9)).verdict == "too few runs"
