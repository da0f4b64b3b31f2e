"""The answer of a search for the smallest swarm: its table, its prices, its sentences, and as plain values."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from swarmsim.core.durations import told
from swarmsim.studies.labels import shown
from swarmsim.studies.prices import Prices
from swarmsim.studies.sizing import Asked
from swarmsim.studies.sizing_words import SizedLadder, said
from swarmsim.studies.survival import Interval


@dataclass(frozen=True, slots=True)
class PricedSwarm:
    """A value that suffices, as one way to do the mission."""

    sized: SizedLadder
    asked: Asked
    price: float
    price_interval: Interval
    seconds: float  # mean time of a mission
    risk: float  # share of runs that were not done in time
    on_front: bool  # no other point is better in one of the three and as good in the rest


@dataclass(frozen=True, slots=True)
class Sizing:
    """The answer of `swarmsim size`."""

    scenario: Path
    confidence: float  # in all its statements together
    answers: tuple[SizedLadder, ...]
    prices: Prices | None
    simulated: int  # runs done now; others were in the store
    figures: tuple[Path, ...] = ()  # files

    @property
    def answered(self) -> bool:
        """Whether a value that suffices was found, and all that is next to the best ones is settled."""
        found = [one.answer for one in self.answers]
        return all(one.decided for one in found) and any(one.best is not None for one in found)

    @property
    def used(self) -> int:
        """The runs that the answer is made of."""
        return sum(one.answer.used for one in self.answers)

    @property
    def sentences(self) -> list[str]:
        """The answer in words, a paragraph for each combination of varied keys, then the price."""
        paragraphs = [
            (f"{one.name}: " if one.name else "") + " ".join(said(one, self.confidence)) for one in self.answers
        ]
        if self.prices is not None and (points := self.front()):
            best = min(points, key=lambda point: point.price)
            where = f" ({best.sized.name})" if best.sized.name else ""
            low, high = best.price_interval
            paragraphs.append(
                f"Cheapest of those that suffice: {best.sized.said(best.asked.place)}{where} for {best.price:.2f} a "
                f"mission on average, between {low:.2f} and {high:.2f}; robots and {told(best.seconds)} of mission."
            )
        spent = f"This answer rests on {self.used} runs; {self.simulated} were simulated now."
        return [*paragraphs, spent]

    @property
    def head(self) -> list[str]:
        """The head of `rows`."""
        question = self.answers[0].answer.question
        level = f"{100 * self.confidence:g} % interval"
        names = [self.answers[0].key.rpartition(".")[2], "runs", "done", f"chance, {level}"]
        names += [f"{100 * question.sure:g} % done by", level, "verdict"]
        varied = ["alternative"] if self.answers[0].name else []
        priced = ["price", level, "front"] if self.prices is not None else []
        return [*varied, *names, *priced]

    @property
    def rows(self) -> list[list[str]]:
        """One line for each value asked."""
        points = {(id(point.sized), point.asked.place): point for point in self.front()}
        lines: list[list[str]] = []
        for sized in self.answers:
            for asked in sized.answer.asked:
                line = [sized.name] if sized.name else []
                line += _line(sized, asked)
                if self.prices is not None:
                    line += _priced(points.get((id(sized), asked.place)))
                lines.append(line)
        return lines

    def front(self) -> list[PricedSwarm]:
        """Every asked value that suffices, with its price, time and risk; without prices none."""
        if self.prices is None:
            return []
        found = []
        for sized in self.answers:
            for asked in sized.answer.asked:
                if asked.verdict == "suffices":
                    price, ends = self.prices.of(asked, sized.robots[asked.place], sized.extra)
                    share = asked.judged.successes / asked.judged.runs
                    found.append((sized, asked, price, ends, asked.mean()[0], 1.0 - share))
        costs = np.array([(price, seconds, risk) for _, _, price, _, seconds, risk in found]).reshape(-1, 3)
        return [
            PricedSwarm(*one, not bool(((costs <= cost).all(axis=1) & (costs < cost).any(axis=1)).any()))
            for one, cost in zip(found, costs, strict=True)
        ]

    def record(self) -> dict[str, object]:
        """The answer as plain values, for JSON."""
        return {
            "scenario": str(self.scenario),
            "sentences": self.sentences,
            "answered": self.answered,
            "confidence": self.confidence,
            "runs": self.used,
            "simulated": self.simulated,
            "answers": [_recorded(sized, self.prices) for sized in self.answers],
        }


def _line(sized: SizedLadder, asked: Asked) -> list[str]:
    judged = asked.judged
    if not judged.runs:
        return [str(shown(sized.values[asked.place])), "0", *["-"] * 4, "not asked"]
    low, high = judged.interval
    point, ends = asked.quantile(asked.question.sure)
    between = f"{_by(ends[0], asked)} to {_by(ends[1], asked)}" if np.isfinite(ends[0]) else "-"
    both = " (close)" if asked.verdict == "suffices" and judged.below else ""
    return [
        str(shown(sized.values[asked.place])),
        str(judged.runs),
        str(judged.successes),
        f"{100 * judged.successes / judged.runs:.1f} % ({100 * low:.1f} to {100 * high:.1f})",
        _by(point, asked),
        between,
        asked.verdict + both,
    ]


def _by(seconds: float, asked: Asked) -> str:
    return told(seconds) if np.isfinite(seconds) else f"over {told(asked.question.within)}"


def _priced(point: PricedSwarm | None) -> list[str]:
    if point is None:
        return ["-", "-", ""]
    low, high = point.price_interval
    return [f"{point.price:.2f}", f"{low:.2f} to {high:.2f}", "front" if point.on_front else ""]


def _recorded(sized: SizedLadder, prices: Prices | None) -> dict[str, object]:
    answer = sized.answer
    best = None if answer.best is None else sized.values[answer.best]
    return {
        "changes": {key: shown(value) for key, value in sized.changes.items()},
        "key": sized.key,
        "best": shown(best),
        "decided": answer.decided,
        "falls": [[shown(sized.values[place]) for place in pair] for pair in answer.falls],
        "asked": [
            {
                "value": shown(sized.values[one.place]),
                "runs": one.judged.runs,
                "done": one.judged.successes,
                "interval": list(one.judged.interval),
                "verdict": one.verdict,
                "price": None if prices is None else prices.of(one, sized.robots[one.place], sized.extra)[0],
            }
            for one in answer.asked
            if one.times.size
        ],
    }
