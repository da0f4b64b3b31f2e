"""What `import` means in code of the user's own, and which files a part needs."""

from __future__ import annotations

import importlib
import os
import random
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from conftest import ROOT

from swarmsim.core.code import snapshot
from swarmsim.core.code.snapshot import PREFIX, Files, Snapshot
from swarmsim.core.errors import InputError, PartError
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.file import load
from swarmsim.core.scenario.identity import code_of
from swarmsim.engine.build import build

MINE = "class Mine:\n    def step(self, me):\n        return None\n"


def write(folder: Path, **texts: str) -> Path:
    for name, text in texts.items():
        file = folder / f"{name.replace('__', '/')}.py"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    return folder


def found(use: str):
    """What a part's name stands for, as its author wrote it."""
    with registry.own_code(True):
        kind = registry.find("strategy", use)
    return getattr(sys.modules[kind.__module__], kind.__name__)


@pytest.mark.parametrize(
    ("statement", "value"),
    [
        ("import helper", "helper.X"),
        ("import helper as other", "other.X"),
        ("from helper import X", "X"),
        ("from helper import *", "X"),
        ("from . import helper", "helper.X"),
        ("from .helper import X", "X"),
        ("import pack.inner", "pack.inner.X"),
        ("import pack.inner as inner", "inner.X"),
        ("from pack import inner", "inner.X"),
        ("from pack.inner import X", "X"),
        ("from .pack import inner", "inner.X"),
        ("import bare.inner", "bare.inner.X"),  # a folder without an __init__.py
        ("import importlib\nhelper = importlib.import_module('.helper', __package__)", "helper.X"),
    ],
)
def test_files_beside_a_part_are_imported_as_in_a_script(statement: str, value: str, tmp_path: Path) -> None:
    before = list(sys.path)
    write(
        tmp_path,
        mine=f"{statement}\n{MINE}    x = {value}\n",
        helper="X = 7\n",
        pack__inner="from .deep import X\n",
        pack__deep="X = 7\n",
        bare__inner="X = 7\n",
    )
    (tmp_path / "pack" / "__init__.py").touch()
    assert found(f"{tmp_path}/mine.py:Mine").x == 7
    assert sys.path == before
    assert not {"helper", "pack", "bare"} & sys.modules.keys()


def test_two_folders_that_have_files_of_one_name_have_two_modules(tmp_path: Path) -> None:
    kinds = []
    for name in ("a", "b"):
        write(tmp_path / name, mine=f"import helper\n{MINE}    x = helper.X\n", helper=f"X = {name!r}\n")
        kinds.append(found(f"{tmp_path / name}/mine.py:Mine"))
    assert [kind.x for kind in kinds] == ["a", "b"]
    assert found(f"{tmp_path}/a/mine.py:Mine") is kinds[0]


def test_a_file_called_like_an_installed_module_is_met_by_what_is_beside_it_alone(tmp_path: Path) -> None:
    """A file that imports its own name means the other module, and `swarmsim` is always this package."""
    write(
        tmp_path,
        mine=f"import random, numpy, swarmsim\nfrom types import KIND\n{MINE}"
        "    x = (random.X, KIND)\n    ours = swarmsim.__file__\n    theirs = numpy.random.__name__\n",
        random="import random\nX = random.Random(1).random()\n",
        types="KIND = 'own'\n",
        swarmsim="raise RuntimeError('not this one')\n",
    )
    kind = found(f"{tmp_path}/mine.py:Mine")
    assert kind.x == (random.Random(1).random(), "own")
    assert Path(kind.ours) == ROOT / "swarmsim" / "__init__.py"
    assert kind.theirs == "numpy.random"
    assert "own" not in vars(sys.modules["types"])


def test_a_file_in_a_package_may_import_what_is_beside_it_in_either_way(tmp_path: Path) -> None:
    write(
        tmp_path,
        pack__mine=f"from . import helper\nfrom .. import above\n{MINE}    x = helper.X\n",
        pack__script=f"import helper\n{MINE}    x = helper.X\n",
        pack__helper="X = 3\n",
    )
    (tmp_path / "pack" / "__init__.py").write_text("")
    assert found(f"{tmp_path}/pack/script.py:Mine").x == 3
    (tmp_path / "above.py").write_text("")
    assert found(f"{tmp_path}/pack/mine.py:Mine").x == 3


@pytest.mark.parametrize("edited", ["mine", "helper", "late"])
def test_a_module_that_is_named_is_loaded_anew_with_what_it_imports(
    edited: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As a notebook's session sees a module in its folder; what the session has imported itself stays as it is."""
    monkeypatch.syspath_prepend(tmp_path)
    own = f"own_{edited}"  # no other test has imported these
    texts = {
        f"{own}_mine": f"import {own}_helper\n{MINE}    x = {own}_helper.X\n    def late(self):\n"
        f"        import {own}_late\n        return {own}_late.X\n",
        f"{own}_helper": "X = 1\n",
        f"{own}_late": "X = 1\n",
    }
    write(tmp_path, **texts)
    session = importlib.import_module(f"{own}_mine")
    use = f"{own}_mine:Mine"
    first = found(use)
    assert found(use) is first
    write(tmp_path, **{f"{own}_{edited}": texts[f"{own}_{edited}"].replace("X = 1", "X = 2") + "# edited\n"})
    second = found(use)
    assert second is not first
    assert (second.x, second().late()) == ((2, 1) if edited == "helper" else (1, 2) if edited == "late" else (1, 1))
    assert (first.x, first().late()) == (1, 1)  # a run that is under way goes on as it began
    assert sys.modules[f"{own}_mine"] is session


def test_an_edit_that_changes_neither_length_nor_time_is_seen(tmp_path: Path) -> None:
    write(tmp_path, mine=f"{MINE}    x = 1\n")
    times = (tmp_path / "mine.py").stat()
    assert found(f"{tmp_path}/mine.py:Mine").x == 1
    write(tmp_path, mine=f"{MINE}    x = 2\n")
    os.utime(tmp_path / "mine.py", ns=(times.st_atime_ns, times.st_mtime_ns))
    assert found(f"{tmp_path}/mine.py:Mine").x == 2


def test_a_file_that_comes_to_stand_before_an_installed_module_is_seen(tmp_path: Path) -> None:
    write(tmp_path, mine=f"import random\n{MINE}    x = getattr(random, 'X', None)\n")
    assert found(f"{tmp_path}/mine.py:Mine").x is None
    write(tmp_path, random="X = 4\n")
    assert found(f"{tmp_path}/mine.py:Mine").x == 4


def test_code_is_what_its_import_statements_reach_and_no_more(tmp_path: Path) -> None:
    write(
        tmp_path,
        mine=f"import json\nfrom helper import *\n{MINE}    def late(self):\n        from pack import inner\n",
        helper="import importlib\nimportlib.import_module('.named', __package__)\n",
        named="",
        pack__inner="from .. import above\nfrom . import beside\n",
        pack__beside="",
        pack__unused="",
        above="",
        unused="1 / 0\n",
    )
    (tmp_path / "pack" / "__init__.py").write_text("")
    found(f"{tmp_path}/mine.py:Mine")
    now = snapshot.present()
    names = {now.short(file) for file in now.texts([f"{tmp_path}/mine.py"])}
    expected = {"mine.py", "helper.py", "named.py", "above.py"}
    assert names == expected | {f"pack/{name}.py" for name in ("__init__", "inner", "beside")}


def scenario(folder: Path, code: str, **others: str) -> Path:
    write(folder, mine=code, **others)
    room = (ROOT / "scenarios" / "room.toml").read_text().replace("../worlds", str(ROOT / "worlds"))
    (folder / "room.toml").write_text(room + '[mind]\nuse = "./mine.py:Mine"\n[task]\nuse = "./mine.py:still"\n')
    return folder / "room.toml"


STILL = "def still(moment):\n    return 0.0\n"


def test_messages_show_the_line_that_runs_of_the_file_as_it_is_now(tmp_path: Path) -> None:
    path = scenario(tmp_path, STILL + "class Mine:\n    def step(self, me):\n        return 1 / 0\n")
    with registry.own_code(True):
        for lines, what in ((0, "1 / 0"), (3, "2 / 0  # now"), (1, "me.nothing")):
            code = STILL + "#\n" * lines + f"class Mine:\n    def step(self, me):\n        return {what}\n"
            (tmp_path / "mine.py").write_text(code)
            with pytest.raises(PartError) as caught:
                build(load(path), str(path)).simulation.tick()
            line = f"{tmp_path}/mine.py, line {5 + lines}, in step: return {what}"
            assert line in str(caught.value)
            assert str(caught.value).startswith("strategy mine.py:Mine, iteration 0")


def test_messages_of_a_run_under_way_show_the_lines_that_it_runs(tmp_path: Path) -> None:
    path = scenario(tmp_path, STILL + "class Mine:\n    def step(self, me):\n        return 1 / 0\n")
    with registry.own_code(True):
        simulation = build(load(path), str(path)).simulation
        (tmp_path / "mine.py").write_text("# other lines\n" * 20)
        with pytest.raises(PartError, match=r"mine.py, line 5, in step: return 1 / 0"):
            simulation.tick()


def test_a_mistake_in_a_file_beside_names_that_file_and_its_line(tmp_path: Path) -> None:
    path = scenario(tmp_path, "import helper\n" + STILL + MINE, helper="\nimport nothing_of_that_name\n")
    with registry.own_code(True):
        with pytest.raises(InputError, match=r"helper.py, line 2, in <module>: import nothing_of_that_name"):
            load(path)
        (tmp_path / "helper.py").write_text("def broken(:\n")
        with pytest.raises(InputError, match=r"helper.py, line 1"):
            load(path)
        (tmp_path / "helper.py").write_text("")
        load(path)  # once it is mended


def test_parts_of_one_run_share_the_classes_of_a_file(tmp_path: Path) -> None:
    shared = f"import helper\n{STILL}{MINE}    shared = helper.Shared\n"
    path = scenario(tmp_path, shared, other=shared, helper="class Shared:\n    pass\n")
    with registry.own_code(True):
        made = build(load(path), str(path))
    assert found(f"{tmp_path}/mine.py:Mine").shared is found(f"{tmp_path}/other.py:Mine").shared
    assert made.code.hashes.keys() == {"swarmsim", "mine.py", "helper.py"}


def test_given_texts_run_in_the_place_of_files_wherever_these_are(tmp_path: Path) -> None:
    texts = {"mine.py": f"import helper\n{MINE}    x = helper.X\n".encode(), "helper.py": b"X = 1\n"}
    files = Files("/not/here", tuple((f"/not/here/{name}", text) for name, text in sorted(texts.items())))
    with snapshot.given(files):
        assert found("./mine.py:Mine").x == 1
        assert found("mine:Mine").x == 1
    with pytest.raises(InputError, match="no file"):
        found("./mine.py:Mine")


def test_threads_with_different_code_do_not_meet(tmp_path: Path) -> None:
    """As those of a worker of Dask's that has several."""
    write(
        tmp_path, mine=f"{MINE}    def late(self):\n        import helper\n        return helper.X\n", helper="X = 0\n"
    )
    answers: dict[int, list[int]] = {}

    def run(number: int) -> None:
        texts = {"helper.py": f"X = {number}\n".encode(), "mine.py": (tmp_path / "mine.py").read_bytes()}
        with snapshot.given(Files("/far", tuple((f"/far/{name}", text) for name, text in texts.items()))):
            with registry.own_code(True):
                module = snapshot.present().load("./mine.py")
            answers[number] = [module.Mine().late() for _ in range(200)]

    threads = [threading.Thread(target=run, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert answers == {number: [number] * 200 for number in range(4)}


def test_a_part_that_a_session_has_made_runs_but_is_in_no_study(tmp_path: Path) -> None:
    path = scenario(tmp_path, STILL)
    path.write_text(path.read_text().replace("./mine.py:Mine", "__main__:Mine"))
    (tmp_path / "study.toml").write_text('title = "T"\nscenario = "room.toml"\n')
    session = f"""
import swarmsim
from swarmsim.core.scenario.registry import own_code
from swarmsim.studies.plan import open_study
{MINE}
print(swarmsim.run("room.toml", overrides={{"stop.iterations": 2}}, allow_code=True).recording.code["__main__"])
with own_code(True):
    open_study(__import__("pathlib").Path("study.toml"))
"""
    done = subprocess.run(
        [sys.executable, "-"], input=session, capture_output=True, text=True, cwd=tmp_path, check=False
    )
    assert done.stdout == "unseen\n"
    assert "study.toml: condition 'base': the code of '__main__' stands in no file" in done.stderr


def test_modules_are_called_alike_in_every_process(tmp_path: Path) -> None:
    """Or what numba has kept of their functions could not be used again."""
    write(tmp_path, mine=MINE)
    names = {Snapshot().name_of(f"{tmp_path}/mine.py") for _ in range(2)}
    assert len(names) == 1
    assert names.pop().startswith(PREFIX)


def test_code_of_ours_and_of_plug_ins_is_known_by_content(tmp_path: Path) -> None:
    (hashes,) = {tuple(code_of(load(ROOT / "scenarios" / "room.toml")).hashes.items()) for _ in range(2)}
    ((name, first),) = hashes
    assert (name, len(first)) == ("swarmsim", 16)


@pytest.mark.parametrize("keys", ["", "    angles: list[float] = []\n"], ids=["hashable", "not hashable"])
def test_an_edited_sensor_changes_what_can_be_explored(keys: str, tmp_path: Path) -> None:
    """Which is found out once for equal sensors: they are not equal if their code is not."""
    sensor = (
        "import msgspec\nfrom swarmsim.robots.sensors import IrRing, NoSensor\n"
        f"class Eye(msgspec.Struct, frozen=True):\n{keys}    def build(self, context):\n"
        "        return IrRing(tile=(9, 9), reach=0.6).build(context)\n"
    )
    path = scenario(tmp_path, STILL + MINE, eye=sensor)
    path.write_text(path.read_text() + '[sensor]\nuse = "./eye.py:Eye"\n')

    def explored() -> int:
        with registry.own_code(True):
            return int(build(load(path), str(path)).explorable.sum())

    first = explored()
    (tmp_path / "eye.py").write_text(sensor.replace("IrRing(tile=(9, 9), reach=0.6)", "NoSensor()"))
    assert explored() != first
