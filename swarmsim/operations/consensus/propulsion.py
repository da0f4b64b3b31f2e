"""Self-propelled robots: each follows its heading at constant speed, and turns away from walls that it senses."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from msgspec import Meta, Struct

from swarmsim.core.context import BuildContext
from swarmsim.core.messages import Inbox, MessageBatch
from swarmsim.core.state import Intents, Knowledge, Senses
from swarmsim.operations.consensus.heading import Headings
from swarmsim.operations.steering import away_from_walls, wrapped


class SelfPropelled(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each robot drives at constant speed and turns to its heading within an iteration, as far as it can.

    Occupied cells of its tile, nearer than `clearance` and not behind it, push its direction away from them, as in the
    potential of Khatib (1986); robots without tiles drive blindly.
    """

    speed: Annotated[float, Meta(gt=0.0)] | None = None  # m/s; default: two thirds of what wheels can
    clearance: Annotated[float, Meta(ge=0.0)] = 0.3  # m; 0 avoids nothing

    def build(self, context: BuildContext) -> Propulsion:
        return Propulsion(self, context)


class Propulsion:
    """Velocities from headings."""

    requires_knowledge: type[Knowledge] = Headings

    def __init__(self, parameters: SelfPropelled, context: BuildContext) -> None:
        self._speed = parameters.speed or context.robots.speed * 2.0 / 3.0
        self._clearance, self._lattice, self._period = parameters.clearance, context.lattice, context.period

    def step(self, senses: Senses, inbox: Inbox[MessageBatch], knowledge: Headings) -> Intents:
        """Drive towards the heading or away from walls."""
        heading = knowledge.heading
        tiles, place = senses.readings.tiles, senses.pose[:, :2]
        push = away_from_walls(place, tiles, self._lattice, self._clearance)
        way = np.stack([np.cos(heading), np.sin(heading)], axis=1) + push
        turn = wrapped(np.arctan2(way[:, 1], way[:, 0]) - senses.pose[:, 2]) / self._period
        ahead = np.where(senses.alive, self._speed, 0.0)
        return Intents.twisting(np.stack([ahead, np.where(senses.alive, turn, 0.0)], axis=1))


class Stand(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Robots stay where they are."""

    def build(self, context: BuildContext) -> Stationary:
        return Stationary()


class Stationary:
    """No robot moves."""

    requires_knowledge: type[Knowledge] = Knowledge  # type: ignore[type-abstract]  # any kind will do

    def step(self, senses: Senses, inbox: Inbox[MessageBatch], knowledge: Knowledge) -> Intents:
        """Nothing."""
        return Intents.twisting(np.zeros((len(senses.alive), 2)))
