"""How well the maps follow a changing building: delay, staleness, and how much is mapped again."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.building import Building
from swarmsim.core.state import Moment
from swarmsim.operations.mapping.maps import Maps

Cells = NDArray[np.bool_]  # (rows, columns)


@dataclass(slots=True)
class Change:
    """One change of the building, and when it reached the maps; delays count iterations, 1 is at once."""

    iteration: int  # the first one with the change
    cells: NDArray[np.int64]  # (c,): row-major, those of the domain that turned from free to occupied, or the reverse
    first: int | None = None  # until the union was right about one of them
    half: int | None = None  # until it was right about half of them
    robots: dict[int, int] = field(default_factory=dict)  # until a robot's own map was right about half, by its id
    right: float = 0.0  # share of the cells that the union had right when last checked
    over: bool = False  # whether another change has touched its cells since, which ends the watch


class ChangeMeasures:
    """An observer that compares the maps with the present truth.

    In the union a cell is occupied if it is for any robot that observed it, as in the films.
    """

    def __init__(self, building: Building) -> None:
        """`building`: as at the start."""
        self._version = building.version
        self._truth, self._domain = building.occupied, building.explorable
        self._stale: list[float | None] = []  # since the first change
        self._robots = 0
        self.changes: list[Change] = []

    def sample(self, moment: Moment[Maps]) -> None:
        """Take note of one iteration."""
        observed, log_odds = moment.knowledge.observed, moment.knowledge.log_odds
        self._robots = len(observed)
        if self._version != moment.building.version:
            self._note(moment.building, moment.state.iteration)
        if self.changes:
            self._stale.append(self._stale_share(observed, log_odds))
        for change in self.changes:
            if not change.over:
                self._watch(change, moment.state.iteration, observed, log_odds)

    def _stale_share(self, observed: Cells, log_odds: NDArray[np.float32]) -> float | None:
        known = observed.any(axis=0) & self._domain
        wrong: NDArray[np.bool_] = known & ((observed & (log_odds > 0.0)).any(axis=0) != self._truth)
        count = int(np.count_nonzero(known))
        return int(np.count_nonzero(wrong)) / count if count else None

    def _watch(self, change: Change, iteration: int, observed: Cells, log_odds: NDArray[np.float32]) -> None:
        cells, delay = change.cells, iteration - change.iteration + 1
        known = observed.reshape(len(observed), -1)[:, cells]
        occupied = known & (log_odds.reshape(len(observed), -1)[:, cells] > 0.0)
        truth = self._truth.reshape(-1)[cells]
        right = np.count_nonzero(known.any(axis=0) & (occupied.any(axis=0) == truth))
        change.right = int(right) / len(cells)
        if change.first is None and right > 0:
            change.first = delay
        if change.half is None and 2 * right >= len(cells):
            change.half = delay
        own = np.count_nonzero(known & (occupied == truth), axis=1)
        for robot in np.flatnonzero(2 * own >= len(cells)).tolist():
            change.robots.setdefault(robot, delay)

    def _note(self, building: Building, iteration: int) -> None:
        """Watch the changed cells; a cell that changes again is no longer watched for the earlier change."""
        self._version = building.version
        changed: NDArray[np.bool_] = building.occupied != self._truth
        for change in self.changes:
            change.over |= bool(changed.reshape(-1)[change.cells].any())
        cells = np.flatnonzero(changed & building.explorable)
        if len(cells):
            self.changes.append(Change(iteration, cells))
        self._truth, self._domain = building.occupied, building.explorable

    def summary(self) -> dict[str, float | int | None]:
        """The run in numbers; docs/buildings.md defines each. None where undefined."""
        changes = self.changes
        stale = [share for share in self._stale if share is not None]
        watched = len(changes) * self._robots
        return {
            "changes": len(changes),
            "changes_detected": sum(change.half is not None for change in changes),
            "detection_first": _mean([change.first for change in changes if change.first is not None]),
            "detection_half": _mean([change.half for change in changes if change.half is not None]),
            "robot_detection_half": _mean([delay for change in changes for delay in change.robots.values()]),
            "robots_detected": sum(len(change.robots) for change in changes) / watched if watched else None,
            "stale_mean": _mean(stale),
            "stale_end": self._stale[-1] if self._stale else None,
            "remapped_share": _mean([change.right for change in changes]),
        }


def _mean(values: list[float] | list[int]) -> float | None:
    return float(np.mean(values)) if values else None
