"""Channels that lose messages: by chance, in bursts, by distance and by walls."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from swarmsim.core import chance
from swarmsim.core.building import Building, Walls
from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.messages import Delivery, Packets
from swarmsim.core.parts import Links, NetworkChannel
from swarmsim.core.state import State
from swarmsim.network.channel import StackedChannel, but_lost

Law = Callable[[State, Packets], NDArray[np.bool_]]  # which of the messages (m, 4) are lost now


class LossyChannel:
    """Loses the messages that a law selects, for one reason; calls the law in every iteration."""

    def __init__(self, below: NetworkChannel, reason: str, law: Law) -> None:
        self._below = below
        self._reason = reason
        self._law = law

    def deliver(self, state: State, links: Links, sizes: NDArray[np.int32]) -> Delivery:
        """What the channel below delivers, less the law's losses."""
        delivery = self._below.deliver(state, links, sizes)
        return but_lost(delivery, self._reason, self._law(state, delivery.heard))


class Bernoulli(StackedChannel, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each message is lost with the same probability, independently of all others."""

    loss: Annotated[float, Meta(ge=0.0, le=1.0)]  # probability that a message is lost

    def build(self, context: BuildContext) -> LossyChannel:
        """The channel, which loses messages for the reason "loss"."""
        salt = self.salt(context)

        def law(state: State, heard: Packets) -> NDArray[np.bool_]:
            return chance.uniform(salt, heard[:, 2], heard[:, 0], heard[:, 1]) < self.loss

        return LossyChannel(self.below(context), "loss", law)


class GilbertElliott(StackedChannel, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Losses come in bursts: each directed pair of robots is in a good or a bad state, and the bad one loses all.

    In every iteration a good pair turns bad with probability p and a bad one good with probability r
    (Gilbert 1960, Elliott 1963). With r = 1 / `burst` and p = `loss` r / (1 - `loss`) the mean loss and the
    mean length of a burst are as given.
    """

    loss: Annotated[float, Meta(ge=0.0, lt=1.0)]  # mean share of messages lost
    burst: Annotated[float, Meta(ge=1.0)]  # mean length of a bad state, iterations

    def build(self, context: BuildContext) -> LossyChannel:
        """The channel, which loses messages for the reason "burst". Raises InputError if p would exceed 1."""
        recovery = 1.0 / self.burst
        failure = self.loss * recovery / (1.0 - self.loss)
        if failure > 1.0:
            raise InputError(
                f"burst: bursts of {self.burst:g} iterations are too short for a mean loss of {self.loss:g}; "
                f"expected at least loss / (1 - loss) = {self.loss / (1.0 - self.loss):g}"
            )
        states = PairStates(self.salt(context), context.swarm, self.loss, failure, recovery)
        return LossyChannel(self.below(context), "burst", states.lost)


class PairStates:
    """The good or bad state of every directed pair, linked or not, so that links never affect each other."""

    def __init__(self, salt: int, robots: int, loss: float, failure: float, recovery: float) -> None:
        """`failure` and `recovery` are the probabilities per iteration of turning bad and good."""
        self._salt = salt
        self._robots = np.arange(robots)
        self._failure, self._recovery = failure, recovery
        self._iteration = 0
        # The chain starts from its stationary distribution: there is no time before the run in which to settle.
        self._bad = self._draw() < loss  # (n, n): receiver, sender

    def lost(self, state: State, heard: Packets) -> NDArray[np.bool_]:
        """Which messages travel between a pair that is bad now."""
        while self._iteration < state.iteration:
            self._iteration += 1
            draw = self._draw()
            self._bad = np.where(self._bad, draw >= self._recovery, draw < self._failure)
        return self._bad[heard[:, 0], heard[:, 1]]

    def _draw(self) -> NDArray[np.float64]:
        return chance.uniform(self._salt, self._iteration, self._robots[:, None], self._robots)


class Range(StackedChannel, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Messages arrive up to a distance between two robots, and never beyond."""

    metres: Annotated[float, Meta(gt=0.0)]  # m, range of messages

    def build(self, context: BuildContext) -> LossyChannel:
        """The channel, which loses messages for the reason "range"."""

        def law(state: State, heard: Packets) -> NDArray[np.bool_]:
            gap = state.pose[heard[:, 0], :2] - state.pose[heard[:, 1], :2]
            return np.asarray(np.hypot(gap[:, 0], gap[:, 1]) > self.metres)

        return LossyChannel(self.below(context), "range", law)


class PathLoss(StackedChannel, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Messages arrive if enough power is left after distance, walls and shadowing.

    The loss in dB is pl0 + 10 exponent log10(d / 1 m) + wall_loss walls + X, with X normal of standard deviation
    sigma: the log-distance model with log-normal shadowing and partition losses (Rappaport 2002, chapter 4).
    Below 1 m the distance loss stays pl0.
    """

    power: float = 15.0  # dBm, transmitted (default of the MAES simulator)
    sensitivity: float = -82.0  # dBm, the weakest signal understood (default of MAES)
    pl0: Annotated[float, Meta(ge=0.0)] = 40.0  # dB at 1 m: free space at 2.4 GHz (Friis 1946)
    exponent: Annotated[float, Meta(ge=0.0)] = 2.0  # free space (Friis 1946): walls are counted apart
    sigma: Annotated[float, Meta(ge=0.0)] = 3.0  # dB, shadowing
    wall_loss: Annotated[float, Meta(ge=0.0)] = 15.0  # dB for each wall (concrete in MAES)

    def build(self, context: BuildContext) -> LossyChannel:
        """The channel, which loses messages for the reason "weak"."""
        radio = Reception(self, self.salt(context), context.building)
        return LossyChannel(self.below(context), "weak", radio.lost)


class Reception:
    """The power that arrives between two robots, the same in both directions."""

    def __init__(self, parameters: PathLoss, salt: int, building: Building) -> None:
        self._parameters = parameters
        self._salt = salt
        self._building = building

    def lost(self, state: State, heard: Packets) -> NDArray[np.bool_]:
        """Which messages arrive too weak to be understood."""
        ends = np.sort(heard[:, :2], axis=1)
        pairs, which = np.unique(ends, axis=0, return_inverse=True)
        margin = self.received(state, pairs) - self._parameters.sensitivity
        # Walls only weaken a signal: look for them only where it would arrive without them.
        near = np.flatnonzero(margin >= 0.0)
        here, there = state.pose[pairs[near, 0], :2], state.pose[pairs[near, 1], :2]
        margin[near] -= self._parameters.wall_loss * walls_between(here, there, self._building.walls.copy())
        return np.asarray(margin < 0.0)[which.reshape(-1)]

    def received(self, state: State, pairs: NDArray[np.int32]) -> NDArray[np.float64]:
        """The power in dBm between unordered `pairs` (p, 2) of robots, lower id first, without walls.

        The shadowing of each pair is drawn anew in every iteration.
        """
        parameters = self._parameters
        gap = state.pose[pairs[:, 0], :2] - state.pose[pairs[:, 1], :2]
        distance = np.maximum(np.hypot(gap[:, 0], gap[:, 1]), 1.0)
        shadow = parameters.sigma * chance.normal(self._salt, state.iteration, pairs[:, 0], pairs[:, 1])
        return np.asarray(parameters.power - parameters.pl0 - 10.0 * parameters.exponent * np.log10(distance) - shadow)


def walls_between(here: NDArray[np.float64], there: NDArray[np.float64], walls: Walls) -> NDArray[np.float64]:
    """How many walls stand between the points `here` and `there` (p, 2 each).

    Walls are the outlines of solids, crossed once on the way in and once on the way out, so half the crossings
    are counted. Points on a line count as left of it, so that a way in through a corner crosses one of the two
    segments that meet there, and a way past it crosses both or neither.
    """
    along = walls[:, 2:] - walls[:, :2]
    offset = _cross(along, walls[:, :2])
    sides = [along[:, 0] * point[:, 1:] - along[:, 1] * point[:, :1] >= offset for point in (here, there)]
    way, wall = np.nonzero(sides[0] != sides[1])  # (p, s): the way leads from one side of the wall's line to the other
    here, straight = here[way], (there - here)[way]
    first, last = walls[wall, :2], walls[wall, 2:]
    crossed: NDArray[np.bool_] = (_cross(straight, first - here) >= 0.0) != (_cross(straight, last - here) >= 0.0)
    return np.asarray(np.bincount(way[crossed], minlength=len(there)) / 2.0)


def _cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
