"""The reference is whole, and says what the code says. `python tests/api/test_reference.py` makes its pages anew."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import msgspec
import pytest
from conftest import ROOT, called

from swarmsim.api import reference
from swarmsim.core.errors import InputError
from swarmsim.core.events import Happened
from swarmsim.core.scenario import describe, registry
from swarmsim.core.scenario.boards import BOARDS
from swarmsim.core.scenario.file import Scenario, load
from swarmsim.core.scenario.platforms import PLATFORMS
from swarmsim.core.scenario.schema import schema
from swarmsim.core.seams import SEAMS
from swarmsim.studies.plan import Study

PAGES = {"docs/keys.md": reference.keys_in_markdown, "docs/part-keys.md": reference.parts_in_markdown}
KEYS = {one.key: one for one in (*reference.scenario_keys(), *reference.study_keys())}


@pytest.mark.parametrize("page", PAGES)
def test_the_pages_are_those_of_the_code(page: str) -> None:
    assert (ROOT / page).read_text() == PAGES[page]()


def structs(kind: type[msgspec.Struct], found: dict[type, None]) -> None:
    """All structs of tables within a struct, found by msgspec's own schema and not by the reference."""
    info = msgspec.inspect.type_info(kind)
    found[kind] = None
    pending = [field.type for field in info.fields]
    while pending:
        one = pending.pop()
        pending += [getattr(one, name) for name in ("type", "item_type") if hasattr(one, name)]
        pending += getattr(one, "types", ())
        if isinstance(one, msgspec.inspect.StructType) and one.cls not in found:
            structs(one.cls, found)


def test_no_key_is_missing_and_each_has_a_meaning() -> None:
    found: dict[type, None] = {}
    structs(Scenario, found)
    structs(Study, found)
    assert len(found) > 12
    page = (ROOT / "docs/keys.md").read_text()
    for kind in found:
        for name in kind.__struct_fields__:
            assert name == "groups" or re.search(rf"^\| `(?:[\w.\[\]]+\.)?{name}` \|", page, re.MULTILINE), (kind, name)
    assert {key for key, one in KEYS.items() if not one.meaning} == set()


def test_no_part_preset_event_or_exit_code_is_missing() -> None:
    keys, parts = ((ROOT / page).read_text() for page in PAGES)
    for seam in SEAMS:
        for name, entry in registry.entries(seam).items():
            assert f"### {seam}.{name}\n" in parts or entry.dist.name != "swarmsim-lab"
    described = [one for one in describe.parts() if one.origin.startswith("swarmsim-lab ")]
    assert parts.count("\n### ") == len(described)
    for each in (one for part in described for one in part.parameters):
        assert f"| `{each.key}` |" in parts
    events = [kind.__struct_config__.tag for kind in Happened.__subclasses__()]
    for name in (*PLATFORMS, *BOARDS, *events):
        assert f"| `{name}` |" in keys
    told = "".join(path.read_text() for path in ROOT.glob("swarmsim/cli/*.py")) + (ROOT / "README.md").read_text()
    for code in {int(one) for one in re.findall(r"\b[Ee]xit code (\d+)|; (\d): ", told) for one in one if one}:
        assert code in reference.EXIT_CODES


#: Keys that contradict others of the small room, with what makes room for them.
BESIDE = {
    "world.generate": 'world={generate={use = "rooms"}}', "world.file": 'world={file="house"}',
    "world.scale": 'world={file="house", scale=0.01}', "world.width": 'world={file="house", width=24.0}',
    "world.resolution": 'world={file="house", resolution=0.05}',
}  # fmt: skip


@pytest.mark.parametrize("key", [one.key for one in reference.scenario_keys()])
def test_the_example_of_a_key_can_be_read(key: str) -> None:
    text = reference.example_of(KEYS[key])
    if "[]" in key or text == "none":
        return
    given = BESIDE.get(key, f"{key}={text}")
    assert text in given
    load(ROOT / "scenarios" / "room.toml", [given])


def test_the_examples_of_lists_and_studies_are_toml() -> None:
    for key in KEYS:
        if (text := reference.example_of(KEYS[key])) != "none":
            assert list(tomllib.loads(f"x = {text}")) == ["x"]


def test_editors_show_the_same_words() -> None:
    whole = schema()
    for one in reference.scenario_keys():
        table, keys = whole, one.key.split(".")
        if "[]" in one.key or len(keys) > 2:
            continue
        for name in keys[:-1]:
            table = whole["$defs"][name.capitalize()]
        if keys != ["expect"]:
            assert table["properties"][keys[-1]]["description"] == one.meaning, one.key


def test_a_key_is_told_on_the_command_line(tmp_path: Path) -> None:
    shown = " ".join(called("parts", "robots.wheel_base", cwd=tmp_path).stdout.split())
    assert "robots.wheel_base" in shown
    assert "0.1 " in shown
    assert len(reference.key("stop")) == 4
    with pytest.raises(InputError, match=r"robots\.whel_base: no such key; did you mean 'robots\.wheel_base'"):
        reference.key("robots.whel_base")


def test_the_glossary_has_the_words_of_seams_and_the_riddles() -> None:
    page = (ROOT / "docs/glossary.md").read_text()
    words = {word for row in re.findall(r"^\| ([^|]+) \|", page, re.MULTILINE) for word in row.split(", ")}
    assert {"tile", "frontier", "group", "1NN", "domain", "not finished"} <= words
    assert {name for name, seam in SEAMS.items() if seam.required or (seam.default and seam.place)} - words == {
        "physics", "sensor", "motion"
    }  # fmt: skip


if __name__ == "__main__":
    for page, made in PAGES.items():
        (ROOT / page).write_text(made())
