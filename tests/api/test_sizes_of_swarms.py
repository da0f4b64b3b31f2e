"""`swarmsim size` on a real scenario: short runs in a small room."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from conftest import ROOT
from typer.testing import CliRunner

import swarmsim as sw
from swarmsim.cli import app
from swarmsim.core.errors import InputError
from swarmsim.studies.sizing_report import Sizing

pytestmark = pytest.mark.usefixtures("no_workers")
ROOM = ROOT / "scenarios" / "room.toml"
#: Three answers from few runs: a wide slack, and a low chance asked for.
EASY = {"sure": 0.7, "slack": 0.25, "confidence": 0.8}


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("sizes") / "room.sqlite"


@pytest.fixture(scope="module")
def found(store: Path) -> Sizing:
    return sw.size(ROOM, "40s", high=12, store=store, plot=store.with_name("room"), price="robot=2,minute=9", **EASY)


def test_the_smallest_swarm_is_found_told_and_drawn(found: Sizing) -> None:
    (ladder,) = found.answers
    best = ladder.answer.at(ladder.answer.best)
    assert found.answered
    assert best.verdict == "suffices"
    assert ladder.said(best.place) in found.sentences[0].lower()
    assert [path.name for path in found.figures] == ["room.png", "room.svg", "room-front.png", "room-front.svg"]
    assert all(path.stat().st_size > 5000 for path in found.figures)
    assert len(found.rows) == len(ladder.answer.asked)
    assert {len(row) for row in found.rows} == {len(found.head)}
    assert best.times[best.done].max() <= 40.0
    assert found.record()["runs"] == found.used


def test_resuming_does_no_run_again_and_says_the_same(found: Sizing, store: Path) -> None:
    again = sw.size(ROOM, 40, high=12, store=store, price={"robot": 2, "minute": 9}, **EASY)
    assert again.simulated == 0
    assert found.simulated >= found.used
    assert again.sentences[:-1] == found.sentences[:-1]
    assert again.rows == found.rows


def test_a_run_is_the_same_as_by_hand(found: Sizing) -> None:
    (ladder,) = found.answers
    asked = ladder.answer.asked[-1]
    for seed, seconds in enumerate(asked.times[:2], 1):
        run = sw.run(ROOM, seed=seed, overrides={"robots.count": ladder.values[asked.place], "stop.iterations": 40})
        assert run.finished == (seconds <= 40.0)
        assert not run.finished or run.iterations == seconds


def test_faults_make_more_robots_necessary_or_cannot_help(store: Path) -> None:
    found = sw.size(ROOM, "40s", values=[6], faults=["crash at=1 fraction=1.0 min_alive=0"], store=store, **EASY)
    assert not found.answered
    assert "Not one of" in found.sentences[0]


@pytest.mark.thorough
def test_any_key_can_be_sized_and_its_direction_is_found_out(store: Path) -> None:
    found = sw.size(
        ROOM, "60s", over="network.topology.k", values="0,1,7", overrides={"robots.count": 8}, store=store, **EASY
    )
    assert found.head[0] == "k"
    assert [row[0] for row in found.rows if row[1] != "0"]


@pytest.mark.thorough
def test_alternatives_are_searched_side_by_side(store: Path) -> None:
    found = sw.size(
        ROOM, "40s", low=6, high=12, vary=["network.topology.k=1,3"], price="robot=1,3=5", store=store, **EASY
    )
    assert [one.name for one in found.answers] == ["k=1", "k=3"]
    assert found.head[0] == "alternative"
    points = found.front()
    assert any(point.on_front for point in points)
    assert {point.sized.extra for point in points} <= {0.0, 5.0}


@pytest.mark.parametrize(("settings", "said"), [
    ({"within": "soon"}, r"--within 'soon' is no duration; expected a time above 0"),
    ({"within": "0.5s"}, r"--within 0.5 s: less than one iteration of 1 s"),
    ({"sure": 1.0}, r"--sure 1 --slack 0.02: expected 0 < slack < chance < 1"),
    ({"budget": 1}, r"--budget 1: expected 2 runs or more"),
    ({"low": 5, "high": 3}, r"--low 5 --high 3: expected whole numbers from 1, low not above high"),
    ({"low": 1.5, "high": 3}, r"--low 1\.5 --high 3"),
    ({"over": "network.topology.k"}, r"--over network\.topology\.k: expected --low and --high, or --values"),
    ({"over": "network.topology.q", "values": [1]}, r"room\.toml: q=1: .*q: unknown key; known: k"),
    ({"values": [1], "low": 1}, r"--values: expected either values, or --low and --high"),
    ({"values": "4,4"}, r"--over robots\.count: 2 values; expected 1 to 10000, each once"),
    ({"price": "robot=x"}, r"--price robot=x: no price of 0 or more; expected name=number"),
    ({"price": "robots=3"}, r"--price robots: unknown; .*known: robot, minute"),
    ({"vary": ["k"]}, r"--vary k: expected key=value,value"),
    ({"faults": ["crsh at=3"]}, r"--fault 'crsh at=3': .*crash"),
    ({"confidence": 0.2}, r"--confidence 0\.2"),
    ({"over": "stop.iterations", "values": [9, 99]}, r"stop\.iterations: runs end after --within"),
    ({"vary": ["stop.seconds=9,99"]}, r"stop\.seconds: runs end after --within"),
    ({"vary": ["robots.count=4,5"]}, r"--vary robots\.count: it is the key whose value is looked for"),
])  # fmt: skip
def test_bad_input_is_refused(settings: dict, said: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=said):
        sw.size(ROOM, **{"within": "40s", "high": 12, "store": tmp_path / "s.sqlite", **(
            {"high": None} if {"over", "values"} & set(settings) else {}), **settings})  # fmt: skip
    assert not (tmp_path / "s.sqlite-journal").exists()


def test_the_verb_prints_and_has_exit_codes(found: Sizing, store: Path) -> None:
    words = ["size", str(ROOM), "--within", "40s", "--high", "12", "--sure", "0.7", "--slack", "0.25"]
    words += ["--confidence", "0.8", "--store", str(store), "--price", "robot=2,minute=9"]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    assert found.sentences[0] in done.output
    as_json = CliRunner().invoke(app, [*words, "--json"])
    assert json.loads(as_json.output)["answers"][0]["key"] == "robots.count"
    never = CliRunner().invoke(app, [*words[:2], "--within", "2s", "--values", "3,4", *words[6:]])
    assert never.exit_code == 1
    assert "Not one of" in never.output
