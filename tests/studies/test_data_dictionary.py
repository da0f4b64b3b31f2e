"""Every measure and every column of an export has a unit and a meaning on the pages."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from conftest import ROOT

import swarmsim as sw
from swarmsim.core.scenario.file import load
from swarmsim.engine.build import build
from swarmsim.recording.measures import SHARES, RunMeasures

SCENARIOS = [
    path
    for kind in ("", "operations/", "computing/", "faults/")
    for path in sorted(ROOT.glob(f"scenarios/{kind}*.toml"))
]


def defined() -> set[str]:
    """The names in the first column of the tables of measures, wherever they stand."""
    found = {f"t{share}" for share in SHARES}
    for page in sorted(ROOT.glob("docs/*.md")):
        for table in re.findall(r"(?:^\|.*\n)+", page.read_text(), flags=re.MULTILINE):
            if page.stem not in ("keys", "part-keys") and not table.startswith("| column"):
                found |= {name for row in table.splitlines() for name in re.findall(r"`(\w+)`", row.split(" | ")[0])}
    return found


def base(name: str) -> str:
    """A measure without what the pages say of many at once: of whom, when, how far ahead, of which job."""
    name = re.sub("^(union|robot)_|_(end|late)$", "", name)
    return re.sub(r"_\d+s$", "_30s", re.sub("^(percolation|stigmergy|storage)_bytes$", "NAME_bytes", name))


def names_of(path: Path) -> set[str]:
    """The measures that a study keeps of a scenario's runs, and those of each iteration."""
    made = build(load(path, ["stop.iterations=1"]), str(path))
    task, scenario = made.simulation.parts.task, made.scenario
    summaries = [RunMeasures(scenario.robots, scenario.period, task.curve), *task.summaries()]
    moment = made.simulation.tick(summaries)
    return {name for one in summaries for name in one.summary()} | set(moment.measured.values)


def undefined(path: Path) -> set[str]:
    known = defined()
    return {name for name in names_of(path) if not {name, base(name)} & known}


def test_no_measure_of_a_room_is_missing() -> None:
    assert len(defined()) > 90
    assert undefined(ROOT / "scenarios/room.toml") == set()


@pytest.mark.slow
@pytest.mark.parametrize("path", SCENARIOS, ids=lambda path: path.stem)
def test_no_measure_of_any_scenario_is_missing(path: Path) -> None:
    assert undefined(path) == set()


@pytest.mark.usefixtures("no_workers")
def test_no_column_of_an_export_is_missing(tmp_path: Path) -> None:
    (tmp_path / "s.toml").write_text(
        f'title = "s"\nscenario = "{ROOT}/scenarios/room.toml"\nseeds = 1\nset = {{"stop.iterations" = 2}}\n'
    )
    study = sw.study(tmp_path / "s.toml", store=tmp_path / "s.sqlite", workers=1)
    columns = {name for name in study.records()[0] if not name.startswith("measure_")}
    page = (ROOT / "docs/measures.md").read_text()
    told = set(re.findall(r"^\| `(\w+)` \|", page[page.index("## An export") :], flags=re.MULTILINE))
    assert columns <= told
