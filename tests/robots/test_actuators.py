"""Actuators: what robots decide besides driving, what it really is, who sees it, and what is kept of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import h5py
import numpy as np
import pytest
from conftest import ROOT, made, moments_of, setting_of

from swarmsim.core.errors import InputError, PartError
from swarmsim.core.readings import Channel, Channels, Readings
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.decoding import convert
from swarmsim.core.state import Moment, State
from swarmsim.engine import contracts
from swarmsim.recording.columns import columns_of
from swarmsim.recording.digests import Digests
from swarmsim.recording.reader import Recording
from swarmsim.robots.led import Led, LedLight
from swarmsim.robots.neighbours import Neighbours
from swarmsim.testing import check_contracts, check_locality

LED = LedLight.channels
LIGHTS = "operations/lights"
FAR = 'sensors=[{use="neighbours", reach=9.0, most=15, sees=["led"]}]'
STILL = 'mind.strategy={use="mimic", drive={use="stand"}}'
REACH = 2.2  # m
NEAR = f'sensors=[{{use="neighbours", reach={REACH}, most=15, sees=["led"]}}]'
RED = (255, 0, 0)


def shining(pose: Sequence[Sequence[float]], colours: Sequence[Sequence[int]], alive: Sequence[bool]) -> State:
    place, nothing = np.asarray(pose, float), np.zeros((len(pose), 3))
    lights = Readings(LED, (np.array(colours, np.uint8),))
    return State(0, place, nothing, nothing[:, :2], np.array(alive), lights)


def seen(state: State, walls: Sequence[Sequence[float]] = (), **keys: object) -> Readings:
    context = replace(setting_of(state.robots, walls=walls), actuators=LED)
    return convert({"reach": 5.0, "sees": ["led"], **keys}, Neighbours).build(context).sense(state)


# What it is, and who sees it


def test_a_light_shines_in_the_nearest_colour_that_it_has() -> None:
    wanted = Readings(LED, (np.array([[0, 1, 255], [100, 127, 128]], np.uint8),))
    state = shining(np.zeros((2, 3)), np.zeros((2, 3)), [True, True])
    assert Led().build(setting_of(2)).act(wanted, state)["led"].tolist() == [[0, 1, 255], [100, 127, 128]]
    assert Led(levels=2).build(setting_of(2)).act(wanted, state)["led"].tolist() == [[0, 0, 255], [0, 0, 255]]
    assert Led(levels=4).build(setting_of(2)).act(wanted, state)["led"].tolist() == [[0, 0, 255], [85, 85, 170]]


def test_the_colours_of_neighbours_stand_beside_their_distances_and_what_is_hidden_is_not_seen() -> None:
    pose = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]
    state = shining(pose, [RED, (0, 255, 0), (0, 0, 255)], [True, True, True])
    found = seen(state)
    assert found["neighbours_led"].shape == (3, 2, 3)
    assert found["neighbours_led"][0].tolist() == [[0, 0, 255], [0, 255, 0]]  # the nearest first
    assert found["neighbours"][0, :, 0].tolist() == [1.0, 2.0]
    walled = seen(state, [[1.0, -5.0, 1.0, 5.0]])
    assert walled["neighbours_led"][0].tolist() == [[0, 0, 255], [0, 0, 0]]
    assert walled["neighbours_count"][0] == 1
    assert not walled["neighbours_led"][1].any()
    assert "neighbours_led" not in seen(state, sees=[]).channels


def test_the_lights_of_the_dead_are_not_seen_and_the_dead_see_none() -> None:
    state = shining([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]], [RED] * 3, [True, False, True])
    found = seen(state)
    assert found["neighbours_led"][0].tolist() == [list(RED), [0, 0, 0]]
    assert found["neighbours"][0, 0, 0] == 2.0
    assert not found["neighbours_led"][1].any()


# From hand to hand


def check_passed_on(moments: list[Moment], first: int = 0) -> None:
    """Others shine in the end; and each decides to exactly when it does already or sees one nearby that did before."""
    lit = [moment.intents.commands["led"].any(axis=1) for moment in moments]
    for t, moment in enumerate(moments[1:], 1):
        place = moment.state.pose[:, :2]
        near = np.hypot(*(place[:, None] - place[None]).transpose(2, 0, 1)) <= REACH
        source = lit[t - 1] & moment.state.alive
        np.testing.assert_array_equal(lit[t], lit[t - 1] | (near & source).any(axis=1) & moment.state.alive)
        np.testing.assert_array_equal(moment.state.actuators["led"].any(axis=1), source)
    assert lit[0].tolist() == [robot == first for robot in range(len(lit[0]))]
    assert lit[-1].sum() > 3


def test_a_colour_travels_one_hop_in_each_iteration() -> None:
    moments = moments_of(made(NEAR, STILL, scenario=LIGHTS))
    check_passed_on(moments)
    assert len(moments) > 3
    colours = moments[-1].state.actuators["led"]
    assert (colours == colours[0]).all()
    assert moments[-1].measured.values["lit"] == 1.0


def test_it_does_not_while_lights_are_broken_nor_without_anybody_who_begins(monkeypatch: pytest.MonkeyPatch) -> None:
    limit = "stop.iterations=6"
    dark = moments_of(made(NEAR, STILL, limit, "mind.strategy.first=[]", scenario=LIGHTS))
    assert not any(moment.intents.commands["led"].any() for moment in dark)
    monkeypatch.setattr(LedLight, "act", lambda self, told, state: Readings.filled(LED, {}, state.alive))
    broken = moments_of(made(NEAR, STILL, limit, scenario=LIGHTS))
    assert broken[0].intents.commands["led"].any()
    with pytest.raises(AssertionError):
        check_passed_on(broken)


@pytest.mark.parametrize(("at", "others"), [(1, False), (2, True)])
def test_a_robot_that_dies_before_anybody_looks_has_shown_nothing(at: int, others: bool) -> None:
    """What is decided in iteration 0 is seen in iteration 1, unless its robot is dead by then."""
    dies = f'faults=[{{use="remove", at={at}, robots=[0]}}]'
    moments = moments_of(made(FAR, STILL, dies, "stop.iterations=5", scenario=LIGHTS))
    assert not moments[at].state.actuators["led"][0].any()
    assert moments[-1].state.actuators["led"][1:].any() == others


def test_the_scenario_keeps_every_contract() -> None:
    check_contracts(ROOT / "scenarios" / f"{LIGHTS}.toml", iterations=12)


# Minds of one's own


def run_of(tmp_path: Path, code: str, *overrides: str) -> list[Moment]:
    (tmp_path / "mine.py").write_text(f"import numpy as np\n{code}")
    own = (f'mind={{use="{tmp_path}/mine.py:Mine"}}', 'task={use="travelled", distance=9.0}', "stop.iterations=5")
    with registry.own_code(True):
        return moments_of(made('actuators=[{use="led"}]', FAR, 'sensor={use="ir-ring"}', *own, *overrides))


def mind(decides: str) -> str:
    return f"class Mine:\n    def step(self, me):\n        return {decides}\n"


def test_a_mind_of_ones_own_tells_its_light_and_sees_those_of_others(tmp_path: Path) -> None:
    moments = run_of(
        tmp_path,
        """
class Mine:
    recorded = ("green", "rows")
    green = rows = 0.0

    def step(self, me):
        self.rows, self.green = len(me.neighbours_led), sum(int(green) for _, green, _ in me.neighbours_led)
        return me.drive(0.02).also(led=(me.iteration, 100 + me.id, 0)) if me.id else None
""",
    )
    for before, moment in pairwise(moments):
        led = moment.state.actuators["led"]
        assert led.tolist() == [[0, 0, 0], [moment.state.iteration - 1, 101, 0], [moment.state.iteration - 1, 102, 0]]
        np.testing.assert_array_equal(before.intents.commands["led"], led)
    shown, seen_then = moments[-1].knowledge.shown, moments[-2].readings["neighbours_led"]
    assert shown["green"].tolist() == seen_then[:, :, 1].sum(axis=1).tolist()
    assert shown["rows"].any()


@pytest.mark.parametrize(
    ("decides", "words"),
    [
        (
            "me.drive(0.0).also(lamp=1)",
            "robot 0: step gave 'lamp', which no actuator of these robots takes; known: led",
        ),
        ("me.drive(0.0).also(leb=RED)", "takes; did you mean 'led'"),
        (
            "me.drive(0.0).also(led=(1, 2))",
            r"led: \(1, 2\), of shape \(2,\); expected uint8 of shape \(3,\); .* take led",
        ),
        ("me.drive(0.0).also(led=(300, 0, 0))", r"led: \(300, 0, 0\) does not fit uint8"),
        ("me.drive(0.0).also(led=(0.5, 0, 0))", r"led: \(0.5, 0, 0\) does not fit uint8"),
        ("me.drive(0.0).also(led='red')", "led: 'red'; expected uint8"),
    ],
)
def test_what_an_actuator_cannot_be_told_is_refused_with_the_line(tmp_path: Path, decides: str, words: str) -> None:
    with pytest.raises(PartError, match=words) as caught:
        run_of(tmp_path, f"RED = (255, 0, 0)\n{mind(decides)}")
    assert "in step: def step(self, me):" in str(caught.value)


def test_robots_without_actuators_can_tell_none(tmp_path: Path) -> None:
    with pytest.raises(PartError, match="'led', which no actuator of these robots takes; known: none"):
        run_of(tmp_path, mind("me.drive(0.0).also(led=(1, 2, 3))"), "actuators=[]", "sensors=[]")


def strategy(gives: str) -> str:
    return f"def Mine(observations):\n    n = len(observations.alive)\n    return {gives}\n"


@pytest.mark.parametrize(
    ("gives", "words"),
    [
        (
            "np.zeros((n, 2)), {'lamp': np.zeros(n)}",
            "Mine gave 'lamp', which no actuator of these robots takes; known: led",
        ),
        ("np.zeros((n, 2)), {'led': np.zeros((n, 2))}", r"led: an array .*\(3, 2\); expected uint8 of shape \(3, 3\)"),
        ("Intents(**GOOD, commands={'lamp': np.zeros(n)})", "commands: 'lamp', which no actuator .*known: led"),
        (
            "Intents(**GOOD, commands={'led': np.zeros((n, 3))})",
            r"commands\['led'\]: float64 .*expected uint8 .*\(3, 3\)",
        ),
        ("Intents(**GOOD, commands=[1])", r"commands: \[1\]; expected a dict of arrays by channel"),
    ],
)
def test_functions_and_strategies_give_arrays_by_channel(tmp_path: Path, gives: str, words: str) -> None:
    head = """
from dataclasses import fields
from swarmsim.core.state import Intents
STILL = Intents.twisting(np.zeros((3, 2)))
GOOD = {one.name: getattr(STILL, one.name) for one in fields(Intents) if one.name != "commands"}
"""
    own = f'mind={{strategy={{use="{tmp_path}/mine.py:Mine"}}, computation={{use="reactive"}}}}'
    good = "np.zeros((n, 2)), {'led': np.full((n, 3), 7)}"
    assert (run_of(tmp_path, strategy(good), own)[-1].state.actuators["led"] == 7).all()
    with pytest.raises(PartError, match=words):
        run_of(tmp_path, head + strategy(gives), own)


def test_a_strategy_that_tells_lights_what_others_see_is_found_not_to_be_local(tmp_path: Path) -> None:
    peeks = strategy(
        "np.zeros((n, 2)), {'led': np.roll(observations.readings['neighbours_count'], 1)[:, None] + [[0] * 3]}"
    )
    (tmp_path / "mine.py").write_text(f"import numpy as np\n{peeks}")
    own = f'mind={{strategy={{use="{tmp_path}/mine.py:Mine"}}, computation={{use="reactive"}}}}'
    lights = ("robots.count=5", 'sensors=[{use="neighbours", reach=1.0}]', own)
    with pytest.raises(AssertionError, match="does something else when others sense"):
        check_locality(ROOT / "scenarios" / f"{LIGHTS}.toml", lights, 10, allow_code=True)


# What they declare


@pytest.mark.parametrize(
    ("channel", "words"),
    [
        (Channel("lamp"), "'lamp': rests at nan; expected a blank within -inf and inf"),
        (Channel("lamp", low=1.0, high=2.0, blank=0.0), "'lamp': rests at 0; expected a blank within 1 and 2"),
        (Channel("lamp.left", blank=0.0), "'lamp.left': of a frame, a group or a structure"),
        (Channel("lamp", "f8", (2,), frame="world", blank=0.0), "'lamp': of a frame"),
        (Channel("Lamp", blank=0.0), "'Lamp': "),
    ],
)
def test_a_declaration_that_cannot_be_is_refused(channel: Channel, words: str) -> None:
    assert contracts.acting(LED, 3) is None
    assert words in (contracts.acting(Channels(channel), 3) or "")


def test_what_an_actuator_gives_is_held_to_its_declaration() -> None:
    lamp = Channels(Channel("lamp", low=0.0, high=1.0, blank=0.0))
    state = shining(np.zeros((2, 3)), np.zeros((2, 3)), [True, True])
    assert contracts.readings(Readings(lamp, (np.array([0.0, 1.0]),)), state, lamp, "act") is None
    for column, words in ((np.array([0.0, 2.0]), "lamp: 2.0 at [1]"), (np.array([np.nan, 0.0]), "[0] is not finite")):
        assert words in (contracts.readings(Readings(lamp, (column,)), state, lamp, "act") or "")
    assert contracts.readings(None, state, lamp, "act") == "act: NoneType; expected Readings"


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (['actuators=[{use="led"}, {use="led"}]'], r"actuators\[1\]\.name: gives 'led', as actuators\[0\] does"),
        (['actuators=[{use="led", levels=1}]'], r"actuators\[0\]\.levels: "),
        (['actuators=[{use="lamp"}]'], r"actuators\[0\]\.use: no actuator is called 'lamp'"),
        (
            ["actuators=[]", "sensors=[]"],
            r"mind\.strategy\.light: no actuator of these robots shines as 'led'; known: none",
        ),
        (
            ['actuators=[{use="led", name="tail"}]'],
            r"sensors\[0\]\.sees: no actuator of these robots is 'led'.*tail_led",
        ),
        (["sensors=[]"], r"needs 'neighbours_led' .*; expected the sensor 'neighbours' with sees = \['led'\]"),
        (["mind.strategy.first=[16]"], r"mind\.strategy\.first: there is no robot 16"),
    ],
)
def test_what_does_not_go_together_is_refused_before_the_run(overrides: list[str], words: str) -> None:
    with pytest.raises(InputError, match=words):
        made(*overrides, scenario=LIGHTS)


def test_two_lights_are_told_apart_by_their_names() -> None:
    both = 'actuators=[{use="led"}, {use="led", name="tail", levels=2}]'
    sees = 'sensors=[{use="neighbours", reach=9.0, sees=["tail_led", "led"]}]'
    moments = moments_of(made(both, sees, "stop.iterations=4", scenario=LIGHTS))
    state, readings = moments[-1].state, moments[-1].readings
    assert [one.name for one in state.actuators.channels] == ["led", "tail_led"]
    assert state.actuators["led"].any()
    assert not state.actuators["tail_led"].any()  # told nothing, it rests
    assert readings["neighbours_led"].any()
    assert not readings["neighbours_tail_led"].any()


def test_an_actuator_and_a_sensor_cannot_have_one_table(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text("""
from msgspec import Struct
from swarmsim.core.readings import Channel, Channels, Readings

class Mine(Struct, frozen=True):
    def build(self, context):
        return Made()

class Made:
    channels = Channels(Channel("ground", blank=0.0))

    def act(self, commands, state):
        return commands
""")
    floor = 'sensors=[{use="ground", floors=[{use="formula", formula="x"}]}]'
    with registry.own_code(True), pytest.raises(InputError, match="actuators: 'ground' is already given by a sensor"):
        made(f'actuators=[{{use="{tmp_path}/mine.py:Mine"}}]', 'sensor={use="ir-ring"}', floor)


# Faults


def test_a_frozen_mind_keeps_its_light_and_one_that_starts_again_rests(tmp_path: Path) -> None:
    blinks = mind("me.drive(0.0).also(led=(1 + me.iteration, 0, 0))")
    lights = {}
    for failure in ("frozen", "reboot"):
        fault = f'faults=[{{use="mind", failure="{failure}", at=2, duration=2, robots=[1]}}]'
        lights[failure] = [moment.state.actuators["led"][:, 0].tolist() for moment in run_of(tmp_path, blinks, fault)]
    plain = [0, 1, 2, 3, 4]
    assert [row[1] for row in lights["frozen"]] == [0, 1, 2, 2, 2]
    assert [row[1] for row in lights["reboot"]] == [0, 1, 2, 0, 0]
    assert [row[0] for row in lights["frozen"]] == [row[2] for row in lights["reboot"]] == plain


def test_whose_neighbours_are_off_sees_no_lights_and_whose_are_stuck_sees_those_of_before() -> None:
    def run(failure: str) -> list[Moment]:
        fault = f'faults=[{{use="sensor", failure="{failure}", channels=["neighbours"], at=3, robots=[1]}}]'
        return moments_of(made(FAR, fault, 'mind.strategy={use="mimic", first=[2], drive={use="wander"}}',
                               "stop.iterations=6", scenario=LIGHTS))  # fmt: skip

    off, stuck = run("off"), run("stuck")
    assert off[2].readings["neighbours_led"][1].any()
    for moment in off[3:]:
        assert not moment.readings["neighbours_led"][1].any()
        assert moment.readings["neighbours_led"][3].any()
    for moment in stuck[4:]:
        np.testing.assert_array_equal(moment.readings["neighbours_led"][1], stuck[3].readings["neighbours_led"][1])


# What is kept


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Recording, Digests]:
    folder, digests = tmp_path_factory.mktemp("lights"), Digests()
    run = made("stop.iterations=12", scenario=LIGHTS)
    with run.recorder(folder / "recording.h5") as recorder:
        run.simulation.run([recorder, digests])
    return Recording(folder), digests


def test_colours_are_recorded_read_back_and_digested(recorded: tuple[Recording, Digests]) -> None:
    recording, digests = recorded
    assert recording.digested[-1] == "actuators"
    assert recording.digest() == digests.total()
    assert recording.actuators == LED
    assert recording["led"].shape == (12, 16, 3)
    assert recording["led"][1, 0].tolist() == [255, 0, 255]
    assert not recording["led"][0].any()
    frame = columns_of(recording, "led")
    assert list(frame) == ["iteration", "time (s)", "robot", "red (sRGB)", "green (sRGB)", "blue (sRGB)"]
    other = Digests()
    made("stop.iterations=2", "mind.strategy.colour=[0, 0, 9]", scenario=LIGHTS).simulation.run([other])
    assert recording.difference(0, digests.rows[0], {}) is None
    assert recording.difference(0, other.rows[0], {}) == "iteration 0, field 'actuators'"


@pytest.mark.parametrize(
    "text", ['[{"name": "led"}]', '[{"name": "pose", "dtype": "u1"}]', '{"name": "led"}', "[[]]", '[{"name": "lost"}]']
)
def test_a_strangers_declaration_of_actuators_is_refused(
    text: str, recorded: tuple[Recording, Digests], tmp_path: Path
) -> None:
    (tmp_path / "recording.h5").write_bytes(recorded[0].path.read_bytes())
    with h5py.File(tmp_path / "recording.h5", "r+") as file:
        del file.attrs["actuators"]
        file.attrs["actuators"] = np.bytes_(text.encode())
    with pytest.raises(InputError, match="not a whole recording"):
        Recording(tmp_path)
