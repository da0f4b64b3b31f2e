"""A third-party swarm that does not map: every robot sends its heading and drives along it."""

from __future__ import annotations

from dataclasses import dataclass

import msgspec
import numpy as np

from swarmsim.core.messages import Broadcast, MessageBatch, PlainCodec
from swarmsim.core.parts import Curve
from swarmsim.core.state import Estimates, Intents, Knowledge, Measured


@dataclass(frozen=True, slots=True, eq=False)
class Heading(MessageBatch):
    heading: np.ndarray  # (t,)


@dataclass(frozen=True, slots=True, eq=False)
class Headings(Estimates):
    heading: np.ndarray  # (n,)


class Tell(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A computation."""

    def build(self, context):
        return Teller()


class Teller:
    knowledge_type = Headings
    codec = PlainCodec(Heading(np.zeros(0)))

    def say(self, senses):
        return Broadcast.each(Heading(senses.pose[:, 2].copy()), self.codec.size)

    def hear(self, senses, inbox):
        return Headings(senses.pose[:, 2].copy())

    def reset(self, robots):
        pass

    def copy_from(self, robots, source):
        pass


class Drive(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A strategy; it fails in a given iteration, if any."""

    speed: float = 0.1
    breaks_at: int = -1

    def build(self, context):
        return Driver(self)


class Driver:
    requires_knowledge = Headings

    def __init__(self, parameters):
        self._parameters = parameters

    def step(self, senses, inbox, knowledge):
        if senses.iteration == self._parameters.breaks_at:
            raise RuntimeError("the wheel came off")
        twists = np.zeros((len(senses.alive), 2))
        twists[:, 0] = self._parameters.speed
        return Intents.twisting(twists)


class Roam(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A task: to be this far from the start, in m, on average."""

    far: float = 0.5

    def build(self, context):
        return Roaming(self.far, context)


class Roaming:
    requires_knowledge = Knowledge
    curve = Curve("distance", "distance, m")

    def __init__(self, far, context):
        self._far, self._start = far, context.start[:, :2]

    def measure(self, moment):
        away = np.hypot(*(moment.state.pose[:, :2] - self._start).T)
        mean = float(away.mean())
        return Measured(
            {"distance": mean, "farthest": float(away.max())}, {}, min(1.0, mean / self._far), mean >= self._far
        )

    def summaries(self):
        return ()


WANDERING = [
    f'mind.computation={{use="{__file__}:Tell"}}',
    f'mind.strategy={{use="{__file__}:Drive"}}',
    f'task={{use="{__file__}:Roam"}}',
]
