"""The entries that come with the benchmark's set: whole, of the shipped methods, and what the page says of them."""

from __future__ import annotations

from pathlib import Path

import pytest
from conftest import ROOT

from swarmsim.studies.benchmark.entries import ENTERED, entries_to_compare, read_entry, read_method
from swarmsim.studies.benchmark.leaderboard import shown
from swarmsim.studies.benchmark.scores import standings
from swarmsim.studies.benchmark.sets import TaskSet, open_set, shipped_set

METHODS = ROOT / "scenarios" / "benchmarks" / "explore" / "methods"
ENTRIES = sorted((shipped_set() / ENTERED).iterdir())
PAGE = (ROOT / "docs" / "benchmark.md").read_text()


@pytest.fixture(scope="module")
def tasks() -> TaskSet:
    return open_set(shipped_set())


@pytest.mark.parametrize("path", ENTRIES, ids=lambda path: path.stem)
def test_a_shipped_entry_is_whole_and_of_the_shipped_method(path: Path, tasks: TaskSet) -> None:
    entry = read_entry(path, tasks)  # checksum, set, every task once
    assert entry.method == read_method(METHODS / f"{path.stem}.toml")
    assert entry.method.name == path.stem
    assert entry.parts == ("public", "held-out")
    assert list(entry.code) == ["swarmsim"]


@pytest.mark.slow  # signs drawn anew for every pair, twice
def test_the_page_has_the_scores_of_the_entries(tasks: TaskSet) -> None:
    entries = entries_to_compare(tasks, [], alone=False)
    public, held_out = (standings(tasks, entries, part) for part in ("public", "held-out"))
    others = {one.name: one for one in held_out.scores}
    rows = PAGE.partition("## Results")[2].splitlines()
    for one in public.scores:
        other = others[one.name]
        told = [f"`{one.name}`"]
        for each in (one, other):
            told += [shown(each.times["t99"]), f"{each.reached['t99']} of {each.runs}"]
        assert f"| {' | '.join(told)} |" in rows
