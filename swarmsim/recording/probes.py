"""Shipped probes, and how a run samples probes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from swarmsim.core.context import BuildContext, Gauge
from swarmsim.core.parts import Probe
from swarmsim.core.probes import Declared, Name, ProbeTable, Row, Sampled
from swarmsim.core.state import Knowledge, Moment


@dataclass(frozen=True, slots=True)
class Watching:
    """A probe of a run."""

    declared: Declared
    probe: Probe

    def rows(self, moment: Moment[Knowledge]) -> dict[str, Row]:
        """A row of each table that is due, by its name in the recording."""
        now, robots = moment.state.iteration, moment.state.robots
        due = [one for one in self.declared.tables if now % self.declared.due(one) == 0]
        found = self.probe.sample(moment) if due else {}
        return {self.declared.called(one): one.row(found[one.name], robots) for one in due}


class Batteries(Sampled, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The energy left in every robot, after paying for the iteration's messages.

    Driving is paid for before the next iteration. With two batteries the emptier one counts; without any, energy is
    infinite.
    """

    name: Name = "batteries"

    def build(self, context: BuildContext) -> BatteryProbe:
        return BatteryProbe(tuple(gauge for gauge in context.gauges if gauge.name == "energy"))


class BatteryProbe:
    """Reads the gauges of energy."""

    tables = (ProbeTable("left", shape=("robots",), unit="J", meaning="energy left", low=0.0),)

    def __init__(self, gauges: tuple[Gauge, ...]) -> None:
        self._gauges = gauges

    def sample(self, moment: Moment[Knowledge]) -> Mapping[str, object]:
        """The energy left in each robot's emptiest battery."""
        full = np.full(moment.state.robots, np.inf)
        return {"left": np.minimum.reduce([full, *(gauge.read() for gauge in self._gauges)])}


class Believed(Sampled, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Every robot's estimated pose, and its distance from the true one."""

    name: Name = "believed_poses"

    def build(self, context: BuildContext) -> BelievedProbe:
        return BelievedProbe()


class BelievedProbe:
    """Compares estimated with true poses."""

    tables = (
        ProbeTable("place", shape=("robots", 2), unit="m", meaning="estimated position", columns=("x", "y")),
        ProbeTable("yaw", shape=("robots",), unit="rad", meaning="estimated heading"),
        ProbeTable("error", shape=("robots",), unit="m", meaning="distance from the true position", low=0.0),
    )

    def sample(self, moment: Moment[Knowledge]) -> Mapping[str, object]:
        """The estimates at the start of the iteration, when robots sense."""
        truth = moment.state.pose
        pose = truth if moment.believed is None else moment.believed
        return {
            "place": pose[:, :2], "yaw": pose[:, 2], "error": np.hypot(*(pose[:, :2] - truth[:, :2]).T),
        }  # fmt: skip
