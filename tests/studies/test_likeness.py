"""Runs of different buildings, tasks, cells or periods are not put side by side without a word."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest
from conftest import ROOT, called, made

from swarmsim.studies.likeness import Side, notices

SHORT = "stop.iterations=3"


def side(name: str, *overrides: str, scenario: str = "room") -> Side:
    run = made(SHORT, *overrides, scenario=scenario)
    return Side(name, run.scenario, run.world)


def test_runs_of_one_building_and_task_are_alike_whatever_else_differs() -> None:
    other = side("b", "network.topology.k=1", "robots.count=2", "seed=9", 'faults=[{use="remove", at=2, count=1}]')
    moved = msgspec.structs.replace(other.scenario.world, file="elsewhere/room.svg")
    copied = Side("c", msgspec.structs.replace(other.scenario, world=moved), other.world)
    assert notices([side("a"), other, copied]) == []


@pytest.mark.parametrize(
    ("override", "told"),
    [
        ("task.share=0.6", "differ in task.share, .*: 1.0 (a, c); 0.6 (b)"),
        ("grid.cell=0.1", "differ in grid.cell, .*: 0.15 (a, c); 0.1 (b)"),
        ("period=0.5", "differ in period, .*: 1.0 (a, c); 0.5 (b)"),
    ],
)
def test_what_differs_is_named_with_its_values(override: str, told: str) -> None:
    before, after = told.split(".*")
    (found,) = notices([side("a"), side("b", override), side("c")])
    assert before in found
    assert found.endswith(after)


def test_buildings_that_are_called_alike_are_told_apart_and_long_lists_are_cut() -> None:
    first = side("a")
    (found,) = notices([first, Side("b", first.scenario, first.world.replace("</svg>", " </svg>"))])
    title = first.scenario.world.title
    assert f": {title} (a); {title}, drawing " in found
    (found,) = notices([first, *(side(name, "task.share=0.6") for name in "bcdefg")])
    assert found.endswith(": 1.0 (a); 0.6 (b, c, d, e, 2 more)")


def test_compare_says_that_buildings_differ(tmp_path: Path) -> None:
    runs = []
    for name, scenario in (("first", "room"), ("second", "exploring")):
        out = tmp_path / name
        called("run", ROOT / "scenarios" / f"{scenario}.toml", "--set", SHORT, "--out", out, "--quiet")
        runs.append(out)
    done = called("compare", *runs)
    assert done.returncode == 0, done.stderr
    told = " ".join(done.stdout.split())
    assert "notice: these differ in world, so their numbers are hard to compare: " in told
    assert "room.svg (first); " in told
    assert "(second)" in told
    assert "notice:" not in called("compare", runs[0], runs[0]).stdout


def test_a_study_that_compares_conditions_in_different_buildings_says_so(tmp_path: Path) -> None:
    study = tmp_path / "two.toml"
    study.write_text(
        f'title = "Two"\nscenario = "{ROOT}/scenarios/room.toml"\nseeds = 1\nset = {{"stop.iterations" = 3}}\n'
        '[[condition]]\nname = "whole"\nset = {}\n[[condition]]\nname = "part"\nset = {"task.share" = 0.6}\n'
    )
    done = called("study", "table", study, "--store", tmp_path / "two.sqlite", "--compare", "whole")
    assert "notice: these differ in task.share, so" in done.stdout, done.stderr
