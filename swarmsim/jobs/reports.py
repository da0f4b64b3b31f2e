"""What robots say of themselves, passed on by all: which pieces they compute and keep, and how far they are."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple, Self

from swarmsim.jobs.facts.wire import Fact, long, short

AFAR = 254  #: hops to a robot that has not been heard of
NEVER = -(1 << 40)

#: The kinds of facts of a job in pieces: a report, what a piece shows, and its state.
REPORT, SHOW, STATE = range(3)


class PieceClaim(NamedTuple):
    """That a robot computes a piece."""

    step: int
    far: int = 0  # cells, from the robot to the piece
    has: int = 0  # bit i: it knows what the piece's joint i shows to this step


@dataclass(frozen=True, slots=True)
class Report:
    """What one robot said of itself in an exchange."""

    beat: int  # the exchange; -1 for what is presumed
    claims: dict[int, PieceClaim]  # by piece
    keeps: dict[int, int]  # the step of the newest copy, by piece that it does not compute

    def fact(self, who: int, hops: int) -> Fact:
        """To be said by a robot so many hops from it."""
        numbers = [len(self.claims)]
        for piece, claim in sorted(self.claims.items()):
            numbers += [piece, *claim]
        for kept in sorted(self.keeps.items()):
            numbers += kept
        return Fact(REPORT, who, self.beat, hops, short(numbers))

    @classmethod
    def of(cls, fact: Fact) -> Self:
        """What a fact reports."""
        numbers = long(fact.value)
        end = 1 + 4 * numbers[0]
        claims = {numbers[at]: PieceClaim(*numbers[at + 1 : at + 4]) for at in range(1, end, 4)}
        return cls(fact.version, claims, dict(zip(numbers[end::2], numbers[end + 1 :: 2], strict=True)))

    def like(self, other: Report) -> bool:
        """Whether it tells the same steps."""
        mine, its = ({piece: claim.step for piece, claim in one.claims.items()} for one in (self, other))
        return mine == its and self.keeps == other.keeps


@dataclass(slots=True)
class News:
    """The newest report of a robot."""

    report: Report
    hops: int
    seen: int  # the iteration in which it was news
    said: Report = Report(NEVER, {}, {})  # that was last passed on


class Hearsay:
    """What one robot has heard of others and itself. Who has not been heard of for `patience` iterations is silent."""

    def __init__(self, patience: int) -> None:
        self._patience = patience
        self.news: dict[int, News] = {}  #: by robot
        self._last: dict[int, int] = {}  # iteration of the last news, by piece
        self._newest: dict[int, int] = {}  # the highest step heard of, by piece
        self._kept: dict[int, int] = {}  # the same of copies

    def note(self, who: int, report: Report, hops: int, now: int) -> None:
        """Take in what a robot said of itself; older reports change nothing."""
        known = self.news.get(who)
        if known is None:
            self.news[who] = News(report, hops, now)
        elif report.beat > known.report.beat:
            self.news[who] = News(report, hops, now, known.said)
        else:
            if report.beat == known.report.beat:
                known.hops = min(hops, known.hops)
            return
        for piece, claim in report.claims.items():
            self._last[piece] = now
            self._newest[piece] = max(claim.step, self._newest.get(piece, 0))
        for piece, step in report.keeps.items():
            self._kept[piece] = max(step, self._kept.get(piece, 0))

    def wake(self, now: int) -> None:
        """Count all news as of now."""
        self._last = dict.fromkeys(self._last, now)
        for news in self.news.values():
            news.seen = now

    def fresh(self, now: int) -> Iterator[tuple[int, News]]:
        """The robots that are not silent."""
        return ((who, news) for who, news in self.news.items() if now - news.seen <= self._patience)

    def of(self, piece: int, now: int) -> Iterator[tuple[int, PieceClaim, int]]:
        """The robots that compute a piece and are not silent, with their hops."""
        for who, news in self.fresh(now):
            if piece in news.report.claims:
                yield who, news.report.claims[piece], news.hops

    def keeping(self, piece: int, now: int) -> Iterator[tuple[int, int]]:
        """The robots that keep a copy of a piece and are not silent, with its step."""
        for who, news in self.fresh(now):
            if piece in news.report.keeps:
                yield who, news.report.keeps[piece]

    def newest(self, piece: int) -> int:
        """The highest step that anybody was heard to have reached; 0 without news."""
        return self._newest.get(piece, 0)

    def kept(self, piece: int) -> int:
        """The highest step of which anybody was heard to keep a copy; 0 without news."""
        return self._kept.get(piece, 0)

    def silence(self, piece: int, now: int) -> int:
        """For how many iterations there has been no news of who computes a piece."""
        return now - self._last.get(piece, 0)

    def due(self, now: int, every: int) -> Iterator[tuple[int, News]]:
        """What is to be passed on: steps that have changed, and signs of life `every` so many exchanges."""
        for who, news in self.fresh(now):
            report = news.report
            alive = report.beat - news.said.beat >= every and (report.claims or report.keeps)
            if report.beat >= 0 and (alive or not report.like(news.said)):
                yield who, news
