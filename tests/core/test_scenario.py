from __future__ import annotations

import tomllib
from contextlib import suppress
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import tomli_w
from conftest import ROOT, made
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmsim.core.errors import InputError
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.file import Scenario, assign, decode, load, table_of
from swarmsim.core.scenario.schema import schema

SMALL = """
title = "t"
world = "w.svg"
[robots]
count = 3
spawn = "room"
[network.topology]
use = "knn"
k = 1
"""


def scenario(tmp_path: Path, text: str = SMALL) -> Path:
    path = tmp_path / "s.toml"
    path.write_text(text)
    return path


def refusal(path: Path, *overrides: str) -> str:
    with pytest.raises(InputError) as refused:
        load(path, overrides)
    return str(refused.value)


def test_a_small_file_gets_every_default_written_out(tmp_path: Path) -> None:
    read = load(scenario(tmp_path))
    ring = {"preset": "ideal", "tile": [6, 7], "frame": "map", "beams": 72, "reach": 1.0}
    ring |= {"robots": "ignored", "ranges": False}
    ring |= dict.fromkeys(
        ("blind", "cone", "error", "error_share", "error_square", "drop_out", "outliers", "step"), 0.0
    )
    assert read.sensor.table == {"use": "ir-ring", **ring}
    assert read.network.channel.table == {"use": "perfect"}
    assert read.stop.iterations == 5000
    assert read.grid.cell == 0.15


def test_the_world_is_found_from_the_scenario_file(tmp_path: Path) -> None:
    (tmp_path / "deep").mkdir()
    path = tmp_path / "deep" / "s.toml"
    path.write_text(SMALL.replace("w.svg", "../w.svg"))
    assert load(path).world.file == str(tmp_path / "w.svg")
    path.write_text(SMALL.replace('"w.svg"', '{file = "w.svg", scale = 0.5}'))
    assert load(path).world.scale == 0.5


def test_a_complete_scenario_reads_back_as_itself(tmp_path: Path) -> None:
    first = load(scenario(tmp_path))
    assert decode(tomllib.loads(tomli_w.dumps(table_of(first))), "again") == first


def test_overrides_are_toml_values_at_dotted_keys(tmp_path: Path) -> None:
    read = load(
        scenario(tmp_path),
        ["robots.count=7", "network.topology.k=2", 'title="a = b"', "task.share=0.5", "sensor.tile=[5, 5]"],
    )
    assert (read.robots.count, read.title, read.task.table["share"]) == (7, "a = b", 0.5)
    assert read.network.topology.table == {"use": "knn", "k": 2, "mutual": False, "periodic": False}
    assert read.sensor.table["tile"] == [5, 5]


@pytest.mark.parametrize(
    ("override", "key", "value"),
    [
        ("title=ring", "title", "ring"),
        ("title=Two robots, no walls", "title", "Two robots, no walls"),
        ("title=2024", "title", "2024"),
        ("title=true", "title", "true"),
        ('title="in quotes"', "title", "in quotes"),
        ("stop.when_done=continue", "stop.when_done", "continue"),
        ("robots.spawn = hall", "robots.spawn", "hall"),
        ("sensor.preset=sharp-gp2y0a21", "sensor.preset", "sharp-gp2y0a21"),
        ("mind.strategy.use=random-waypoint", "mind.strategy.use", "random-waypoint"),
        ("network.topology.use=knn", "network.topology.use", "knn"),
        ("world.unknown=space", "world.unknown", "space"),
    ],
)
def test_text_needs_no_quotes_where_a_key_takes_text(tmp_path: Path, override: str, key: str, value: str) -> None:
    found: Any = table_of(load(scenario(tmp_path), [override]))
    for step in key.split("."):
        found = found[step]
    assert found == value


def test_a_world_is_overridden_by_the_name_of_its_file_alone(tmp_path: Path) -> None:
    assert load(scenario(tmp_path), ["world=hall.svg", "world.scale=2"]).world.file == str(tmp_path / "hall.svg")


OWN_MIND = """
class Spreader:
    def __init__(self, reach: float = 0.5, gains: list[float] = (1.0,)) -> None:
        self.reach = reach

    def step(self, me) -> None:
        me.say(float(self.reach))
"""


@pytest.fixture
def short(tmp_path: Path) -> Path:
    """A scenario whose mind is written in the short form."""
    (tmp_path / "own.py").write_text(OWN_MIND)
    return scenario(tmp_path, SMALL + '[mind]\nuse = "./own.py:Spreader"\nreach = 0.8\n')


def reaches(read: Scenario) -> list[float]:
    return [read.mind.computation.table["reach"], read.mind.strategy.table["reach"]]


@pytest.mark.parametrize(
    ("overrides", "expected"),
    [
        ([], [0.8, 0.8]),
        (["mind.reach=0.3"], [0.3, 0.3]),
        (["mind.computation.reach=0.3"], [0.3, 0.8]),
        (["mind.computation.reach=0.3", "mind.reach=0.4"], [0.4, 0.4]),
        (["mind.reach=0.4", "mind.strategy.reach=0.3"], [0.4, 0.3]),
        (["mind.gains=[1, 2]", "mind.reach=1"], [1.0, 1.0]),
        (['mind={use="./own.py:Spreader"}', "mind.reach=0.1"], [0.1, 0.1]),
        (["mind.use=./own.py:Spreader", "mind.reach=0.1"], [0.1, 0.1]),
    ],
)
def test_keys_of_a_mind_in_the_short_form_are_overridden_as_they_are_written(
    short: Path, overrides: list[str], expected: list[float]
) -> None:
    with registry.own_code(True):
        assert reaches(load(short, overrides)) == expected
        assert reaches(load(short, changes=dict(_pairs(overrides)))) == expected


def _pairs(overrides: list[str]) -> list[tuple[str, Any]]:
    pairs = [one.partition("=")[::2] for one in overrides]
    return [(key, tomllib.loads(f"v = {text}")["v"] if not text.startswith("./") else text) for key, text in pairs]


def test_halves_that_are_one_part_are_overridden_at_once_and_others_are_not(short: Path, tmp_path: Path) -> None:
    with registry.own_code(True):
        written_out = load(short)
        table = tomllib.loads(tomli_w.dumps(table_of(written_out)))
        assign(table, "mind.reach", 0.2)
        assert reaches(decode(table, "again")) == [0.2, 0.2]
    assert "mind.reach: unknown key" in refusal(scenario(tmp_path), "mind.reach=0.2")
    both = SMALL + '[mind]\nuse = "x"\n[mind.strategy]\nuse = "y"\n'
    message = refusal(scenario(tmp_path, both), "robots.count=2")
    assert message.startswith(f"{tmp_path / 's.toml'}: mind.use sets both computation and strategy")


def test_an_overriding_table_replaces_the_whole_table(tmp_path: Path) -> None:
    assert load(scenario(tmp_path), ['network.topology={use="ring"}']).network.topology.table == {"use": "ring"}
    assert "network.topology.k" in refusal(scenario(tmp_path), 'network.topology.use="ring"')


@pytest.mark.parametrize(
    ("overrides", "parts"),
    [
        (["robots.cuont=3"], ["robots.cuont", "unknown key", "'count'"]),
        (["sede=3"], ["sede", "unknown key", "'seed'"]),
        (["network.topology.kk=3"], ["network.topology.kk", "unknown key", "'k'"]),
        (["sensor.beems=3"], ["sensor.beems", "'beams'"]),
        (["robots.count=0"], ["robots.count", ">= 1"]),
        (["robots.count=-4"], ["robots.count", ">= 1"]),
        (["robots.count=2.5"], ["robots.count", "expected `int`", "float"]),
        (['robots.count="many"'], ["robots.count", "expected `int`", "str"]),
        (["robots.radius=0"], ["robots.radius", ">= 0.0001"]),
        (["period=-1"], ["period", ">= 0.0001"]),
        (["period=nan"], ["period", "finite"]),
        (["period=inf"], ["period", "finite"]),
        (["task.share=1.5"], ["task.share", "<= 1"]),
        (["seed=-1"], ["seed", ">= 0"]),
        (["network.topology.k=-1"], ["network.topology.k", ">= 0"]),
        (['network.topology={use="knm"}'], ["network.topology.use", "'knm'", "'knn'"]),
        (['network.topology={use="knn"}'], ["network.topology.k", "missing"]),
        (["network.topology={k=1}"], ["network.topology.use", "missing"]),
        (['sensor={use="no.such.module:Part"}'], ["sensor.use", "no.such.module"]),
        (['sensor={use="json:dumps"}'], ["sensor.use", "--allow-code"]),
        (["robots=3"], ["robots", "expected `object`"]),
        (["robots.count.deep=3"], ["robots.count is 3, not a table"]),
        (["robots.count"], ["key=value"]),
        (["robots.count=five"], ["robots.count takes", "a whole number from 1 to 100000", "'five'"]),
        (["grid.cell=0,05"], ["grid.cell takes", "a number above 0", "'0,05'"]),
        (["network.topology=ring"], ["network.topology takes", "a table"]),
        (["sensor.beams=all"], ["sensor.beams takes", "a whole number from 1 to 10000"]),
        (["robots.cuont=five"], ["robots.cuont", "unknown key", "'count'"]),
        (["sensor.tile=[5,"], ["'[5,'", "TOML"]),
        (['title="plain'], ["TOML", "Unterminated"]),
        (["title="], ["TOML"]),
        (["seed=1\ntitle=2"], ["one value"]),
        (["title=a\nb"], ["TOML"]),
        (["world.generate" + ".a" * 20 + "=1"], ["more than 20 deep"]),
        (['mind.strategy.replan="never"'], ["mind.strategy.replan", "never"]),
    ],
)
def test_a_bad_value_is_refused_with_file_key_and_remedy(
    tmp_path: Path, overrides: list[str], parts: list[str]
) -> None:
    message = refusal(scenario(tmp_path), *overrides)
    assert "\n" not in message
    assert str(tmp_path / "s.toml") in message or "--set" in message
    for part in parts:
        assert part in message, message


def test_broken_files_are_refused_with_the_place(tmp_path: Path) -> None:
    assert "cannot be read" in refusal(tmp_path / "none.toml")
    assert "line 2" in refusal(scenario(tmp_path, 'title = "x"\nworld = \n'))
    assert "robots.count, network.topology: required keys are missing" in refusal(
        scenario(tmp_path, 'title = "x"\nworld = "w.svg"')
    )
    for text, told in (
        ("seed = " + 5000 * "9", "thousands of digits"),
        ("seed = 0x" + 5000 * "f" + SMALL, "seed: "),
        ("title = " + 100_000 * "[", "more than 20 deep"),
        ("title = " + 25 * "[" + 25 * "]", "more than 20 deep"),
        ("title = " + 25 * "{a=" + "1" + 25 * "}", "more than 20 deep"),
        ("a = 1\n" + 20_000 * "a." + "a = 1", "line 2 has a key of more than 20 names"),
        ("[" + 20_000 * '"a" . ' + "a]", "line 1 has a key of more than 20 names"),
        ("[[" + ".".join("a" * 22) + "]]", "line 1 has a key of more than 20 names"),
    ):
        message = refusal(scenario(tmp_path, text))
        assert told in message
        assert str(tmp_path / "s.toml") in message
        assert len(message) < 300
    long = SMALL.replace('"t"', f'"{300_000 * "a"}{30 * "."}"')  # looked through once, not from every letter
    assert len(load(scenario(tmp_path, long)).title) == 300_030
    assert load(scenario(tmp_path, SMALL.replace('"t"', f'"{30 * "."} 1.2.3.4.5.6"'))).title.startswith("...")
    binary = tmp_path / "b.toml"
    binary.write_bytes(b"\xff\xfe\x00")
    assert "UTF-8" in refusal(binary)
    assert "cannot be read" in refusal(tmp_path)


values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8) | st.dates(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=6,
)
keys = st.sampled_from(
    [*Scenario.__struct_fields__, "robots.count", "network.topology", "sensor.use", "sensor.tile", "x"]
)


@settings(max_examples=300, deadline=None, derandomize=True)
@given(st.dictionaries(keys, values, max_size=4))
def test_no_table_makes_anything_but_a_scenario_or_a_refusal(changes: dict[str, Any]) -> None:
    table = tomllib.loads(SMALL)
    for key, value in changes.items():
        inner = table
        *path, last = key.split(".")
        for step in path:
            inner = inner.setdefault(step, {}) if isinstance(inner.setdefault(step, {}), dict) else {}
        inner[last] = value
    with suppress(InputError):  # anything else fails this test
        assert isinstance(decode(table, "fuzzed"), Scenario)


@settings(max_examples=200, deadline=None, derandomize=True)
@given(st.text(max_size=40))
def test_no_override_makes_anything_but_a_scenario_or_a_refusal(text: str) -> None:
    path = ROOT / "scenarios" / "room.toml"
    with suppress(InputError):  # anything else fails this test
        assert isinstance(load(path, [text]), Scenario)


def test_the_schema_accepts_every_shipped_scenario_and_refuses_unknown_keys(root: Path) -> None:
    described = schema()
    jsonschema.Draft202012Validator.check_schema(described)
    validator = jsonschema.Draft202012Validator(described)
    for path in sorted(root.glob("scenarios/*.toml")):
        table = tomllib.loads(path.read_text())
        validator.validate(table)
        assert not validator.is_valid(table | {"sede": 1})
        assert not validator.is_valid(table | {"sensor": {"use": "ir-ring", "beems": 3}})


def test_old_keys_are_refused_with_the_new_ones(tmp_path: Path) -> None:
    for override, now in (
        ("behaviour={decay=0.1}", "mind.computation and mind.strategy"),
        ('network.sharing={use="map"}', "mind.computation.sharing"),
        ("stop.coverage=0.5", "task.share"),
        ('stop.at_coverage="continue"', "stop.when_done"),
    ):
        message = refusal(scenario(tmp_path), override)
        assert override.partition("=")[0] in message
        assert f"expected {now}" in message


def test_a_file_without_a_title_is_called_as_the_file(tmp_path: Path) -> None:
    path = scenario(tmp_path)
    path.write_text("\n".join(line for line in path.read_text().splitlines() if not line.startswith("title")))
    assert load(path).title == path.stem


def test_a_title_tells_how_many_robots_there_are_in_the_end() -> None:
    path = ROOT / "scenarios" / "room.toml"
    assert load(path).title == "Quick trial: 3 robots in a small room"
    assert load(path, ["robots.count=5"]).title == "Quick trial: 5 robots in a small room"
    assert load(path, ['title="{robots.count} {other}"']).title == "3 {other}"


def test_a_byte_order_mark_is_no_key(tmp_path: Path) -> None:
    path = scenario(tmp_path)
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert load(path).robots.count > 0


@pytest.mark.parametrize(
    "change",
    [
        "robots.radius=1e-300", "robots.radius=1e9", "robots.speed=1e-300", "robots.mass=1e300",
        "robots.wheel_base=1e-9", "robots.acceleration=1e-9", "robots.traction=1e9", "period=1e-9", "period=1e9",
    ],
)  # fmt: skip
def test_quantities_that_nothing_has_are_refused_with_what_can_be(change: str) -> None:
    key = change.partition("=")[0]
    with pytest.raises(InputError, match=rf"{key.partition('.')[2] or key}: .*(>=|<=)"):
        made(change)


@pytest.mark.parametrize(
    ("stop", "period", "limit", "text"),
    [
        ({}, 1.0, 5000, {"iterations": 5000}),
        ({"iterations": 300}, 0.1, 300, {"iterations": 300}),
        ({"seconds": 12_000}, 1.0, 12_000, {"seconds": 12_000.0}),
        ({"seconds": 90}, 0.1, 900, {"seconds": 90.0}),
        ({"seconds": 90.05}, 0.1, 900, {"seconds": 90.05}),  # whole iterations alone
        ({"seconds": 0.3}, 0.1, 3, {"seconds": 0.3}),  # 2.9999999999999996 by floats
        ({"seconds": 90, "iterations": 300}, 0.1, 300, {"iterations": 300, "seconds": 90.0}),
        ({"seconds": 20, "iterations": 300}, 0.1, 200, {"iterations": 300, "seconds": 20.0}),
    ],
)
def test_the_limit_is_in_iterations_or_seconds_and_the_earlier_of_both(
    stop: dict[str, Any], period: float, limit: int, text: dict[str, Any]
) -> None:
    given = {**tomllib.loads(SMALL), "stop": stop, "period": period}
    jsonschema.validate(given, schema())
    scenario = decode(given, "x.toml")
    assert scenario.limit == limit
    assert table_of(scenario)["stop"] == {"when_done": "stop", **text}
    assert decode(table_of(scenario), "x.toml") == scenario


def test_a_run_ends_at_its_limit_in_seconds() -> None:
    run = made("stop={seconds=4.5}", "period=0.5", 'task={use="coverage"}').simulation
    while not run.over:
        run.tick()
    assert (run.state.iteration, run.finished) == (9, False)


@pytest.mark.parametrize("seconds", [0.4, 60_000.0])
def test_a_limit_in_seconds_that_is_no_number_of_iterations_is_refused(seconds: float) -> None:
    with pytest.raises(InputError, match=r"x\.toml: stop\.seconds: .* expected 1 to 100000 iterations"):
        decode({**tomllib.loads(SMALL), "stop": {"seconds": seconds}, "period": 0.5}, "x.toml")
