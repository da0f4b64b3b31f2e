"""Parts of a scenario: typed once, equal by their keys, and kept as tables where they are not installed."""

from __future__ import annotations

import copy
import pickle
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any, get_args, get_origin

import msgspec
import pytest
from conftest import ROOT, made

from swarmsim.core.errors import InputError
from swarmsim.core.scenario import decoding, registry
from swarmsim.core.scenario import part as asked
from swarmsim.core.scenario.file import Scenario, all_parts, load, shape, table_of
from swarmsim.core.scenario.part import NONE, Part, seam_of
from swarmsim.core.scenario.robots import Group
from swarmsim.core.seams import SEAMS
from swarmsim.engine import build as engine

OWN = '''
from msgspec import Struct


class Own(Struct, frozen=True):
    """A mind with keys of its own, one of which is called as mapping's."""

    share: dict[str, float] = {}
    weights: list[float] = []

    def build(self, context):
        raise RuntimeError(f"share {self.share}")
'''
KINDS = [(seam, name, kind) for seam in SEAMS for name, kind in registry.known(seam).items()]
SCENARIOS = ["basilica", "faults/blind", "merging", "moving-field"]


@pytest.mark.parametrize("name", [name for name in SCENARIOS if (ROOT / "scenarios" / f"{name}.toml").is_file()])
def test_each_part_is_decoded_once_for_a_run(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """From the file to the end of the recording; it was two to eight times."""
    decoded: Counter[tuple[str, str | None]] = Counter()
    one = asked.parameters_of

    def counted(seam: str, use: str | None, keys: Mapping[str, Any]) -> msgspec.Struct:
        decoded[seam, use] += 1
        return one(seam, use, keys)

    monkeypatch.setattr(asked, "parameters_of", counted)
    run = made("stop.iterations=2", scenario=name)
    with run.recorder(tmp_path / "recording.h5") as recorder:
        run.simulation.run([recorder])
    named = Counter((one.seam, one.use) for part in all_parts(run.scenario) for one in part.inside())
    assert decoded
    assert all(count <= named[key] for key, count in decoded.items()), decoded


@pytest.mark.parametrize(("seam", "name", "kind"), KINDS, ids=[f"{seam} {name}" for seam, name, _ in KINDS])
def test_our_parameters_can_be_hashed(seam: str, name: str, kind: type[msgspec.Struct]) -> None:
    """Whatever their keys hold: no list, and no table that is not a struct or a part."""
    assert kind.__struct_config__.frozen
    for field in msgspec.structs.fields(kind):
        _check_hashable(field.type, f"{seam} {name}: {field.name}")


def _check_hashable(kind: Any, place: str) -> None:
    assert get_origin(kind) not in (list, dict, set), place
    assert kind not in (list, dict, set), place
    for inner in get_args(kind):
        _check_hashable(inner, place)


def test_parts_in_structs_are_of_the_seam_that_their_type_says() -> None:
    found = 0
    for kind in (Scenario, *(kind for _, _, kind in KINDS)):
        for field in msgspec.structs.fields(kind):
            if get_origin(field.type) is Part and isinstance(field.default, Part) and field.default:
                assert field.default.seam == seam_of(field.type), field.name
                found += 1
    assert found >= 10
    assert all(seam.place[0] in Group.__struct_fields__ for seam in SEAMS.values() if seam.of_groups)


def test_parts_are_equal_and_hashed_by_all_their_keys() -> None:
    plain = Part[Any]("topology", {"use": "knn", "k": 2})
    complete = Part[Any]("topology", {"use": "knn", "k": 2, "mutual": False}).decoded()
    assert plain == complete
    assert hash(plain) == hash(complete)
    assert plain != Part("topology", {"use": "knn", "k": 3})
    assert plain.table == {"use": "knn", "k": 2}
    assert complete.table == {"use": "knn", "k": 2, "mutual": False, "periodic": False}


def test_scenarios_can_be_hashed_and_copied_and_sent_to_another_process() -> None:
    for name in SCENARIOS[:3]:
        scenario = load(ROOT / "scenarios" / f"{name}.toml")
        sent = pickle.loads(pickle.dumps(scenario))
        assert sent == scenario == copy.deepcopy(scenario)
        assert hash(sent) == hash(scenario)
        assert not {"layers", "generate"} & table_of(sent)["world"].keys() - table_of(scenario)["world"].keys()
    assert pickle.loads(pickle.dumps(NONE)) is NONE


def test_parts_of_others_are_hashed_whatever_their_keys_hold(tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(OWN)
    table = {"use": f"{tmp_path}/own.py:Own", "share": {"a": 1.0}, "weights": [1.0, 2.0]}
    with registry.own_code(True):
        first, again = Part[Any]("computation", table), Part[Any]("computation", dict(table))
        assert hash(first) == hash(again)
        assert first == again
        assert first != Part("computation", {**table, "weights": [3.0]})


def test_a_key_called_share_is_a_computations_own_business(tmp_path: Path) -> None:
    """What is shared is a part by the type of the key, not by what it is called."""
    (tmp_path / "own.py").write_text(OWN)
    own = f"{tmp_path}/own.py:Own"
    with registry.own_code(True):
        part = load(
            ROOT / "scenarios" / "room.toml", [f'mind.computation={{use="{own}", share={{use=2.0}}}}']
        ).mind.computation
        assert [one.seam for one in part.inside()] == ["computation"]
        with pytest.raises(
            InputError, match=r"mind.computation.use: .* cannot be built: RuntimeError: share {'use': 2"
        ):
            made(f'mind.computation={{use="{own}", share={{use=2.0}}}}')


def test_what_is_not_installed_keeps_its_table() -> None:
    table = table_of(load(ROOT / "scenarios" / "room.toml"))
    theirs = {"use": "nobody-has-this", "reach": 2.0, "keys": [1, {"a": "b"}]}
    table["sensor"] = theirs
    scenario = shape(table, "recording")
    assert scenario.sensor.use == "nobody-has-this"
    assert scenario.sensor.table == theirs
    assert table_of(scenario) == table
    assert scenario.sensor.declares("margin", 12) == 12
    assert hash(scenario) == hash(shape(table, "recording"))
    with pytest.raises(InputError, match=r"x: sensor.use: no sensor is called 'nobody-has-this'"):
        engine.build(scenario, "x")


def test_nothing_is_looked_for_when_a_recording_is_opened(monkeypatch: pytest.MonkeyPatch) -> None:
    table = table_of(load(ROOT / "scenarios" / "faults" / "blind.toml"))
    monkeypatch.setattr(registry, "find", lambda seam, use: pytest.fail(f"{seam} {use} was looked for"))
    assert table_of(shape(table, "recording")) == table


def test_parts_say_what_others_need_to_know() -> None:
    def says(seam: str, name: str, default: object, **keys: Any) -> object:
        return Part[Any](seam, keys).declares(name, default)

    assert says("physics", "walled", False)
    assert not says("physics", "walled", False, use="particles")
    assert says("channel", "perfect", False)
    slow = {"use": "latency", "delay": 2.0}
    assert says("channel", "delays", False, **slow)
    assert says("channel", "delays", False, use="range", metres=1.0, over=slow)
    assert not says("channel", "delays", True, use="range", metres=1.0)
    assert says("computation", "merges", False, sharing={"use": "merge"})
    assert not says("computation", "merges", False)
    assert says("fault", "mark", "fault", use="remove", at=1) == "removed"
    assert NONE.declares("noise", 0.0) == 0.0


def test_keys_of_other_types_than_parts_are_told_by_their_type() -> None:
    class Colour:
        pass

    lamp = msgspec.defstruct("Lamp", [("colour", Colour)])
    with pytest.raises(InputError, match=r"^colour: expected `Colour`, got `dict`$"):
        decoding.convert({"colour": {"red": 1.0}}, lamp)
