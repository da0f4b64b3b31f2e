"""Drawings in the styles of many programs, against areas from formulas and against a rasteriser; and broken ones."""

from __future__ import annotations

import gzip
import io
import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import resvg_py
from drawn import read_floor_plan
from PIL import Image
from scipy import ndimage

from swarmsim.core.errors import InputError
from swarmsim.core.scenario.decoding import convert
from swarmsim.core.scenario.file import World
from swarmsim.world.arena import Arena
from swarmsim.world.plan import FloorPlan
from swarmsim.world.source import floor_plan, read_world

WORLDS = Path(__file__).parents[1] / "worlds"
DRAWINGS = tomllib.loads((WORLDS / "drawings.toml").read_text(encoding="utf-8"))
BROKEN = tomllib.loads((WORLDS / "broken.toml").read_text(encoding="utf-8"))
ACROSS, FINE = 48, 8  # cells across a page, pixels across a cell


def opened(name: str) -> FloorPlan:
    world = convert({"file": str(WORLDS / name), **DRAWINGS[name].get("world", {})}, World)
    return floor_plan(read_world(world, 0.15), world)


def test_there_are_as_many_as_promised() -> None:
    assert len(DRAWINGS) >= 30
    assert len(BROKEN) >= 20
    assert {path.name for path in WORLDS.glob("*.svg")} == set(DRAWINGS)


@pytest.mark.parametrize("name", DRAWINGS)
def test_a_drawing_has_its_area(name: str) -> None:
    assert opened(name).walls.area == pytest.approx(DRAWINGS[name]["area"], rel=0.005)


@pytest.mark.parametrize("name", [name for name, said in DRAWINGS.items() if said.get("raster", True)])
def test_a_rasteriser_sees_the_same_cells(name: str) -> None:
    plan = opened(name)
    cell = plan.width / ACROSS
    arena = Arena.open(plan, cell, 1, name)
    rows = round(plan.height / cell)
    first = arena.lattice.cells(np.array([plan.page[0] + cell / 2, plan.page[1] + cell / 2]))
    occupied = arena.occupied[first[0] : first[0] + rows, first[1] : first[1] + ACROSS]
    text = read_world(World(file=str(WORLDS / name)), 0.15)
    text = text[text.index("<s") :] if "ENTITY" not in text else text  # a declared encoding is no longer true
    if hide := DRAWINGS[name].get("hide"):
        text = re.sub(hide, "", text, count=1, flags=re.DOTALL)
    text = re.sub(r'(width|height)="(\d+)(mm|cm|in)"', r'\1="\2"', text, count=2)  # it refuses pages as large as houses
    drawn = resvg_py.svg_to_bytes(svg_string=text, width=ACROSS * FINE, height=rows * FINE, skip_system_fonts=True)
    alpha = np.asarray(Image.open(io.BytesIO(drawn)).convert("RGBA"))[::-1, :, 3]
    assert alpha.shape == (rows * FINE, ACROSS * FINE)
    # A cell is no boundary cell if all of its pixels, and those around it, are alike: slivers leave no trace in 8 bits.
    full, empty = (
        ~ndimage.binary_dilation(pixels, np.ones((3, 3))).reshape(rows, FINE, ACROSS, FINE).any(axis=(1, 3))
        for pixels in (alpha == 0, alpha > 0)
    )
    assert full.sum() + empty.sum() > 0.5 * full.size
    assert occupied[full].all()
    assert not occupied[empty].any()


def _read(file: str, keys: dict[str, Any]) -> None:
    world = convert({"file": file, **keys}, World)
    floor_plan(read_world(world, 0.15), world)


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_drawing_is_refused_with_the_reason(name: str) -> None:
    with pytest.raises(InputError) as caught:
        _read(str(WORLDS / "broken" / name), BROKEN[name].get("world", {}))
    for words in BROKEN[name]["says"]:
        assert words in str(caught.value)


def test_what_is_passed_over_is_told_in_one_notice_each() -> None:
    assert opened("cad-inches.svg").notices == ()
    (text,) = opened("text.svg").notices
    assert "1 <image>, 1 <text> are passed over" in text
    paper, whole = opened("no-layers.svg").notices
    assert "all 2 visible shapes are walls" in whole
    assert "<rect> number 1 (line 1) fills the page and is taken for its paper" in paper
    assert any(
        "(max-width: 9px)" in notice for notice in _with_style("@media (max-width: 9px) { path { fill: none } }")
    )
    assert any("imports another one" in notice for notice in _with_style("@import url(other.css);"))
    assert any("'path:nonsense(3)'" in notice for notice in _with_style("path:nonsense(3) { fill: none }"))


def _with_style(sheet: str) -> tuple[str, ...]:
    plan = read_floor_plan(f'<svg viewBox="0 0 4 4"><style>{sheet}</style><path d="M0 0H2V2Z"/></svg>', "w.svg")
    assert plan.walls.area == pytest.approx(2.0)
    return plan.notices


def test_spawn_areas_of_a_drawing_without_them() -> None:
    largest = opened("fill-rules.svg").spawns["spawn"]
    assert largest.area == pytest.approx(77 - 9 - 9)
    world = World(file=str(WORLDS / "fill-rules.svg"), spawn=(1.0, 5.5, 2.0, 1.0))
    assert floor_plan(read_world(world, 0.15), world).spawns["spawn"].bounds == (1.0, 5.5, 3.0, 6.5)


def test_a_compressed_drawing_is_unpacked_within_bounds(tmp_path: Path) -> None:
    text = (WORLDS / "arcs.svg").read_bytes()
    (tmp_path / "a.svgz").write_bytes(gzip.compress(text))
    world = World(file=str(tmp_path / "a.svgz"))
    assert floor_plan(read_world(world, 0.15), world).walls.equals(opened("arcs.svg").walls)
    for content, message in (
        (gzip.compress(bytes(70_000_000)), "unpacks to more than 64 MB"),
        (gzip.compress(text)[:-20], "broken gzip"),
        (b"\x1f\x8b nothing", "broken gzip"),
    ):
        (tmp_path / "a.svgz").write_bytes(content)
        with pytest.raises(InputError, match=message):
            read_world(world, 0.15)


@pytest.mark.parametrize(
    "name", ["walls", "Walls", " WALLS ", "walls_1_", "Walls-2", "walls copy", "Walls_copy_3", "walls_x20_", "_walls_"]
)
def test_a_layer_is_known_however_programs_write_its_name(name: str) -> None:
    plan = read_floor_plan(f'<svg viewBox="0 0 9 9"><g id="{name}"><path d="M0 0H2V2Z"/></g><circle r="4"/></svg>', "w")
    assert plan.walls.area == pytest.approx(2.0)
