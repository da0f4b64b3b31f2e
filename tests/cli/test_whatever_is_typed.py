"""Whatever one types, the command line answers in words and with a documented exit code."""

from __future__ import annotations

import io
import random
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT, made
from typer.main import get_command

from swarmsim.cli import app, main

pytestmark = pytest.mark.usefixtures("no_workers")
#: Verbs that open windows, run for minutes or look after the installation.
LEFT_OUT = {"view", "reproduce", "doctor"}
ODD = (
    "",
    " ",
    "-1",
    "0",
    "1",
    "3",
    "1e309",
    "nan",
    "-0.0",
    "é☃",
    "a=b",
    "x=1",
    "=",
    "{",
    "[1",
    '"',
    "a" * 5000,
    "10**9",
    "0x10",
    "None",
)
KEYS = (
    "stop.iterations=2", "robots.count=0", "robots.count=-1", "robots=3", "seed=-1", "seed=1e3", "world=3", "world={}",
    "faults=[]", "faults=[{}]", 'faults=[{use="remove"}]', "network={}", "network.topology.k=99", 'sensor={use="none"}',
    "grid.cell=nan", "period=inf", "mind=1", 'task={use="coverage", share=2}', "a.b.c=1", "title=[]",
)  # fmt: skip
FAULTS = (
    "remove",
    "remove at=1",
    "remove at=-1 count=x",
    "motor off",
    "motor",
    "radio loss=2",
    "door",
    "at=3",
    "push velocity=[1",
)


def leaves(command: Any, words: tuple[str, ...] = ()) -> list[tuple[tuple[str, ...], Any]]:
    """Every verb, with the words that call it."""
    inner = getattr(command, "commands", None)
    if inner is None:
        return [(words, command)]
    return [leaf for name, one in sorted(inner.items()) for leaf in leaves(one, (*words, name)) if name not in LEFT_OUT]


VERBS = leaves(get_command(app))


@pytest.fixture(scope="module")
def things(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Files and folders of all kinds."""
    folder = tmp_path_factory.mktemp("things")
    run = made("stop.iterations=12")
    (folder / "run").mkdir()
    with run.recorder(folder / "run" / "recording.h5") as recorder:
        run.simulation.run([recorder])
    (folder / "study.toml").write_text(
        f'scenario = "{ROOT}/scenarios/room.toml"\nseeds = 1\n[set]\n"stop.iterations" = 2\n'
    )
    (folder / "empty.toml").touch()
    (folder / "bytes.toml").write_bytes(bytes(range(256)))
    names = (
        "run",
        "run/recording.h5",
        "study.toml",
        "empty.toml",
        "bytes.toml",
        "missing",
        "missing/x.png",
        "out.mp4",
        "out.yaml",
    )
    own = (
        ROOT / "scenarios" / "room.toml",
        ROOT / "worlds" / "room.svg",
        ROOT / "worlds",
        "/dev/null",
        "/proc/self/mem",
    )
    return [*(str(folder / name) for name in names), *map(str, own)]


def typed(verb: Any, dice: random.Random, things: list[str]) -> list[str]:
    """A command's options and arguments, some of which make sense."""
    words: list[str] = []
    for parameter in verb.params:
        name = next((option for option in parameter.opts if option.startswith("--")), None)
        if name is None:
            if dice.random() < 0.9:
                words.append(dice.choice(things if dice.random() < 0.85 else ODD))
        elif dice.random() < 0.3 and name not in ("--help", "--scheduler", "--allow-code"):
            words.append(name)
            if not getattr(parameter, "is_flag", False):
                pool = {"--set": KEYS, "--fault": FAULTS}.get(name, ODD if dice.random() < 0.6 else things)
                words.append(dice.choice(pool))
    if dice.random() < 0.1:
        words.insert(dice.randrange(len(words) + 1), dice.choice(("--nonsense", *ODD)))
    return words


def answers(seed: int, things: list[str], folder: Path, monkeypatch: pytest.MonkeyPatch) -> int:
    dice = random.Random(seed)
    name, verb = dice.choice(VERBS)
    words = [*name, *typed(verb, dice, things)]
    if name[0] == "run":  # the last of several counts
        words += ["--set", "stop.iterations=3"]
    monkeypatch.chdir(folder)
    monkeypatch.setattr("sys.argv", ["swarmsim", *words])
    told = io.StringIO()
    try:
        with redirect_stdout(told), redirect_stderr(told), pytest.raises(SystemExit) as ended:
            main()
    except BaseException as problem:
        problem.add_note(f"seed {seed}: swarmsim {' '.join(words)[:500]}")
        raise
    code = ended.value.code or 0
    assert code in (0, 1, 2, 3), (seed, words, told.getvalue())
    assert code != 2 or told.getvalue().strip()
    return int(code)


def test_whatever_is_typed_is_answered(things: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    codes = [answers(seed, things, tmp_path, monkeypatch) for seed in range(100)]
    assert 0 in codes


@pytest.mark.slow
def test_whatever_is_typed_is_answered_many_times(
    things: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    codes = [answers(seed, things, tmp_path, monkeypatch) for seed in range(1000, 3000)]
    print({code: codes.count(code) for code in sorted(set(codes))})
    assert {0, 2} <= set(codes)
