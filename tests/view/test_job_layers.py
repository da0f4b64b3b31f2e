"""Pictures of what jobs and probes show: the same declarations in films, pages and viewers."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from swarmsim.core.drawing import Circles, Lines, Polygons, Raster, Texts
from swarmsim.core.errors import InputError
from swarmsim.core.probes import NOBODY
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.file import load
from swarmsim.engine.build import build
from swarmsim.recording.reader import Recording
from swarmsim.view.canvas import Canvas
from swarmsim.view.layers import LayerStack
from swarmsim.view.layers.jobs import FLASH, SCALE
from swarmsim.view.legend import signs
from swarmsim.view.page.document import replay_page
from swarmsim.view.page.tracks import Tracks
from swarmsim.view.scene import Scene
from swarmsim.view.style import LAYERS, Style
from swarmsim.view.theme import THEMES
from swarmsim.view.video import frame
from swarmsim.view.viewers.foxglove import write_mcap

SCENARIO = """
world = "room.svg"
robots = {count = 4, spawn = "floor"}
grid.cell = 0.2
network.topology = {use = "full"}
stop = {iterations = 40, when_done = "continue"}
jobs = [{use = "./own.py:Fill", name = "fill", steps = 40, patience = 4}]
probes = [{use = "./own.py:Guess", name = "guess"}]
faults = [{use = "remove", at = 8, robots = [2]}]
"""
ROOM = """<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 4 4" width="4m" height="4m">
  <g id="walls"><path fill-rule="evenodd" d="M0 0H4V4H0Z M0.2 0.2V3.8H3.8V0.2Z"/></g>
  <g id="spawn"><rect id="floor" x="0.5" y="0.5" width="3" height="3"/></g>
</svg>"""
OWN = """
import numpy as np
from swarmsim.core.probes import ProbeTable, Sampled
from swarmsim.jobs.pieces import bisected


class Fill:
    "A piece's number, and a hundredth of the steps done."
    halo, level, unit = 1, 2, "K"

    def __init__(self, *, steps: int = 8, name: str = "", copies: int = 2, patience: int = 12):
        self.steps = steps

    def pieces(self, domain):
        return bisected(domain, 4, self.halo)

    def start(self, piece, sensed):
        return np.full(len(piece.cells), float(piece.number))

    def shows(self, piece, state, step):
        return state[piece.rim]

    def step(self, piece, state, around, step):
        return state + 0.01

    def work(self, piece):
        return 2.0

    def answer(self, piece, state):
        return state


class Guess(Sampled, frozen=True, forbid_unknown_fields=True, kw_only=True):
    wide: bool = False

    def build(self, context):
        return Guesses(self.wide)


class Guesses:
    def __init__(self, wide):
        shape = ("robots", 4 if wide else 3)
        self.tables = (
            ProbeTable("there", "f8", shape, "m", "its guess", -100.0, 100.0, drawn="places"),
            ProbeTable("count", "i4", ("robots",), "", "counted", drawn="robots"),
        )

    def sample(self, moment):
        n = moment.state.robots
        return {"there": np.column_stack([moment.state.pose[:, :2], np.arange(n)]), "count": np.arange(n)}
"""


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    return recorded(tmp_path_factory.mktemp("own"))


def recorded(folder: Path, *overrides: str) -> Recording:
    for name, text in (("room.svg", ROOM), ("own.py", OWN), ("room.toml", SCENARIO)):
        (folder / name).write_text(text)
    shutil.rmtree(folder / "out", ignore_errors=True)
    with registry.own_code(True):
        run = build(load(folder / "room.toml", overrides), "room.toml")
        (folder / "out").mkdir()
        with run.recorder(folder / "out" / "recording.h5") as recorder:
            run.simulate([recorder])
    return Recording(folder / "out")


def drawn(recording: Recording, iteration: int, name: str) -> list[object]:
    scene = Scene(recording)
    marks = LayerStack(scene).draw(scene.at(iteration), Style(layers=frozenset({"jobs"})))
    return [mark for mark in marks if mark.name == name]


def test_a_field_has_the_colours_of_its_scale(recording: Recording) -> None:
    field = recording["fill.field"]
    (raster,) = drawn(recording, 20, "fill.field")
    assert isinstance(raster, Raster)
    shares = field[4] / np.nanmax(field)
    np.testing.assert_array_equal(raster.values, np.nan_to_num(1.0 + np.rint(247.0 * shares)))
    canvas = Canvas(Scene(recording), (640, 360), Style(layers=frozenset({"jobs"})))
    surface, shades = canvas.draw(20), THEMES["dark"].shades(raster.palette)
    cells = np.argwhere(raster.values)
    places = canvas.pixels(recording.lattice.centres(cells)).astype(int)
    found = np.array([surface.get_at(place)[:3] for place in places.tolist()])
    right = (found == shades[raster.values[tuple(cells.T)]]).all(axis=1)
    assert right.mean() > 0.6  # outlines, robots and arrows cover the others


def test_a_page_tells_the_ends_of_each_scale_in_the_colours_of_the_film(recording: Recording) -> None:
    page, most = replay_page(recording), np.nanmax(recording["fill.field"])
    assert f'<p class="scale"><i></i>fill: field computed, 0 to {most:.3g} K</p>' in page
    assert f"linear-gradient(to right, {', '.join(SCALE)})" in page
    assert page.count('class="scale"') == 2  # and the numbers of the probe


def test_pieces_have_the_colours_of_their_holders_and_flash_when_taken_over(recording: Recording) -> None:
    holder = recording["fill.holder"]
    (piece,) = np.flatnonzero(holder[5] == 2)
    taken = int(np.flatnonzero(holder[:, piece] == holder[-1, piece])[0])
    assert set(holder[8:taken, piece]) == {NOBODY}

    def inks(iteration: int) -> list[object]:
        return [mark.edge for mark in drawn(recording, iteration, "piece") if isinstance(mark, Polygons)]

    assert inks(5) == ["edge", [f"robot {robot}" for robot in holder[5]]]
    assert inks(9)[1][piece] == "dead"  # type: ignore[index]
    assert inks(taken)[2:] == ["edge", ["mark"]]
    assert [len(inks(iteration)) for iteration in (taken - 1, taken + FLASH - 1, taken + FLASH)] == [2, 4, 2]
    (labels,) = [mark for mark in drawn(recording, 9, "holder") if isinstance(mark, Texts)]
    assert labels.texts[piece] == "?"
    (rings,) = drawn(recording, 9, "holds a piece")
    assert isinstance(rings, Circles)
    assert rings.of.tolist() == [0, 1, 3]


def test_halos_numbers_and_guesses_are_drawn_of_the_living(recording: Recording) -> None:
    halos = recording["fill.halos"][4]
    (arrows,) = drawn(recording, 4, "fill.halos")
    assert isinstance(arrows, Lines)
    assert len(arrows.ends) == np.count_nonzero(halos >= 0) > 0
    assert arrows.z < min(mark.z for mark in drawn(recording, 4, "holder"))  # numbers stay readable
    (counts,) = drawn(recording, 20, "guess.count")
    assert counts.of.tolist() == [0, 1, 3]
    assert list(counts.ink)[::2] == [SCALE[0], SCALE[-1]]
    (spreads,) = drawn(recording, 20, "guess.there spread")
    assert spreads.radius.tolist() == [0.0, 1.0, 3.0]


def test_the_legend_has_scales_with_ends_and_unit(recording: Recording) -> None:
    told = [sign.means for sign in signs(Scene(recording), Style(), 1.0)]
    top = float(np.nanmax(recording["fill.field"]))
    assert f"fill: field computed, 0 to {top:.3g} K" in told
    assert "guess: counted, 0 to 3" in told
    assert {"piece just taken over", "nobody computes it", "guess: its guess and spread"} <= set(told)
    without = Style(layers=frozenset(LAYERS) - {"jobs"})
    assert (frame(recording, 20, (640, 360)) != frame(recording, 20, (640, 360), without)).any()
    hidden = [sign.means for sign in signs(Scene(recording), without, 1.0)]
    assert not [one for one in hidden if one.startswith(("fill", "guess", "piece"))]


def test_pages_and_viewers_show_them_too(recording: Recording, tmp_path: Path) -> None:
    tracks = Tracks(Scene(recording))
    kinds = {(one["name"], one["kind"]) for one in tracks.words if one["layer"] == "jobs"}
    assert {
        ("fill.field", "Raster"),
        ("piece", "Polygons"),
        ("fill.halos", "Lines"),
        ("guess.count", "Circles"),
    } <= kinds
    write_mcap(recording, tmp_path / "run.mcap")
    with (tmp_path / "run.mcap").open("rb") as file:
        topics = {channel.topic for _, channel, _ in make_reader(file).iter_messages()}
    assert {"/jobs", "/jobs/fill.field"} <= topics


def test_true_sources_are_drawn_from_when_they_begin(tmp_path: Path) -> None:
    places = "{x = 1.0, y = 2.0, begin = 3.0, velocity = [0.1, 0.0]}, {x = 3.0, y = 1.0, end = 2.0}"
    found = recorded(
        tmp_path, f'field={{use = "model", model = {{use = "diffusion"}}, sources = [{places}]}}',
        'probes=[{use = "sources"}]', "stop.iterations=6",
    )  # fmt: skip
    at = {when: [mark.centre.tolist() for mark in drawn(found, when, "true_sources.place")] for when in (2, 5)}
    assert at == {2: 3 * [[[3.0, 1.0]]], 5: 3 * [[[1.2, 2.0], [3.0, 1.0]]]}


def test_true_sources_of_a_field_without_any_are_refused(tmp_path: Path) -> None:
    told = r"probes\[0\]\.use: 'sources' looks where a field's sources are; expected \[field\] use = .model"
    with pytest.raises(InputError, match=told):
        recorded(tmp_path, 'probes=[{use = "sources"}]')


def test_a_table_that_cannot_be_drawn_as_it_says_is_refused(tmp_path: Path) -> None:
    told = r"probes\[0\]\.use: 'there' is drawn as places; expected f8 of shape \('robots', 3\), within 1e\+07"
    with pytest.raises(InputError, match=told):
        recorded(tmp_path, "probes.0.wide=true")


def test_rasters_of_fields_lie_over_the_map(recording: Recording) -> None:
    scene = Scene(recording)
    names = [mark.name for mark in LayerStack(scene).draw(scene.at(20), Style()) if isinstance(mark, Raster)]
    assert names == ["known", "fill.field"]
