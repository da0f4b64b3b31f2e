"""A ledger of every message of a run, exchange by exchange: who sent it, what was in it, and what became of it."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from swarmsim.core.bundle import whole
from swarmsim.core.parts import Parts
from swarmsim.core.state import Moment
from swarmsim.engine.build import BuiltRun

AT_ONCE = {"perfect", "bernoulli", "gilbert-elliott", "path-loss", "range"}  # channels on which nothing waits

Columns = tuple[np.ndarray, ...]


class Overheard:
    """One exchange, as it passed between the parts of a run."""

    number: int  # of all exchanges
    links: np.ndarray  # (m, 2): receiver, sender
    delivery: Any
    inbox: Any

    def __init__(self, said: Any, alive: np.ndarray) -> None:
        self.said, self.alive = said, alive.copy()

    @cached_property
    def items(self) -> dict[int, list[tuple[int, Columns]]]:
        """Of each robot with a link: how many items it said, and their columns; of its mind, then of each job."""
        return {
            sender: [(len(part), part.arrays()) for part in (one.of(sender) for one in (self.said, *self.said.beside))]
            for sender in np.unique(self.links[:, 1]).tolist()
        }


class Taps:
    """Overhears what a run's parts say to each other: the computation, its jobs and the channel."""

    def __init__(self) -> None:
        #: The exchanges of this iteration, so far.
        self.now: list[Overheard] = []

    def on(self, parts: Parts) -> Parts:
        """The same parts, overheard."""
        jobs = None if parts.jobs is None else _Jobs(parts.jobs, self)
        return replace(parts, computation=_Mind(parts.computation, self), channel=_Air(parts.channel, self), jobs=jobs)


class _Tap:
    def __init__(self, inner: Any, taps: Taps) -> None:
        self._inner, self._taps = inner, taps

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inner, name)


class _Mind(_Tap):
    def say(self, senses: Any) -> Any:
        said = self._inner.say(senses)
        self._taps.now = [Overheard(said, senses.alive)]
        return said

    def hear(self, senses: Any, inbox: Any) -> Any:
        self._taps.now[-1].inbox = inbox
        return self._inner.hear(senses, inbox)


class _Jobs(_Tap):
    def say_more(self, senses: Any) -> Any:
        said = self._inner.say_more(senses)
        self._taps.now.append(Overheard(said, senses.alive))
        return said

    def hear_more(self, senses: Any, inbox: Any) -> None:
        self._taps.now[-1].inbox = inbox
        self._inner.hear_more(senses, inbox)


class _Air(_Tap):
    def deliver(self, state: Any, links: np.ndarray, sizes: np.ndarray) -> Any:
        exchange = self._taps.now[-1]
        assert np.array_equal(sizes, exchange.said.sizes), "other sizes on the air than were said"
        exchange.number, exchange.links = state.iteration, links.copy()
        exchange.items  # noqa: B018 - before anybody can change them
        exchange.delivery = self._inner.deliver(state, links, sizes)
        return exchange.delivery


class Ledger:
    """Every message said is heard or lost once, as it was said and where there was a link, or is still under way."""

    def __init__(self, run: BuiltRun, taps: Taps) -> None:
        self._taps, self._codec = taps, run.simulation.parts.computation.codec
        self._rounds = run.scenario.network.exchanges
        self._under_way = set[tuple[int, int, int, int]]()
        self._said: dict[int, Overheard] = {}  # by exchange, as long as anything of it may be under way
        self._late: list[tuple[int, int, int, int]] = []  # heard in further exchanges: minds take them in later
        self._layers = list(_stack(run.scenario.network.channel.table))
        late = any(fault.declares("failure", "") == "delay" for fault in run.scenario.faults)
        self._at_once = {layer["use"] for layer in self._layers} <= AT_ONCE and not late
        fixed = all(layer["use"] in AT_ONCE or layer.get("law") == "fixed" for layer in self._layers)
        self._delay = sum(int(layer.get("delay", 0)) for layer in self._layers) if fixed and not late else None
        #: Messages, and bytes of those heard.
        self.total: Counter[str] = Counter()

    def check(self, moment: Moment) -> None:
        """One iteration."""
        now, exchanges = moment.state.iteration, self._taps.now
        first = now * self._rounds
        assert [one.number for one in exchanges] == list(range(first, first + self._rounds)), "other exchanges"
        assert np.array_equal(exchanges[0].links, moment.links), "a message where there was no link"
        for one in exchanges:
            self._said[one.number] = one
            self._links(one, moment)
            self._packed(one)
            self._fates(one)
            self._beside(one)
        self._minds(moment)
        self._sums(moment)
        oldest = min((sent for _, _, sent, _ in (*self._under_way, *self._late)), default=first + self._rounds)
        self._said = {number: one for number, one in self._said.items() if number >= oldest}

    def _links(self, one: Overheard, moment: Moment) -> None:
        """Who can hear whom: in further exchanges, those who say something."""
        links = moment.links
        if one is not self._taps.now[0]:
            links = links[one.said.sizes[links[:, 1]] > 0]
        assert np.array_equal(one.links, links), "a message where there was no link"
        assert moment.state.alive[links].all(), "a link of the dead"
        new = {(*link, one.number, int(one.said.sizes[link[1]])) for link in links.tolist()}
        assert len(new) == len(links), "a link twice"
        assert all(receiver != sender for receiver, sender, *_ in new), "a robot that hears itself"
        self._under_way |= new
        self.total["said"] += len(new)

    def _packed(self, one: Overheard) -> None:
        """What is said goes into as many bytes as it says, part by part, and comes out of them as it was."""
        for sender, parts in one.items.items():
            message, size = whole(one.said, sender), int(one.said.sizes[sender])
            if size == 0:
                assert not any(count for count, _ in parts), "something said in no bytes"
                continue
            data = self._codec.pack(sender, one.number, message)
            assert len(data) == size, f"a letter of another length than its message: {len(data)} bytes"
            found, number, back = self._codec.unpack(data)
            assert (found, number) == (sender, one.number), "a message of another sender or exchange"
            inside = back.parts if one.said.beside else (back,)
            for (count, said), read in zip(parts, inside, strict=True):
                assert len(read) == count, "a message unpacks to another number of items"
                assert count == 0 or _same(said, read.arrays()), "a message unpacks to something else"
            if one.said.beside:
                lengths = _lengths(data)
                assert lengths[1:] == [int(job.sizes[sender]) for job in one.said.beside], "other bytes of jobs"

    def _fates(self, one: Overheard) -> None:
        """Each letter is heard or lost once, in time."""
        delivery = one.delivery
        for fate, letters in (("heard", delivery.heard), *(("lost", lost) for _, lost in delivery.lost)):
            for letter in map(tuple, letters.tolist()):
                assert letter in self._under_way, f"letter {letter} was never sent, or ended before, and is {fate}"
                self._under_way.remove(letter)
                self.total[fate] += 1
                self.total["bytes"] += letter[3] if fate == "heard" else 0
        assert self.total["said"] == self.total["heard"] + self.total["lost"] + len(self._under_way)
        assert not (self._at_once and self._under_way), "a message waits, and nothing delays it"
        oldest = min((sent for _, _, sent, _ in self._under_way), default=one.number)
        assert oldest >= delivery.oldest, "forgotten too early"
        assert one.alive[delivery.heard[:, 0]].all(), "the dead hear"
        if self._delay is not None:
            assert (one.number - delivery.heard[:, 2] == self._delay).all(), "a message is not as late as it has to be"

    def _beside(self, one: Overheard) -> None:
        """Each job hears in this exchange what it was told in the letters that are heard in it."""
        letters = [tuple(letter) for letter in one.delivery.heard.tolist()]
        assert len(one.inbox.beside) == len(one.said.beside), "a job without its part"
        for job, inbox in enumerate(one.inbox.beside):
            self._heard(inbox, letters, job + 1, 1)
            sizes = [int(self._said[sent].said.beside[job].sizes[sender]) for _, sender, sent, _ in letters]
            assert inbox.bytes == sum(sizes), "other bytes of a job heard than were said"

    def _minds(self, moment: Moment) -> None:
        """Minds hear in the first exchange what has arrived in it, and in the further ones since the last."""
        first, *further = self._taps.now
        letters = sorted([*self._late, *map(tuple, first.delivery.heard.tolist())])
        self._heard(moment.inbox, letters, 0, self._rounds)
        self._late = [tuple(letter) for one in further for letter in one.delivery.heard.tolist()]

    def _heard(self, inbox: Any, letters: Sequence[tuple[int, int, int, int]], part: int, rounds: int) -> None:
        """What is heard is what was said."""
        counts = [self._said[sent].items[sender][part][0] for _, sender, sent, _ in letters]
        dates = np.repeat(np.array(letters, np.int64).reshape(-1, 4)[:, :3], counts, axis=0)
        dates[:, 2] //= rounds
        assert len(inbox) == len(dates), "more or less was heard than letters hold"
        for column, wanted in zip((inbox.receivers, inbox.senders, inbox.sent), dates.T, strict=True):
            assert np.array_equal(column, wanted), "an item that its letter does not hold"
        at = 0
        for (_, sender, sent, _), count in zip(letters, counts, strict=True):
            items = inbox.content.take(np.arange(at, at + count)).arrays() if count else ()
            assert not count or _same(items, self._said[sent].items[sender][part][1]), "a message changed on its way"
            at += count

    def _sums(self, moment: Moment) -> None:
        """What is told of an iteration is what its exchanges come to."""
        exchanges = self._taps.now
        heard = np.concatenate([one.delivery.heard for one in exchanges])
        assert _dated(heard, self._rounds) == _dated(moment.delivery.heard, 1), "other letters heard than told"
        lost = [_dated(letters, self._rounds) for one in exchanges for _, letters in one.delivery.lost]
        assert sum(lost, Counter()) == sum((_dated(one, 1) for _, one in moment.delivery.lost), Counter())
        sent = sum(int(one.said.sizes[one.alive].sum()) for one in exchanges)
        assert (moment.traffic.offered, moment.traffic.sent) == (sum(len(one.links) for one in exchanges), sent)
        for job, told in enumerate(moment.jobs):
            said = sum(int(one.said.beside[job].sizes[one.alive].sum()) for one in exchanges)
            letters = [letter for one in exchanges for letter in one.delivery.heard.tolist()]
            heard_of = sum(int(self._said[at].said.beside[job].sizes[sender]) for _, sender, at, _ in letters)
            assert (told.sent, told.heard) == (said, heard_of), "other bytes of a job than its letters have"


def _same(one: Columns, other: Columns) -> bool:
    return len(one) == len(other) and all(
        np.array_equal(a, b, equal_nan=a.dtype.kind == "f") for a, b in zip(one, other, strict=True)
    )


def _dated(letters: np.ndarray, rounds: int) -> Counter[tuple[int, ...]]:
    """Letters with iterations for exchanges."""
    return Counter((receiver, sender, sent // rounds, size) for receiver, sender, sent, size in letters.tolist())


def _lengths(data: bytes) -> list[int]:
    """The lengths of the parts of an envelope, after its 6 bytes of sender and exchange."""
    at, found = 6, list[int]()
    while at < len(data):
        (length,) = struct.unpack_from(">I", data, at)
        found.append(length)
        at += 4 + length
    return found


def _stack(channel: Any) -> Any:
    """A channel's table and those of the channels below."""
    while channel:
        yield channel
        channel = channel.get("over")
