"""Swarms that do nothing but a job of facts, without bodies: links, a channel, deaths and joins."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from networks import context_of

from swarmsim.core.messages import MessageBuffer
from swarmsim.core.readings import Readings
from swarmsim.core.scenario.part import Part
from swarmsim.core.state import Senses, State
from swarmsim.jobs.facts.tellers import JobStanding, Tellers

LOSSY = {"use": "bernoulli", "loss": 0.3}
LATE = {"use": "latency", "delay": 3, "law": "geometric", "over": LOSSY}


@dataclass
class Telling:
    """A swarm with a job; `ended` says after how many iterations it had settled."""

    part: Any  # with `build`
    robots: int = 7
    channel: Mapping[str, object] = field(default_factory=lambda: {"use": "perfect"})
    topology: str = "full"  # or ring, line, none; of living robots, by number
    deaths: Mapping[int, Sequence[int]] = field(default_factory=dict)  # robots that die, by iteration
    comes: Mapping[int, Sequence[int]] = field(default_factory=dict)  # robots that come later, by iteration
    strike: Callable[[int, Telling], None] = lambda now, swarm: None  # before an iteration
    rounds: int = 1
    seed: int = 5
    limit: int = 400
    on: bool = False  # whether to go on until the limit

    def __post_init__(self) -> None:
        self.context = context_of(self.robots, self.seed, self.rounds)
        self.job: Tellers[Any] = self.part.build(self.context)
        self.alive = np.ones(self.robots, bool)
        self.alive[[robot for robots in self.comes.values() for robot in robots]] = False
        self.ended: int | None = None
        self.sent = self.largest = 0

    def links(self) -> np.ndarray:
        living = np.flatnonzero(self.alive)
        heard = np.full((self.robots, self.robots), self.topology == "full")
        if self.topology in ("ring", "line"):
            pairs = np.array([living, np.roll(living, -1)])[:, : len(living) - (self.topology == "line")]
            heard[pairs[0], pairs[1]] = heard[pairs[1], pairs[0]] = True
        heard &= self.alive & self.alive[:, None]
        np.fill_diagonal(heard, False)
        return np.argwhere(heard).astype(np.int32)

    def run(self) -> Telling:
        post, channel = MessageBuffer(), Part("channel", self.channel).build(self.context)
        still = np.zeros((self.robots, 3))
        for now in range(self.limit):
            self.alive[list(self.comes.get(now, []))] = True
            self.alive[list(self.deaths.get(now, []))] = False
            self.strike(now, self)
            links = self.links()
            senses = Senses(now, still, still, self.alive.copy(), Readings())
            for number in range(self.rounds):
                clock = now * self.rounds + number
                said = self.job.say(senses)
                self.check_sizes(said, clock)
                self.largest = max(self.largest, int(said.sizes.max()))
                post.post(clock, said)
                state = State(clock, still, still, still[:, :2], self.alive.copy())
                delivery = channel.deliver(state, links, said.sizes)
                self.standing: JobStanding = self.job.hear(senses, post.open(clock, delivery))
                self.sent += int(said.sizes[self.alive].sum())
            due = max(self.comes, default=-1) < now
            if self.ended is None and due and self.standing.ended(self.alive):
                self.ended = now + 1
                if not self.on:
                    break
        return self

    def check_sizes(self, said, clock: int) -> None:
        codec = self.job.codec
        for robot, size in enumerate(said.sizes.tolist()):
            packed = codec.pack(robot, clock, said.of(robot)) if size else b""
            assert len(packed) == size
            if size:
                assert codec.unpack(packed)[2].rows() == said.of(robot).rows()

    def numbers(self) -> dict[str, float]:
        return self.standing.numbers(self.alive)
