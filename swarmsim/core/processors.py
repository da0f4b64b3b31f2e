"""Processors: what robots can compute in the time that they have, and what they have computed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Final

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

MIND: Final = "mind"  #: the holder of a mind's memory, beside the jobs


class Processor(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, omit_defaults=True):
    """What a robot computes its part of jobs on; without a number it is unlimited in that.

    `use` names a real one, whose numbers replace missing ones.
    """

    use: str = ""  # a real one, whose numbers replace missing ones: atmega328, esp32, stm32f407 or pi-zero-2
    rate: Annotated[float, Meta(gt=0.0, le=1e18)] | None = None  # floating-point operations a second
    memory: Annotated[float, Meta(gt=0.0, le=1e18)] | None = None  # bytes, for the mind's data and the jobs'
    energy: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.0  # J an operation


class Processors:
    """The processors of robots, row by row, in the exchanges of a run.

    In each exchange a processor has as many operations as it does in that time. What is not asked for by its end is
    gone. What has been done of a step that takes longer stays done.
    """

    def __init__(self, kinds: Sequence[Processor], kind: NDArray[np.int64], exchange: float, rounds: int) -> None:
        """`kind` (rows,) gives each row's; an `exchange` takes that many seconds, and an iteration has `rounds`."""

        def column(values: Sequence[float | None]) -> NDArray[np.float64]:
            return np.array([np.inf if one is None else one for one in values])[kind]

        #: The operations of each (rows,) in an exchange.
        self.full: Final = column([one.rate for one in kinds]) * exchange
        self._energy: Final = column([one.energy for one in kinds])
        self._rounds: Final = rounds
        #: The bytes of each (rows,).
        self.memory: Final = column([one.memory for one in kinds])
        self._left = self.full.copy()
        self._given, self._done, self._late, self._peak = np.zeros((4, len(kind)))
        self._held: list[dict[str, float]] = [{} for _ in kind]  # bytes, by holder
        self._slowed: list[tuple[NDArray[np.bool_], float | NDArray[np.float64]]] = []

    @classmethod
    def unlimited(cls, rows: int) -> Processors:
        """Those that do all at once."""
        return cls((Processor(),), np.zeros(rows, np.int64), 1.0, 1)

    @property
    def timed(self) -> NDArray[np.bool_]:
        """Which (rows,) have a limited rate."""
        return np.isfinite(self.full)

    @property
    def limited(self) -> bool:
        """Whether any of them has a number."""
        return bool(self.timed.any() or np.isfinite(self.memory).any() or self._energy.any())

    # --- time

    def slow(self, active: NDArray[np.bool_], factor: float | NDArray[np.float64]) -> None:
        """Multiply the rates of those that are `active` (rows,) by a factor, or each by its own; 0 stops them.

        Both arrays are live views.
        """
        self._slowed.append((active, factor))

    @property
    def speed(self) -> NDArray[np.float64]:
        """The share of its rate that each (rows,) has at present."""
        found = np.ones(len(self.full))
        for active, factor in self._slowed:
            found *= np.where(active, factor, 1.0)
        return found

    @property
    def running(self) -> NDArray[np.bool_]:
        """Which (rows,) are not stopped."""
        return self.speed > 0.0

    def refill(self, awake: NDArray[np.bool_]) -> None:
        """Begin an exchange, for the robots that are `awake` (rows,)."""
        self._left = np.where(awake, self.full * np.where(awake, self.speed, 1.0), 0.0)
        self._given += np.where(self.timed, self._left, 0.0)

    def take(self, row: int, wanted: float) -> float:
        """The operations that a row does in this exchange of those wanted by a step that it could do."""
        done = min(wanted, float(self._left[row]))
        self._left[row] -= done
        self._done[row] += done
        self._late[row] += done < wanted
        return done

    # --- memory

    def hold(self, row: int, holder: str, size: float) -> None:
        """Note the bytes that a holder, the mind or a job, has on a row."""
        self._held[row][holder] = size
        self._peak[row] = max(self._peak[row], sum(self._held[row].values()))

    def held(self, holder: str) -> NDArray[np.float64]:
        """The bytes (rows,) that a holder has on each."""
        return np.array([one.get(holder, 0.0) for one in self._held])

    def room(self, row: int, holder: str) -> float:
        """The bytes that a holder may have on a row."""
        return float(self.memory[row]) - sum(size for one, size in self._held[row].items() if one != holder)

    # --- what it took

    def used(self) -> NDArray[np.float64]:
        """The share of its time that each (rows,) has computed; NaN for those without a rate or time."""
        there = self._given > 0.0
        return np.where(there, self._done / np.where(there, self._given, 1.0), np.nan)

    def late(self) -> NDArray[np.float64]:
        """The iterations (rows,) for which steps that could be done waited for each, all steps together."""
        return self._late / self._rounds

    def spent(self) -> NDArray[np.float64]:
        """The energy (rows,) of all operations, in J."""
        return self._done * self._energy

    def peak(self) -> NDArray[np.float64]:
        """The most bytes (rows,) held by each at a time."""
        return self._peak.copy()

    def summary(self, steps: float) -> dict[str, float | int | None]:
        """What all did together for so many steps, defined in docs/computing-processors.md; empty if unlimited."""
        if not self.limited:
            return {}
        given = float(self._given.sum())
        return {
            "processor_used": float(self._done[self.timed].sum()) / given if given else None,
            "processor_late": float(self.late().sum() / steps) if steps else None,
            "computing_energy": float(self.spent().sum()),
            "memory_peak": int(self._peak.max()) if np.isfinite(self.memory).any() else None,
        }


@dataclass(frozen=True, slots=True)
class OwnProcessor:
    """One job's part of one robot's processor."""

    processors: Processors
    row: int
    holder: str  # the job's name

    @property
    def timed(self) -> bool:
        """Whether the processor's rate is limited."""
        return bool(self.processors.timed[self.row])

    @property
    def exchange(self) -> float:
        """The operations of an exchange, as long as the processor has its full rate."""
        return float(self.processors.full[self.row])

    @property
    def room(self) -> float:
        """The bytes that the job may have."""
        return self.processors.room(self.row, self.holder)

    def take(self, wanted: float) -> float:
        """The operations done in this exchange of those wanted."""
        return self.processors.take(self.row, wanted)

    def hold(self, size: float) -> None:
        """Note the bytes that the job has."""
        self.processors.hold(self.row, self.holder, size)
