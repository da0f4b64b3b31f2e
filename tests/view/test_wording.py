"""Words are made from typed events and the scenario's faults, where people read them."""

from __future__ import annotations

import subprocess
import sys

import pytest
from conftest import made

from swarmsim.core.events import Begins, BoxGone, BoxStands, BoxWaits, Ended, Ends
from swarmsim.core.parts import Curve
from swarmsim.view.timeline import noted
from swarmsim.view.wording import worded, worded_value

BOX = (3.9, 0.9, 4.3, 1.3)
FAULTS = """faults=[
    {use="remove", at=5}, {use="crash", at=5}, {use="join", at=5},
    {use="battery", capacity=5.0, per_metre=1.0, per_byte=0.0, idle=0.0}, {use="motor", failure="off", at=5},
    {use="door", at=5, box=[3.9, 0.9, 4.3, 1.3]}, {use="furniture", at=5, box=[3.9, 0.9, 4.3, 1.3]},
    {use="radio", failure="jam", at=5, area=[0.5, 0.5, 1.0, 1.0]}]""".replace("\n", "")
REMOVE, CRASH, JOIN, BATTERY, MOTOR, DOOR, FURNITURE, JAM = range(8)


@pytest.fixture(scope="module")
def scenario():
    return made("robots.count=6", FAULTS).scenario


@pytest.mark.parametrize(
    ("event", "words"),
    [
        (Begins(5, REMOVE, (1,)), "removed"),
        (Ends(5, REMOVE, (1,)), "returned"),
        (Begins(5, CRASH, (1,)), "crashed"),
        (Ends(5, CRASH, (1,)), "repaired"),
        (Begins(0, JOIN, (1,)), "late"),
        (Ends(5, JOIN, (1,)), "joined"),
        (Begins(5, BATTERY, (1,)), "battery empty"),
        (Begins(5, MOTOR, (1,)), "motor off"),
        (Ends(5, MOTOR, (1,)), "motor off over"),
        (Begins(5, JAM), "radio jam"),
        (Ends(5, JAM), "radio jam over"),
        (BoxStands(5, DOOR, BOX), "door closed"),
        (BoxGone(5, DOOR, BOX), "door opened"),
        (BoxWaits(5, DOOR, BOX), "door waits"),
        (BoxStands(5, FURNITURE, BOX), "furniture placed"),
        (BoxGone(5, FURNITURE, BOX), "furniture taken"),
        (Ended(9, True), "finished"),
        (Ended(9, False), "not finished"),
    ],
)
def test_an_event_is_called_as_people_call_it(scenario, event, words: str) -> None:
    assert worded(event, scenario) == words


@pytest.mark.parametrize(
    ("event", "line"),
    [
        (Begins(5, MOTOR, (3, 4)), "iteration 5: motor off: robots 3, 4"),
        (BoxStands(5, DOOR, BOX), "iteration 5: door closed"),
        (Ended(9, True), "iteration 9: finished: 100 % coverage reached"),
        (Ended(499, False), "iteration 499: not finished: limit of 500 iterations"),
    ],
)
def test_a_line_names_when_what_and_whom(scenario, event, line: str) -> None:
    assert noted(event, scenario).text == line


def test_words_need_no_pictures() -> None:
    code = "import sys, swarmsim.view.wording; sys.exit(' '.join({'pygame', 'matplotlib'} & {*sys.modules}))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stderr.strip() == ""


def test_all_pictures_say_one_value_and_100_per_cent_is_all_of_it() -> None:
    coverage = Curve("coverage", "coverage, %", scale=100.0, low=0.0, high=100.0)
    told = {value: worded_value(coverage, value) for value in (0.9999, 0.98765, 0.29, 1.0)}
    assert list(told.values()) == ["99.9 %", "98.7 %", "29 %", "100 %"]
    assert worded_value(Curve("spread", "spread, m"), 1.25).endswith(" m")
