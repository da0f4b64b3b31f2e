"""Robots that map, for tests: their messages, their grids, and both halves of their minds."""

from __future__ import annotations

import numpy as np

from swarmsim.core.context import BuildContext
from swarmsim.core.messages import Inbox
from swarmsim.core.state import FREE, OCCUPIED, Intents, Senses
from swarmsim.operations.mapping.computation import OccupancyGrid
from swarmsim.operations.mapping.exploration.nearest import NearestFrontier
from swarmsim.operations.mapping.grids import OccupancyGrids
from swarmsim.operations.mapping.maps import TileItems


def inbox_of(receivers, senders, values, origins, iteration: int = 0) -> Inbox[TileItems]:
    """Messages of one tile each, just sensed by its sender."""
    receivers, senders = np.asarray(receivers, np.int32), np.asarray(senders, np.int32)
    sent = np.full(len(senders), iteration, np.int32)
    return Inbox(receivers, senders, sent, TileItems(values, origins, senders, sent), iteration)


def items(receivers, senders, values, origins, sources, sensed) -> Inbox[TileItems]:
    """An inbox of tiles, each sent when it was sensed."""
    return Inbox(receivers, senders, sensed, TileItems(values, origins, sources, sensed))


class Grids(OccupancyGrids):
    """Grids whose known cells are all new, for sharing policies called without a computation."""

    @property
    def changes(self) -> np.ndarray:
        robot, row, column = np.nonzero(self.observed)
        states = np.where(self.log_odds[robot, row, column] > 0.0, OCCUPIED, FREE)
        return np.stack([robot, row * self.observed.shape[2] + column, states], axis=1).astype(np.int32)


class Mapper:
    """The two halves of a mapping mind; parameters go to the half that has them."""

    def __init__(self, **parameters) -> None:
        fields = NearestFrontier.__struct_fields__
        self._strategy = NearestFrontier(**{key: value for key, value in parameters.items() if key in fields})
        self._computation = OccupancyGrid(**{key: value for key, value in parameters.items() if key not in fields})

    def build(self, context: BuildContext) -> Mapping:
        return Mapping(self._computation.build(context), self._strategy.build(context))


class Mapping:
    """A mapping mind."""

    def __init__(self, computation, strategy) -> None:
        self.computation, self.strategy = computation, strategy
        self.observed, self.log_odds = computation._grids.observed, computation._grids.log_odds  # for tests to write

    def step(self, senses: Senses, inbox: Inbox) -> Intents:
        return self.strategy.step(senses, inbox, self.computation.hear(senses, inbox))
