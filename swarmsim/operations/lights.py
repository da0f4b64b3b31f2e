"""A colour that robots pass on by sight: each takes that of the nearest shining robot that it sees."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Final

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from swarmsim.core.adapters.forms import Last
from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError, nearest
from swarmsim.core.messages import Inbox, MessageBatch
from swarmsim.core.parts import AnyStrategy, Curve, Summary
from swarmsim.core.readings import Name
from swarmsim.core.scenario.part import Part
from swarmsim.core.state import Done, Intents, Knowledge, Measured, Senses

Byte = Annotated[int, Meta(ge=0, le=255)]
CURVE: Final = Curve("lit", "robots that shine, %", scale=100.0, high=100.0, format=".0f")


class Mimic(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A dark robot takes the colour of the nearest shining robot that it sees, and keeps it.

    The `first` robots shine in `colour` from the start. Another strategy drives all robots. Their sensor `neighbours`
    has to see the light.
    """

    drive: Part[AnyStrategy] = Part("strategy", {"use": "stand"})
    first: tuple[Annotated[int, Meta(ge=0)], ...] = (0,)  # numbers of robots
    colour: tuple[Byte, Byte, Byte] = (255, 0, 255)  # red, green and blue
    light: Name = "led"  # the channel of the actuator

    def build(self, context: BuildContext) -> Mimicry:
        """The strategy. Raises InputError for an unknown light or robot."""
        _check_light(self.light, context)
        for robot in self.first:
            if robot >= context.swarm:
                raise InputError(f"first: there is no robot {robot}; expected ids from 0 to {context.swarm - 1}")
        return Mimicry(self, context)


class Mimicry:
    """Another strategy's ways and velocities, and colours."""

    def __init__(self, parameters: Mimic, context: BuildContext) -> None:
        self._drive = parameters.drive.build(context, "drive")
        self._light, self._sees = parameters.light, f"neighbours_{parameters.light}"
        self._first = np.zeros((len(context.ids), 3), np.uint8)
        self._first[np.isin(context.ids, parameters.first)] = parameters.colour
        #: The channels of sensors that it needs.
        self.requires = (self._sees, *getattr(self._drive, "requires", ()))

    @property
    def requires_knowledge(self) -> type[Knowledge]:
        """The knowledge that the driving strategy needs."""
        return self._drive.requires_knowledge

    def step(self, senses: Senses, inbox: Inbox[MessageBatch], knowledge: Knowledge) -> Intents:
        """The driving strategy's intents, with the colour that each robot has, or has just seen."""
        shown = (self._first if senses.decided is None else senses.decided.commands[self._light]).copy()
        seen = senses.readings[self._sees]  # (n, most, 3), the nearest first
        shines: NDArray[np.bool_] = seen.max(axis=2) > 0
        takes = np.flatnonzero((shown.max(axis=1) == 0) & shines.any(axis=1))
        shown[takes] = seen[takes, shines[takes].argmax(axis=1)]
        intents = self._drive.step(senses, inbox, knowledge)
        return replace(intents, commands={**intents.commands, self._light: shown})


class Lit(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Live robots shine: the share of them whose light is on reaches a threshold."""

    share: Annotated[float, Meta(gt=0.0, le=1.0)] = 1.0  # of the live
    light: Name = "led"  # the channel of the actuator

    def build(self, context: BuildContext) -> LitTask:
        """The task. Raises InputError for an unknown light."""
        _check_light(self.light, context)
        return LitTask(self)


class LitTask:
    """Counts lights that are on."""

    requires_knowledge: type[Knowledge] = Knowledge  # type: ignore[type-abstract]  # any kind will do
    curve = CURVE

    def __init__(self, parameters: Lit) -> None:
        self._wanted, self._light = parameters.share, parameters.light

    def measure(self, done: Done[Knowledge]) -> Measured:
        """The share of the live that shine."""
        shines = done.state.actuators[self._light].max(axis=1) > 0
        share = float(shines[done.state.alive].mean()) if done.state.alive.any() else 0.0
        return Measured({"lit": share}, {}, min(1.0, share / self._wanted), share >= self._wanted)

    def summaries(self) -> Sequence[Summary[Knowledge]]:
        """The last value."""
        return (Last(),)


def _check_light(name: str, context: BuildContext) -> None:
    """Raise InputError unless the robots have a coloured light of this name."""
    lights = {one.name: one for one in context.actuators if one.is_colour}
    if name not in lights:
        raise InputError(
            f"light: no actuator of these robots shines as {name!r}; {nearest(name, lights)}; "
            "expected one of [[actuators]], as in use = 'led'"
        )
