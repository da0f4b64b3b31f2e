"""One robot's mind behind bytes: what it senses and the frames that it hears go in, frames and deeds come out.

It is built for one row, under its robot's number, and knows of others only what they say. Nothing here, nor anything
imported, has a world: the same mind runs in a simulated swarm, in a process of its own, and on a robot.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol, Self, cast

import numpy as np
from numpy.typing import NDArray

from swarmsim.core import assembly, reports
from swarmsim.core.capabilities import PLACING
from swarmsim.core.charge import Charge
from swarmsim.core.context import BuildContext
from swarmsim.core.messages import Broadcast, Codec, FrameError, Inbox, MessageBatch
from swarmsim.core.parts import AnyComputation, AnyStrategy
from swarmsim.core.readings import Column, Readings
from swarmsim.core.reports import Report
from swarmsim.core.scenario.file import minds_of
from swarmsim.core.state import Intents, Senses

NONE_YET = np.empty(0, np.int64)


@dataclass(frozen=True, slots=True, eq=False)
class Sensed:
    """What one robot senses at the start of an iteration."""

    iteration: int
    alive: bool
    pose: NDArray[np.float64]  # (3,): its estimate of it: x, y in m, yaw in rad
    velocity: NDArray[np.float64]  # (3,): m/s, m/s, rad/s, in the world frame
    readings: tuple[Column, ...]  # a row of each channel of its sensors
    decided: Intents | None = None  # what it did in the last iteration, if that was not its own decision
    forget: bool = False  # whether its memory is lost
    faults: tuple[int, ...] = ()  # numbers of those that its mind has now, of its charge's


@dataclass(frozen=True, slots=True, eq=False)
class Letter:
    """A frame that was read."""

    sender: int
    sent: int  # iteration
    items: MessageBatch


@dataclass(frozen=True, slots=True, eq=False)
class Deed:
    """What one robot decides until the next iteration, and what it has learned in this one."""

    iteration: int
    intents: Intents  # of one row
    report: Report
    heard: NDArray[np.int32]  # (m, 2): sender and iteration sent of the letters that it took in, sorted


@dataclass(frozen=True, slots=True)
class BothHalves:
    """Both halves of a mind, as faults wrap them."""

    computation: AnyComputation
    strategy: AnyStrategy


class MindsEffect(Protocol):
    """What a fault does to a mind, as `faults.effect.Effect` does it to a swarm's."""

    def wrap(self, parts: BothHalves, active: NDArray[np.bool_]) -> BothHalves: ...

    def begin(self, robots: NDArray[np.int64], state: None) -> None: ...

    def end(self, robots: NDArray[np.int64], state: None) -> NDArray[np.int64]: ...


class MindsTimedFault(Protocol):
    """A fault as built, whose timeline is the world's."""

    @property
    def effect(self) -> MindsEffect: ...


@dataclass(frozen=True, slots=True)
class HeldFault:
    """A fault that the robot has in its mind while `active` (1,)."""

    number: int
    effect: MindsEffect
    active: NDArray[np.bool_]

    def turn(self, on: bool) -> None:
        """Begin or end it, if that is new."""
        if on != self.active[0]:
            self.active[0] = on
            (self.effect.begin if on else self.effect.end)(np.zeros(1, np.int64), None)


class Robot:
    """A robot's mind. In each iteration it senses first, then hears."""

    def __init__(
        self,
        number: int,
        context: BuildContext,
        mind: BothHalves,
        codec: Codec[MessageBatch],
        faults: Sequence[HeldFault] = (),
    ) -> None:
        """The `codec` reads and writes the messages of all its swarm; the `faults` have wrapped its mind."""
        #: Its number in the swarm.
        self.number = number
        self._context, self._codec, self._faults = context, codec, faults
        self._computation, self._strategy = mind.computation, mind.strategy
        self._decided: Intents | None = None
        self._senses: Senses | None = None
        self._said: Broadcast[MessageBatch] | None = None

    @classmethod
    def of(cls, charge: Charge) -> Self:
        """The robot that a charge describes, with an empty memory. Raises InputError."""
        context = charge.context()
        mind, faults = BothHalves(*assembly.together(assembly.built_for(charge, context), charge)), list[HeldFault]()
        for one in charge.faults:
            fault: object = one.fault.build(replace(context, number=one.number))
            effect, active = cast("MindsTimedFault", fault).effect, np.zeros(1, np.bool_)
            mind = effect.wrap(mind, active)
            faults.append(HeldFault(one.number, effect, active))
        return cls(charge.robot, context, mind, _codec(charge, mind.computation), faults)

    @property
    def context(self) -> BuildContext:
        """What its mind was built from."""
        return self._context

    def read(self, frame: bytes) -> Letter:
        """A frame of another robot. Raises FrameError for bytes that none of its swarm can have packed."""
        sender, sent, items = self._codec.unpack(frame)
        if sender >= self._context.swarm or sender == self.number:
            raise FrameError(f"a frame of robot {sender}; expected another one of {self._context.swarm}")
        return Letter(sender, sent, items)

    def sense(self, sensed: Sensed) -> list[bytes]:
        """Take in what it senses; what it says, as frames: one or, if it has nothing to say, none."""
        if sensed.forget:
            self._computation.reset(np.zeros(1, np.int64))
        for fault in self._faults:
            fault.turn(fault.number in sensed.faults)
        if sensed.decided is not None:
            self._decided = sensed.decided
        readings = Readings(self._context.channels, tuple([column[None] for column in sensed.readings]))
        alive = np.array([sensed.alive])
        self._senses = Senses(
            sensed.iteration, sensed.pose[None], sensed.velocity[None], alive, readings, self._decided
        )
        self._said = said = self._computation.say(self._senses)
        if not said.sizes[0]:
            return []
        return [self._codec.pack(self.number, sensed.iteration, said.of(0))]

    def hear(self, letters: Sequence[Letter], awake: bool = True, oldest: int = 0) -> Deed:
        """Take in what it hears; what it does until the next iteration.

        A robot that is not `awake` takes nothing in, and decides as if dead. No letter still under way was sent before
        the iteration `oldest`. Raises RuntimeError before it has sensed.
        """
        if self._senses is None or self._said is None:
            raise RuntimeError("a robot that hears before it has sensed")
        senses = self._senses
        if not awake:
            nobody = np.zeros(1, np.bool_)
            senses = replace(senses, alive=nobody, readings=senses.readings.blanked(~nobody))
        found = sorted(letters, key=lambda one: (one.sender, one.sent))
        inbox = self._inbox([one for one in found if len(one.items)], self._said, oldest)
        knowledge = self._computation.hear(senses, inbox)
        self._decided = self._strategy.step(replace(self._senses, alive=senses.alive), inbox, knowledge)
        heard = np.array([(one.sender, one.sent) for one in found], np.int32).reshape(-1, 2)
        return Deed(senses.iteration, self._decided, reports.report(self._computation, knowledge), heard)

    def nearest(self, letters: Sequence[Letter], most: int) -> list[Letter]:
        """The letters of the `most` senders who are nearest by what they say. Raises LackingError if they do not.

        Of two that are equally near the lower number counts. Raises RuntimeError before it has sensed.
        """
        if self._senses is None:
            raise RuntimeError("a robot that hears before it has sensed")
        placing = PLACING.needed(self._computation, "the nearest robots by their messages")
        here, distances = self._senses.pose[0, :2], dict[int, float]()
        for one in sorted(letters, key=lambda letter: letter.sent):  # the newest says where a sender is
            places = placing.places(one.items, one.sender)
            distances[one.sender] = float(np.hypot(*(places[-1] - here))) if len(places) else math.inf
        near = sorted(distances, key=lambda sender: (distances[sender], sender))[:most]
        return [one for one in letters if one.sender in near]

    def _inbox(self, found: Sequence[Letter], said: Broadcast[MessageBatch], oldest: int) -> Inbox[MessageBatch]:
        """The letters, sorted by sender and iteration sent, item by item."""
        counts = [len(one.items) for one in found]
        senders, sent = (
            np.repeat(np.array(column, np.int32), counts)
            for column in ([one.sender for one in found], [one.sent for one in found])
        )
        content = said.content.take(NONE_YET)
        if found:
            content = type(found[0].items).joined([one.items for one in found])
        return Inbox(np.zeros(len(senders), np.int32), senders, sent, content, oldest)


def _codec(charge: Charge, computation: AnyComputation) -> Codec[MessageBatch]:
    """The codec of all messages in a swarm, whose groups may have computations of several kinds."""
    firsts = np.cumsum([0, *(group.count for group in charge.robots.groups)])
    minds = minds_of(charge)
    if len(minds) == 1:
        return computation.codec
    everybody = assembly.built_for(charge, charge.context(*(int(firsts[one.groups[0]]) for one in minds)))
    return assembly.together(everybody, charge)[0].codec


def warm(charge: Charge) -> None:
    """Go through an iteration with a robot that is then forgotten: what has to be compiled or imported is."""
    robot = Robot.of(charge)
    others = [number for number in range(robot.context.swarm) if number != robot.number][:1]
    with np.errstate(all="ignore"):  # the other one is at the same place, where some ways have no direction
        for iteration in range(2):
            frames = robot.sense(_nothing(robot, charge, iteration, True))
            items = [robot._codec.unpack(frame)[2] for frame in frames]
            robot.hear([Letter(other, iteration, one) for other in others for one in items])


def idle(charge: Charge) -> Deed:
    """What a robot does and has learned that is dead at the start."""
    robot = Robot.of(charge)
    robot.sense(_nothing(robot, charge, 0, False))
    return robot.hear([], awake=False)


def _nothing(robot: Robot, charge: Charge, iteration: int, alive: bool) -> Sensed:
    """What a robot in the middle of the page senses if it senses nothing."""
    x, y, cell, rows, columns = charge.lattice
    pose = np.array([x + cell * (columns // 2), y + cell * (rows // 2), 0.0])
    blank = tuple(channel.blanks(1)[0] for channel in robot.context.channels)
    return Sensed(iteration, alive, pose, np.zeros(3), blank)
