"""Batteries: what is charged, when a robot is out, and that nobody notices before."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from conftest import made, moments_of, setting_of, worded_of
from numpy.testing import assert_allclose, assert_array_equal

from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.parts import Tick
from swarmsim.core.state import Moment, State
from swarmsim.faults.battery import Battery, BatteryFault, Energy, Exhaustion


def watch(*overrides: str, iterations: int = 60, scenario: str = "basilica") -> tuple[list[Moment], object]:
    run = made(f"stop.iterations={iterations}", *overrides, scenario=scenario)
    return moments_of(run), run


def battery(keys: str) -> str:
    return f'faults=[{{use="battery", {keys}}}]'


def alive(moments: list[Moment]) -> np.ndarray:
    return np.array([moment.state.alive for moment in moments])


def context(robots: int, seed: int = 1) -> BuildContext:
    return setting_of(robots, (8, 8), seed)


def test_an_idle_swarm_lasts_capacity_by_power() -> None:
    """12 J at 1 W are 12 s; with periods of half a second, 24 iterations."""
    for period, last in ((1.0, 12), (0.5, 24)):
        keys = "capacity=12.0, per_metre=0.0, per_byte=0.0, idle=1.0"
        moments, run = watch(battery(keys), f"period={period}", iterations=30)
        assert alive(moments).sum(axis=1).tolist() == [15] * last + [0] * (30 - last)
        events = worded_of(moments, run)
        assert [(event.iteration, event.kind) for event in events[:-1]] == [(last, "battery empty")] * 15
        assert [event.robot for event in events[:-1]] == list(range(15))
        assert events[0].cause == "battery capacity=12.0 per_metre=0.0 per_byte=0.0 idle=1.0"
        assert events[-1].kind == "not finished"


@pytest.mark.parametrize(
    ("per_metre", "per_byte", "idle"), [(10.0, 0.0, 0.0), (0.0, 0.05, 0.0), (5.0, 0.02, 0.1)], ids=["m", "byte", "all"]
)
def test_every_robot_is_out_once_it_has_spent_what_it_had(per_metre, per_byte, idle) -> None:
    capacity = 20.0
    keys = f"capacity={capacity}, per_metre={per_metre}, per_byte={per_byte}, idle={idle}"
    moments, run = watch(battery(keys))
    spent = np.zeros(15)
    for moment, following in pairwise(moments):
        sends = np.bincount(moment.links[:, 1], minlength=15)
        size = moment.delivery.heard[0, 3] if len(moment.links) else 0
        moved = np.hypot(*(following.state.pose[:, :2] - moment.state.pose[:, :2]).T)
        spent += moment.state.alive * (per_metre * moved + per_byte * size * sends + idle)
        assert_array_equal(following.state.alive, spent < capacity)
    assert (spent >= capacity).any()
    events = [event.robot for event in worded_of(moments, run) if event.kind == "battery empty"]
    assert sorted(events) == np.flatnonzero(spent >= capacity).tolist()
    assert_allclose(run.simulation.parts.channel._batteries.left, np.maximum(capacity - spent, 0.0), atol=per_metre)


def test_nothing_else_changes_before_the_first_is_out() -> None:
    moments, _ = watch(battery("capacity=20.0, spread=0.5, per_metre=5.0, per_byte=0.01, idle=0.1"), iterations=40)
    plain, _ = watch(iterations=40)
    first = int(np.flatnonzero(~alive(moments).all(axis=1))[0])
    assert first > 5
    for ours, theirs in zip(moments[:first], plain, strict=False):
        assert_array_equal(ours.state.pose, theirs.state.pose)
        assert_array_equal(ours.delivery.heard, theirs.delivery.heard)
        assert_array_equal(ours.intents.goals, theirs.intents.goals)


def test_an_empty_robot_stays_in_the_way_or_is_taken_out() -> None:
    for empty, solid in (("crash", 15), ("remove", 12)):
        keys = f'capacity=5.0, per_metre=0.0, per_byte=0.0, idle=1.0, robots=[2, 3, 9], empty="{empty}"'
        moments, run = watch(battery(keys), iterations=10)
        assert np.flatnonzero(~alive(moments)[-1]).tolist() == [2, 3, 9]
        assert run.simulation.parts.bodies.solid.sum() == solid


def test_capacities_have_the_mean_and_spread_asked_for_and_each_robot_its_own() -> None:
    fault = Battery(capacity=50.0, spread=0.3, per_metre=1.0, per_byte=0.0, idle=0.0)
    many = Energy(fault, context(4000)).left
    # within four standard errors, of the mean and (normal approximation) of the standard deviation
    assert many.mean() == pytest.approx(50.0, abs=4 * 15.0 / np.sqrt(4000))
    assert many.std() == pytest.approx(15.0, rel=0.08)
    assert many.min() > 0.0
    assert_array_equal(Energy(fault, context(7)).left, many[:7])
    assert not np.isin(Energy(fault, replace(context(7), number=1)).left, many[:7]).any()
    assert not np.isin(Energy(fault, context(7, seed=2)).left, many[:7]).any()
    even = Energy(Battery(capacity=50.0, per_metre=1.0, per_byte=0.0, idle=0.0, robots=[1]), context(3))
    assert even.left.tolist() == [np.inf, 50.0, np.inf]


def test_a_repair_does_not_bring_back_a_robot_without_energy() -> None:
    first = '{use="crash", at=3, duration=5, robots=[4]}'
    drained = '{use="battery", capacity=5.0, per_metre=0.0, per_byte=0.0, idle=1.0, robots=[4, 6]}'
    for faults in (f"{first}, {drained}", f"{drained}, {first}"):
        moments, _ = watch(f"faults=[{faults}]", iterations=20)
        # it spends nothing while crashed, so that 2 of 5 J are left for iterations 8 and 9
        assert np.flatnonzero(alive(moments)[:, 4]).tolist() == [0, 1, 2, 8, 9]
        assert np.flatnonzero(alive(moments)[:, 6]).tolist() == [0, 1, 2, 3, 4]
    late = '{use="crash", at=4, duration=3, robots=[6]}, {use="crash", at=8, duration=2, robots=[4]}'
    drained = drained.replace("5.0", "4.0")
    for faults in (f"{drained}, {late}", f"{late}, {drained}"):
        moments, run = watch(f"faults=[{faults}]", iterations=14)
        assert np.flatnonzero(alive(moments)[:, [4, 6]].any(axis=1)).tolist() == [0, 1, 2, 3]
        empty = [event.robot for event in worded_of(moments, run) if event.kind == "battery empty"]
        assert empty == [4, 6]


def test_being_carried_costs_no_more_than_driving_at_top_speed() -> None:
    before = State(0, np.zeros((2, 3)), np.zeros((2, 3)), np.zeros((2, 2)), np.ones(2, bool))
    after = State(1, np.array([[3.0, 4.0, 0.0], [0.06, 0.08, 0.0]]), before.velocity, before.wheels, before.alive)

    class Carried:
        def state(self) -> State:
            return after

        def crash(self, robots: np.ndarray) -> None: ...

    place = context(2)
    fault = Battery(capacity=100.0, per_metre=10.0, per_byte=0.0, idle=0.0)
    batteries = Energy(fault, place)
    Exhaustion(Carried(), BatteryFault(fault, batteries, place)).advance(Tick(1, before, after, 0.0))
    assert_allclose(batteries.left, [100.0 - 10.0 * place.robots.speed, 99.0])


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ("per_metre=1.0, per_byte=0.0, idle=0.0", r"capacity: required key is missing"),
        ("capacity=1.0, per_byte=0.0, idle=0.0", r"per_metre: required key is missing"),
        ("capacity=0.0, per_metre=1.0, per_byte=0.0, idle=0.0", r"capacity: .*> 0"),
        ("capacity=1.0, per_metre=-1.0, per_byte=0.0, idle=0.0", r"per_metre: .*>= 0"),
        (
            "capacity=1.0, per_metre=0.0, per_byte=0.0, idle=0.0",
            r"idle: nothing costs energy; expected idle, per_metre",
        ),
        ("capacity=1.0, per_metre=1.0, per_byte=0.0, idle=0.0, robots=[15]", r"robots: there is no robot 15"),
        ('capacity=1.0, per_metre=1.0, per_byte=0.0, idle=0.0, empty="beep"', r"empty: invalid enum value 'beep'"),
        ("capacity=1.0, per_metre=1.0, per_byte=0.0, idle=0.0, at=3", r"at: unknown key"),
    ],
)
def test_a_battery_that_cannot_be_is_refused(keys: str, words: str) -> None:
    with pytest.raises(InputError, match=rf"faults\[0\]\.{words}"):
        made(battery(keys), scenario="basilica")
