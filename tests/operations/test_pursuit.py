"""Pursuit, against what defines it: who stands catches nobody, who flees is caught later, who is caught stands."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, made, moments_of
from numpy.testing import assert_allclose, assert_array_equal

from swarmsim import testing
from swarmsim.core.errors import InputError
from swarmsim.core.kinds import Mixed
from swarmsim.recording.columns import columns_of
from swarmsim.recording.reader import Recording

PURSUIT = "operations/pursuit"
STAND = 'robots.{}.mind.strategy={{use="stand"}}'
ALL_SEEN = ('sensors=[{use="neighbours", reach=20.0, groups=true}]', "stop.iterations=300")
FEW = ("robots.pursuers.count=1", "robots.evaders.count=1")


def duration(*keys: str) -> int:
    run = made(*keys, scenario=PURSUIT)
    run.simulation.run()
    assert run.simulation.finished_after is not None
    return run.simulation.finished_after


def test_all_are_caught_and_who_has_been_caught_stands() -> None:
    moments = moments_of(made(scenario=PURSUIT))
    shares = [moment.measured.values["caught"] for moment in moments]
    assert shares[-1] == 1.0
    assert (np.diff(shares) >= 0.0).all()
    given_up = np.array([moment.knowledge.of_group("evaders").given_up for moment in moments])
    assert_array_equal(given_up.mean(axis=1), shares)  # robots see exactly, so that they know what is measured
    for moment in moments:
        twists = moment.intents.twists[6:]
        assert_array_equal(twists[moment.knowledge.of_group("evaders").given_up], 0.0)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_pursuers_that_stand_catch_none(seed: int) -> None:
    moments = moments_of(made(f"seed={seed}", STAND.format("pursuers"), "stop.iterations=150", scenario=PURSUIT))
    assert len(moments) == 150
    assert moments[0].measured.values["caught"] == moments[-1].measured.values["caught"] == 0.0


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_an_evader_that_stands_is_caught_sooner(seed: int) -> None:
    keys = (f"seed={seed}", *FEW, *ALL_SEEN)
    assert duration(*keys, STAND.format("evaders")) < duration(*keys)


def test_pursuers_go_for_the_nearest_free_evader_that_they_see_or_hear_of() -> None:
    """By the true places of all robots, which the sensor shows without errors to those within its reach."""
    seen = heard = 0
    for moment in moments_of(made("stop.iterations=60", scenario=PURSUIT)):
        place, alone = moment.state.pose[:, :2], moment.knowledge.of_group("pursuers").quarry
        free = ~moment.knowledge.of_group("evaders").given_up
        for pursuer, quarry in enumerate(alone):
            apart = np.hypot(*(place[6:] - place[pursuer]).T)
            near = np.flatnonzero(apart < 2.0)
            if len(near) and np.isclose(apart[near].min(), np.hypot(*(quarry - place[pursuer])), atol=1e-9):
                assert_allclose(quarry, place[6 + near[apart[near].argmin()]], atol=1e-9)
                seen += 1
            elif not np.isnan(quarry[0]):
                heard += 1
            if not len(near) and free.any() and not np.isnan(quarry[0]):
                assert np.hypot(*(place[6:] - quarry).T).min() < 0.5  # as told an iteration ago
    assert min(seen, heard) > 20


def test_two_kinds_of_messages_share_one_network() -> None:
    moments = moments_of(made("stop.iterations=40", scenario=PURSUIT))
    across = 0
    for moment in moments:
        content = moment.inbox.content
        assert isinstance(content, Mixed)
        assert_array_equal(content.kind, moment.inbox.senders >= 6)
        across += int(((moment.inbox.senders >= 6) & (moment.inbox.receivers < 6)).sum())
    assert across > 0
    assert (moments[0].delivery.heard[:, 3] == 6 + 16 + 1).all()


@pytest.mark.parametrize("group", ["pursuers", "evaders"])
def test_a_group_that_is_gone(group: str) -> None:
    robots = list(range(6)) if group == "pursuers" else list(range(6, 10))
    gone = f'faults=[{{use="remove", at=3, robots={robots}, min_alive=0}}]'
    run = made(gone, "stop.iterations=30", scenario=PURSUIT)
    moments = moments_of(run)
    assert run.simulation.finished == (group == "evaders")
    if group == "pursuers":
        assert_array_equal(moments[-1].intents.twists[6:], 0.0)  # nobody is there to flee from


def test_neighbours_are_told_apart_by_their_group_and_recorded(tmp_path: Path) -> None:
    run = made("stop.iterations=5", scenario=PURSUIT)
    with run.recorder(tmp_path / "recording.h5") as recorder:
        run.simulation.run([recorder])
    recording = Recording(tmp_path)
    columns = columns_of(recording, "neighbours_group")
    ranges = columns_of(recording, "neighbours")["range (m)"]
    assert len(columns["neighbours_group"]) == len(ranges)
    for when, robot, group, distance in zip(
        columns["iteration"], columns["robot"], columns["neighbours_group"], ranges, strict=True
    ):
        place = recording["pose"][when - 1, :, :2]
        apart = np.hypot(*(place - place[robot]).T)
        other = int(np.abs(apart - distance).argmin())
        assert group == (other >= 6)


@pytest.mark.thorough
def test_pursuit_keeps_every_contract() -> None:
    testing.check_contracts(ROOT / "scenarios" / f"{PURSUIT}.toml", iterations=12)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        (("task.evaders=cats",), r"task\.evaders: no group of robots is called 'cats'; known: pursuers, evaders"),
        (("robots.1.mind.strategy.of=cats",), r"robots\[1\]\.mind\.strategy\.of: no group .* 'cats'"),
        (('sensors=[{use="neighbours"}]',), r"'chase' needs 'neighbours_group' .*the sensor 'neighbours' with groups"),
        (('robots=[{count=3}]',), r"task\.pursuers: no group .* 'pursuers'; known: 0"),
    ],
)  # fmt: skip
def test_pursuit_without_what_it_needs_is_refused(keys: tuple[str, ...], words: str) -> None:
    with pytest.raises(InputError, match=words):
        made(*keys, scenario=PURSUIT)
