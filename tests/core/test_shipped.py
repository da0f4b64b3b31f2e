"""What ships goes by its name wherever a path does, in any folder."""

from __future__ import annotations

from pathlib import Path

import pytest
from conftest import ROOT, called, jobs_here

import swarmsim as sw
from swarmsim.core.errors import InputError
from swarmsim.core.scenario import shipped

EVERYTHING = [(kind, name) for kind in shipped.KINDS for name in shipped.examples(kind)]


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In an empty folder."""
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize(("kind", "name"), EVERYTHING, ids=[f"{kind}-{name}" for kind, name in EVERYTHING])
def test_everything_that_ships_is_found_where_its_kind_is_expected_and_copied(kind: str, name: str) -> None:
    path = shipped.found(name, kind)
    assert path.is_file()
    assert path.is_relative_to(ROOT)
    assert shipped.kind_of(path) == kind
    copies = shipped.copy(f"{kind}/{name}", "mine")
    assert path.read_bytes() in [one.read_bytes() for one in copies]  # scenarios come with their worlds


def test_all_files_that_ship_have_a_name_but_those_of_benchmarks() -> None:
    files = {path for kind, name in EVERYTHING for path in [shipped.found(name, kind)]}
    tomls = {path for path in ROOT.glob("scenarios/**/*.toml") if "benchmarks" not in path.parts}
    assert files == tomls | set(ROOT.glob("worlds/*.svg")) | set(ROOT.glob("papers/*/paper.toml"))


def test_a_file_here_comes_before_what_ships(tmp_path: Path) -> None:
    (tmp_path / "room").write_text("title = 'mine'")
    assert shipped.found("room") == Path("room")
    with pytest.raises(InputError, match=r"^room: "):
        sw.run("room")
    assert shipped.found("scenarios/room") == ROOT / "scenarios" / "room.toml"  # of any kind, by its kind


def test_a_folder_of_that_name_is_in_nobodys_way(tmp_path: Path) -> None:
    (tmp_path / "room").mkdir()
    assert shipped.found("room") == ROOT / "scenarios" / "room.toml"
    assert shipped.found("house", "worlds") == ROOT / "worlds" / "house.svg"
    (tmp_path / "house").mkdir()
    assert shipped.found("house", "worlds") == Path("house")  # some buildings are folders


def test_a_path_of_the_repository_is_told_the_name(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"^scenarios/faults/blind.toml: no such file here; .* called 'faults/blind'$"):
        sw.run("scenarios/faults/blind.toml")
    with pytest.raises(InputError, match="'house'"):
        sw.world_check("worlds/house.svg")
    ended = called("run", "basillica")
    assert (ended.returncode, ended.stderr) == (
        2, "swarmsim: basillica: no such file; did you mean 'basilica', which comes with swarmsim?\n"
    )  # fmt: skip
    assert shipped.found("nothing/like.toml") == Path("nothing/like.toml")


def test_without_what_ships_paths_are_paths(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing() -> Path:
        raise shipped.NotShippedError("nothing")

    monkeypatch.setattr(shipped, "root", missing)
    assert shipped.found("room") == Path("room")


def test_names_stand_in_files_too(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(
        'world = "room"\nrobots = {count = 2, spawn = "room"}\nnetwork.topology.use = "none"\nstop.iterations = 3\n'
    )
    assert sw.run("mine.toml").recording.scenario.world.file == str(ROOT / "worlds" / "room.svg")
    (tmp_path / "study.toml").write_text('title = "two"\nscenario = "room"\nseeds = 2\nset."stop.iterations" = 2\n')
    with jobs_here():
        done = sw.study("study.toml")
    assert len(done.records()) == 2


def test_examples_run_by_their_kind(tmp_path: Path) -> None:
    with jobs_here():
        ended = called("examples", "run", "studies/operations/rendezvous", "--seeds", "1", "--quiet")
    assert ended.returncode == 0, ended.stderr
    assert (tmp_path / "runs" / "studies" / "rendezvous.sqlite").exists()
    building = called("examples", "run", "house")
    assert (building.returncode, building.stderr.split("; ")[1]) == (2, "expected: swarmsim world check house\n")
    refused = called("examples", "run", "kit2018/network", "--video", "film.mp4")
    assert refused.returncode == 2
    assert "expected --seeds" in refused.stderr


def test_a_copied_paper_and_study_stand_alone(tmp_path: Path) -> None:
    said = called("examples", "copy", "papers/shang2014", "mine").stdout
    assert said.endswith("use it: swarmsim reproduce mine/papers/shang2014\n")
    assert sw.open_study("mine/papers/shang2014/speed.toml").plan.path.is_file()
    called("examples", "copy", "operations/rendezvous", "mine")
    called("examples", "copy", "studies/kit2018/network", "mine")
    assert sw.open_study("mine/scenarios/studies/kit2018/network.toml").plan.conditions
