"""What a search for the smallest swarm found, in sentences for people who decide."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from swarmsim.core.durations import told
from swarmsim.studies import sequential
from swarmsim.studies.labels import label, shown
from swarmsim.studies.sizing import Asked, LadderAnswer

COUNT: Final = "robots.count"
MOST: Final = 10_000_000  # runs, beyond which a number of runs to go is not told


@dataclass(frozen=True, slots=True)
class SizedLadder:
    """One ladder and its answer: the only one, or that of one combination of varied keys."""

    changes: Mapping[str, object]  # values of the varied keys
    key: str  # of the ladder
    values: tuple[object, ...]  # by place
    answer: LadderAnswer
    robots: Mapping[int, int]  # by place, where it was asked
    extra: float = 0.0  # price of each robot beside the usual one

    @property
    def name(self) -> str:
        """The varied keys and their values; empty if none is varied."""
        return label(dict(self.changes)) if self.changes else ""

    def said(self, place: int) -> str:
        """A value in a sentence, such as "13 robots" or "loss 0.3"."""
        value = shown(self.values[place])
        if self.key == COUNT:
            return f"{value} robot{'' if value == 1 else 's'}"
        return f"{self.key.rpartition('.')[2]} {value}"


def said(sized: SizedLadder, confidence: float) -> list[str]:
    """The answer of one ladder, a sentence each: what suffices, what does not, what else was asked, what is open."""
    answer = sized.answer
    if answer.best is None:
        return _none(sized)
    question = answer.question
    best = answer.at(answer.best)
    low = math.floor(1000.0 * best.judged.interval[0] + 1e-9) / 10.0
    sentences = [
        f"{_does(sized, best.place)} it within {told(question.within)} at least {low:g} times in 100, shown with "
        f"{100 * confidence:g} % confidence ({_counted(best)}); {100 * question.sure:g} were asked, less a slack of "
        f"{100 * question.slack:g}."
    ]
    beside = [one for one in answer.asked if one.place == answer.best + (1 if answer.more_is_better is False else -1)]
    for one in beside:
        open_ = f"For {sized.said(one.place)} it is open" if one.times.size else f"{sized.said(one.place)}: not asked"
        refused = f"{_does(sized, one.place)} not"
        sentences.append(f"{refused if one.verdict == 'does not' else open_} ({_counted(one)}).")
    others = [one for one in answer.asked if one not in beside and one is not best and one.times.size]
    told_of = [
        f"{_listed(sized, there)} {_agreed(there, verdict)}"
        for verdict in ("suffices", "does not", "may")
        if (there := [one.place for one in others if one.verdict == verdict])
    ]
    if told_of:
        sentences.append(f"Also asked: {', '.join(told_of)}.")
    return [*sentences, *_fallen(sized), *_surer(sized, best)]


def _none(sized: SizedLadder) -> list[str]:
    answer = sized.answer
    asked = [one for one in answer.asked if one.times.size]
    within, runs = told(answer.question.within), answer.used
    if not any(one.judged.successes for one in asked):
        return [
            f"Not one of {runs} runs was done within {within}, with any value of {sized.key} that was asked "
            f"({_listed(sized, [one.place for one in asked])}): give more time, or check that the task can be done."
        ]
    best = max(asked, key=lambda one: one.judged.successes / one.judged.runs)
    verdict = (
        "Nothing that was asked suffices" if answer.decided else f"Not decided within {answer.question.budget} runs"
    )
    return [
        f"{verdict} for {100 * answer.question.sure:g} in 100 within {within}; the best was {sized.said(best.place)} "
        f"({_counted(best)}). Widen --low and --high, or give more time{'' if answer.decided else ' or --budget'}."
    ]


def _does(sized: SizedLadder, place: int) -> str:
    many = sized.key == COUNT and sized.values[place] != 1
    subject = sized.said(place)
    return f"{subject[:1].upper()}{subject[1:]} {'do' if many else 'does'}"


def _counted(asked: Asked) -> str:
    if not asked.times.size:
        return "no run of it"
    low, high = (100.0 * end for end in asked.judged.interval)
    return f"done in {asked.judged.successes} of {asked.judged.runs} runs, so between {low:.1f} and {high:.1f} % of all"


def _listed(sized: SizedLadder, places: list[int]) -> str:
    values = [str(shown(sized.values[place])) for place in places]
    joined = values[0] if len(values) == 1 else f"{', '.join(values[:-1])} and {values[-1]}"
    return joined if sized.key == COUNT else f"{sized.key.rpartition('.')[2]} {joined}"


def _agreed(places: list[int], verdict: str) -> str:
    """The verdict of these places as a verb."""
    many = {"suffices": "suffice", "does not": "do not", "may": "may or may not"}
    return many[verdict] if len(places) > 1 or verdict == "may" else verdict


def _fallen(sized: SizedLadder) -> list[str]:
    """Where the chance falls again, and what the answer is about."""
    if not sized.answer.falls:
        return ["Nothing is claimed of values that were not asked."]
    lower = sorted({second for _, second in sized.answer.falls})
    more = "fewer" if sized.answer.more_is_better is False else "more"
    return [
        f"The chance falls again at {_listed(sized, lower)}: {more} is not always better here, and nothing is claimed "
        "of values that were not asked."
    ]


def _surer(sized: SizedLadder, best: Asked) -> list[str]:
    """What it would take to be surer."""
    question = sized.answer.question
    sentences = []
    if not sized.answer.decided:
        sentences.append(
            f"Not decided within {question.budget} runs: a larger --budget goes on from here, a larger --slack needs "
            "fewer."
        )
    slack = question.slack / 2.0
    bound = question.sure - slack
    share = best.judged.successes / best.judged.runs
    runs = runs_to_show(share, bound, best.question.alpha * best.question.part)
    if runs is None:
        return [
            *sentences,
            f"To be surer takes a better swarm: {sized.said(best.place)} did it in {100 * share:.1f} % of the runs, so "
            f"more of them would hardly show {100 * bound:g} in 100.",
        ]
    return [
        *sentences,
        f"To be surer: about {runs} runs in all for {sized.said(best.place)} would show {100 * bound:g} in 100, at the "
        f"share of the runs so far (--slack {slack:g}).",
    ]


def runs_to_show(share: float, bound: float, alpha: float) -> int | None:
    """The number of runs after which P > bound is shown if this share of them is done; None for too many."""
    if share <= bound:
        return None
    low, high = 0, 1
    while sequential.evidence(share * high, (1.0 - share) * high, bound) < -math.log(alpha):
        low, high = high, 2 * high
        if high > MOST:
            return None
    while high - low > 1:
        middle = (low + high) // 2
        shown_ = sequential.evidence(share * middle, (1.0 - share) * middle, bound) >= -math.log(alpha)
        low, high = (low, middle) if shown_ else (middle, high)
    return high
