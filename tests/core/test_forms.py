"""Minds as classes of one robot, and parts as plain functions: run and held to contracts as all others."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, moments_of
from numpy.testing import assert_allclose, assert_array_equal

from swarmsim.core.errors import InputError, PartError
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.file import load
from swarmsim.engine.build import build
from swarmsim.operations.mapping.exploration.nearest import NearestFrontier
from swarmsim.recording.reader import Recording

CODE = '''
import numpy as np
from swarmsim.core.state import Measured


class Follower:
    """Turns to the mean of the directions that it hears."""

    message_fields = {"yaw": "f8", "steps": "i4"}
    recorded = ("steps",)

    def __init__(self, speed: float = 0.05):
        self.speed, self.steps, self.wanted = speed, 0, 0.0

    def say(self, me):
        return {"yaw": me.yaw, "steps": self.steps}

    def hear(self, me):
        turns = [np.exp(1j * message.yaw) for message in me.heard]
        self.wanted = float(np.angle(sum(turns) + np.exp(1j * me.yaw)))

    def step(self, me):
        self.steps += 1
        return me.head(self.wanted, self.speed)


class Silent:
    """Says nothing, and goes where its number tells it to."""

    def step(self, me):
        return me.go([(me.x + 0.1, me.y), (me.x + 0.1, me.y + 0.1)]) if me.id % 2 else None


class Curious:
    """Drives on over a map that another part has made for it."""

    def step(self, me):
        assert me.knowledge.observed.shape == me.lattice.shape
        assert not me.knowledge.observed.flags.writeable
        return me.drive(0.05, me.random.uniform(-1.0, 1.0) if len(me.walls) else 0.0)


class Broken:
    def __init__(self, how: str = "raise"):
        self.how = how

    def step(self, me):
        if me.iteration == 2 and me.id == 1:
            if self.how == "raise":
                raise ValueError("lost my way")
            if self.how == "write":
                me.velocity[:] = 0.0
            return "north"


class Half:
    message_fields = {"x": "f8"}

    def step(self, me):
        return None


def circle(observations, *, ahead: float = 0.05, turn: float = 0.5):
    """Everybody drives a circle."""
    return np.tile([ahead, turn], (len(observations.alive), 1))


def mean(observations, value, *, gain: float = 0.3):
    if value is None:
        return observations.pose[:, :2].copy()
    inbox = observations.inbox
    new = value.copy()
    np.add.at(new, inbox.receivers, gain * (inbox.content.value - value[inbox.receivers]))
    return new


def wrong_shape(observations, value):
    return np.zeros((3, 2)) if value is None else np.zeros(3)


def listing(state):
    return np.array([[0, 1], [1, 0]], np.int32)


def travelled(moment, *, far: float = 1e9):
    """How far robots are from the origin, in m."""
    away = float(np.hypot(*moment.state.pose[:, :2].T).mean())
    return away, away > far


def number(moment):
    return 1


def half(moment):
    """A whole number at first, as one writes it by mistake."""
    return Measured({"half": 0 if moment.state.iteration == 0 else 0.5})


class Outward:
    def step(self, me):
        return me.go((-40.0, -40.0))


class Nearly:
    """Follows a way at first, then a velocity: what it does not do is NaN, which is no mistake."""

    message_fields = {"far": "f4", "yes": "?", "place": "(2,)f8"}

    def say(self, me):
        return {"far": 0.1, "yes": True, "place": (me.x, me.y)}

    def step(self, me):
        return me.go((me.x, me.y)) if me.iteration % 2 else me.drive(np.float32(0.1), np.array(0.5))


def all_of_it(moment):
    return Measured({"all_of_it": 2.0, "more": 3.0}, {}, 0.5)
'''


@pytest.fixture
def own(tmp_path: Path):
    (tmp_path / "mine.py").write_text(CODE)
    room = (ROOT / "scenarios" / "room.toml").read_text().replace("../worlds", str(ROOT / "worlds"))
    path = tmp_path / "room.toml"
    path.write_text(room)

    def opened(*overrides: str):
        with registry.own_code(True):
            whole = ('task={use="./mine.py:travelled"}', "stop.iterations=6", *overrides)
            return build(load(path, whole), str(path))

    return opened


MIND = 'mind={use="./mine.py:Follower"}'


def test_one_key_names_both_halves_of_a_mind_and_what_it_shows_is_recorded(own, tmp_path: Path) -> None:
    run = own(MIND, 'network.topology={use="full"}')
    start = run.simulation.state.pose[:, 2].copy()
    with run.recorder(tmp_path / "r.h5") as recorder:
        run.simulation.run([recorder])
    recording = Recording(tmp_path / "r.h5")
    assert recording.iterations == 6
    # A mind shows what it knew after it had heard, before it decided.
    assert_array_equal(recording["steps"], np.tile(np.arange(6.0)[:, None], 3))
    mean = np.angle(np.exp(1j * start).sum())
    assert_allclose(np.exp(1j * recording["pose"][-1, :, 2]), np.exp(1j * mean), atol=0.2)
    assert recording.letters(0)[0, 3] == 6 + 8 + 4  # header, yaw, steps


def test_keys_of_a_class_are_those_of_its_constructor(own) -> None:
    slow, fast = (own(f'mind={{use="./mine.py:Follower", speed={speed}}}') for speed in (0.01, 0.1))
    for run in (slow, fast):
        run.simulation.run()
    gone = [np.hypot(*(r.simulation.state.pose - r.simulation.parts.strategy._part._swarm._context.start)[:, :2].T)
            for r in (slow, fast)]  # fmt: skip
    assert gone[1].max() > 3 * gone[0].max()
    with pytest.raises(InputError, match=r"mind\.computation\.sped: unknown key; did you mean 'speed'"):
        own('mind={use="./mine.py:Follower", sped=1.0}')
    with pytest.raises(InputError, match=r"room\.toml: mind\.use sets both computation and strategy"):
        own('mind={use="./mine.py:Follower", strategy={use="stand"}}')


def test_a_silent_mind_sends_headers_and_goes_its_way(own) -> None:
    run = own('mind={use="./mine.py:Silent"}', "stop.iterations=1")
    moment = moments_of(run)[0]
    assert moment.intents.counts.tolist() == [0, 3, 0]  # from where it is
    assert_allclose(np.diff(moment.intents.waypoints[1], axis=0), [[0.1, 0.0], [0.0, 0.1]], atol=1e-12)
    assert moment.intents.planned.tolist() == [False, True, False]
    assert np.isnan(moment.intents.goals[0]).all()
    assert moment.intents.goals[1].tolist() == moment.intents.waypoints[1, 2].tolist()
    assert set(moment.delivery.heard[:, 3].tolist()) == {6}


def test_a_mind_decides_on_the_map_that_another_computation_makes(own) -> None:
    run = own('mind.strategy={use="./mine.py:Curious"}', 'task={use="coverage"}')
    moments = moments_of(run)
    assert moments[-1].measured.values["coverage"] > moments[0].measured.values["coverage"]
    assert moments_of(own('mind.strategy={use="./mine.py:Curious"}'))[-1].state.pose.tolist() == (
        moments[-1].state.pose.tolist()
    )


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ("raise", r"ValueError: lost my way, robot 1\n.*mine\.py, line \d+, in step"),
        ("write", r"ValueError: assignment destination is read-only, robot 1"),
        ("talk", r"robot 1: step gave 'north'; expected me\.drive"),
    ],
)
def test_what_goes_wrong_in_a_mind_names_it_the_robot_and_the_line(own, how: str, words: str) -> None:
    run = own(f'mind={{use="./mine.py:Broken", how="{how}"}}')
    with pytest.raises(PartError, match=rf"(?s)strategy mine\.py:Broken, iteration 2: {words}"):
        run.simulation.run()


def test_a_way_out_of_the_building_can_be_recorded(own, tmp_path: Path) -> None:
    run = own('mind={use="./mine.py:Outward"}')
    with run.recorder(tmp_path / "r.h5") as recorder:
        run.simulation.run([recorder])
    assert (Recording(tmp_path / "r.h5")["goals"] == -40.0).all()


def test_velocities_and_ways_take_turns(own) -> None:
    moments = moments_of(own('mind={use="./mine.py:Nearly"}'))
    assert np.isfinite(moments[0].intents.twists).all()
    assert np.isnan(moments[1].intents.twists).all()
    assert set(moments[0].delivery.heard[:, 3].tolist()) == {6 + 4 + 1 + 16}


def test_measures_are_recorded_as_they_are_though_the_first_is_a_whole_number(own, tmp_path: Path) -> None:
    run = own('task={use="./mine.py:half"}')
    with run.recorder(tmp_path / "r.h5") as recorder:
        run.simulation.run([recorder])
    assert Recording(tmp_path / "r.h5")["half"].tolist() == [0.0, 0.5, 0.5, 0.5, 0.5, 0.5]


def test_half_a_conversation_is_refused(own) -> None:
    with pytest.raises(
        InputError, match="Half: expected both 'message_fields', the fields of a message, and 'say', or neither"
    ):
        own('mind={use="./mine.py:Half"}')


def test_minds_forget_and_adopt(own) -> None:
    run = own(MIND, 'faults=[{use="mind", failure="reboot", at=3, robots=[1]}]')
    assert [m.knowledge.steps.tolist() for m in moments_of(run)][-1] == [5.0, 1.0, 5.0]
    run = own(MIND)
    run.simulation.run()
    computation = run.simulation.parts.computation._part
    computation.copy_from(np.array([1]), 0)
    minds = computation._swarm.minds
    assert minds[1].steps == minds[0].steps == 6
    assert minds[1] is not minds[0]


def test_functions_are_strategies_computations_topologies_and_tasks(own) -> None:
    keys = (
        'mind.strategy={use="./mine.py:circle", turn=0.25}',
        'mind.computation={use="./mine.py:mean"}',
        'network.topology={use="./mine.py:listing"}',
    )
    moments = moments_of(own(*keys, "stop.iterations=30"))
    assert_allclose(moments[0].intents.twists, np.tile([0.05, 0.25], (3, 1)))
    assert moments[0].links.tolist() == [[0, 1], [1, 0]]
    assert set(moments[0].delivery.heard[:, 3].tolist()) == {6 + 16}
    value = moments[-1].knowledge.value
    start = moments[0].state.pose[:, :2]
    assert_allclose(value[:2], np.tile(start[:2].mean(axis=0), (2, 1)), atol=1e-9)
    assert_array_equal(value[2], start[2])
    assert list(moments[0].measured.values) == ["travelled"]


def test_tasks_give_a_number_whether_they_are_done_or_everything(own) -> None:
    assert own('task={use="./mine.py:travelled", far=0.1}').simulation.run()
    assert not own('task={use="./mine.py:number"}').simulation.run()
    assert moments_of(own('task={use="./mine.py:all_of_it"}'))[0].measured.values["more"] == 3.0
    with pytest.raises(InputError, match=r"task\.near: unknown key; known: far"):
        own('task={use="./mine.py:travelled", near=0.1}')


def test_a_function_that_changes_its_mind_about_shapes_is_refused(own) -> None:
    run = own('mind.computation={use="./mine.py:wrong_shape"}', 'mind.strategy={use="stand"}')
    with pytest.raises(PartError, match=r"computation mine\.py:wrong_shape, iteration 0: wrong_shape gave an array"):
        run.simulation.run()


def test_what_has_no_form_for_its_seam_is_refused(own) -> None:
    with pytest.raises(InputError, match=r"network\.channel\.use: .*is not a channel: expected a msgspec\.Struct"):
        own('network.channel={use="./mine.py:circle"}')
    with pytest.raises(InputError, match=r"task\.use: .*is not a task"):
        own('task={use="./mine.py:Follower"}')


def test_simple_forms_are_held_to_their_contracts_and_ours_are_not_wrapped(own) -> None:
    ours = own().simulation.parts.strategy
    assert type(ours).__module__ == type(NearestFrontier().build).__module__ or registry.is_ours(ours)
    assert not registry.is_ours(own(MIND).simulation.parts.strategy._part)
