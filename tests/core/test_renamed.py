"""Old names are told their new ones, and these exist."""

from __future__ import annotations

from importlib import import_module, util
from pathlib import Path

import pytest
from conftest import ROOT

from swarmsim.core import renamed
from swarmsim.core.errors import InputError, PartError
from swarmsim.core.scenario.file import load
from swarmsim.core.scenario.registry import own_code
from swarmsim.engine.build import build


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
