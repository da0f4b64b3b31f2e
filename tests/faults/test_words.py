"""Faults in words: on the command line, and as the causes that events name."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from conftest import ROOT
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner, Result

from swarmsim.cli import app
from swarmsim.core.errors import InputError
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.part import Part
from swarmsim.faults.in_words import described, fault_in_words


@pytest.mark.parametrize(
    ("words", "keys"),
    [
        ("remove at=50 count=5", {"at": 50, "count": 5}),
        ("motor off at=20 fraction=0.2 duration=100", {"failure": "off", "at": 20, "fraction": 0.2, "duration": 100}),
        ("motor failure=off at=20", {"failure": "off", "at": 20}),
        ("mind random-walk at=3", {"failure": "random-walk", "at": 3}),
        ('remove at=3 map="lost"', {"at": 3, "map": "lost"}),
        ("  remove \t at=3\n map='lost' ", {"at": 3, "map": "lost"}),
        ("remove at=3 target=nearest point=[1, 2.5]", {"at": 3, "target": "nearest", "point": [1.0, 2.5]}),
        ("remove between=[3,\n5]", {"between": [3, 5]}),
        ("crash life={mean = 30, shape = 2}", {"life": {"mean": 30.0, "shape": 2.0}}),
        ("radio partition at=1 groups=[[0, 1], [2]]", {"failure": "partition", "at": 1, "groups": [[0, 1], [2]]}),
        ("swarmsim.faults.body:Crash at=1", {"at": 1}),
    ],
)
def test_a_fault_is_its_kind_its_failure_and_its_keys(words: str, keys: dict[str, object]) -> None:
    with registry.own_code(":" in words.split()[0]):
        _is(words, keys)


def _is(words: str, keys: dict[str, object]) -> None:
    fault = fault_in_words(words)
    assert fault.use == words.split()[0]
    assert {key: fault.table[key] for key in keys} == keys
    assert fault == Part("fault", {"use": words.split()[0], **keys})


REFUSED = [
    ("", "'nothing' is not a kind of fault; expected a kind"),
    ("   ", "'nothing' is not a kind of fault"),
    ("remvoe at=3", r"no fault is called 'remvoe'; did you mean 'remove'\?"),
    ("at=3", "'at=3' is not a kind of fault; expected a kind"),
    (".x:y at=3", "is not a kind of fault"),
    ("no.such.module:Thing", "cannot be imported"),
    ("os.path:join at=1", "is not a fault: expected a msgspec.Struct"),
    ("remove off at=3", "'off': 'remove' fails in one way only; expected key=value"),
    ("motor of at=3", "failure: .*'of'; expected 'off' or 'slow' or 'stuck'"),
    ("motor at=3", "failure: required key is missing; expected 'off' or 'slow' or 'stuck'"),
    ("motor off slow at=3", "'slow' is not key=value"),
    ("remove at=3 map=burnt", "map: .*; expected 'kept' or 'lost'"),
    ("remove at=3 cuont=4", "cuont: unknown key; did you mean 'count'"),
    ("remove at=", "at: '' is not one value"),
    ("remove =3", "'=3' is not key=value"),
    ("remove at=soon", "at: expected `int"),
    ("remove at=3.5", "at: "),
    ("remove at=1,2", "at: '1,2' is not one value"),
    ("remove at=-1", "at: .*>= 0"),
    ("remove at=nan", "at: nan is not a number to compute with"),
    ("remove at=99999999999999999999999999", "at: .*<= 100000"),
    ("remove at=2020-01-01", "at: expected `int"),
    ("remove at=3#often", "at: '3#often' is not a TOML value"),
    ("remove at=3 at=4", "at: given twice"),
    ("remove use=crash at=4", "use: given twice"),
    ("remove between=[3", r"'between=\[3': a bracket is left open"),
    ("remove at=3]", "a bracket is left open"),
    ('remove at=3 map="lost', "\" is left open"),
    ("remove point=[[[1]]] at=3", "point"),
]  # fmt: skip


@pytest.mark.parametrize(("words", "reason"), REFUSED)
def test_words_that_make_no_fault_are_refused_with_the_reason(words: str, reason: str) -> None:
    with registry.own_code(":" in words), pytest.raises(InputError, match=reason):
        fault_in_words(words)


PIECES = [
    "remove", "motor", "off", "at", "=", "=3", "at=3", "[", "]", "{", "}", '"', "'", "#", "\\", "\n", " ", ",", "-",
    "life=", "{mean=3}", "use=", "map=lost", "robots=[1,2]", ".", "inf", "nan", "true", "1e999", "0x", "\x00", "\ud800",
]  # fmt: skip
WORDS = st.sampled_from(PIECES)


@settings(derandomize=True, deadline=None, max_examples=300)
@given(st.one_of(st.text(), st.lists(WORDS).map("".join), st.lists(WORDS).map(" ".join)))
def test_any_text_is_a_fault_or_is_refused(text: str) -> None:
    try:
        fault = fault_in_words(text)
    except InputError:
        return
    assert Part("fault", fault.table) == fault


def test_brackets_without_end_are_refused() -> None:
    deep = "[" * 3000
    with pytest.raises(InputError, match="region"):
        fault_in_words(f"remove at=1 region={deep}{']' * 3000}")


@pytest.mark.parametrize(
    "words",
    [
        "remove at=50 count=5",
        "remove between=[3,5] robots=[1,2] map=lost",
        "crash life={mean=30.0,shape=2.0}",
        "motor off at=20 fraction=0.2",
        "motor slow at=20 wheel=left factor=0.25",
        "radio partition at=1 groups=[[0,1],[2]]",
        "byzantine spoof rate=0.5 target=hub",
    ],
)
def test_the_cause_that_events_name_can_be_given_on_the_command_line(words: str) -> None:
    cause = described(fault_in_words(words))
    assert sorted(cause.split()) == sorted(words.split())
    assert fault_in_words(cause) == fault_in_words(words)


def swarmsim(*arguments: object) -> Result:
    return CliRunner().invoke(app, list(map(str, arguments)))


ROOM = ROOT / "scenarios" / "room.toml"


def test_faults_of_the_command_line_come_on_top_of_the_scenario(tmp_path: Path) -> None:
    one = 'faults=[{use="remove", at=2, robots=[0]}]'
    more = ("--fault", "motor off at=3 duration=2 robots=[1]", "--fault", "crash at=6 robots=[2]")
    short = ("--set", "stop.iterations=8")
    done = swarmsim("run", ROOM, *short, "--set", one, *more, "--out", tmp_path / "a")
    assert (done.exit_code, done.stderr) == (1, "")
    assert "iteration 3: motor off: robot 1" in " ".join(done.stdout.replace("│", "").split())
    summary = json.loads((tmp_path / "a" / "summary.json").read_text())
    assert summary["status"] == "not finished"
    told = [
        (event["event"], event["iteration"], event.get("fault"), event.get("robots")) for event in summary["events"]
    ]
    assert told == [
        ("begins", 2, 0, [0]), ("begins", 3, 1, [1]), ("ends", 5, 1, [1]), ("begins", 6, 2, [2]),
        ("ended", 7, None, None),
    ]  # fmt: skip
    tables = ', {use="motor", failure="off", at=3, duration=2, robots=[1]}, {use="crash", at=6, robots=[2]}]'
    swarmsim("run", ROOM, *short, "--set", one[:-1] + tables, "--out", tmp_path / "b", "--quiet")
    assert json.loads((tmp_path / "b" / "summary.json").read_text())["digest"] == summary["digest"]


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        ("remove cuont=3", "cuont: unknown key; did you mean 'count'"),
        ("remove count=3", "at: required key is missing"),  # found when it is built
        ("remove at=3 min_alive=7", "min_alive: 7 of 3 robots"),
        ("sensor beams at=3 beams=[9999]", "beams"),  # found when it is installed
        ("door at=3 box=[8,8,9,9]", "box"),
        ("remove at=3 region=[nan,0,1,1]", "region"),
    ],
)
def test_what_is_wrong_with_a_fault_names_the_option(tmp_path: Path, words: str, reason: str) -> None:
    done = swarmsim("run", ROOM, "--fault", "crash at=2", "--fault", words, "--out", tmp_path / "none")
    assert isinstance(done.exception, InputError)
    assert str(done.exception).startswith(f"--fault '{words}': {reason}")
    assert not (tmp_path / "none").exists()


def test_the_help_shows_how_to_give_a_fault() -> None:
    assert '--fault "remove at=50 count=5"' in " ".join(swarmsim("run", "--help").stdout.split())
