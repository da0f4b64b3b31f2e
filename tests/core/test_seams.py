"""The table of seams: everything that has to go with a row is there, and one more row is seen everywhere."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Protocol, get_args, get_origin

import jsonschema
import msgspec
import pytest
from conftest import ROOT
from typer.testing import CliRunner

from swarmsim.api import skeletons
from swarmsim.cli import app
from swarmsim.core.adapters.forms import FunctionForm
from swarmsim.core.code import distributions
from swarmsim.core.errors import InputError
from swarmsim.core.scenario import describe, file, registry, schema
from swarmsim.core.scenario.part import Part as Asked
from swarmsim.core.scenario.part import seam_of
from swarmsim.core.seams import PLACED, SEAMS, Seam
from swarmsim.core.state import State
from swarmsim.engine import promises
from swarmsim.engine.build import build
from swarmsim.engine.foreign import built


def places_of_parts(kind: type[msgspec.Struct], place: tuple[str, ...] = ()) -> set[tuple[str, tuple[str, ...]]]:
    """The seams of parts in a scenario by their type, and where these or lists of them are."""
    found: set[tuple[str, tuple[str, ...]]] = set()
    for one in msgspec.structs.fields(kind):
        here = (*place, one.name)
        part = get_args(one.type)[0] if get_origin(one.type) is tuple else one.type
        if get_origin(part) is Asked:
            found.add((seam_of(part), here))
        elif isinstance(one.type, type) and issubclass(one.type, msgspec.Struct):
            found |= places_of_parts(one.type, here)
    return found


def test_every_seam_has_its_field_in_scenarios_and_its_entry_points() -> None:
    places = {(seam.name, seam.place) for seam in SEAMS.values() if seam.place}
    places |= {(seam.name, (seam.more,)) for seam in SEAMS.values() if seam.more}
    assert places == places_of_parts(file.Scenario)
    groups = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["entry-points"]
    assert set(groups) == {"swarmsim.seam", *(seam.group for seam in SEAMS.values())}
    for seam in SEAMS.values():
        assert seam.default is None or seam.default in groups[seam.group], seam.name


def test_every_seam_has_a_skeleton_or_a_reason_why_not() -> None:
    kinds = set(skeletons.kinds()) - {"mind"}
    assert kinds | set(skeletons.WITHOUT) == {*PLACED, "transport"}
    assert not kinds & set(skeletons.WITHOUT)
    with pytest.raises(InputError, match=r"new physics: .*start from swarmsim/robots/particles\.py"):
        skeletons.new("physics", "mine")
    with pytest.raises(InputError, match=r"new sharing: .*start from swarmsim/operations/mapping/sharing/policies\.py"):
        skeletons.new("sharing", "mine")
    check_files_in(skeletons.WITHOUT)


def test_every_seam_has_its_contract_checked_or_a_reason_why_not() -> None:
    assert set(promises.CHECKS) | set(promises.WITHOUT) == set(PLACED)
    assert not set(promises.CHECKS) & set(promises.WITHOUT)
    check_files_in(promises.WITHOUT)


def check_files_in(reasons: Mapping[str, str]) -> None:
    """Files that reasons name are there."""
    for reason in reasons.values():
        for word in reason.split():
            assert not word.startswith("swarmsim/") or (ROOT / word).is_file(), word


def test_the_page_about_parts_has_the_table_of_seams_and_what_there_is_to_start_from() -> None:
    page = (ROOT / "docs" / "parts.md").read_text()
    assert describe.seams_in_markdown() in page
    kinds = skeletons.kinds()
    assert f"knows {', '.join(kinds[:-1])} and {kinds[-1]}." in page
    told = CliRunner(env={"COLUMNS": "200"}).invoke(app, ["new", "--help"]).output
    assert f"{', '.join(kinds[:-1])} or {kinds[-1]}." in " ".join(told.split())


def test_our_parts_have_what_their_seams_ask_for() -> None:
    parts = build(file.load(ROOT / "scenarios" / "room.toml"), "room.toml").simulation.parts
    for name, seam in SEAMS.items():
        part = {"physics": parts.bodies}.get(name) or getattr(parts, name, None)
        assert part is None or seam.missing(part) == [], name


def test_verbs_are_those_of_the_protocol_and_properties_are_not_asked_for() -> None:
    class Base(Protocol):
        colour: str

        @property
        def codec(self) -> int: ...

    class Wider(Base, Protocol):
        def shine(self) -> None: ...

    class Part:
        @property
        def codec(self) -> int:
            raise RuntimeError("not there before the first message")

        def __getattr__(self, name: str) -> object:  # as a wrapper passes things on
            if name == "shine":
                return print
            raise AttributeError(name)

    seam = Seam("lamp", ("lamp",), Wider)
    assert seam.verbs == ("colour", "codec", "shine")
    assert seam.missing(Part()) == ["colour"]


class Beacon(Protocol):
    """Shines for robots to see."""

    def shine(self, state: State) -> float:
        """How bright it is."""
        ...


class FunctionBeacon(FunctionForm):
    def shine(self, state: State) -> float:
        return float(self._ask(state))


class Lamp(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A lamp that never goes out."""

    power: float = 2.0  # W

    def build(self, context: object) -> object:
        return object()


class Wider(file.Scenario, frozen=True, forbid_unknown_fields=True, kw_only=True):
    beacon: Asked[Beacon] = Asked("beacon")


@pytest.fixture
def beacon(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Path]:
    """One more seam: a row, a Protocol, a field of scenarios, a distribution with an entry point and a skeleton."""
    monkeypatch.setitem(PLACED, "beacon", Seam("beacon", ("beacon",), Beacon, "lamp", function=FunctionBeacon))
    for module in (file, schema):
        monkeypatch.setattr(module, "Scenario", Wider)
    installed = tmp_path / "lamps-1.0.dist-info"
    installed.mkdir()
    (installed / "METADATA").write_text("Metadata-Version: 2.1\nName: lamps\nVersion: 1.0\n")
    (installed / "entry_points.txt").write_text(f"[swarmsim.beacon]\nlamp = {__name__}:Lamp\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    distributions.parts.cache_clear()
    folder = tmp_path / "skeletons"
    folder.mkdir()
    (folder / "beacon.txt").write_text("def $name(state, *, power: float = 1.0):\n    return power\n")
    monkeypatch.setattr(skeletons, "_HERE", folder)
    room = (ROOT / "scenarios" / "room.toml").read_text().replace("../worlds", str(ROOT / "worlds"))
    path = tmp_path / "room.toml"
    path.write_text(room)
    yield path
    distributions.parts.cache_clear()


def test_one_more_seam_is_seen_by_registry_scenario_and_schema(beacon: Path) -> None:
    assert registry.known("beacon") == {"lamp": Lamp}
    read = file.load(beacon)
    assert file.parts_of(read)["beacon"].table == {"use": "lamp", "power": 2.0}
    assert file.table_of(read)["beacon"] == {"use": "lamp", "power": 2.0}
    assert file.parts_of(file.load(beacon, ["beacon.power=3"]))["beacon"].parameters == Lamp(power=3.0)
    with pytest.raises(InputError, match=r"room\.toml: beacon\.powr: unknown key; did you mean 'power'"):
        file.load(beacon, ["beacon.powr=3"])
    with pytest.raises(InputError, match=r"'full' is not what beacon\.power takes: a number"):
        file.load(beacon, ["beacon.power=full"])
    table = tomllib.loads(beacon.read_text())
    jsonschema.validate({**table, "beacon": {"use": "lamp", "power": 1.0}}, schema.schema())
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate({**table, "beacon": {"use": "lamp", "power": "full"}}, schema.schema())


def test_one_more_seam_is_held_to_its_protocol_and_takes_functions(beacon: Path, tmp_path: Path) -> None:
    run = build(file.load(ROOT / "scenarios" / "room.toml"), "room.toml")
    with pytest.raises(InputError, match=r"use: what 'lamp' builds, .*object, lacks shine; expected a beacon"):
        built(Asked[Beacon]("beacon", {"use": "lamp"}), run.context)
    (tmp_path / "mine.py").write_text("def mine(state, *, power: float = 4.0):\n    return power\n")
    with registry.own_code(True):
        part = built(Asked[Beacon]("beacon", {"use": f"{tmp_path}/mine.py:mine"}), run.context)
    assert part.shine(run.simulation.state) == 4.0


def test_one_more_seam_is_told_listed_and_started_from(beacon: Path, tmp_path: Path) -> None:
    assert "| beacon | `[beacon]` | `lamp` | Shines for robots to see | `shine` |" in describe.seams_in_markdown()
    (described,) = describe.parts("beacon")
    assert (described.name, described.default, described.origin) == ("lamp", True, "lamps 1.0")
    printed = CliRunner(env={"COLUMNS": "200"}).invoke(app, ["parts"]).output
    assert "beacon (* is the default)" in printed
    assert "A lamp that never goes out." in printed
    made = CliRunner().invoke(app, ["new", "beacon", "mine", "--to", str(tmp_path)])
    assert '[beacon] use = "./mine.py:mine"' in made.output
    assert 'beacon = {use = "HERE/mine.py:mine"}' in (tmp_path / "test_mine.py").read_text()


class Battery(Protocol):
    """Says how long a lamp burns."""

    def lasts(self) -> float:
        """For so many s."""
        ...


class Cell(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A cell that is empty some day."""

    energy: float = 3.0  # J

    def build(self, context: object) -> object:
        return object()


class Torch(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A topology with a battery in it."""

    battery: Asked[Battery] = Asked("battery")

    def build(self, context: object) -> object:
        return self.battery.build(context, "battery")


BATTERY = Seam("battery", (), Battery, "cell")
NO_SEAM = Seam("battery", ("lamp",), Battery)


@pytest.fixture
def declared(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Callable[[str], None]]:
    """Installs a distribution that declares a seam of its own, a part of it, and a part that such parts stand in."""

    def install(seam: str) -> None:
        installed = tmp_path / "torches-1.0.dist-info"
        installed.mkdir()
        (installed / "METADATA").write_text("Metadata-Version: 2.1\nName: torches\nVersion: 1.0\n")
        groups = {"seam": f"battery = {__name__}:{seam}", "battery": f"cell = {__name__}:Cell"}
        groups["topology"] = f"torch = {__name__}:Torch"
        lines = "".join(f"[swarmsim.{group}]\n{line}\n" for group, line in groups.items())
        (installed / "entry_points.txt").write_text(lines)
        monkeypatch.syspath_prepend(str(tmp_path))
        distributions.parts.cache_clear()

    yield install
    distributions.parts.cache_clear()


def test_a_distribution_can_declare_a_seam_for_parts_in_its_parts(declared: Callable[[str], None]) -> None:
    declared("BATTERY")
    assert list(SEAMS)[-7:] == ["adapter", "battery", "figure", "method", "model", "sharing", "transport"]
    assert registry.known("battery") == {"cell": Cell}
    read = file.load(ROOT / "scenarios" / "room.toml", ['network.topology={use="torch"}'])
    assert read.network.topology.table == {"use": "torch", "battery": {"use": "cell", "energy": 3.0}}
    with pytest.raises(
        InputError, match=r"topology\.battery\.use: what 'cell' builds, .*lacks lasts; expected a battery"
    ):
        build(read, "room.toml")
    with pytest.raises(InputError, match=r"network\.topology\.battery\.enrgy: unknown key; did you mean 'energy'"):
        file.load(ROOT / "scenarios" / "room.toml", ['network.topology={use="torch", battery={enrgy=1}}'])
    choices = {one["properties"]["use"].get("const"): one for one in schema.schema()["$defs"]["topology"]["anyOf"]}
    assert choices["torch"]["properties"]["battery"]["$ref"] == "#/$defs/battery"
    assert "| battery | in another part's table | `cell` | Says how long a lamp burns |" in describe.seams_in_markdown()
    assert (
        "A cell that is empty some day." in CliRunner(env={"COLUMNS": "200"}).invoke(app, ["parts", "battery"]).output
    )


def test_what_is_declared_as_a_seam_and_is_none_is_refused(declared: Callable[[str], None]) -> None:
    declared("NO_SEAM")
    with pytest.raises(
        InputError, match=r"^swarmsim\.seam battery: .*:NO_SEAM is Seam.*; expected a Seam of this name"
    ):
        list(SEAMS)
    assert file.load(ROOT / "scenarios" / "room.toml").network.topology.use  # which needs none of them


def test_seams_are_found_without_compiled_kernels() -> None:
    words = "import sys; from swarmsim.core.seams import SEAMS; print('sharing' in SEAMS, 'numba' in sys.modules)"
    told = subprocess.run([sys.executable, "-c", words], capture_output=True, text=True, check=True)
    assert told.stdout.split() == ["True", "False"]
