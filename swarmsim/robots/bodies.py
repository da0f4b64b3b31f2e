"""Discs on wheels under pymunk: the bridge between arrays and rigid bodies."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
import pymunk
from msgspec import Meta, Struct
from numpy.typing import NDArray
from pymunk import batch

from swarmsim.core.building import Building, Crowd
from swarmsim.core.context import BuildContext
from swarmsim.core.crew import Crew
from swarmsim.core.errors import InputError
from swarmsim.core.kinematics import Drives
from swarmsim.core.parts import Motion
from swarmsim.core.state import State
from swarmsim.kernels import drive
from swarmsim.robots.batched import READ, WRITE, addresses, check
from swarmsim.robots.kinematics import TwoWheels, differential, drives_of
from swarmsim.robots.motion import Compiled

STRIDE = 0.25  # of its radius, the most that a robot may drive in a sub-step: more would let it pass thin walls
MOST = 100_000  # sub-steps of an iteration


class Pymunk(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Discs on wheels with mass, traction and friction, which push, slip and block each other (Chipmunk)."""

    substep: Annotated[float, Meta(gt=0.0)] = 1.0 / 64.0  # s, at most; shorter for fast robots, which might pass walls
    friction: Annotated[float, Meta(ge=0.0)] = 0.09  # coefficient between robots, and of robots on walls
    parting: Annotated[float, Meta(gt=0.0)] | None = None  # s, in which an overlap falls to a fifth; none: a 60th

    @property
    def walled(self) -> bool:
        return True

    def build(self, context: BuildContext) -> RigidDiscs:
        """The bodies at the robots' starts. Raises InputError for an iteration of more sub-steps than MOST."""
        stride = longest_stride(context.robots, self)
        if context.period > MOST * stride:
            raise InputError(
                f"substep: an iteration of {context.period:g} s would have {context.period / stride:.3g} sub-steps of "
                f"{stride:.3g} s, which the radius and speed of robots ask for too; expected at most {MOST}"
            )
        return RigidDiscs(context.robots, self, context.building, context.start, drives_of(context))


class RigidDiscs:
    """A swarm of discs on wheels, among walls and walking people.

    Walls stand still, but are replaced when the building changes; people are moved by their crowd, not by contacts.

    Sub-steps are at most `physics.substep` long, and so short that no robot drives farther than STRIDE of its radius
    in one. Contacts are found after the overlap, which reaches about speed times sub-step between a robot and a wall
    and twice that between two robots.
    """

    def __init__(
        self,
        robots: Crew,
        physics: Pymunk,
        building: Building,
        pose: NDArray[np.float64],
        drives: Drives | None = None,
    ) -> None:
        """By default all robots have two wheels. Raises InputError for a pymunk whose insides are not as used here."""
        check()
        self._substep = longest_stride(robots, physics)
        mass, radii = robots.each("mass"), robots.each("radius")
        moments = [pymunk.moment_for_circle(*one) for one in zip(mass, np.zeros(len(mass)), radii, strict=True)]
        self._drives = drives = drives or differential(robots, len(pose))
        self.space = pymunk.Space()
        self.space.iterations = 10
        self.space.collision_slop = 0.001 * float(radii.min())  # Chipmunk's default is made for pixels
        self.space.collision_bias = 0.2 ** (1.0 / (physics.parting or 1.0 / 60.0))  # what remains after 1 s
        self._friction = math.sqrt(physics.friction)  # of a shape: Chipmunk multiplies those of two touching shapes
        self._building = building
        self._walls: list[pymunk.Segment] = []
        self._walkers: list[list[pymunk.Body]] = []  # by crowd
        self._discs: list[pymunk.Shape] = []
        self._robot_ids: list[int] = []
        for (x, y, yaw), kilograms, moment, radius in zip(pose, mass.tolist(), moments, radii.tolist(), strict=True):
            body = pymunk.Body(kilograms, moment)
            body.position, body.angle = (x, y), yaw
            disc = pymunk.Circle(body, radius)
            disc.friction = self._friction
            self.space.add(body, disc)
            self._discs.append(disc)
            self._robot_ids.append(body.id)
        self._wheels = np.zeros((len(pose), drives.width))
        self._alive = np.ones(len(pose), np.bool_)
        self._retired = np.zeros(len(pose), np.bool_)
        self._iteration = 0
        self._prepare()

    def _prepare(self) -> None:
        """Add the present walls and people."""
        self._build_walls()
        self._admit_walkers()
        self._open_buffers()
        self._version, self._stirred = self._building.version, True

    def _build_walls(self) -> None:
        """Replace the walls by the present ones."""
        self.space.remove(*self._walls)
        ground = self.space.static_body
        self._walls = [pymunk.Segment(ground, (x1, y1), (x2, y2), 0.0) for x1, y1, x2, y2 in self._building.walls]
        for wall in self._walls:
            wall.friction = self._friction
        self.space.add(*self._walls)

    def _admit_walkers(self) -> None:
        """Give new people a body that nothing can push."""
        for crowd in self._building.crowds[len(self._walkers) :]:
            walkers = []
            for x, y, radius in crowd.discs:
                body = pymunk.Body(body_type=pymunk.Body.KINEMATIC)
                body.position = (x, y)
                disc = pymunk.Circle(body, radius)
                disc.friction = self._friction
                self.space.add(body, disc)
                walkers.append(body)
            self._walkers.append(walkers)

    def _open_buffers(self) -> None:
        """Map the arrays that pymunk's batch calls read and write.

        Bodies are never removed from the space, so robot i keeps row i; the static body and those of people have
        rows after them. The read buffer belongs to pymunk, which would reallocate one of ours.
        """
        identities = batch.Buffer()
        batch.get_space_bodies(self.space, batch.BodyFields.BODY_ID, identities)
        rows = np.frombuffer(identities.int_buf(), np.uintp)
        count = len(self._robot_ids)
        if list(rows[:count]) != self._robot_ids:
            raise RuntimeError("pymunk's batch rows are not in the order in which the bodies were added")
        self._reading, self._writing = batch.Buffer(), batch.Buffer()
        batch.get_space_bodies(self.space, READ, self._reading)
        self._moving = np.frombuffer(self._reading.float_buf()).reshape(-1, 6)[:count]
        self._push = np.zeros((len(rows), 3))
        self._writing.set_float_buf(self._push)
        self._engine, self._written, self._read, self._batched = addresses(self.space, self._reading, self._writing)

    def state(self) -> State:
        """The robots' present state; the arrays are copies."""
        return State(
            self._iteration,
            self._moving[:, :3].copy(),
            self._moving[:, 3:].copy(),
            self._wheels.copy(),
            self._alive.copy(),
        )

    @property
    def solid(self) -> NDArray[np.bool_]:
        """Which robots (n,) have bodies in the world, alive or crashed."""
        return np.array([disc.space is not None for disc in self._discs], np.bool_)

    def remove(self, robots: NDArray[np.int64]) -> None:
        """Take robots (r,) out of the world: nothing collides with them, and their bodies rest."""
        for robot in robots:
            disc = self._discs[robot]
            if disc.space is not None:
                self.space.remove(disc)
                self._stirred = True
            disc.body.velocity, disc.body.angular_velocity = (0.0, 0.0), 0.0
        self._moving[robots, 3:] = 0.0
        self.crash(robots)

    def crash(self, robots: NDArray[np.int64]) -> None:
        """Brake live robots (r,) for good; their bodies stay in the way and can be pushed."""
        self._alive[robots] = False
        self._wheels[robots] = 0.0

    def place(self, robots: NDArray[np.int64], pose: NDArray[np.float64]) -> None:
        """Put dead robots (r,) at `pose` (r, 3), at rest and alive again, except retired ones."""
        robots, pose = robots[~self._retired[robots]], pose[~self._retired[robots]]
        for robot, (x, y, yaw) in zip(robots, pose, strict=True):
            disc = self._discs[robot]
            if disc.space is None:
                self.space.add(disc)
                self._stirred = True
            disc.body.position, disc.body.angle = (x, y), yaw
            disc.body.velocity, disc.body.angular_velocity = (0.0, 0.0), 0.0
        self._moving[robots, :3] = pose
        self._moving[robots, 3:] = 0.0
        self._wheels[robots] = 0.0
        self._alive[robots] = True

    def push(self, robots: NDArray[np.int64], velocity: tuple[float, float]) -> None:
        """Give the bodies of robots (r,) a velocity (m/s), as a blow does; their wheels brake it."""
        for robot in robots:
            self._discs[robot].body.velocity = velocity
        self._moving[robots, 3:5] = velocity

    def retire(self, robots: NDArray[np.int64]) -> None:
        """Never revive these robots (r,)."""
        self._retired[robots] = True

    def _meet_crowds(self) -> list[tuple[Crowd, list[pymunk.Body], NDArray[np.bool_]]]:
        """The crowds, their bodies, and which robots (n,) they see.

        The bodies are put exactly where their crowds say: summing many sub-steps would round differently.
        """
        for crowd, walkers in zip(self._building.crowds, self._walkers, strict=True):
            for body, (x, y, _) in zip(walkers, crowd.discs.tolist(), strict=True):
                body.position = (x, y)
        return [(*pair, self.solid) for pair in zip(self._building.crowds, self._walkers, strict=True)]

    def drive(self, motion: Motion, period: float) -> State:
        """The state one period (s) later; `motion` gives commands at every sub-step."""
        if self._version != self._building.version:
            self._prepare()
        crowds = self._meet_crowds()
        substeps = math.ceil(period / self._substep - 1e-9)
        dt = period / substeps
        space, clear = self.space, self._reading.clear
        moving, wheels, push = self._moving, self._wheels, self._push
        pose = moving[:, :3]
        # With no people and two wheels each, a period is one compiled call if the motion offers it, except for a first
        # sub-step of pymunk's own after something was added to the space or removed from it.
        kind, course = self._drives.alone, None
        if isinstance(motion, Compiled) and isinstance(kind, TwoWheels) and not crowds:
            course = motion.course(kind)
        asked = substeps if course is None else int(self._stirred)
        for _ in range(asked):
            for crowd, walkers, solid in crowds:
                for body, velocity in zip(walkers, crowd.walk(pose, solid, dt).tolist(), strict=True):
                    body.velocity = velocity
            wheels[:], push[: len(wheels)] = self._drives.forces(moving, wheels, motion.command(pose), dt)
            batch.set_space_bodies(space, WRITE, self._writing)
            space.step(dt)
            clear()
            batch.get_space_bodies(space, READ, self._reading)
        if course is not None and isinstance(kind, TwoWheels):
            engine = (self._engine, self._written, self._read)
            drive.roll(substeps - asked, dt, *engine, moving, wheels, push, kind.traits, *course)
        self._stirred = False
        self._iteration += 1
        return self.state()


def longest_stride(robots: Crew, physics: Pymunk) -> float:
    """The longest sub-step (s), at most `substep`, in which no robot drives farther than STRIDE of its radius."""
    return min(physics.substep, STRIDE * float((robots.each("radius") / robots.each("speed")).min()))
