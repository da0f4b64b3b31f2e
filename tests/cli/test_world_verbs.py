"""The verbs of buildings and the export of maps, as one types them."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from swarmsim.cli import app
from swarmsim.core.errors import InputError
from swarmsim.core.state import FREE, OCCUPIED, UNKNOWN
from swarmsim.operations.mapping.replay import MapReplay
from swarmsim.recording.reader import Recording
from swarmsim.world import rosmap
from swarmsim.world.source import floor_plan

pytestmark = pytest.mark.usefixtures("no_workers")
ROOT = Path(__file__).parents[2]
ROOM = str(ROOT / "worlds" / "room.svg")


def run(*words: str, code: int = 0) -> str:
    found = CliRunner().invoke(app, list(words))
    if isinstance(found.exception, InputError):
        raise found.exception
    assert found.exit_code == code, found.output
    return found.output


def test_check_tells_size_rooms_doors_and_seats() -> None:
    text = run("world", "check", ROOM)
    for words in ("cells that make 100 %", "rooms: 2", "doors: 1", "0.90", "100 % is attainable"):
        assert words in text
    found = json.loads(run("world", "check", str(ROOT / "scenarios" / "room.toml"), "--json"))
    assert found["problem"] is None
    assert found["doors"][0]["width"] == pytest.approx(0.9, abs=0.01)
    assert found["domain_cells"] == 758


def test_check_ends_with_2_and_names_the_place_where_100_percent_is_unattainable(tmp_path: Path) -> None:
    wide = ("--set", "robots.radius=0.5", "--set", "robots.count=2")
    text = run("world", "check", ROOM, *wide, "--set", 'world.pockets="refuse"', code=2)
    assert "100 % is unattainable: " in text
    assert "wider than every door" in text
    text = run("world", "check", ROOM, *wide)
    assert "1 place lies behind gaps narrower than a robot of 1 m and does not count" in text
    assert "% of the floor, so that the robot or the scale may be wrong" in text
    run("world", "preview", ROOM, str(tmp_path / "p.png"), *wide)
    with Image.open(tmp_path / "p.png") as picture:
        assert min(picture.size) > 400


def test_a_tiny_drawing_is_told_how_to_grow(tmp_path: Path) -> None:
    (tmp_path / "s.toml").write_text(
        'world = "w.svg"\n[robots]\ncount = 1\n[network.topology]\nuse = "none"\n', encoding="utf-8"
    )
    small = Path(ROOM).read_text(encoding="utf-8").replace("<svg ", '<svg data-x="1" ', 1)
    (tmp_path / "w.svg").write_text(small, encoding="utf-8")
    text = run("world", "check", str(tmp_path / "s.toml"), "--set", "world.scale=0.02", code=2)
    assert "drawn at a scale" in text
    assert "scale = 100" in text


@pytest.mark.parametrize("ending", [".geojson", ".svg", ".yaml"])
def test_convert_there_and_back_changes_no_cell(tmp_path: Path, ending: str) -> None:
    out = tmp_path / f"room{ending}"
    assert str(out) in run("world", "convert", ROOM, str(out))
    run("world", "convert", str(out), str(tmp_path / "again.yaml"), "--cell", "0.15")
    run("world", "convert", ROOM, str(tmp_path / "first.yaml"))
    first, again = (rosmap.read(tmp_path / f"{name}.yaml") for name in ("first", "again"))
    assert (first.states == again.states).all()
    assert {OCCUPIED, FREE} <= set(np.unique(first.states))


def test_an_occupancy_grid_is_written_as_json(tmp_path: Path) -> None:
    run("world", "convert", ROOM, str(tmp_path / "g.json"), "--cell", "0.1")
    grid = json.loads((tmp_path / "g.json").read_text())
    assert grid["info"]["resolution"] == 0.1
    assert len(grid["data"]) == grid["info"]["width"] * grid["info"]["height"]
    assert set(grid["data"]) == {0, 100}


def test_generate_and_a_study_over_its_seeds(tmp_path: Path) -> None:
    run("world", "generate", "rooms", str(tmp_path / "a.svg"), "--seed", "3", "--set", "width=6", "--set", "height=6")
    assert "100 % is attainable" in run("world", "check", str(tmp_path / "a.svg"))
    (tmp_path / "s.toml").write_text(
        'world = {generate = {use = "rooms", width = 6.0, height = 4.5}}\n[robots]\ncount = 3\n'
        '[network.topology]\nuse = "full"\n[stop]\niterations = 3000\n'
    )
    (tmp_path / "study.toml").write_text(
        'title = "Rooms"\nscenario = "s.toml"\nseeds = 1\n[[vary]]\nkey = "world.seed"\nvalues = [1, 2, 3]\n'
    )
    store = str(tmp_path / "r.sqlite")
    run("study", "run", str(tmp_path / "study.toml"), "--store", store, "--quiet", "--workers", "1")
    text = run("study", "status", str(tmp_path / "study.toml"), "--store", store)
    assert text.count("seed=") >= 3


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["world", "convert", ROOM, "x.dxf"], "expected a name that ends in"),
        (["world", "convert", ROOM, "x.yaml", "--cell", "0"], "--cell 0"),
        (["world", "preview", ROOM, "x.jpg"], "ends in .png, .svg or .pdf"),
        (["world", "check", ROOM, "--door", "-1"], "--door -1"),
        (["world", "check", "nowhere.svg"], "no such file"),
        (["world", "generate", "castle", "x.svg"], "no generator is called"),
        (["world", "generate", "rooms", "x.png"], "ends in .svg or .geojson"),
        (["world", "convert", ROOM, "/nowhere/x.svg"], "cannot be written"),
    ],
)
def test_bad_words_are_refused(words: list[str], message: str) -> None:
    with pytest.raises(InputError, match=message):
        run(*words)


def test_what_robots_mapped_is_exported_for_ros(room: Path, tmp_path: Path) -> None:
    run("export", str(room), "--map", str(tmp_path / "all.yaml"))
    run("export", str(room), "--map", str(tmp_path / "one.yaml"), "--robot", "1", "--at", "5")
    recording = Recording(room)
    replay = MapReplay(recording)
    replay.advance(5)
    one = rosmap.read(tmp_path / "one.yaml")
    plan, lattice = floor_plan(recording.world, recording.scenario.world), recording.lattice
    row, column = lattice.cells(np.array(plan.page[:2]) + 1e-6)
    inside = slice(row, row + one.states.shape[0]), slice(column, column + one.states.shape[1])
    size = np.array(one.states.shape[::-1]) * lattice.cell
    assert one.origin[:2] == pytest.approx(plan.page[:2], abs=1e-9)
    assert ((size - (plan.width, plan.height) >= 0.0) & (size - (plan.width, plan.height) < lattice.cell)).all()
    assert (one.states == replay.maps[1][inside]).all()
    assert (one.states == UNKNOWN).any()
    replay.advance(recording.iterations - 1)
    everyone = replay.collective()
    assert (rosmap.read(tmp_path / "all.yaml").states == everyone[inside]).all()
    everyone[inside] = UNKNOWN
    assert not (everyone != UNKNOWN).any()
    for line in (tmp_path / "all.yaml").read_text().splitlines():
        assert len(line) < 60  # as in origin: [-13.4, 0.0, 0.0], not -13.399999999999999
    for words, message in ((["--robot", "99"], "--robot 99"), (["--at", "-1"], "--at -1")):
        with pytest.raises(InputError, match=message):
            run("export", str(room), "--map", str(tmp_path / "x.yaml"), *words)


def test_files_outside_of_the_scenarios_folder_are_named(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    shutil.copy(ROOM, tmp_path / "w.svg")
    (tmp_path / "net.csv").write_text("0,1\n1,0\n")
    (tmp_path / "in" / "s.toml").write_text(
        'world = "../w.svg"\n[robots]\ncount = 2\n[network.topology]\nuse = "edges"\nlinks = {file = "../net.csv"}\n'
        "[stop]\niterations = 3\n"
    )
    text = " ".join(run("run", str(tmp_path / "in" / "s.toml"), "--out", str(tmp_path / "r"), code=1).split())
    assert text.count("notice: ") == 2
    assert text.count("lies outside of the scenario's folder") == 2
    own = run("run", str(ROOT / "scenarios" / "room.toml"), "--out", str(tmp_path / "own"))
    assert "notice" not in own
