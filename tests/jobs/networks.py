"""Swarms that do nothing but share a job, without bodies: places, links, a channel and deaths."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from conftest import setting_of

from swarmsim.core.building import Building, Survey
from swarmsim.core.jobs import PieceJob, Shared
from swarmsim.core.messages import MessageBuffer
from swarmsim.core.processors import Processor, Processors
from swarmsim.core.readings import Readings
from swarmsim.core.scenario.part import Part
from swarmsim.core.state import Senses, State
from swarmsim.jobs.alone import alone
from swarmsim.jobs.pieces import bisected
from swarmsim.jobs.runtime import Lockstep, Parcel

SHAPE = (14, 16)
FREE = np.zeros(SHAPE, bool)
FREE[1:13, 1:15] = True
FREE[6, 4:12] = False  # a wall between two halves, open at both ends
CELL = 0.5  # m


class Heat:
    """Explicit diffusion without flux through walls, decaying, from a state of its own."""

    halo = 1

    def __init__(self, parts: int = 7, rate: float = 0.2, level: int = 5, steps: int = 20) -> None:
        self.parts, self.rate, self.level, self.steps = parts, rate, level, steps

    def pieces(self, domain):
        return bisected(domain, self.parts, self.halo)

    def start(self, piece, sensed):
        return sensed + np.sin(0.9 * piece.cells[:, 0]) + np.cos(0.7 * piece.cells[:, 1] + piece.number)

    def shows(self, piece, state, step):
        return state[piece.rim]

    def step(self, piece, state, around, step):
        cells = np.concatenate([piece.cells, piece.halo])
        grid = np.full((SHAPE[0] + 1, SHAPE[1] + 1), np.nan)
        grid[cells[:, 0], cells[:, 1]] = np.concatenate([state, around])
        near = np.stack([grid[cells[: len(state), 0] + r, cells[: len(state), 1] + c] for r, c in STEPS])
        return state * (1.0 - 0.01 * step) + self.rate * np.where(np.isnan(near), 0.0, near - state).sum(axis=0)

    def work(self, piece):
        return 9.0 * len(piece.cells)

    def answer(self, piece, state):
        return state


UNLIMITED = Processor()
RINGS = {"ring": 1, "wide ring": 3}  # robots on either side that each one hears
STEPS = ((-1, 0), (0, -1), (0, 1), (1, 0))


def context_of(robots: int, seed: int = 5, rounds: int = 1, field: object = None):
    """A building of FREE cells."""
    context = setting_of(robots, SHAPE, seed, CELL)
    entrance = np.array([[1.25, 1.25]])
    found = Survey(np.empty((0, 4)), ~FREE, entrance, lambda: FREE)
    place = Building(found, lambda boxes: found, lattice=context.lattice)
    return replace(context, building=place, rounds=rounds, scalar_field=field)


@dataclass
class Swarm:
    """A swarm that shares a job; `ended` says after how many iterations it was done."""

    job: PieceJob = field(default_factory=Heat)
    robots: int = 7
    keys: Mapping[str, object] = field(default_factory=dict)
    channel: Mapping[str, object] = field(default_factory=lambda: {"use": "perfect"})
    topology: Callable[[int, np.ndarray], np.ndarray] | str = "full"  # of iteration and alive (n,): heard (n, n)
    deaths: Mapping[int, list[int]] = field(default_factory=dict)  # robots that die, by iteration
    comes: Mapping[int, list[int]] = field(default_factory=dict)  # robots that come later, by iteration
    strike: Callable[[int, Swarm], list[int]] = lambda now, swarm: []  # robots that die before an iteration
    until: Callable[[Swarm], bool] = lambda swarm: False  # whether to end after an iteration
    rounds: int = 1
    seed: int = 5
    limit: int = 400
    field_: object = None
    processor: Processor | Sequence[Processor] = UNLIMITED  # of all robots, or each one's
    slow: Mapping[int, tuple[float, list[int]]] = field(default_factory=dict)  # by iteration: a factor, and its robots

    def __post_init__(self) -> None:
        kinds = [self.processor] * self.robots if isinstance(self.processor, Processor) else self.processor
        self.processors = Processors(kinds, np.arange(self.robots), 1.0 / self.rounds, self.rounds)
        self.paces = np.ones(self.robots)
        self.processors.slow(np.ones(self.robots, bool), self.paces)
        self.context = context_of(self.robots, self.seed, self.rounds, self.field_)
        self.context = replace(self.context, processors=self.processors)
        keys = {"name": "heat", "patience": 6, **self.keys}
        self.runtime = Lockstep(self.job, Shared(**keys), self.context)
        self.alive = np.ones(self.robots, bool)
        self.alive[[robot for robots in self.comes.values() for robot in robots]] = False
        self.places = np.random.default_rng(self.seed).uniform(0.5, 6.5, (self.robots, 3))
        self.ended: int | None = None
        self.lost: list[int] = []
        self.sent = 0

    def links(self, iteration: int) -> np.ndarray:
        if self.topology == "full":
            heard = np.ones((self.robots, self.robots), bool)
        elif self.topology in RINGS:  # of the living
            living = np.flatnonzero(self.alive)
            heard = np.zeros((self.robots, self.robots), bool)
            for steps in range(1, RINGS[self.topology] + 1):
                heard[living, np.roll(living, steps)] = heard[np.roll(living, steps), living] = True
        else:
            heard = self.topology(iteration, self.alive)
        heard = heard & self.alive & self.alive[:, None]
        np.fill_diagonal(heard, False)
        return np.argwhere(heard).astype(np.int32)

    def run(self) -> Swarm:
        post, channel = MessageBuffer(), Part("channel", self.channel).build(self.context)
        for now in range(self.limit):
            self.alive[self.comes.get(now, [])] = True
            self.alive[self.deaths.get(now, [])] = False
            self.alive[self.strike(now, self)] = False
            for factor, robots in [self.slow[now]] if now in self.slow else []:
                self.paces[robots] = factor
            links, still = self.links(now), np.zeros((self.robots, 3))
            senses = Senses(now, self.places, still, self.alive & self.processors.running, Readings())
            for number in range(self.rounds):
                clock = now * self.rounds + number
                said = self.runtime.say(senses)
                post.post(clock, said)
                state = State(clock, self.places, still, np.zeros((self.robots, 2)), self.alive.copy())
                delivery = channel.deliver(state, links, said.sizes)
                self.processors.refill(senses.alive)
                self.parcel: Parcel = self.runtime.hear(senses, post.open(clock, delivery))
                self.sent += int(said.sizes[self.alive].sum())
            step = self.parcel.progress(self.alive)
            self.lost = np.flatnonzero(step < 0).tolist()
            if (step == self.job.steps).all():
                self.ended = now + 1
            if self.ended is not None or self.until(self):
                break
        return self

    def holders(self, piece: int) -> list[int]:
        """The living robots that compute a piece."""
        return [robot for robot in np.flatnonzero(self.alive).tolist() if self.parcel.step[robot, piece] >= 0]

    def keepers(self, piece: int) -> list[int]:
        """The living robots that keep a copy of a piece that they do not compute."""
        mine = (self.parcel.kept[:, piece] >= 0) & (self.parcel.step[:, piece] < 0) & self.alive
        return np.flatnonzero(mine).tolist()

    @property
    def exact(self) -> bool:
        """Whether all pieces have the bits of the job done in sequence."""
        plan, found = self.runtime._plan, self.parcel.answers(self.alive)
        sensed = None
        if self.field_ is not None:
            sensed = [self.field_.value(0.0, self.context.lattice.centres(one.cells)) for one in plan.pieces]
        want = alone(self.job, plan.pieces, sensed, value=plan.keys.value)
        return len(found) == len(want) and all(np.array_equal(found[piece], one) for piece, one in enumerate(want))
