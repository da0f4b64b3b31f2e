"""Sets of benchmark tasks: frozen, balanced, and refused where a world has changed."""

from __future__ import annotations

import shutil
from collections import Counter
from pathlib import Path

import pytest
from tiny_set import SECRET, tiny_set

from swarmsim.core.errors import InputError
from swarmsim.studies.benchmark import sets
from swarmsim.studies.benchmark.entries import open_method, read_method
from swarmsim.studies.benchmark.listed import read_lines


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny_set(tmp_path_factory.mktemp("sets") / "tiny")


@pytest.fixture
def copy(tiny: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(tiny, tmp_path / "copy"))


def test_the_shipped_set_has_the_worlds_that_it_names_and_is_balanced() -> None:
    found = sets.open_set(sets.shipped_set())  # makes every public world and compares digests
    worlds = [task.world for task in found.tasks if task.robots == 4]
    assert (found.name, len(worlds), len(found.tasks), len(found.made)) == ("explore-1", 60, 180, 120)
    public = [world for world in worlds if world.part == "public"]
    for part in (public, [world for world in worlds if world.part == "held-out"]):
        assert len(set(Counter(world.regime for world in part).values())) == 1
        assert len(set(Counter(world.regime for world in part if world.struck).values())) == 1
        assert set(Counter(world.kind for world in part).values()) <= {len(part) // 6, len(part) // 6 + 1}
    assert (len(public), sum(world.struck for world in worlds)) == (40, 12)
    assert len({world.digest for world in public}) == 40


def test_held_out_worlds_have_neither_seed_nor_digest_and_open_with_their_secret_alone(tiny: Path) -> None:
    assert [task.name for task in sets.open_set(tiny).made] == ["a/2", "a/3", "b/2", "b/3"]
    opened = sets.open_set(tiny, tiny / "secret.txt")
    assert [task.name for task in opened.made][4:] == ["c/2", "c/3"]
    assert opened.digest == sets.open_set(tiny).digest
    assert SECRET not in "".join(file.read_text() for file in tiny.glob("*.*") if file.name != "secret.txt")


@pytest.mark.parametrize("wrong", ["another secret, long enough", "", "short", SECRET + "!", SECRET.upper()])
def test_another_secret_is_refused(tiny: Path, tmp_path: Path, wrong: str) -> None:
    (tmp_path / "wrong.txt").write_text(wrong)
    with pytest.raises(InputError, match=r"wrong\.txt: (not the secret|is empty)"):
        sets.open_set(tiny, tmp_path / "wrong.txt")


#: A change of a file, and what the refusal says.
DAMAGES = {
    "another world": (
        "worlds.csv",
        "public,nearest,false,0,",
        "public,nearest,false,7,",
        "another world than the set's",
    ),
    "another generator": ("set.toml", "width = 3.0", "width = 3.15", "another world than the set's"),
    "a column less": ("worlds.csv", ",digest", "", "line 1: expected the columns world, kind"),
    "a cell less": ("worlds.csv", "a,rooms,", "a,", "line 2: 7 cells; expected 8"),
    "no such part": ("worlds.csv", "a,rooms,public", "a,rooms,secret", "line 2: Invalid enum value 'secret'"),
    "no such regime": ("worlds.csv", "nearest", "farthest", "a: regime 'farthest' is not in set.toml"),
    "no such kind": ("worlds.csv", "a,rooms", "a,room", "a: kind 'room' is not in set.toml; known: rooms"),
    "twice": ("worlds.csv", "b,rooms", "a,rooms", "a: is listed twice"),
    "a name that is a path": ("worlds.csv", "b,rooms", "../b,rooms", "line 3: Expected `str` matching regex"),
    "a seed that is a word": ("worlds.csv", "false,0,", "false,zero,", "line 2: Expected `int"),
    "a held-out seed": ("worlds.csv", "sight,false,,", "sight,false,5,", "c: held out, but its seed"),
    "a limit of a regime's own": (
        "set.toml",
        '= {use = "perfect"}}',
        '= {use = "perfect"}, "stop.iterations" = 9}',
        "stop.iterations: all",
    ),
    "no robots": ("set.toml", "counts = [2, 3]", "counts = []", "counts: expected"),
    "an unknown key": ("set.toml", "cap =", "cup =", "cup"),
    "a quote without end": ("worlds.csv", "a,rooms", '"a,rooms', "worlds.csv"),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_set_is_refused_with_file_and_place(copy: Path, damage: str) -> None:
    name, before, after, told = DAMAGES[damage]
    text = (copy / name).read_text()
    assert before in text
    (copy / name).write_text(text.replace(before, after, 1))
    with pytest.raises(InputError) as problem:
        sets.open_set(copy)
    assert told in str(problem.value)
    assert str(copy) in str(problem.value)


def test_changed_held_out_worlds_are_refused(copy: Path) -> None:
    text = (copy / "set.toml").read_text()
    (copy / "set.toml").write_text(text.replace('sealed = "', 'sealed = "00', 1))
    with pytest.raises(InputError, match="sealed: the held-out worlds are others"):
        sets.open_set(copy, copy / "secret.txt")


def test_references_of_unknown_tasks_are_refused(copy: Path) -> None:
    columns = sets.ReferenceRow.__struct_fields__
    row = ["a/2", "1", "100", "5", "9", "10", "12", "14.5", "8", "14", "16", "", "0.995", "0" * 32]
    (copy / "references.csv").write_text("\n".join([",".join(columns), ",".join(row)]))
    assert sets.open_set(copy).references["a/2", 1].t100 is None
    (copy / "references.csv").write_text("\n".join([",".join(columns), ",".join(["a/4", *row[1:]])]))
    with pytest.raises(InputError, match="a/4, seed 1: no task of the set"):
        sets.open_set(copy)


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"set\.toml"):
        sets.open_set(tmp_path)
    with pytest.raises(InputError, match="worlds"):
        read_lines(tmp_path / "worlds.csv", sets.SetWorld)


METHODS = sorted((sets.shipped_set().parent / "methods").glob("*.toml"))


@pytest.mark.parametrize("path", METHODS, ids=[path.stem for path in METHODS])
def test_every_shipped_method_can_enter_with_the_same_means(tiny: Path, path: Path) -> None:
    found, method = sets.open_set(tiny), read_method(path)
    plan = open_method(found, method, path, found.made[:1])
    (mind,) = [condition.scenario.mind for condition in plan.conditions]
    assert method.name == path.stem
    assert method.mind["computation"] == {"use": "occupancy-grid", "sharing": {"use": "gossip", "goals": True}}
    assert method.oracle or mind.strategy.table["replan"] == "every-iteration"
