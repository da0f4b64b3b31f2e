"""The network's part of an iteration: one exchange of messages, or several for the jobs of a swarm."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from swarmsim.core.messages import Broadcast, Delivery, Inbox, MessageBatch, MessageBuffer, Packets
from swarmsim.core.parts import Exchanges, Links, NetworkChannel
from swarmsim.core.state import Senses, State, Traffic


class Exchange:
    """Messages on their way, and what an iteration took.

    With several exchanges in an iteration, channels count these: a delay of one iteration is then one of one exchange.
    Minds speak in the first one, and hear in it what has arrived since the one before.
    """

    def __init__(self, rounds: int = 1) -> None:
        self._rounds = rounds
        self._post: MessageBuffer[MessageBatch] = MessageBuffer()
        self._late: list[Inbox[Any]] = []  # for minds, arrived in further exchanges
        #: The fate of this iteration's messages, dated by iterations.
        self.delivery = Delivery(np.empty((0, 4), np.int32), (), 0)
        #: What was said in this iteration.
        self.traffic = Traffic(0, 0)

    def first(
        self, channel: NetworkChannel, state: State, links: Links, said: Broadcast[MessageBatch]
    ) -> Inbox[MessageBatch]:
        """What arrives in the first exchange of an iteration."""
        self.traffic = Traffic(0, 0)
        inbox = self._carried(channel, state, 0, links, said)
        if self._rounds == 1:
            return inbox
        found = [*self._late, inbox]
        self._late = []
        columns = [np.concatenate(column) for column in zip(*(one.dates() for one in found), strict=True)]
        columns[2] = (columns[2] // self._rounds).astype(np.int32)
        content = type(inbox.content).joined([one.content for one in found])
        dated = Inbox(columns[0], columns[1], columns[2], content, inbox.oldest // self._rounds, beside=inbox.beside)
        heard: Inbox[MessageBatch] = dated.take(np.lexsort(columns[::-1]))
        return heard

    def rest(self, channel: NetworkChannel, state: State, links: Links, senses: Senses, jobs: Exchanges | None) -> None:
        """The further exchanges of the jobs."""
        for number in range(1, self._rounds):
            if jobs is None:
                return
            said = jobs.say_more(senses)
            spoken = links[said.sizes[links[:, 1]] > 0]
            before = self.delivery
            inbox = self._carried(channel, state, number, spoken, said)
            self._late += [inbox] if len(inbox) else []
            jobs.hear_more(senses, inbox)
            self.delivery = _both(before, self.delivery)

    def _carried(
        self, channel: NetworkChannel, state: State, number: int, links: Links, said: Broadcast[MessageBatch]
    ) -> Inbox[MessageBatch]:
        """What arrives in one exchange, dated by exchanges."""
        now = state.iteration * self._rounds + number
        self._post.post(now, said)
        delivery = channel.deliver(state if self._rounds == 1 else replace(state, iteration=now), links, said.sizes)
        inbox = self._post.open(now, delivery)
        sent = int(said.sizes[state.alive].sum())
        self.traffic = Traffic(self.traffic.offered + len(links), self.traffic.sent + sent)
        self.delivery = delivery if self._rounds == 1 else _dated(delivery, self._rounds)
        return inbox


def _dated(delivery: Delivery, rounds: int) -> Delivery:
    """The same with iterations in place of exchanges."""

    def dated(packets: Packets) -> Packets:
        changed = packets.copy()
        changed[:, 2] //= rounds
        return changed

    lost = tuple((reason, dated(packets)) for reason, packets in delivery.lost)
    return Delivery(dated(delivery.heard), lost, delivery.oldest // rounds)


def _both(first: Delivery, then: Delivery) -> Delivery:
    """The fates of two exchanges."""
    heard = np.concatenate([first.heard, then.heard])
    order = np.lexsort((heard[:, 2], heard[:, 1], heard[:, 0]))
    return Delivery(heard[order], (*first.lost, *then.lost), then.oldest)
