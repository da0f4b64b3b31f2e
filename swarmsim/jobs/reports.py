"""What robots say of themselves, passed on by all: which pieces they compute and keep, and how far they are."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple, Self

from swarmsim.core.messages import FrameError
from swarmsim.jobs.facts.wire import Fact, long, short

AFAR = 254  #: hops to a robot that has not been heard of
FARTHEST = (1 << 16) - 1  #: cells from a robot to a piece, at most
NEVER = -(1 << 40)

#: The kinds of facts of a job in pieces: a report, what a piece shows, and its state.
REPORT, SHOW, STATE = range(3)


class PieceClaim(NamedTuple):
    """That a robot computes a piece."""

    step: int
    far: int = 0  # cells, from the robot to the piece
    has: int = 0  # bit i: it knows what the piece's joint i shows to this step


Holding = tuple[int, PieceClaim, int]  # a robot, what it claims of a piece, and the hops to it


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
        """What a fact reports. Raises FrameError for numbers that `fact` cannot have made."""
        numbers = long(fact.value)
        end = 1 + 4 * numbers[0] if numbers else 1
        if end > len(numbers) or (len(numbers) - end) % 2:
            raise FrameError(f"a report of {len(numbers)} numbers; expected {end}, and two for each copy")
        pieces, kept = numbers[1:end:4], numbers[end::2]
        if any(one >= other for its in (pieces, kept) for one, other in pairwise(its)):
            raise FrameError("a report of pieces out of order, or more than once")
        claims = {piece: PieceClaim(*numbers[4 * at + 2 : 4 * at + 5]) for at, piece in enumerate(pieces)}
        return cls(fact.version, claims, dict(zip(kept, numbers[end + 1 :: 2], strict=True)))

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
    said: Report = Report(NEVER, {}, {})  # that was last passed on ...
    when: int = NEVER  # ... in this exchange


class Hearsay:
    """What one robot has heard of others and itself. Who has not been heard of for `patience` iterations is silent."""

    def __init__(self, patience: int) -> None:
        self._patience = patience
        self.news: dict[int, News] = {}  #: by robot
        self._last: dict[int, int] = {}  # iteration of the last news, by piece
        self._newest: dict[int, int] = {}  # the highest step heard of, by piece
        self._kept: dict[int, int] = {}  # the same of copies
        self._sorted: tuple[int, dict[int, list[Holding]]] | None = None  # what `of` gives in an iteration, by piece

    def older(self, fact: Fact) -> bool:
        """Whether a report is known already, over as few hops, or a newer one."""
        known = self.news.get(fact.key)
        return known is not None and (fact.version, -fact.robot) <= (known.report.beat, 1 - known.hops)

    def note(self, who: int, report: Report, hops: int, now: int) -> None:
        """Take in what a robot said of itself; older reports change nothing."""
        known = self.news.get(who)
        if known is not None and report.beat <= known.report.beat:
            if report.beat == known.report.beat and hops < known.hops:
                self._sorted, known.hops = None, hops
            return
        said = (known.said, known.when) if known is not None else ()
        self._sorted, self.news[who] = None, News(report, hops, now, *said)
        for piece, claim in report.claims.items():
            self._last[piece] = now
            self._newest[piece] = max(claim.step, self._newest.get(piece, 0))
        for piece, step in report.keeps.items():
            self._kept[piece] = max(step, self._kept.get(piece, 0))

    def wake(self, now: int) -> None:
        """Count all news as of now."""
        self._sorted = None
        self._last = dict.fromkeys(self._last, now)
        for news in self.news.values():
            news.seen = now

    def fresh(self, now: int) -> Iterator[tuple[int, News]]:
        """The robots that are not silent."""
        return ((who, news) for who, news in self.news.items() if now - news.seen <= self._patience)

    def of(self, piece: int, now: int) -> Sequence[Holding]:
        """The robots that compute a piece and are not silent, with their hops."""
        return self._by_piece(now).get(piece, ())

    def _by_piece(self, now: int) -> dict[int, list[Holding]]:
        if self._sorted is None or self._sorted[0] != now:
            found: dict[int, list[Holding]] = {}
            for who, news in self.fresh(now):
                for piece, claim in news.report.claims.items():
                    found.setdefault(piece, []).append((who, claim, news.hops))
            self._sorted = now, found
        return self._sorted[1]

    def keeping(self, piece: int, now: int) -> Iterator[tuple[int, int]]:
        """The robots that keep a copy of a piece and are not silent, with its step."""
        for who, news in self.fresh(now):
            if piece in news.report.keeps:
                yield who, news.report.keeps[piece]

    def newest(self, piece: int) -> int:
        """The highest step that anybody was heard to have reached; 0 without news."""
        return self._newest.get(piece, 0)

    def present(self, now: int) -> dict[int, int]:
        """The highest step of each piece at which a robot computes it that is not silent; without one, of all."""
        its = self._by_piece(now).items()
        return self._newest | {piece: max(claim.step for _, claim, _ in holdings) for piece, holdings in its}

    def kept(self, piece: int) -> int:
        """The highest step of which anybody was heard to keep a copy; 0 without news."""
        return self._kept.get(piece, 0)

    def silence(self, piece: int, now: int) -> int:
        """For how many iterations there has been no news of who computes a piece."""
        return now - self._last.get(piece, 0)

    def due(self, now: int, clock: int, every: int) -> Iterator[tuple[int, News]]:
        """What is to be passed on: steps that have changed, and signs of life `every` so many exchanges.

        If nothing newer has come by then, the same is said again: said once, news over h hops would get through with
        the h-th power of the chance of one.
        """
        for who, news in self.fresh(now):
            report = news.report
            again = report.beat - news.said.beat >= every or clock - news.when > every
            if report.beat >= 0 and (not report.like(news.said) or (again and (report.claims or report.keeps))):
                yield who, news
