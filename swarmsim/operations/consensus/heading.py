"""Heading consensus: each robot turns towards the headings that it hears (Kit et al. 2018, Eq. 1)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Final

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from swarmsim.core import chance
from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.messages import Broadcast, Inbox, MessageBatch, PlainCodec
from swarmsim.core.state import Estimates, Knowledge, Senses
from swarmsim.operations.steering import wrapped

TURN: Final = 2.0 * np.pi  # rad


@dataclass(frozen=True, slots=True, eq=False)
class Heading(MessageBatch):
    """The message: the robot's heading."""

    heading: NDArray[np.float64]  # (t,): rad


@dataclass(frozen=True, slots=True, eq=False)
class Headings(Estimates):
    """The heading that every robot has decided on."""

    heading: NDArray[np.float64]  # (n,): rad, counter-clockwise from the x axis
    leads: NDArray[np.bool_]  # (n,): whether it is informed, and now turns by itself


class HeadingConsensus(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Own heading plus the mean of the wrapped differences to those heard, plus noise.

    theta_i(t + dt) = theta_i(t) + dt / k sum_j wrap(theta_j(t) - theta_i(t)) + noise xi_i(t), where robot i hears k
    robots and xi is uniform in [-pi, pi] (Kit, Mateo and Bouffanais 2018, Eq. 1). With `body`, theta_i(t) is the
    heading of its body, so that a robot turning away from a wall turns others too; else its last decision. It starts
    with the heading of its body or, with a `spread` below a full circle, with that heading times spread / 2 pi: within
    half a circle headings never wrap, and the equation is the linear consensus of the theorems.

    `leaders` are informed robots, like the two birds of the paper's Fig. 2 that see an obstacle: from iteration `at` on
    they turn by `turn` from their heading at that time or, with a `frequency`, to and fro by `turn` to each side.
    """

    noise: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.0  # eta
    dt: Annotated[float, Meta(gt=0.0, le=1.0)] | None = None  # s; default: the period, at most 1
    body: bool = False
    spread: Annotated[float, Meta(gt=0.0, le=TURN)] = TURN  # rad, of the headings at the start
    leaders: tuple[Annotated[int, Meta(ge=0)], ...] = ()  # ids of the informed robots
    turn: float = 0.0  # rad
    at: Annotated[int, Meta(ge=0)] = 0  # the first iteration in which leaders turn
    frequency: Annotated[float, Meta(ge=0.0)] = 0.0  # Hz

    def build(self, context: BuildContext) -> HeadingComputation:
        """The computation. Raises InputError for an unknown leader."""
        for robot in self.leaders:
            if robot >= context.swarm:
                raise InputError(f"leaders: there is no robot {robot}; expected ids from 0 to {context.swarm - 1}")
        return HeadingComputation(self, context)


class HeadingComputation:
    """One heading a robot."""

    knowledge_type: type[Knowledge] = Headings

    def __init__(self, parameters: HeadingConsensus, context: BuildContext) -> None:
        count = len(context.ids)
        self.codec = PlainCodec(Heading(np.zeros(0)))
        self._parameters, self._period = parameters, context.period
        self._dt = parameters.dt or min(1.0, context.period)
        self._salt = int(context.streams.open("heading noise").integers(0, 2**64, dtype=np.uint64))
        self._heading, self._known = np.zeros(count), np.zeros(count, np.bool_)
        self._ids, self._leads = context.ids, np.isin(context.ids, parameters.leaders)
        self._course = np.zeros(count)  # leaders' headings when they began to turn

    def say(self, senses: Senses) -> Broadcast[Heading]:
        """Every robot's heading; a robot without one yet has that of its body."""
        new = senses.alive | ~self._known if self._parameters.body else ~self._known
        first = ~self._known
        self._heading[new] = senses.pose[new, 2]
        self._heading[first] *= self._parameters.spread / TURN
        self._known[:] = True
        return Broadcast.each(Heading(self._heading.copy()), self.codec.size)

    def hear(self, senses: Senses, inbox: Inbox[Heading]) -> Headings:
        """Turn towards the headings heard."""
        heading, parameters = self._heading, self._parameters
        count = len(heading)
        apart = wrapped(inbox.content.heading - heading[inbox.receivers])
        total = np.bincount(inbox.receivers, apart, minlength=count)
        heard = np.bincount(inbox.receivers, minlength=count)
        turned = heading + self._dt * total / np.maximum(heard, 1)
        if parameters.noise > 0.0:
            draw = chance.uniform(self._salt, senses.iteration, self._ids, 0)
            turned = turned + parameters.noise * np.pi * (2.0 * draw - 1.0)
        leads = self._leads if senses.iteration >= parameters.at else np.zeros_like(self._leads)
        if leads.any():
            turned = np.where(leads, self._led(senses.iteration - parameters.at), turned)
        heading[senses.alive] = wrapped(turned[senses.alive])
        return Headings(heading.copy(), leads)

    def _led(self, since: int) -> NDArray[np.float64]:
        """Leaders' headings, given the iterations since they began to turn."""
        if since == 0:
            self._course[:] = self._heading
        parameters, turns = self._parameters, TURN * self._parameters.frequency * since * self._period
        return np.asarray(self._course + parameters.turn * (np.sin(turns) if parameters.frequency else 1.0))

    def reset(self, robots: NDArray[np.int64]) -> None:
        """Restart robots (r,) from the headings of their bodies."""
        self._known[robots] = False

    def copy_from(self, robots: NDArray[np.int64], source: int) -> None:
        """Give robots (r,) the heading of another one."""
        self._heading[robots], self._known[robots] = self._heading[source], True
