"""What can be explored of a building is found out for those who ask, and told at its place in the scenario."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import made

from swarmsim.core.errors import InputError
from swarmsim.core.scenario import budget
from swarmsim.engine import survey

BLIND = "sensor={reach=0.001}"  # no beam gets far enough to show a cell


def looked(*overrides: str, scenario: str) -> list[str]:
    """From where is looked while a run is built and does two iterations."""
    survey.opened.cache_clear()
    survey.surveyed.cache_clear()
    told: list[str] = []
    with budget.told_to(lambda work, share: told.append(work.doing)):
        run = made(*overrides, scenario=scenario)
        run.simulation.tick()
        run.simulation.tick()
    return [one for one in told if one.startswith("looking from")]


def test_nobody_looks_from_everywhere_for_robots_that_agree_on_a_heading() -> None:
    assert looked(scenario="operations/heading-consensus") == []
    assert looked(scenario="room")


def test_what_robots_can_explore_is_told_of_the_sensor_whoever_asks() -> None:
    with pytest.raises(InputError, match=r"room\.toml: sensor: robots see no cell from anywhere"):
        made(BLIND)
    people = 'faults=[{use="people"}]'
    with pytest.raises(InputError, match=r"consensus\.toml: sensor: robots see no cell from anywhere"):
        made(BLIND, people, scenario="operations/heading-consensus")
    assert not made(BLIND, scenario="operations/heading-consensus").simulation.finished


def test_a_change_of_the_building_is_explored_anew_for_those_who_ask() -> None:
    run = made()
    building = run.simulation.parts.building
    before = building.explorable
    left, low, right, high = 1.0, 1.0, 1.3, 1.3
    building.rebuild(((left, low, right, high),))
    assert 0 < np.count_nonzero(building.explorable & ~building.occupied) < np.count_nonzero(before)
    building.rebuild(())
    assert np.array_equal(building.explorable, before)


def test_sensors_that_ask_what_can_be_explored_are_surveyed_with_as_well() -> None:
    floor = 'sensors=[{use="ground", floors=[{use="formula", formula="x"}]}]'
    assert made('sensor={use="ir-ring"}', floor).explorable.any()


@pytest.mark.parametrize("tile", ["[6, 7]", "[7, 6]", "[5, 9]"])
@pytest.mark.parametrize("scenario", ["basilica", "worlds/house", "worlds/cave"])
def test_places_that_are_left_out_would_add_nothing(scenario: str, tile: str, monkeypatch: pytest.MonkeyPatch) -> None:
    looked_from = 0
    tiles_from = survey.tiles_from

    def counted(sensor, context, points):  # type: ignore[no-untyped-def]
        nonlocal looked_from
        looked_from += len(points)
        return tiles_from(sensor, context, points)

    def explored() -> tuple[np.ndarray, int]:
        nonlocal looked_from
        survey.opened.cache_clear()
        survey.surveyed.cache_clear()
        looked_from = 0
        return made(f"sensor.tile={tile}", scenario=scenario).simulation.parts.building.explorable, looked_from

    monkeypatch.setattr(survey, "tiles_from", counted)
    monkeypatch.setattr(survey, "MANY", 500)
    found, few = explored()
    monkeypatch.setattr(survey, "_known", lambda observed, cells, window: np.zeros(len(cells), np.bool_))
    everywhere, all_ = explored()
    assert np.array_equal(found, everywhere)
    assert few < 0.8 * all_
