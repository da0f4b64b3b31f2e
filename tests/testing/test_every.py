"""Each check of each part is a test of its own, and what breaks one promise fails that test alone."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT

from swarmsim.core.seams import SEAMS
from swarmsim.testing import BrokenError, parametrize_with_checks
from swarmsim.testing.every import CHECKS

PARTS = """
import random

import numpy as np
from swarmsim.core.state import Measured


def touching(state):
    \"\"\"Each robot hears itself, which no topology may say.\"\"\"
    return np.array([[0, 0]], np.int32)


def moody(state):
    \"\"\"The first robot hears the second, or not.\"\"\"
    return np.array([[0, 1]], np.int32)[: random.randrange(2)]


def gap(moment):
    \"\"\"How far the first two robots are apart.\"\"\"
    x = moment.state.pose[:, 0]
    return x[1] - x[0], False


def degree(moment):
    \"\"\"How many robots each one hears, on average.\"\"\"
    return 0.0 if len(moment.state.alive) == 1 else len(moment.state.alive) / len(moment.links), False


def careful(observations):
    \"\"\"Robots turn away from any other nearby, whether they sense it or not.\"\"\"
    place = observations.pose[:, :2]
    near = (np.hypot(*(place[:, None] - place).transpose(2, 0, 1)) < 0.05).sum(axis=1) > 1
    return np.where(near[:, None], (0.0, 1.0), (0.02, 0.0))


def crowded(observations):
    \"\"\"Robots drive more slowly if they are several.\"\"\"
    count = len(observations.alive)
    return np.tile((0.02 if count > 1 else 0.03, 0.0), (count, 1))


def led(observations):
    \"\"\"The robot in the second row leads.\"\"\"
    speed = np.where(np.arange(len(observations.alive)) == 1, 0.03, 0.02)
    return np.stack([speed, np.zeros(len(speed))], axis=1)
"""
ROOM = """<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 4 4" width="4m" height="4m">
  <g id="walls"><path fill-rule="evenodd" d="M0 0H4V4H0Z M0.2 0.2V3.8H3.8V0.2Z"/></g>
  <g id="spawn"><rect id="floor" x="0.5" y="0.5" width="3" height="3"/></g>
</svg>"""
SCENARIO = """
world = "room.svg"
sensor.ranges = true
robots = {count = 5, spawn = "floor"}
network.topology.use = "full"
mind.computation.use = "reactive"
mind.strategy.use = "wander"
task = {use = "travelled", distance = 99.0}
"""
TEST = """
from swarmsim.testing import parametrize_with_checks

@parametrize_with_checks("scenario.toml", ['mind.strategy={use="./mine.py:careful"}'], iterations=10, allow_code=True)
def test_mine(check):
    check()
"""


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    (tmp_path / "room.svg").write_text(ROOM)
    (tmp_path / "scenario.toml").write_text(SCENARIO)
    (tmp_path / "mine.py").write_text(PARTS)
    return tmp_path / "scenario.toml"


def outcomes(*asked: object, **more: object) -> dict[str, str]:
    """What came of each test of a scenario, by its name."""
    found = {}
    for test in parametrize_with_checks(*asked, **more).mark.args[1]:
        try:
            test.values[0]()
            found[test.id] = "passed"
        except pytest.skip.Exception:
            found[test.id] = "skipped"
        except pytest.fail.Exception:
            found[test.id] = "failed"
    return found


@pytest.mark.parametrize(
    ("overrides", "failed"),
    [
        ('network.topology={use="./mine.py:touching"}', "contracts-topology.touching"),
        ('network.topology={use="./mine.py:moody"}', "determinism"),
        ('task={use="./mine.py:gap"}', "alone-task.gap"),
        ('task={use="./mine.py:degree"}', "silence-task.degree"),
        ('mind.strategy={use="./mine.py:careful"}', "locality-strategy.careful"),
        ('mind.strategy={use="./mine.py:crowded"}', "one-robot-strategy.crowded"),
        ('mind.strategy={use="./mine.py:led"}', "permutation-strategy.led"),
    ],
)
def test_a_part_that_breaks_one_promise_fails_the_test_of_that_name_alone(
    scenario: Path, overrides: str, failed: str
) -> None:
    found = outcomes(scenario, [overrides], iterations=10, allow_code=True)
    assert [name for name, outcome in found.items() if outcome == "failed"] == [failed]
    others = {outcome for name, outcome in found.items() if not name.startswith("contracts")} - {"failed"}
    assert others == {"skipped" if failed.startswith("contracts") else "passed"}


def test_the_tests_have_these_names_in_pytest(scenario: Path) -> None:
    (scenario.parent / "test_mine.py").write_text(TEST)
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-v", "test_mine.py"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=scenario.parent)
    found = dict(re.findall(r"test_mine\[(.*?)\] (PASSED|FAILED|SKIPPED|ERROR) ", done.stdout))
    names = {test.id for test in parametrize_with_checks(scenario).mark.args[1]}
    assert found.keys() == {name.replace("wander", "careful") for name in names}
    assert [name for name, outcome in found.items() if outcome != "PASSED"] == ["locality-strategy.careful"]
    assert "scenario.toml, iteration 0, robot 0: does something else when others sense" in done.stdout


def test_each_check_has_a_test_for_every_part_that_it_tells_apart() -> None:
    names = {test.id for test in parametrize_with_checks(ROOT / "scenarios" / "room.toml").mark.args[1]}
    assert {name for name in names if name.startswith("contracts")} == {
        *("contracts-physics.pymunk", "contracts-sensor.ir-ring", "contracts-localisation.perfect"),
        *("contracts-computation.occupancy-grid", "contracts-strategy.nearest-frontier", "contracts-topology.knn"),
        *("contracts-channel.perfect", "contracts-motion.pure-pursuit", "contracts-task.coverage"),
    }
    for name, (_, seams) in CHECKS.items():
        assert any(one == name or one.startswith(f"{name}-") for one in names)
        assert set(seams) <= set(SEAMS)


def test_a_broken_promise_of_a_part_without_a_test_of_its_own_fails_them_all() -> None:
    """A part inside another one, for instance."""
    room = ROOT / "scenarios" / "room.toml"
    tests = [test.values[0] for test in parametrize_with_checks(room).mark.args[1] if test.id.startswith("contracts")]
    tests[0].outcomes._known["contracts"] = BrokenError("wrong", "sharing")
    for test in tests:
        with pytest.raises(pytest.fail.Exception, match="wrong"):
            test()


def test_what_one_robot_cannot_do_is_no_failure_of_it() -> None:
    mark = parametrize_with_checks(ROOT / "scenarios" / "operations" / "formation.toml", iterations=2).mark
    tests = {test.id: test.values[0] for test in mark.args[1]}
    tests["contracts-strategy.formation"]()
    with pytest.raises(pytest.skip.Exception, match="one robot alone cannot do this scenario"):
        tests["alone-strategy.formation"]()


def test_pytest_is_imported_only_where_tests_are_made() -> None:
    code = "import swarmsim.testing, sys; assert 'pytest' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)
