"""Each robot's estimate of the field, from its own samples and those it hears."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Annotated

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.messages import Broadcast, Inbox, MessageBatch, PlainCodec
from swarmsim.core.reports import Report
from swarmsim.core.state import Knowledge, Record, Senses


@dataclass(frozen=True, slots=True, eq=False)
class Sample(MessageBatch):
    """The message: the latest measurement, and its estimated place."""

    x: NDArray[np.float64]  # (t,): m
    y: NDArray[np.float64]  # (t,): m
    value: NDArray[np.float64]  # (t,): in the field's unit


class Basis:
    """Bells on a square grid over the page, with the constant 1 before them."""

    def __init__(self, page: tuple[float, float, float, float], spacing: float) -> None:
        """`spacing` (m) between neighbours, which is their standard deviation too."""
        left, low, right, high = page
        columns, rows = (max(1, math.ceil(side / spacing)) for side in (right - left, high - low))
        x = left + (np.arange(columns) + 0.5) * (right - left) / columns
        y = low + (np.arange(rows) + 0.5) * (high - low) / rows
        self.centres = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        self._spacing = spacing

    def at(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """The functions (k, b) at points (k, 2)."""
        square = ((points[:, None] - self.centres) ** 2).sum(axis=2)
        return np.concatenate([np.ones((len(points), 1)), np.exp(-0.5 * square / self._spacing**2)], axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class Reconstruction(Knowledge):
    """Every robot's estimate of the field: sums of bells with normal weights."""

    weights: NDArray[np.float64]  # (n, b): their means
    precision: NDArray[np.float64]  # (n, b, b): the inverse of their covariance; a view
    samples: NDArray[np.int64]  # (n,): how many each robot has taken in
    basis: Basis

    def arrays(self) -> tuple[NDArray[np.generic], ...]:
        """The weights, and how many samples made them."""
        return self.weights, self.samples

    def record(self) -> Record:
        """The weights, and how many samples made them."""
        return Record({"weights": self.weights, "samples_taken": self.samples})

    def at(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Every robot's estimate (n, k) at points (k, 2)."""
        return np.asarray(self.weights @ self.basis.at(points).T)

    def variance(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Every robot's variance (n, k) of the field at points (k, 2)."""
        functions = self.basis.at(points).T
        solved = np.linalg.solve(self.precision, np.broadcast_to(functions, (len(self.weights), *functions.shape)))
        return np.asarray((functions * solved).sum(axis=1))

    def of(self, robot: int) -> SimpleNamespace:
        """One robot's weights, and the functions that they belong to."""
        return SimpleNamespace(weights=self.weights[robot], samples=int(self.samples[robot]), basis=self.basis)


class FieldEstimate(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Bayesian linear regression on bells, in information form (Bishop 2006, section 3.3).

    A robot holds P = I / prior^2 + sum phi phi^T / noise^2 and q = sum phi y / noise^2 over all samples y, its own and
    those heard, where phi are the bells at the sample's place; its estimate has the weights P^-1 q. The order of
    samples does not matter. With a `half_life` evidence fades, so that robots can follow a changing field.
    """

    spacing: Annotated[float, Meta(gt=0.0, le=1e6)] = 1.0  # m between bells, and their standard deviation
    prior: Annotated[float, Meta(gt=0.0)] = 1.0  # standard deviation of a weight, in the field's unit
    noise: Annotated[float, Meta(gt=0.0)] = 0.05  # assumed standard deviation of a sample, in the field's unit
    half_life: Annotated[float, Meta(gt=0.0)] | None = None  # iterations in which evidence loses half of its weight

    def build(self, context: BuildContext) -> FieldComputation:
        """The computation. Raises InputError without a field, and for too many bells."""
        if context.scalar_field is None:
            raise InputError("use: 'field-estimate' estimates a field; expected a table [field]")
        basis = Basis(context.building.bounds, self.spacing)
        if len(basis.centres) > MOST:
            raise InputError(f"spacing: {len(basis.centres)} bells at {self.spacing:g} m; expected {MOST} at most")
        return FieldComputation(self, len(context.ids), basis)


MOST = 1000  # bells: with more, an iteration takes seconds


class FieldComputation:
    """One information matrix per robot."""

    requires = ("field",)
    knowledge_type: type[Knowledge] = Reconstruction

    def __init__(self, parameters: FieldEstimate, count: int, basis: Basis) -> None:
        self.codec = PlainCodec(Sample(np.zeros(0), np.zeros(0), np.zeros(0)))
        self._parameters, self._basis, bells = parameters, basis, len(basis.centres) + 1
        self._first = np.eye(bells) / parameters.prior**2
        self._precision = np.tile(self._first, (count, 1, 1))
        self._evidence = np.zeros((count, bells))
        self._samples = np.zeros(count, np.int64)
        half = parameters.half_life
        self._kept = 1.0 if half is None else 0.5 ** (1.0 / half)

    def say(self, senses: Senses) -> Broadcast[Sample]:
        field = senses.readings["field"]
        place = senses.pose
        return Broadcast.each(Sample(place[:, 0].copy(), place[:, 1].copy(), field.copy()), self.codec.size)

    def hear(self, senses: Senses, inbox: Inbox[Sample]) -> Reconstruction:
        """Take in each robot's own sample and all samples heard."""
        field = senses.readings["field"]
        heard = inbox.content
        starts = np.searchsorted(inbox.receivers, np.arange(len(field) + 1))
        if self._kept < 1.0:
            self._precision += (1.0 - self._kept) * (self._first - self._precision)
            self._evidence *= self._kept
        for robot in np.flatnonzero(senses.alive):
            rows = slice(starts[robot], starts[robot + 1])
            x = np.append(heard.x[rows], senses.pose[robot, 0])
            y = np.append(heard.y[rows], senses.pose[robot, 1])
            value = np.append(heard.value[rows], field[robot])
            sound = np.isfinite(x) & np.isfinite(y) & np.isfinite(value)
            functions = self._basis.at(np.stack([x[sound], y[sound]], axis=1)) / self._parameters.noise
            self._precision[robot] += functions.T @ functions
            self._evidence[robot] += functions.T @ value[sound] / self._parameters.noise
            self._samples[robot] += int(sound.sum())
        weights = np.asarray(np.linalg.solve(self._precision, self._evidence[:, :, None])[:, :, 0], np.float64)
        view = self._precision.view()
        view.flags.writeable = False
        return Reconstruction(weights, view, self._samples.copy(), self._basis)

    def places(self, items: Sample, sender: int) -> NDArray[np.float64]:
        """Where a sender was (p, 2), in m."""
        return np.stack([items.x, items.y], axis=1)

    def report(self, knowledge: Reconstruction) -> Report:
        """Its only robot's weights, and how many samples made them."""
        return knowledge.weights, knowledge.samples

    def adopt(self, reports: Sequence[Report], inbox: Inbox[Sample]) -> Reconstruction:
        """All robots' estimates, whose precision nobody has reported: NaN."""
        weights, samples = (np.concatenate(column) for column in zip(*reports, strict=True))
        return Reconstruction(weights, np.broadcast_to(np.nan, self._precision.shape), samples, self._basis)

    def reset(self, robots: NDArray[np.int64]) -> None:
        """Reset robots (r,) to the prior."""
        self._precision[robots], self._evidence[robots], self._samples[robots] = self._first, 0.0, 0

    def copy_from(self, robots: NDArray[np.int64], source: int) -> None:
        """Give robots (r,) the evidence of another one."""
        for mine in (self._precision, self._evidence, self._samples):
            mine[robots] = mine[source]
