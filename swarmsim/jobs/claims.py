"""Who was heard to do what with which piece, and when: claims of pieces, and of copies."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

AFAR = 254  #: hops to a robot that has not been heard of


@dataclass(slots=True)
class News:
    """The newest news of one robot and piece."""

    step: int
    beat: int  # the exchange in which that robot said so
    hops: int
    far: int  # cells, from that robot to the piece
    seen: int  # the iteration in which this was news
    said: tuple[int, int] = (-1, -(1 << 40))  # step and beat when it was last passed on


class Hearsay:
    """What one robot has heard, by piece and robot. Who has not been heard of for `patience` iterations is silent."""

    def __init__(self, patience: int) -> None:
        self._patience = patience
        self._entries: dict[int, dict[int, News]] = {}
        self._last: dict[int, int] = {}  # iteration of the last news, by piece

    def note(self, piece: int, who: int, step: int, beat: int, hops: int, far: int, now: int) -> None:
        """Take in what a robot said of a piece; older news changes nothing."""
        known = self._entries.setdefault(piece, {}).get(who)
        if known is not None and (beat < known.beat or (beat == known.beat and hops >= known.hops)):
            return
        seen = now if known is None or beat > known.beat else known.seen
        said = (-1, -(1 << 40)) if known is None else known.said
        self._entries[piece][who] = News(step, beat, hops, far, seen, said)
        self._last[piece] = max(self._last.get(piece, 0), seen)

    def wake(self, now: int) -> None:
        """Count all news as of now."""
        for piece, entries in self._entries.items():
            self._last[piece] = now
            for entry in entries.values():
                entry.seen = now

    def withdraw(self, piece: int, who: int) -> None:
        """Forget a robot's claim."""
        self._entries.get(piece, {}).pop(who, None)

    def of(self, piece: int, now: int) -> Iterator[tuple[int, News]]:
        """The robots that are not silent about a piece."""
        for who, entry in self._entries.get(piece, {}).items():
            if now - entry.seen <= self._patience:
                yield who, entry

    def fresh(self, now: int) -> Iterator[tuple[int, int, News]]:
        """All pieces and robots that are not silent about them."""
        for piece in self._entries:
            for who, entry in self.of(piece, now):
                yield piece, who, entry

    def newest(self, piece: int) -> int:
        """The highest step that anybody was heard to have reached; 0 without news."""
        return max((entry.step for entry in self._entries.get(piece, {}).values()), default=0)

    def silence(self, piece: int, now: int) -> int:
        """For how many iterations there has been no news of a piece."""
        return now - self._last.get(piece, 0)

    def due(self, now: int, every: int) -> Iterator[tuple[int, int, News]]:
        """What is to be passed on: steps that have changed, and signs of life `every` so many exchanges."""
        for piece, who, entry in self.fresh(now):
            if entry.step != entry.said[0] or entry.beat - entry.said[1] >= every:
                yield piece, who, entry
