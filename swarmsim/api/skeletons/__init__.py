"""Parts to start from, each with a test that passes.

Each kind is a file KIND.txt, a Python template. If its test needs more of a scenario than the part itself, dotted keys
with TOML values come first, up to a line `---`. A part that stands in no scenario brings its test, after a line `===`.
"""

from __future__ import annotations

import keyword
from pathlib import Path
from string import Template
from typing import Final

from swarmsim.core.errors import InputError, nearest, unwritten

_HERE: Final = Path(__file__).parent
#: Why some seams have no skeleton.
WITHOUT: Final = {
    "generator": "a building is made before a run; start from swarmsim/world/made/generated.py",
    "layer": "it is a function of a moment; start from the one in docs/own.md",
    "localisation": "start from Noisy in swarmsim/robots/localisation.py",
    "physics": "bodies take eight verbs; start from swarmsim/robots/particles.py",
}
TEST: Final = '''
from pathlib import Path

from swarmsim.testing import check_contracts

HERE = Path(__file__).parent
ROOM = """<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 4 4" width="4m" height="4m">
  <g id="walls"><path fill-rule="evenodd" d="M0 0H4V4H0Z M0.2 0.2V3.8H3.8V0.2Z"/></g>
  <g id="spawn"><rect id="floor" x="0.5" y="0.5" width="3" height="3"/></g>
</svg>"""
SCENARIO = """
$scenario
"""


def test_$name(tmp_path):
    (tmp_path / "room.svg").write_text(ROOM)
    (tmp_path / "scenario.toml").write_text(SCENARIO.replace("HERE", HERE.as_posix()))
    check_contracts(tmp_path / "scenario.toml", allow_code=True)
'''
SCENARIO: Final = {
    "world": '"room.svg"',
    "robots.count": "4",
    "robots.spawn": '"floor"',
    "network.topology": '{use = "full"}',
}


def kinds() -> list[str]:
    """The kinds with a skeleton: seams, and minds, which are two of them."""
    return sorted(path.stem for path in _HERE.glob("*.txt"))


def _place(kind: str) -> tuple[str, bool]:
    """The place of a part of this kind in a scenario, and whether it is a list."""
    from swarmsim.core.seams import SEAMS

    return (SEAMS[kind].at, SEAMS[kind].many) if kind in SEAMS else (kind, False)


def _why_not(kind: str) -> str | None:
    """Why a kind of part has no skeleton, if there is a reason."""
    from swarmsim.core.scenario import registry
    from swarmsim.core.seams import PLACED, SEAMS

    if kind in PLACED or kind not in SEAMS or kind in kinds():
        return WITHOUT.get(kind)
    files = {name: one.module.replace(".", "/") + ".py" for name, one in registry.entries(kind).items()}
    start = files.get(SEAMS[kind].default or "", ", ".join(files.values()))
    return f"its parts stand in the tables of other parts; start from {start}"


def _skeleton(kind: str) -> tuple[dict[str, str], str, str]:
    """A scenario's keys to try such a part, as TOML by dotted key, the code, and its test. Raises InputError."""
    if why := _why_not(kind):
        raise InputError(f"new {kind}: no skeleton: {why}")
    known = {one: one for one in kinds()}
    if kind not in known:
        raise InputError(f"new {kind}: no such kind of part; {nearest(kind, known)}")
    text, _, test = (_HERE / f"{kind}.txt").read_text(encoding="utf-8").partition("===\n")
    head, _, code = text.rpartition("---\n")
    lines = [one.partition(" = ") for one in head.splitlines()]
    return {key: value for key, _, value in lines}, code, test or TEST


def _names(kind: str, name: str) -> tuple[str, str]:
    """The names of the module and of the part in it. Raises InputError."""
    _, code, _ = _skeleton(kind)
    module = name.replace("-", "_").lower()
    if not module.isidentifier() or keyword.iskeyword(module):
        raise InputError(f"new {kind} {name}: not a name for a part; expected letters, digits and _, as in my_rule")
    return module, "".join(word.capitalize() for word in module.split("_")) if "$Name" in code else module


def new(kind: str, name: str, to: str | Path = ".") -> list[Path]:
    """Write a part to start from, and its test, which passes; return both files: `swarmsim new`.

    `kind` is a seam, or `mind`; `name` a word such as my_rule, and `to` a folder, made if missing. Raises InputError
    for a kind without a skeleton, an invalid name, and files that exist already: nothing is overwritten.
    """
    folder = Path(to)
    module, part = _names(kind, name)
    files = [folder / f"{module}.py", folder / f"test_{module}.py"]
    for path in files:
        if path.exists():
            raise InputError(f"{path}: exists already; expected a new name, nothing is overwritten")
    beside, code, tried = _skeleton(kind)
    (place, listed), use = _place(kind), f'{{use = "HERE/{module}.py:{part}"}}'
    scenario = {**SCENARIO, **beside, place: f"[{use}]" if listed else use}
    lines = "\n".join(f"{key} = {value}" for key, value in scenario.items())
    test = Template(tried).substitute(name=module, Name=part, scenario=lines)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for path, text in zip(files, (Template(code).substitute(name=module, Name=part), test), strict=True):
            path.write_text(text.lstrip("\n"), encoding="utf-8")
    except OSError as problem:
        raise unwritten(folder, problem, "a place for files") from problem
    return files


def advice(kind: str, name: str) -> str:
    """The scenario's line, and how to run both."""
    from swarmsim.core.seams import SEAMS

    module, part = _names(kind, name)
    place, listed = _place(kind)
    if not place:
        named = f"{SEAMS[kind].elsewhere.strip('`')} ./{module}.py:{part}"
        return f"named by: {named}\nits test: python -m pytest test_{module}.py"
    return (
        f'in the scenario beside it: {f"[[{place}]]" if listed else f"[{place}]"} use = "./{module}.py:{part}"\n'
        f"then: swarmsim run SCENARIO.toml --allow-code\nits test: python -m pytest test_{module}.py"
    )
