"""Faults of motors: wheels that stop, drag, run away or pull to one side."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.parts import Bodies, Motion, Parts, WheelSpeeds
from swarmsim.core.state import Intents
from swarmsim.faults.effect import StatelessEffect, TimedFault
from swarmsim.faults.timeline import Timed, Timeline
from swarmsim.robots.kinematics import TwoWheels, drives_of
from swarmsim.robots.motion import Compiled, Course

SIDES = {"left": (True, False), "right": (False, True), "both": (True, True)}


class Motor(Timed, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The wheels' motors do not obey; the robot still senses, talks, steers and decides.

    `off`: they stop. `slow`: they turn at `factor` of the wanted speed, all of them or, with `wheel`, only one,
    so that the robot pulls to one side. `stuck`: they always turn at `speed`. `stuck` and `wheel` need robots on two
    wheels.
    """

    failure: Literal["off", "slow", "stuck"]
    wheel: Literal["both", "left", "right"] = "both"
    factor: Annotated[float, Meta(ge=0.0)] | None = None  # for slow; default 0.5
    speed: float | None = None  # for stuck: m/s at the rim, backwards if negative; default: the robots' top speed

    def build(self, context: BuildContext) -> TimedFault:
        """The fault; raises InputError for a key that its failure does not have."""
        for key, failure in (("factor", "slow"), ("speed", "stuck")):
            if getattr(self, key) is not None and self.failure != failure:
                raise InputError(f"{key}: a motor that is {self.failure!r} has none; expected failure = {failure!r}")
        drives = drives_of(context)
        others = " or ".join(map(repr, sorted(drives.names - {"differential"})))
        for key, given in (("wheel", self.wheel != "both"), ("failure", self.failure == "stuck")):
            if given and others:
                raise InputError(
                    f"{key}: {getattr(self, key)!r} is of robots on two wheels, not of {others}; expected failure = "
                    "'off' or 'slow' of both wheels, or kinematics.use = 'differential'"
                )
        top = context.robots.speed
        if self.speed is not None and abs(self.speed) > top:
            raise InputError(f"speed: {self.speed:g} m/s is more than the motors give; expected at most {top:g}")
        gain = (0.5 if self.factor is None else self.factor) if self.failure == "slow" else 0.0
        bias = (top if self.speed is None else self.speed) if self.failure == "stuck" else 0.0
        effect = MotorFailure(drives.motors if others else np.array(SIDES[self.wheel]), gain, bias)
        return TimedFault(Timeline(self, context), effect, context.number)


class MotorFailure(StatelessEffect):
    """Wraps the motion: the wheels' output is a gain times the wanted command, plus a bias."""

    def __init__(self, wheels: NDArray[np.bool_], gain: float, bias: float) -> None:
        """`wheels` (2,), or (n, c) of commands: which of them fail on each robot."""
        self._wheels, self._gain, self._bias = wheels, gain, bias

    def wrap(self, parts: Parts, active: NDArray[np.bool_]) -> Parts:
        """The parts with the motion wrapped."""
        motion = FailingMotion(parts.motion, parts.bodies, active, self._wheels, self._gain, self._bias)
        return replace(parts, motion=motion)


class FailingMotion(Compiled):
    """Motion in which some wheels of live robots fail; those of the dead stand."""

    def __init__(
        self,
        inner: Motion,
        bodies: Bodies,
        active: NDArray[np.bool_],
        wheels: NDArray[np.bool_],
        gain: float,
        bias: float,
    ) -> None:
        self._inner, self._bodies, self._active = inner, bodies, active
        self._wheels, self._gain, self._bias = wheels, gain, bias
        self._failing = np.zeros((len(active), wheels.shape[-1]), np.bool_)

    def follow(self, intents: Intents) -> None:
        self._failing = (self._active & self._bodies.state().alive)[:, None] & self._wheels
        self._inner.follow(intents)

    def command(self, pose: NDArray[np.float64]) -> WheelSpeeds:
        """The wanted commands, altered where wheels fail."""
        wanted = self._inner.command(pose)
        np.copyto(wanted, wanted * self._gain + self._bias, where=self._failing)
        return wanted

    def course(self, wheels: TwoWheels) -> Course | None:
        """The course of the wrapped motion with one failure more, if it has one."""
        inner = self._inner.course(wheels) if isinstance(self._inner, Compiled) else None
        if inner is None:
            return None
        return inner._replace(
            failing=np.concatenate([inner.failing, self._failing[None]]),
            laws=np.vstack([inner.laws, (self._gain, self._bias)]),
        )
