"""The search for the smallest swarm on problems of known truth: runs are drawn instead of simulated."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from swarmsim.studies.sizing import LadderAnswer, LadderSearch, Question, halved, settled

COUNTS = np.arange(1, 33)
QUESTION = Question(100.0)  # 95 in 100, with a slack of 2
LOW, HIGH = 0.93, 0.97


class Drawn:
    """Runs of known chances: they take 0 to 100 s, or are not done. Each place has its own stream, by seed."""

    def __init__(self, chances: np.ndarray, seed: int) -> None:
        self.chances, self.seed = chances, seed
        self.drawn: dict[int, np.ndarray] = {}
        self.runs = 0

    def __call__(self, place: int, runs: int) -> np.ndarray:
        if place not in self.drawn:
            draw = np.random.default_rng([self.seed, place])
            done = draw.random(QUESTION.budget) < self.chances[place]
            self.drawn[place] = np.where(done, draw.uniform(0.0, 100.0, QUESTION.budget), np.inf)
        self.runs = max(self.runs, runs)
        return self.drawn[place][:runs]


def rising(centre: float, width: float) -> np.ndarray:
    return 1.0 / (1.0 + np.exp(-(COUNTS - centre) / width))


def crowded(centre: float, width: float, end: float) -> np.ndarray:
    """A chance that rises with the count and falls again where robots are in each other's way."""
    return rising(centre, width) * (1.0 - rising(end, 1.5 * width))


def searched(ask: Drawn, question: Question = QUESTION, **settings: object) -> LadderAnswer:
    search = LadderSearch(question, len(ask.chances), ask, **settings)
    search.smallest()
    return search.answer()


def told(answer: LadderAnswer) -> tuple[object, ...]:
    """Everything that is said of an answer."""
    return answer.best, answer.decided, answer.falls, [(one.place, one.verdict, one.judged) for one in answer.asked]


def problem(number: int) -> np.ndarray:
    """A problem's chances; every third falls again."""
    draw = np.random.default_rng([7, number])
    if number % 3 == 0:
        return crowded(draw.uniform(3.0, 12.0), draw.uniform(0.4, 1.5), draw.uniform(20.0, 30.0))
    return rising(draw.uniform(2.0, 26.0), draw.uniform(0.4, 3.0))


def cleared(chances: np.ndarray) -> np.ndarray:
    """The same with every chance at least 0.01 outside the slack."""
    return np.where(chances < 0.95, np.minimum(chances, LOW - 0.01), np.maximum(chances, HIGH + 0.01))


def wrong(answer: LadderAnswer, chances: np.ndarray) -> bool:
    """Whether the answer is wrong by more than the slack: of the value that suffices, or of the one below it."""
    if answer.best is None:
        return bool(answer.decided and (chances >= HIGH).any())
    beside = [one for one in answer.asked if one.place == answer.best - 1 and one.verdict == "does not"]
    return bool(chances[answer.best] <= LOW or any(chances[one.place] >= HIGH for one in beside))


def calibrated(numbers: range) -> dict[str, float]:
    answers = [(searched(Drawn(problem(n), n)), problem(n)) for n in numbers]
    clear = [(searched(Drawn(cleared(problem(n)), n)), cleared(problem(n))) for n in numbers]
    runs = np.array([answer.used for answer, _ in clear])
    return {
        "wrong": sum(wrong(answer, truth) for answer, truth in answers) / len(answers),
        "wrong where clear": sum(wrong(answer, truth) for answer, truth in clear) / len(clear),
        "decided where clear": sum(answer.decided for answer, _ in clear) / len(clear),
        "runs, median": float(np.median(runs)),
        "runs, 90 %": float(np.quantile(runs, 0.9)),
        "runs, all problems, median": float(np.median([answer.used for answer, _ in answers])),
    }


def test_few_answers_are_wrong_and_most_are_decided() -> None:
    found = calibrated(range(24))
    assert found["wrong"] <= 0.05
    assert found["decided where clear"] >= 0.95


@pytest.mark.slow
def test_answers_to_400_problems() -> None:
    found = calibrated(range(400))
    for what, value in found.items():
        print(f"{what:28} {value:10.4g}")
    assert found["wrong"] <= 0.05
    assert found["wrong where clear"] <= 0.05
    assert found["decided where clear"] >= 0.98


def fixed_design(low: float, high: float, alpha: float) -> int:
    """The runs of a fixed number that tells P <= low from P >= high, each wrong with probability alpha at most."""
    runs = np.arange(1, 5000)
    least = stats.binom.ppf(1.0 - alpha, runs, low) + 1  # more than so many are too many for P = low
    return int(runs[np.flatnonzero(stats.binom.cdf(least - 1, runs, high) <= alpha)[0]])


@pytest.mark.slow
def test_runs_by_distance_from_the_bound() -> None:
    fixed = fixed_design(LOW, HIGH, QUESTION.alpha)
    print(f"\nfixed design: {fixed} runs\n   P   median  90 %  suffices  does not  may")
    for chance in (0.5, 0.8, 0.9, 0.92, 0.93, 0.94, 0.95, 0.96, 0.97, 0.98, 0.99, 1.0):
        answers = [searched(Drawn(np.array([chance]), seed)).asked[0] for seed in range(200)]
        runs = np.array([len(one.times) for one in answers])
        counts = [sum(one.verdict == verdict for one in answers) for verdict in ("suffices", "does not", "may")]
        print(
            f"{chance:5.2f} {np.median(runs):7.0f} {np.quantile(runs, 0.9):5.0f} "
            f"{counts[0]:9} {counts[1]:9} {counts[2]:4}"
        )
        if chance <= LOW - 0.01:
            assert counts[0] <= 0.05 * 200
        if chance >= HIGH:
            assert counts[1] <= 0.05 * 200
    assert 400 <= fixed <= 470


def test_a_chance_of_exactly_what_is_asked_is_no_coin() -> None:
    verdicts = [searched(Drawn(np.array([0.95]), seed)).asked[0].verdict for seed in range(40)]
    assert verdicts.count("does not") <= 7  # one in ten at most, and then some luck
    assert verdicts.count("suffices") >= 28


@pytest.mark.thorough
@pytest.mark.parametrize(("last", "problems"), [(1.0, 60), (0.5999, 10)])
def test_many_counts_just_too_bad_are_no_more_likely_to_pass(last: float, problems: int) -> None:
    question = Question(100.0, sure=0.7, slack=0.1, budget=8000)
    chances = np.append(np.full(63, 0.5999), last)
    best = [searched(Drawn(chances, seed), question).best for seed in range(problems)]
    wrong = sum(place is not None and chances[place] < 0.6 for place in best)
    print(f"63 counts at 0.5999, one at {last:g}: {wrong} of {problems} wrong")
    assert wrong <= 0.05 * problems


def test_a_swarm_that_never_finishes() -> None:
    answer = searched(Drawn(np.zeros(32), 1))
    assert (answer.best, answer.decided) == (None, True)
    assert {one.verdict for one in answer.asked} == {"does not"}
    assert answer.used <= 3 * 32  # two or three runs each are enough


def test_a_swarm_that_always_finishes() -> None:
    answer = searched(Drawn(np.ones(32), 1))
    assert (answer.best, answer.decided, answer.falls) == (0, True, ())
    assert {len(one.times) for one in answer.asked} == {106}


def test_a_chance_that_falls_again_is_noticed() -> None:
    chances = crowded(6.0, 0.5, 24.0)
    answer = searched(Drawn(chances, 3))
    assert answer.best is not None
    assert chances[answer.best] > LOW
    assert answer.at(31).verdict == "does not"
    assert all(second == 31 for _, second in answer.falls)
    assert answer.falls


def test_a_curve_that_rises_has_no_fall() -> None:
    assert not any(searched(Drawn(rising(8.0, 2.0), seed)).falls for seed in range(10))


@pytest.mark.parametrize("step", [lambda runs: runs + 1, lambda runs: runs + 50, lambda runs: runs + 2000])
def test_looking_often_or_rarely_changes_nothing(step) -> None:
    for seed in range(3):
        chances = rising(4.0 + 5.0 * seed, 0.6)
        plain, other = searched(Drawn(chances, seed)), searched(Drawn(chances, seed), step=step)
        assert told(plain) == told(other)


def test_a_larger_budget_goes_on_with_the_same_runs() -> None:
    ask = Drawn(cleared(rising(10.0, 2.0)), 5)
    first = searched(ask, Question(100.0, budget=100))
    assert not first.decided
    assert first.used <= 100
    assert told(searched(ask)) == told(searched(Drawn(ask.chances, 5)))


def test_shuffled_seeds_rarely_change_a_verdict() -> None:
    draw = np.random.default_rng(1)
    for chance, verdict in ((0.99, "suffices"), (0.85, "does not")):
        outcomes = draw.random(1000) < chance
        verdicts = [verdict_of(draw.permutation(outcomes)) for _ in range(60)]
        assert verdicts.count(verdict) >= 57


def verdict_of(outcomes: np.ndarray) -> str:
    """The first thing that is settled by outcomes, by seed."""
    suffices, does_not = settled(QUESTION.shown(outcomes))
    first = [int(np.argmax(one)) if one.any() else len(one) for one in (suffices, does_not)]
    return "may" if min(first) == len(outcomes) else ("suffices", "does not")[int(first[1] < first[0])]


def test_less_may_be_better_and_is_found_out() -> None:
    search = LadderSearch(QUESTION, 9, Drawn(np.array([1, 1, 0.995, 0.99, 0.985, 0.8, 0.7, 0.3, 0.1]), 2))
    search.smallest(None)
    answer = search.answer()
    assert answer.more_is_better is False
    assert (answer.best, answer.decided) == (4, True)


def test_without_a_hard_end_everything_suffices() -> None:
    search = LadderSearch(QUESTION, 5, Drawn(np.ones(5), 2))
    search.smallest(None)
    assert (search.answer().best, len(search.answer().asked)) == (0, 2)


def test_multiples_of_a_count_are_asked_before_the_end() -> None:
    ask = Drawn(rising(6.0, 0.5), 4)
    search = LadderSearch(QUESTION, 32, ask)
    search.smallest(True, (5, 11, 31))
    assert 31 not in ask.drawn
    assert search.best in (7, 8)


def test_quantiles_and_means_hold_the_truth_whenever_runs_stop() -> None:
    missed = 0
    for seed in range(100):
        (asked,) = searched(Drawn(np.array([0.99]), seed)).asked  # done by t < 100 s: 0.0099 t
        quantile, (low, high) = asked.quantile(0.5)
        mean, ends = asked.mean()
        missed += not (low <= 50.0 / 0.99 <= high and ends[0] <= 50.5 <= ends[1])
        assert low <= quantile <= high
        assert ends[0] <= mean <= ends[1]
    assert missed <= 5


def test_a_quantile_that_no_run_reached_is_unknown() -> None:
    (asked,) = searched(Drawn(np.array([0.5]), 3)).asked
    assert asked.quantile(0.95)[0] == np.inf
    assert asked.quantile(0.95)[1][1] == np.inf


def test_the_cheapest_may_be_a_larger_swarm() -> None:
    def price(place: int) -> float:
        return 10.0 * (place + 1) + 600.0 / (place + 1)  # robots, and a mission that more of them shorten

    plain, search = (
        LadderSearch(QUESTION, 32, Drawn(np.where(COUNTS >= 4, 1.0, 0.1), 1), priced=priced) for priced in (False, True)
    )
    for one in (plain, search):
        one.smallest()
        assert one.best == 3
    assert search.question.alpha < plain.question.alpha  # further values are asked for their price
    search.cheaper(lambda asked: price(asked.place), lambda place: 10.0 * (place + 1))
    assert search.cheapest is not None
    assert price(search.cheapest) < price(3)
    assert len(search.found) <= 12


def test_gaps_are_halved() -> None:
    assert list(halved(0, 7)) == [3, 1, 5, 0, 2, 4, 6]
    assert list(halved(2, 2)) == []
