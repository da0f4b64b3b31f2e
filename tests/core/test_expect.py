from __future__ import annotations

import math
import re
from contextlib import suppress

import pytest
from conftest import ROOT
from hypothesis import given
from hypothesis import strategies as st

from swarmsim.core.errors import InputError
from swarmsim.core.scenario.expect import (
    COMPARED,
    Expect,
    MeasureBound,
    NoRobot,
    TaskDone,
    expectations_in,
    sentence_of,
)  # fmt: skip
from swarmsim.core.scenario.file import decode, load, table_of
from swarmsim.core.scenario.schema import schema
from swarmsim.core.scenario.toml import parsed
from swarmsim.recording.recorder import text_of
from swarmsim.studies.requests import asked

ROOM = ROOT / "scenarios/room.toml"


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("finished", TaskDone()),
        ("finished within 10min", TaskDone(600.0)),
        (" finished  within 1.5 h ", TaskDone(5400.0)),
        ("nobody stuck", NoRobot("stuck", 60.0)),
        ("nobody stuck for 90s", NoRobot("stuck", 90.0)),
        ("nobody dead", NoRobot("dead")),
        ("path_sum <= 200", MeasureBound("path_sum", "<=", 200.0)),
        ("order>0.9", MeasureBound("order", ">", 0.9)),
        ("coverage >= 99 % at 300s", MeasureBound("coverage", ">=", 0.99, "at", 300.0)),
        ("coverage >= 0.5 within 2 min", MeasureBound("coverage", ">=", 0.5, "within", 120.0)),
        ("smallest_gap >= 1e-1 always", MeasureBound("smallest_gap", ">=", 0.1, "always")),
        ("union_f1 != -2 at 10", MeasureBound("union_f1", "!=", -2.0, "at", 10.0)),
    ],
)
def test_sentences_are_read(text: str, found: object) -> None:
    assert sentence_of(text) == found


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is no sentence; expected \"finished\""),
        ("fast", "is no sentence"),
        ("finished in 10min", "'in 10min' at its end; expected within and a time"),
        ("finished within", "expected within and a time"),
        ("finished within 10 parsecs", "is no duration"),
        ("finished within 0s", "is no duration"),
        ("nobody", "is no sentence"),
        ("nobody dead for 3s", "'for 3s' at its end; expected nothing"),
        ("nobody stuck within 3s", "expected for and a time"),
        ("coverage > = 0.9", "is no sentence"),
        ("coverage => 0.9", "is no sentence"),
        ("coverage >= much", "is no sentence"),
        ("coverage >= 1e999", "1e999 is not finite"),
        ("coverage >= 0.9 by 3s", "'by 3s' after the number"),
        ("coverage >= 0.9 at", "'at' after the number"),
        ("coverage >= 0.9 always 3s", "'always 3s' after the number"),
        ("coverage == 0.9 within 3s", "== with within; expected >=, <=, > or <"),
    ],
)  # fmt: skip
def test_what_is_no_sentence_is_refused_with_what_would_be_one(text: str, words: str) -> None:
    with pytest.raises(InputError, match=re.escape(words)):
        sentence_of(text)


@given(st.text(max_size=60))
def test_any_text_is_a_sentence_or_refused(text: str) -> None:
    with suppress(InputError):
        sentence_of(text)


PIECES = [
    "finished", "nobody", "stuck", "dead", "within", "for", "at", "always", "10min", "3", "s", ">=", "==", "x", "%",
    "-1e3", "0.5", "²", "\u0663", "nan", "\0",
]  # fmt: skip


@given(st.lists(st.sampled_from(PIECES), max_size=6), st.sampled_from(["", " ", "\n"]))
def test_any_pieces_of_sentences_make_one_or_are_refused(pieces: list[str], between: str) -> None:
    try:
        found = sentence_of(between.join(pieces))
    except InputError:
        return
    assert getattr(found, "seconds", None) is None or 0.0 < found.seconds < math.inf
    assert not isinstance(found, MeasureBound) or (found.sign in COMPARED and math.isfinite(found.number))


NAMES = st.from_regex(r"[a-z_][a-z0-9_]{0,9}", fullmatch=True).filter(lambda name: name not in ("finished", "nobody"))


@given(NAMES, st.sampled_from(sorted(COMPARED)), st.floats(-1e9, 1e9), st.integers(1, 10_000))
def test_what_is_written_is_what_is_read(name: str, sign: str, number: float, seconds: int) -> None:
    assert sentence_of(f"{name} {sign} {number!r} at {seconds}s") == MeasureBound(name, sign, number, "at", seconds)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('that = "fast"', r"room: expect\[0\]: that: 'fast' is no sentence"),
        ("chance = 0.9", r"room: expect\[0\]\.that: required key is missing"),
        ('that = "finished"\nchances = 0.9', r"expect\[0\]\.chances: unknown key; did you mean 'chance'"),
        ('that = "finished"\nchance = 1.0', r"expect\[0\]\.chance"),
        ('that = "finished"\nzone = 0.1', r"expect\[0\]: zone and budget are those of a chance"),
        (
            'that = "finished"\nchance = 0.9\nzone = 0.3',
            r"0\.3: too wide for chance = 0\.9; expected below 0\.2",
        ),
        ('that = "finished"\nchance = 0.9\nseeds = 3', r"expected either chance or seeds"),
        ('that = "finished"\nseeds = [1, 1]', r"one is listed twice"),
        ('that = "finished"\nseeds = 0', r"expect\[0\]\.seeds"),
        ('that = "finished"\ncondition = "k=2"', r"expect\[0\]\.condition: a scenario has none"),
    ],
)
def test_wrong_expectations_are_refused_by_every_reader_of_the_scenario(text: str, words: str) -> None:
    table = {**parsed(ROOM.read_text()), **parsed(f"[[expect]]\n{text}")}
    with pytest.raises(InputError, match=words):
        decode(table, "room", ROOM.parent)


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers(-2, 9) | st.floats() | st.sampled_from(["finished", "crash at=3", ""]),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from(["that", "k"]), inner, max_size=2),
    max_leaves=6,
)
KEYS = st.sampled_from([*Expect.__struct_fields__, "other"])


@given(st.lists(st.dictionaries(KEYS, VALUES, max_size=5), max_size=3) | VALUES)
def test_any_table_is_read_or_refused_by_its_key(given_: object) -> None:
    try:
        found = expectations_in({"expect": given_})
    except InputError as problem:
        assert str(problem).startswith("expect")  # noqa: PT017 - either is right
        return
    assert all(one.that == "finished" and one.numbers and one.slack > 0.0 for one in found)


def test_no_run_depends_on_what_is_expected_of_it() -> None:
    plain = load(ROOM)
    table = {key: value for key, value in parsed(ROOM.read_text()).items() if key != "expect"}
    more = parsed('[[expect]]\nthat = "finished within 3min"\nset = {"robots.count" = 5}\nfaults = ["crash at=3"]')
    expecting = decode({"title": "room", **table, **more}, "room", ROOM.parent)
    assert expecting == plain
    assert asked(expecting) == asked(plain)
    assert text_of(expecting) == text_of(plain)
    assert "expect" not in table_of(expecting)


def test_the_schema_knows_expectations() -> None:
    found = schema()
    assert found["properties"]["expect"]["type"] == "array"
    assert set(found["$defs"]["Expect"]["properties"]) == set(Expect.__struct_fields__)


def test_zones_and_seeds_have_defaults() -> None:
    (one, other, near) = expectations_in(
        parsed(
            '[[expect]]\nthat = "finished"\n[[expect]]\nthat = "finished"\nchance = 0.9\n'
            '[[expect]]\nthat = "finished"\nchance = 0.99'
        )
    )
    assert one.numbers == (1, 2, 3, 4, 5)
    assert other.slack == 0.02
    assert near.slack == pytest.approx(0.004)
