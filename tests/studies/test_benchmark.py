"""The benchmark's commands on three tiny worlds: an entry, its verification, the page, and scores by hand."""

from __future__ import annotations

import json
import re
import shutil
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from conftest import ROOT, called, jobs_here
from hypothesis import given, settings
from hypothesis import strategies as some
from tiny_set import tiny_set

import swarmsim as sw
from swarmsim.core.errors import InputError
from swarmsim.studies.benchmark import sets
from swarmsim.studies.benchmark.entries import (
    MethodEntry,
    checksum,
    entries_to_compare,
    overheard,
    read_entry,
    read_method,
)
from swarmsim.studies.benchmark.leaderboard import write_board
from swarmsim.studies.benchmark.scores import joules_of, kept_order, sign_flip, standings
from swarmsim.studies.benchmark.sets import ReferenceRow, TaskSet, open_set

PAGE = (ROOT / "docs" / "benchmark.md").read_text()
#: The method of the page, with a title that has marks of HTML and Markdown in it.
RULE = re.findall(r"```python\n(.*?)```", PAGE, flags=re.DOTALL)[0]
METHOD = re.findall(r"```toml\n(.*?)```", PAGE, flags=re.DOTALL)[0].replace("but", "<b>but</b> | *where*")


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the set `tiny` and the entry `entry` of a method with code of its own, which is gone since."""
    place = tmp_path_factory.mktemp("benchmark")
    tiny_set(place / "tiny")
    (place / "mine").mkdir()
    (place / "mine" / "curious.py").write_text(RULE)
    (place / "mine" / "curious.toml").write_text(METHOD)
    with jobs_here():
        done = called(
            "benchmark", "explore", "mine/curious.toml", "--out", "entry", "--tasks", "tiny",
            "--secret", "tiny/secret.txt", "--workers", 1, "--allow-code", cwd=place,
        )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "6 runs in" in done.stdout
    shutil.rmtree(place / "mine")
    return place


@pytest.fixture(scope="module")
def tiny(place: Path) -> TaskSet:
    return open_set(place / "tiny")


@pytest.fixture(scope="module")
def entry(place: Path, tiny: TaskSet) -> MethodEntry:
    return read_entry(place / "entry", tiny)


def sealed(entry: MethodEntry) -> MethodEntry:
    """The entry with the checksum that belongs to it, as a forger would leave it."""
    return msgspec.structs.replace(entry, checksum=checksum(entry))


def written(entry: MethodEntry, path: Path) -> Path:
    path.write_bytes(msgspec.json.encode(entry))
    return path


def with_run(entry: MethodEntry, place: int, **changes: object) -> MethodEntry:
    """A forged entry, one of whose runs has other numbers."""
    runs = list(entry.runs)
    runs[place] = msgspec.structs.replace(runs[place], **changes)
    return sealed(msgspec.structs.replace(entry, runs=tuple(runs)))


def test_an_entry_holds_every_run_with_its_digest_and_the_code(entry: MethodEntry, place: Path) -> None:
    assert [run.task for run in entry.runs] == ["a/2", "a/3", "b/2", "b/3", "c/2", "c/3"]
    assert entry.parts == ("public", "held-out")
    assert len({run.digest for run in entry.runs}) == 6
    assert set(entry.code) == {"swarmsim", "curious.py"}
    assert (place / "entry" / "curious.py").read_text() == RULE
    assert (place / "entry" / "entry.json").read_text().count('\n{"task":') == 6  # a line each
    assert read_method(place / "entry" / "method.toml") == entry.method


def test_verification_in_another_process_finds_a_forged_number(place: Path, entry: MethodEntry) -> None:
    forged = shutil.copytree(place / "entry", place / "forged")
    run = entry.runs[2]
    assert run.t99 is not None
    written(with_run(entry, 2, t99=run.t99 - 1, t90=min(run.t90 or 1, run.t99 - 1)), forged / "entry.json")
    options = ("--share", 1, "--tasks", "tiny", "--workers", 1, "--allow-code")
    found = called("benchmark", "verify", "forged", *options, cwd=place)
    assert found.returncode == 1
    assert f"differs: b/2, seed 1: t99 is {run.t99}, the entry says {run.t99 - 1}" in found.stdout
    assert "4 of 6 runs repeated: not those of the entry" in found.stdout
    assert found.stdout.count("differs") == 1 + (run.t90 == run.t99)


def test_an_entry_with_own_code_is_verified_only_if_that_is_allowed(place: Path) -> None:
    found = called("benchmark", "verify", "entry", "--tasks", "tiny", cwd=place)
    assert found.returncode == 2
    assert "--allow-code" in found.stderr


#: A change of an entry's numbers, sealed again, and what the refusal says.
FORGED = {
    "times that fall": ({"t50": 30, "t90": 20}, "t50 to t100 are"),
    "a time beyond the run": ({"t99": 999, "t100": 1000}, "reached a share after 1000 iterations"),
    "finished without all": ({"t100": None}, "finished, but t100 is None"),
    "no time, then one": ({"t90": None}, "expected rising numbers"),
    "done before it began": ({"t50": 0}, "expected rising numbers"),
    "another task": ({"task": "z/2"}, "has 5 of the 6 runs"),
    "a task twice": ({"task": "a/3"}, "expected each once"),
    "another seed": ({"seed": 2}, "has 5 of the 6 runs"),
}


@pytest.mark.parametrize("what", FORGED)
def test_numbers_that_cannot_be_are_refused(tiny: TaskSet, entry: MethodEntry, tmp_path: Path, what: str) -> None:
    changes, told = FORGED[what]
    path = written(with_run(entry, 0, **changes), tmp_path / "entry.json")
    with pytest.raises(InputError) as problem:
        read_entry(path, tiny)
    assert told in str(problem.value)
    assert str(path) in str(problem.value)


def test_an_edited_entry_and_one_of_another_set_are_refused(tiny: TaskSet, entry: MethodEntry, tmp_path: Path) -> None:
    edited = msgspec.structs.replace(with_run(entry, 0, way=1.0), checksum=entry.checksum)
    with pytest.raises(InputError, match="damaged or edited"):
        read_entry(written(edited, tmp_path / "entry.json"), tiny)
    other = sealed(msgspec.structs.replace(entry, set_digest="0" * 32))
    with pytest.raises(InputError, match=r"made for explore-1 \(00000000\); expected explore-1"):
        read_entry(written(other, tmp_path / "entry.json"), tiny)
    public = sealed(msgspec.structs.replace(entry, runs=entry.runs[:4]))
    with pytest.raises(InputError, match="has 4 of the 6 runs of its parts"):
        read_entry(written(public, tmp_path / "entry.json"), tiny)


@settings(max_examples=150)
@given(data=some.data())
def test_whatever_stands_in_an_entry_it_is_read_or_refused(data: some.DataObject) -> None:
    text = bytearray(FUZZED)
    for _ in range(data.draw(some.integers(1, 4))):
        at, kind = data.draw(some.integers(0, len(text) - 1)), data.draw(some.sampled_from(["byte", "cut", "repeat"]))
        if kind == "byte":
            text[at] = data.draw(some.integers(0, 255))
        elif kind == "cut":
            del text[at : at + data.draw(some.integers(1, 40))]
        else:
            text[at:at] = text[at : at + data.draw(some.integers(1, 40))]
    path = FUZZED_FILE
    path.write_bytes(bytes(text))
    with suppress(InputError):  # any other error would be one of the reader
        read_entry(path)


FUZZED_FILE = Path()
FUZZED = b""


@pytest.fixture(autouse=True, scope="module")
def _fuzzed(entry: MethodEntry, tmp_path_factory: pytest.TempPathFactory) -> None:
    global FUZZED, FUZZED_FILE
    FUZZED, FUZZED_FILE = msgspec.json.encode(entry), tmp_path_factory.mktemp("fuzz") / "entry.json"


@pytest.mark.parametrize("value", [None, -1, 1e400, "12", True, [], {}, float("nan")])
@pytest.mark.parametrize("key", ["t99", "way", "digest", "task", "status", "bytes", "seed"])
def test_a_value_of_another_kind_is_refused_or_sound(
    entry: MethodEntry, tmp_path: Path, key: str, value: object
) -> None:
    table = json.loads(msgspec.json.encode(entry))
    table["runs"][0][key] = value
    (tmp_path / "entry.json").write_text(json.dumps(table))
    with pytest.raises(InputError, match=r"entry\.json"):  # at the latest, the checksum is another
        read_entry(tmp_path / "entry.json")


def test_an_oracle_hears_everything_and_dies_like_all_others(tiny: TaskSet) -> None:
    struck = next(task for task in tiny.made if task.name == "b/3")
    changes = overheard(struck).changes or {}
    assert (changes["network.topology"], changes["network.channel"]) == ({"use": "full"}, {"use": "perfect"})
    assert [fault["use"] for fault in changes["faults"]] == ["remove"]
    assert len((struck.changes or {})["faults"]) == 2
    assert changes["world"] == (struck.changes or {})["world"]


METHODS = {
    "robots": ('name = "m"\n[mind.strategy]\nuse = "market"\n[robots]\ncount = 9', "robots"),
    "a third half": ('name = "m"\n[mind.strategy]\nuse = "market"\n[mind.sensor]\nuse = "x"', "mind.sensor: expected"),
    "no strategy": ('name = "m"\n[mind.computation]\nuse = "occupancy-grid"', "mind.strategy: required"),
    "no name": ('[mind.strategy]\nuse = "market"', "name: required key is missing"),
    "a name that is a path": ('name = "../m"\n[mind.strategy]\nuse = "market"', "name: expected"),
    "no such rule": ('name = "m"\n[mind.strategy]\nuse = "markt"', "markt"),
    "a rule that needs goals": ('name = "m"\n[mind]\nstrategy = "market"', "mind.strategy: expected a table"),
}


@pytest.mark.parametrize("what", METHODS)
def test_a_method_that_cannot_enter_is_refused(tiny: TaskSet, tmp_path: Path, what: str) -> None:
    text, told = METHODS[what]
    (tmp_path / "m.toml").write_text(text)
    with pytest.raises(InputError) as problem:
        sw.benchmark_explore(tmp_path / "m.toml", out=tmp_path / "e", tasks=tiny.folder, store=tmp_path / "s.sqlite")
    assert told in str(problem.value)
    assert "m.toml" in str(problem.value)
    assert not (tmp_path / "e").exists()


def references(tiny: TaskSet, t99: int) -> TaskSet:
    """The set with a tour that shows 99 % of each world in so many iterations."""
    rows = {
        (task.name, 1): ReferenceRow(
            task=task.name, seed=1, cells=100, bound50=2, bound90=4, bound99=t99 // 2, bound100=t99, tour=0.9 * t99,
            t50=4, t90=9, t99=t99, t100=None, covered=0.995, digest="0" * 32,
        )
        for task in tiny.tasks
    }  # fmt: skip
    return replace(tiny, references=rows)


def claimed(entry: MethodEntry, name: str, t99: list[int | None], limit: int = 2000) -> MethodEntry:
    """An entry with these T99, and halves of them before."""
    runs = tuple(
        msgspec.structs.replace(
            run, t50=None if at is None else at // 2, t90=None if at is None else at // 2, t99=at, t100=None,
            status="not finished", iterations=limit, bytes=1000 * int(run.task[-1]),
        )
        for run, at in zip(entry.runs, t99, strict=True)
    )  # fmt: skip
    method = msgspec.structs.replace(entry.method, name=name)
    return sealed(msgspec.structs.replace(entry, method=method, runs=runs))


def test_scores_are_those_worked_out_by_hand(tiny: TaskSet, entry: MethodEntry) -> None:
    known = references(tiny, 10)
    fast = claimed(entry, "fast", [20, 40, 20, 40, 20, 40])
    never = claimed(entry, "never", [20, 40, 20, None, 20, 40])
    found = standings(known, [never, fast])
    one, other = found.scores
    assert (one.name, other.name, found.worlds) == ("fast", "never", 2)
    # ln 2 and ln 4 in both worlds: sqrt(8). In the other, world b has ln 2 and the cap, ln 16: 2^((1.5 + 2.5) / 2) = 4.
    assert one.times["t99"][0] == pytest.approx(8**0.5)
    assert one.times["t50"][0] == pytest.approx(2**0.5)
    assert other.times["t99"][0] == pytest.approx(4.0)
    assert other.of_robots[3][0] == pytest.approx(8.0)
    assert other.of_struck[True][0] == pytest.approx(32**0.5)
    assert (one.reached["t99"], other.reached["t99"], other.reached["t100"], other.runs) == (4, 3, 0, 4)
    assert one.kilobytes[0] == pytest.approx(1.0)
    assert np.isnan(one.times["t99"][1]).all()  # two worlds give no interval
    assert found.bound == pytest.approx(0.5)
    assert found.tour == pytest.approx(0.9)
    # A run that never saw 99 % is within no ratio, whatever the limit.
    assert [one.profiles[0][-1], other.profiles[0][-1]] == [1.0, 0.75]
    assert one.profiles[2][0] == 0.0
    (pair,) = found.pairs
    assert (pair.first, pair.second, pair.different) == ("fast", "never", False)
    assert pair.ratio[0] == pytest.approx(8**0.5 / 4.0)


def test_energy_is_that_of_way_time_and_bytes(tiny: TaskSet, entry: MethodEntry) -> None:
    slow = replace(tiny, period=0.5)  # 2000 iterations of half a second, and a kilobyte a robot
    (one,) = standings(slow, [claimed(entry, "one", [20] * 6)], joules=joules_of("metre=3,second=2,kilobyte=7")).scores
    assert one.energy is not None
    assert one.way[0] > 0.0
    assert one.energy[0] == pytest.approx(3.0 * one.way[0] + 2.0 * 1000.0 + 7.0)
    with pytest.raises(InputError, match=r"--energy metres: unknown; expected .*; known: metre, second, kilobyte"):
        joules_of({"metres": 3.0})


def test_a_limit_below_the_cap_counts_alike_for_all(tiny: TaskSet, entry: MethodEntry) -> None:
    known = references(tiny, 1000)  # the limit, 2000, is 2 tours
    slow = claimed(entry, "slow", [1999, 1999, 1999, 1999, 1, 1])
    never = claimed(entry, "never", [None] * 6)
    one, other = standings(known, [slow, never]).scores
    assert other.times["t99"][0] == pytest.approx(2.0)
    assert one.times["t99"][0] == pytest.approx(1.999)


def test_without_references_the_best_entry_is_the_unit(tiny: TaskSet, entry: MethodEntry) -> None:
    one = claimed(entry, "one", [10, 40, 10, 40, 1, 1])
    other = claimed(entry, "other", [20, 20, 20, None, 1, 1])
    found = standings(tiny, [one, other])
    assert found.bound is None
    assert {score.name: score.times["t99"][0] for score in found.scores} == pytest.approx(
        {"one": 2**0.25, "other": (2 * 1 * 2 * 16) ** 0.25}
    )
    with pytest.raises(InputError, match="one: two entries have this name"):
        standings(tiny, [one, one])


def test_pairs_are_told_apart_by_worlds_together() -> None:
    assert sign_flip(np.zeros(9)) == 1.0
    assert sign_flip(np.array([0.7])) == 1.0
    assert sign_flip(np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])) == pytest.approx(2 / 64)
    assert sign_flip(np.array([0.1, -0.1])) == 1.0


def test_a_pair_turned_round_on_held_out_worlds_is_told(tiny: TaskSet, entry: MethodEntry) -> None:
    one = claimed(entry, "one", [10, 10, 10, 10, 40, 40])
    other = claimed(entry, "other", [20, 20, 20, 20, 20, 20])
    public, held = (standings(tiny, [one, other], part) for part in ("public", "held-out"))
    assert kept_order(public, held) == (0, [])  # two worlds show nothing
    called_so = replace(public, pairs=tuple(replace(pair, adjusted=0.01) for pair in public.pairs))
    count, turned = kept_order(called_so, held)
    assert (count, [pair.first for pair in turned]) == (1, ["one"])


def test_the_page_has_tables_figures_and_no_markup_of_entries(
    tiny: TaskSet, entry: MethodEntry, tmp_path: Path
) -> None:
    other = claimed(entry, "other", [40, 40, 40, None, 40, 40])
    found, files = write_board(references(tiny, 10), [entry, other], tmp_path / "board.html")
    page = (tmp_path / "board.html").read_text()
    assert list(found) == ["public", "held-out"]
    assert [file.name for file in files[1:]] == [
        "board-scores.png", "board-scores.svg", "board-profiles.png", "board-profiles.svg",
    ]  # fmt: skip
    assert all(file.stat().st_size > 1000 for file in files)
    assert "<b>but" not in page
    assert page.count('src="data:image/png') == 2
    for words in ("(proved lower bound)", "3 of 4", "not shown", "Held-out worlds", entry.checksum):
        assert words in page


def test_entries_that_come_with_the_set_are_compared_too(tiny: TaskSet, entry: MethodEntry, tmp_path: Path) -> None:
    (tmp_path / "entries").mkdir()
    set_ = replace(tiny, folder=tmp_path)
    with pytest.raises(InputError, match="no entries come with this set"):
        entries_to_compare(set_, [], alone=False)
    theirs = written(claimed(entry, "theirs", [20] * 6), tmp_path / "entries" / "theirs.json")
    old = claimed(entry, entry.method.name, [30] * 6)
    written(old, tmp_path / "entries" / "old.json")
    mine = written(entry, tmp_path / "mine.json")
    assert entries_to_compare(set_, [mine], alone=False) == [entry, read_entry(theirs)]
    assert entries_to_compare(set_, [mine], alone=True) == [entry]
    assert entries_to_compare(set_, [], alone=False) == [old, read_entry(theirs)]


def test_maps_become_a_set_for_the_same_commands(tmp_path: Path, tiny: TaskSet) -> None:
    maps = tmp_path / "Their Maps"
    maps.mkdir()
    rows = ["#" * 24, *["#" + "." * 10 + ("." if 4 < row < 9 else "#") + "." * 11 + "#" for row in range(14)], "#" * 24]
    pixels = bytes(0 if one == "#" else 254 for row in rows for one in row)
    (maps / "hall.pgm").write_bytes(b"P5\n24 16\n255\n" + pixels)
    (maps / "hall.yaml").write_text(
        "image: hall.pgm\nresolution: 0.15\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    (maps / "Hall 2.pgm").write_bytes(b"P5\n24 16\n255\n" + pixels)
    (maps / "broken.png").write_bytes(b"no picture")
    made = called(
        "benchmark", "import", maps, "--out", tmp_path / "set", "--resolution", 0.15, "--robots", 4, "--limit", 300
    )
    assert made.returncode == 0, made.stderr
    assert f"left out: {maps / 'broken.png'}: no image that can be read" in made.stdout
    found = open_set(tmp_path / "set")
    assert (found.name, found.limit) == ("their-maps-1", 300)
    assert [(task.name, task.world.struck) for task in found.made] == [("hall/4", True), ("hall-2/4", False)]
    plan = sets.plan_of(found, {"strategy": {"use": "nearest-frontier"}}, Path("m.toml"), found.made)
    assert len(plan.conditions) == 2
    again = called("benchmark", "import", maps, "--out", tmp_path / "set", "--resolution", 0.15)
    assert again.returncode == 2
    assert "there is a set already" in again.stderr
    (tmp_path / "set" / "worlds" / "hall.geojson").write_text("{}")
    with pytest.raises(InputError, match="hall"):
        open_set(tmp_path / "set")


@pytest.mark.thorough
def test_references_are_found_kept_and_checked(place: Path, tmp_path: Path) -> None:
    pytest.importorskip("ortools")
    copy = Path(shutil.copytree(place / "tiny", tmp_path / "copy"))
    done = called("benchmark", "references", copy, "--secret", copy / "secret.txt")
    assert done.returncode == 0, done.stderr
    assert "6 references found, 6 in all" in done.stdout
    found = open_set(copy)
    for row in found.references.values():
        times = [time for time in (row.t50, row.t90, row.t99, row.t100) if time is not None]
        assert row.bound50 <= row.bound90 <= row.bound99 <= row.bound100
        assert all(low <= time for low, time in zip((row.bound50, row.bound90, row.bound99), times, strict=False))
    assert "c/2" not in (copy / "tours.csv").read_text()  # the way would show the held-out world
    checked = called("benchmark", "references", copy, "--check", 1, "--secret", copy / "secret.txt")
    assert (checked.returncode, "4 tours replayed" in checked.stdout) == (0, True), checked.stdout
    text = (copy / "references.csv").read_text()
    line = next(line for line in text.splitlines() if line.startswith("b/3"))
    row = found.references["b/3", 1]
    forged = line.replace(f",{row.t50},{row.t90},{row.t99},", f",{row.t50},{row.t90},{(row.t99 or 0) + 1},")
    (copy / "references.csv").write_text(text.replace(line, forged))
    wrong = called("benchmark", "references", copy, "--check", 1)
    assert wrong.returncode == 1
    assert "differs: b/3, seed 1: the tour replayed gives" in wrong.stdout
