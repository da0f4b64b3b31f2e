"""Old names are told their new ones, and these exist."""

from __future__ import annotations

import tomllib
from copy import deepcopy
from importlib import import_module, util
from pathlib import Path

import pytest
from conftest import ROOT

from swarmsim.core import renamed
from swarmsim.core.errors import InputError, PartError
from swarmsim.core.scenario.file import load
from swarmsim.core.scenario.registry import own_code
from swarmsim.engine.build import build
from swarmsim.recording.recorder import text_of


def run_with(folder: Path, code: str, key: str = "mind") -> None:
    (folder / "mine.py").write_text(code)
    with own_code(True):
        room = ROOT / "scenarios" / "room.toml"
        name = str(folder / "mine.py")
        keys = [f"{key}={{use='{name}:Mine'}}", "task={use='travelled',distance=1.0}", "stop.iterations=2"]
        run = build(load(room, keys), str(room))
        run.simulation.run([])


@pytest.mark.parametrize("old", sorted(renamed.OF_MODULES))
def test_modules_stand_where_their_old_names_point_to(old: str) -> None:
    assert util.find_spec(renamed.OF_MODULES[old]) is not None
    now = import_module(renamed.OF_MODULES[old])
    assert old == "swarmsim.core.code" or now.__name__ != old


@pytest.mark.parametrize(
    ("code", "words"),
    [
        ("from swarmsim.core.setting import Setting", "'swarmsim.core.setting' is called 'swarmsim.core.context' now"),
        ("from swarmsim.core.context import Setting", "'Setting' is called 'BuildContext' now"),
        ("class Mine:\n    says = {'x': 'f8'}\n    def step(self, me): ...", "says is called message_fields now"),
        ("class Mine:\n    shows = ('x',)\n    def step(self, me): ...", "shows is called recorded now"),
        ("class Mine:\n    def step(self, me): me.knows", "'knows' is called 'knowledge' now"),
        ("class Mine:\n    def step(self, me): me.reads.bump", "'reads' is called 'readings' now"),
    ],
)
def test_old_names_are_refused_with_the_new_one(tmp_path: Path, code: str, words: str) -> None:
    with pytest.raises((InputError, PartError), match=words):
        run_with(tmp_path, code)


def test_a_part_with_an_old_verb_is_told_the_new_one(tmp_path: Path) -> None:
    code = """
from msgspec import Struct
class Mine(Struct, frozen=True):
    def build(self, context):
        return Old()
class Old:
    reads = object
    def step(self, senses, inbox, knowledge): ...
"""
    with pytest.raises(
        InputError, match="lacks requires_knowledge; expected a strategy; 'reads' is called 'requires_knowledge' now"
    ):
        run_with(tmp_path, code, "mind.strategy")


@pytest.mark.parametrize(
    ("key", "words"),
    [
        ("faults=[{use='crash', at=3, lasts=2}]", r"faults\[0\]\.lasts: is called duration now"),
        ("faults=[{use='crash', at=3, keep=0}]", r"faults\[0\]\.keep: is called min_alive now"),
        ("faults=[{use='crash', at=3, choose='hub'}]", r"faults\[0\]\.choose: is called target now"),
        ("faults=[{use='crash', at=3, share=0.5}]", r"faults\[0\]\.share: is called fraction now"),
        ("mind.computation.share={use='gossip'}", "mind.computation.share: is called sharing now"),
        ("stop.when_done='go-on'", "stop.when_done: .*expected 'continue' or 'stop'"),
        ("faults=[{use='door', at=3, share=0.5, box=[0, 0, 1, 1]}]", r"faults\[0\]\.share: unknown key"),
    ],
)
def test_old_keys_are_refused_with_the_new_one(key: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        load(ROOT / "scenarios" / "room.toml", [key])


def test_recorded_scenarios_are_read_in_new_words() -> None:
    """Recordings keep the words of their day."""
    today = tomllib.loads(text_of(load(ROOT / "scenarios" / "faults" / "partition.toml")))
    old = deepcopy(today)
    old["mind"]["computation"]["share"] = old["mind"]["computation"].pop("sharing")
    old["stop"]["when_done"] = today["stop"]["when_done"] = "go-on"
    for fault in old["faults"]:
        fault["lasts"] = fault.pop("duration")
    assert "lasts" in old["faults"][0]
    assert renamed.in_new_words(old) == {**today, "stop": {**today["stop"], "when_done": "continue"}}
