"""Faults that robots have in their own minds: the world says when and who, and what goes over the air is theirs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from fleet.crews import fleet_of, free_fleet, in_threads

from swarmsim.core.charge import Charge
from swarmsim.engine.build import build
from swarmsim.fleet import merging, wire
from swarmsim.fleet.logbook import entries
from swarmsim.fleet.wire import Telegram
from swarmsim.recording.digests import Digests

ROOM = ROOT / "scenarios" / "room.toml"
FAULTS = (
    'faults=[{use="byzantine", failure="inverted", at=3, count=1}, {use="byzantine", failure="replay", age=2, at=5,'
    ' count=1}, {use="mind", failure="random-walk", at=4, duration=6, robots=[2]}, {use="mind", failure="frozen",'
    ' between=[6, 12], robots=[0]}, {use="mind", failure="reboot", at=8, duration=2, robots=[1]}]'
)
N = 16


def test_a_fleet_whose_minds_fail_is_the_swarm_of_one_process(tmp_path: Path) -> None:
    """Lies, too, are heard from the air: the world tells no frame in the place of another."""
    fleet, alone, apart = fleet_of(ROOM, FAULTS, iterations=N), Digests(), Digests()
    build(fleet.run.scenario, str(ROOM)).simulation.run([alone])
    with in_threads(fleet, str(tmp_path), tmp_path):
        fleet.run.simulation.run([apart])
    assert apart.rows == alone.rows
    telegrams = [
        Telegram.read(entry.data)
        for robot in range(3)
        for entry in entries(tmp_path / f"robot-{robot}.log")
        if entry.kind in (wire.EARS, wire.SENSED)
    ]
    assert not any(one.pieces for one in telegrams)
    told = {number for one in telegrams if one.kind == wire.SENSED for number in one.arrays[1].tolist()}
    assert told == {0, 1, 2, 3, 4}
    again = Digests()
    assert merging.replayed(tmp_path).simulate([again]) == ""
    assert again.rows == alone.rows


def test_a_charge_has_the_faults_of_its_mind_and_not_when_they_strike() -> None:
    fleet = fleet_of(
        ROOM, FAULTS.replace("]}]", ']}, {use="crash", at=9}, {use="radio", failure="off", at=9}]'), iterations=N
    )
    charge = fleet.charges()[1]
    read = Charge.read(charge.packed(), "it")
    assert [one.number for one in read.faults] == [0, 1, 2, 3, 4]
    given = [(one.fault.use, one.fault.parameters.failure) for one in read.faults]
    assert given[1:3] == [("byzantine", "replay"), ("mind", "random-walk")]
    assert [one.fault.parameters.robots for one in read.faults] == [None] * 5
    assert read.faults[1].fault.parameters.age == 2


@pytest.mark.parametrize("failure", ["byzantine inverted", "mind reboot"])
def test_robots_with_real_links_lie_and_start_anew(failure: str, tmp_path: Path) -> None:
    """What another hears at a free pace is a lie: with no wall inside, free cells are told to be occupied."""
    kind, how = failure.split()
    fault = f'faults=[{{use="{kind}", failure="{how}", at=0, duration=40, robots=[0]}}]'
    fleet = free_fleet(ROOM, fault, pace=10.0, links="real", iterations=N)
    with in_threads(fleet, str(tmp_path), tmp_path):
        fleet.run.simulation.run()
    said = [
        fleet.minds.codec.unpack(frame)[2]
        for entry in entries(tmp_path / "robot-0.log")
        if entry.kind == wire.SAID
        for frame in Telegram.read(entry.data).pieces
    ]
    assert len(said) > 5
    occupied = np.mean([(one.values == 2).sum() > (one.values == 1).sum() for one in said])
    assert (occupied > 0.9) == (kind == "byzantine")
