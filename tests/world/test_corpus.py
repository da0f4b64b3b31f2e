"""Buildings in the styles of many programs: how large the floor is, where it is, and that robots run in it."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest
import shapely
from buildings import ALL, AXES, Made, floor_in, lines, plan_in, svg
from drawn import read_floor_plan

from swarmsim.core.scenario.file import load
from swarmsim.core.scenario.part import plain
from swarmsim.engine.build import build


def test_there_are_as_many_as_promised() -> None:
    assert len({made.name for made in ALL}) == len(ALL) >= 30


@pytest.mark.parametrize("made", ALL, ids=lambda made: made.name)
def test_a_building_has_its_floor_where_it_is_and_robots_run_there(made: Made, tmp_path: Path) -> None:
    world = made.world(tmp_path)
    plan = plan_in(world)
    floor = floor_in(plan)
    assert floor.area == pytest.approx(made.area, abs=0.01 * made.area + made.slack)
    assert [place for place in made.inside if not shapely.contains_xy(floor, *place)] == []
    assert [place for place in made.outside if shapely.contains_xy(floor, *place)] == []
    assert [words for words in made.says if not any(words in notice for notice in plan.notices)] == []
    scenario = tmp_path / "run.toml"
    table = {
        "world": msgspec.to_builtins(world, enc_hook=plain),
        "robots": {"count": 3},
        "network": {"topology": {"use": "none"}},
    }
    scenario.write_bytes(msgspec.toml.encode({**table, "stop": {"iterations": 3}}))
    run = build(load(scenario), str(scenario))
    places = []

    class Keep:
        def sample(self, moment) -> None:
            places.extend(moment.state.pose[:, :2])

    run.simulation.run([Keep()])
    assert shapely.contains_xy(floor, *zip(*places, strict=True)).all()


def test_a_prefix_needs_no_declaration_after_a_deeply_nested_drawing() -> None:
    deep = svg("<g>" * 300 + lines(AXES) + "</g>" * 300)
    undeclared = svg(f'<g id="a">{lines(AXES)}</g><use xlink:href="#a"/>')
    for text in (deep, undeclared):
        assert read_floor_plan(text, "w.svg").walls.area == pytest.approx(0.2 * (2 * 7.8 + 2 * 5.8))
