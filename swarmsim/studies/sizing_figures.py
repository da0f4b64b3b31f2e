"""Figures of a search for the smallest swarm."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from swarmsim.core.durations import told
from swarmsim.core.errors import unwritten
from swarmsim.studies import sequential
from swarmsim.studies.sizing import Asked
from swarmsim.studies.sizing_report import Sizing
from swarmsim.studies.sizing_words import SizedLadder
from swarmsim.view import plots

BANDS: Final = 3  # intervals drawn in a panel: of the values with most runs, as more hide each other


def figures(found: Sizing, path: Path, title: str) -> list[Path]:
    """Draw the chance of being done by each time, and with prices the front, as `path` and `path`-front.

    Raises InputError if they cannot be written.
    """
    question = found.answers[0].answer.question
    asked = sequential.bounds(question.sure, question.slack)[0], question.sure
    groups = {one.name: _curves(one) for one in found.answers}
    done = f"{title}: the chance of being done by a time"
    drawn = {path: plots.chances(groups, done, question.within, asked, 1.0 - 2.0 * question.alpha)}
    if points := found.front():
        ways = [
            plots.Way(one.sized.name, one.sized.said(one.asked.place), one.price, one.price_interval, one.seconds,
                      one.risk, one.on_front)
            for one in points
        ]  # fmt: skip
        what = f"{title}: what suffices, done within {told(question.within)}"
        drawn[path.with_stem(f"{path.stem}-front")] = plots.front(ways, what)
    try:
        return [file for place, figure in drawn.items() for file in plots.save(figure, place)]
    except OSError as problem:
        raise unwritten(path, problem, "a place for figures") from problem


def _curves(sized: SizedLadder) -> list[plots.Chances]:
    """A curve for each value that has runs."""
    asked = [each for each in sized.answer.asked if each.times.size]
    banded = {each.place for each in sorted(asked, key=lambda each: len(each.times))[-BANDS:]}
    return [_chances(sized, each, each.place in banded) for each in asked]


def _chances(sized: SizedLadder, asked: Asked, banded: bool) -> plots.Chances:
    """The share done by each time at which a run was done, and its interval at any one time."""
    question, runs = asked.question, len(asked.times)
    times, counts = np.unique(asked.times[asked.done], return_counts=True)
    done = np.concatenate([[0], np.cumsum(counts), [counts.sum()]])
    low, high = sequential.intervals(done, runs, 2.0 * question.alpha).T
    label = f"{sized.said(asked.place)}: {asked.verdict} (n = {runs})"
    at = np.concatenate([[0.0], times, [question.within]])
    return plots.Chances(label, at, done / runs, low, high, asked.place == sized.answer.best, banded)
