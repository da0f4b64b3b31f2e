"""Whatever stands in a file: it is read, or refused with a message, without much time or memory."""

from __future__ import annotations

import resource
import time
import zipfile
from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from swarmsim.core.errors import InputError
from swarmsim.core.scenario.decoding import convert
from swarmsim.core.scenario.file import World, load
from swarmsim.world.indoor import imdf, osm
from swarmsim.world.reading import plan_of
from swarmsim.world.shapes import Drawing
from swarmsim.world.simulators import sdf, stage
from swarmsim.world.source import floor_plan, read_world

ROOT = Path(__file__).parents[2]
SHORT, LONG = 60, 1700  # inputs of each kind, of which there are twelve
LONGEST = 60.0  # s of this process alone: what takes one on a quick machine may take ten on a slow one
MOST = 1 << 30  # bytes more than before
QUIET = {"deadline": None, "suppress_health_check": list(HealthCheck), "derandomize": True, "database": None}

numbers = st.one_of(st.floats(), st.integers(-(10**12), 10**12), st.sampled_from(["1e999", "50%", "3cm", "", "x", "-"]))
TAGS = "svg g path rect circle ellipse line polyline polygon use symbol defs clipPath mask style text switch a image"
KEYS = (
    "id class style transform x y width height r rx ry cx cy x1 y2 d points href fill stroke stroke-width viewBox "
    "clip-path mask preserveAspectRatio display visibility opacity transform-origin data-name"
)
VALUES = (
    "walls;spawn;#walls;#a;a;url(#a);none;evenodd;0 0 9 6;rotate(45);scale(0);matrix(1e300 0 0 1e300 0 0);fill:none;"
    "M0 0H9V6Z;0,0 9,0 9,6;1e9;4"
)
tags, keys = st.sampled_from(TAGS.split()), st.sampled_from(KEYS.split())
values = st.one_of(
    st.text("MmLlHhVvCcSsQqTtAaZz0123456789.,- eE", max_size=30),
    st.sampled_from(VALUES.split(";")),
    st.text(max_size=12),
    numbers.map(str),
)


@st.composite
def elements(draw: st.DrawFn, depth: int = 3) -> str:
    tag = draw(tags)
    attributes = draw(st.dictionaries(keys, values, max_size=5))
    inside = "".join(draw(st.lists(elements(depth - 1), max_size=3))) if depth else ""
    if tag == "style":
        inside = draw(
            st.sampled_from(["*{fill:none}", "@media print{", "g > rect{stroke:red}}", "a:not(b){d:e}", "/*"])
        )
    return f"<{tag}{_attributes(attributes)}>{inside}</{tag}>"


def _attributes(table: dict[str, str]) -> str:
    plain = {key: "".join(c for c in value if c.isprintable() and c not in '<&"') for key, value in table.items()}
    return "".join(f' {key}="{value}"' for key, value in plain.items())


GEOJSON = st.sampled_from(["type", "features", "geometry", "coordinates", "bbox", "properties"])
plain = st.one_of(st.none(), st.booleans(), st.floats(), st.text(max_size=8), st.sampled_from(["Polygon", "walls"]))


def nested(depth: int) -> st.SearchStrategy:
    """Values of JSON, so deep."""
    if not depth:
        return plain
    inner = nested(depth - 1)
    return st.one_of(plain, st.lists(inner, max_size=5), st.dictionaries(GEOJSON, inner, max_size=5))


json_values = nested(4)
rings = st.lists(st.lists(st.floats(-50, 50), min_size=1, max_size=3), max_size=8)
polygons_ = st.builds(lambda ring: {"type": "Polygon", "coordinates": [ring]}, rings)


def damaged(paths: list[Path]) -> st.SearchStrategy[bytes]:
    """The bytes of one of these files with some of them changed, cut out, doubled or put in."""
    cuts = st.tuples(st.floats(0, 1), st.integers(0, 40), st.binary(max_size=6))

    def spoilt(path: Path, places: list[tuple[float, int, bytes]]) -> bytes:
        content = path.read_bytes()
        for share, gone, put in places:
            at = int(share * len(content))
            content = content[:at] + put + content[at + gone :]
        return content

    return st.builds(spoilt, st.sampled_from(paths), st.lists(cuts, min_size=1, max_size=5))


def opened(path: Path, **more: object) -> None:
    """Reads a world; a refusal is as good as a success."""
    begun, before = time.process_time(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    world = convert({"file": str(path), **more}, World)
    _refusing(lambda: floor_plan(read_world(world, 0.15), world))
    assert time.process_time() - begun < LONGEST
    assert 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) < MOST


def drawn(path: Path, read: Callable[[Path, World], Drawing]) -> None:
    """Reads a file by one reader; a refusal is as good as a success."""
    begun, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    world = World(file=str(path))
    _refusing(lambda: plan_of(read(path, world), world))
    assert time.perf_counter() - begun < LONGEST
    assert 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) < MOST


def _refusing(work: Callable[[], object]) -> None:
    """Does something that may be refused, with a message, but not fail otherwise."""
    told = "nothing"
    try:
        work()
    except InputError as problem:
        told = str(problem)
    assert told


STAGE = """define wall model ( size [2 0.2 1] )
map ( bitmap "m.png" size [16 12 1] pose [0 0 0 90] boundary 1 )
wall ( pose [1 2 0 45] block ( points 3 point[0] [0 0] point[1] [1 0] point[2] [0 1] z [0 1] ) wall ( ) )
position ( name "r" pose [1 1 0 0] )  # a robot
include "w.world"
"""
GAZEBO = """<sdf version="1.7"><world name="w"><include><uri>model://x</uri></include>
<model name="m"><pose>1 2 0.5 0.1 0.2 0.3</pose><link name="l"><pose relative_to="l">0 0 0 0 0 0</pose>
<collision name="c"><geometry><box><size>1 2 3</size></box></geometry></collision>
<collision name="d"><geometry><cylinder><radius>1</radius><length>2</length></cylinder></geometry></collision>
</link><model name="n"><link name="l"><collision name="c"><geometry><sphere><radius>1</radius></sphere></geometry>
</collision></link></model></model></world></sdf>
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a map_server pair of each kind in it."""
    folder = tmp_path_factory.mktemp("fuzz")
    levels = np.random.default_rng(2).choice([0, 205, 254], (24, 30)).astype(np.uint8)
    (folder / "m.pgm").write_bytes(b"P5\n30 24\n255\n" + levels.tobytes())
    (folder / "p.pgm").write_text("P2\n# plain\n30 24\n255\n" + " ".join(map(str, levels.ravel())))
    from PIL import Image

    Image.fromarray(levels).save(folder / "m.png")
    (folder / "m.yaml").write_text("image: m.pgm\nresolution: 0.1\norigin: [-1.5, 2, 0.3]\nnegate: 0\nmode: scale\n")
    (folder / "w.world").write_text(STAGE)
    (folder / "g.sdf").write_text(GAZEBO)
    room = {"type": "Polygon", "coordinates": [[[9.93, 53.55], [9.9301, 53.55], [9.9301, 53.5501], [9.93, 53.55]]]}
    door = {"type": "LineString", "coordinates": [[9.93, 53.55], [9.93001, 53.55]]}
    for kind, geometry, own in (("unit", room, {"category": "room"}), ("opening", door, {}), ("level", room, {})):
        feature = {"type": "Feature", "id": "a", "properties": {"level_id": "a", **own}, "geometry": geometry}
        content = msgspec.json.encode({"type": "FeatureCollection", "features": [feature, feature]})
        (folder / f"{kind}.geojson").write_bytes(content)
    with zipfile.ZipFile(folder / "v.zip", "w") as archive:
        for kind in ("unit", "opening", "level"):
            archive.write(folder / f"{kind}.geojson", f"{kind}.geojson")
    corners = ((9.93, 53.55), (9.9301, 53.55), (9.9301, 53.5501), (9.93, 53.5501))
    nodes = "".join(f'<node id="{k}" lon="{x}" lat="{y}"/>' for k, (x, y) in enumerate(corners))
    refs = "".join(f'<nd ref="{k}"/>' for k in (0, 1, 2, 3, 0))
    way = f'<way id="7">{refs}<tag k="indoor" v="room"/><tag k="level" v="0-2"/></way>'
    member = '<relation id="8"><member type="way" ref="7" role="outer"/><tag k="type" v="multipolygon"/></relation>'
    (folder / "m.osm").write_text(f"<osm>{nodes}{way}{member}</osm>")
    return folder


def _fuzzed(kind: str, folder: Path, count: int) -> Callable[[], None]:
    """A function that tries so many inputs of a kind."""
    drawings = sorted((ROOT / "worlds").glob("*.svg")) + sorted((ROOT / "tests" / "worlds").glob("*.svg"))
    small = [path for path in drawings if path.stat().st_size < 40_000]
    scenarios = sorted((ROOT / "scenarios").rglob("*.toml"))
    root = 'xmlns="http://www.w3.org/2000/svg" viewBox="0 0 12 8"'

    def tried(strategy: st.SearchStrategy, name: str, **more: object) -> Callable[[], None]:
        @settings(max_examples=count, **QUIET)
        @given(strategy)
        def attempt(content: bytes | str) -> None:
            raw = content if isinstance(content, bytes) else content.encode(errors="replace")
            (folder / name).write_bytes(raw)
            if name.endswith(".toml"):
                _refusing(lambda: load(folder / name))
            else:
                opened(folder / name, **more)

        return attempt

    def read(source: str, name: str, reader: Callable[[Path, World], Drawing]) -> Callable[[], None]:
        @settings(max_examples=count, **QUIET)
        @given(damaged([folder / source]))
        def attempt(content: bytes) -> None:
            (folder / name).write_bytes(content)
            drawn(folder / name, reader)

        return attempt

    made = st.lists(elements(), max_size=5).map(lambda parts: f"<svg {root}>{''.join(parts)}</svg>")
    written = st.one_of(json_values, polygons_).map(lambda value: msgspec.json.encode(_finite(value)))
    return {
        "svg made": tried(made, "a.svg"),
        "svg damaged": tried(damaged(small), "b.svg"),
        "pgm": tried(damaged([folder / "m.pgm", folder / "p.pgm"]), "c.pgm", resolution=0.1),
        "png": tried(damaged([folder / "m.png"]), "d.png", resolution=0.1),
        "yaml": tried(damaged([folder / "m.yaml"]), "e.yaml"),
        "geojson": tried(written, "f.geojson"),
        "scenario": tried(damaged(scenarios), "g.toml"),
        "indoor": tried(damaged([folder / "unit.geojson"]), "h.geojson"),
        "osm": read("m.osm", "i.osm", osm.read),
        "imdf": read("v.zip", "j.zip", imdf.read),
        "stage": read("w.world", "k.world", stage.read),
        "sdf": read("g.sdf", "l.sdf", sdf.read),
    }[kind]


def _finite(value: object) -> object:
    """The same with 1e308 for what JSON cannot hold."""
    if isinstance(value, float):
        return value if np.isfinite(value) else 1e308
    if isinstance(value, list):
        return [_finite(one) for one in value]
    return {key: _finite(one) for key, one in value.items()} if isinstance(value, dict) else value


KINDS = (
    "svg made",
    "svg damaged",
    "pgm",
    "png",
    "yaml",
    "geojson",
    "scenario",
    "indoor",
    "osm",
    "imdf",
    "stage",
    "sdf",
)


@pytest.mark.parametrize("kind", KINDS)
def test_any_input_is_read_or_refused(kind: str, folder: Path) -> None:
    _fuzzed(kind, folder, SHORT)()


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_twenty_thousand_inputs_are_read_or_refused(kind: str, folder: Path) -> None:
    _fuzzed(kind, folder, LONG)()
