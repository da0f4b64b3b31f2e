from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conftest import made, setting_of
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from swarmsim.core.errors import InputError
from swarmsim.core.events import Begins, Ends
from swarmsim.core.messages import Delivery
from swarmsim.core.parts import Parts, Schedule, Tick
from swarmsim.core.state import Moment, State
from swarmsim.faults.radio import Radio
from swarmsim.network.channel import PerfectChannel
from swarmsim.network.delays import LatentChannel
from swarmsim.recording.digests import Digests

POSE = np.array([[1.0, 1.0, 0.0], [3.0, 1.0, 0.0], [5.0, 1.0, 0.0], [7.0, 3.0, 0.0]])
SIZES = np.array([10, 20, 30, 40], np.int32)
Letter = tuple[int, int, int]  # receiver, sender, iteration sent


class Walking:
    """Bodies that are moved by hand: `pose` and `alive` are what the next state has."""

    def __init__(self, pose: np.ndarray) -> None:
        self.pose, self.alive, self.iteration = pose.copy(), np.ones(len(pose), bool), 0

    def state(self) -> State:
        nothing = np.zeros_like(self.pose)
        return State(self.iteration, self.pose.copy(), nothing, nothing[:, :2], self.alive.copy())

    def drive(self, motion: object, period: float) -> State:
        self.iteration += 1
        return self.state()


class Trial:
    """Robots that all talk to all others in every iteration, over a channel with these faults."""

    def __init__(self, *faults: Radio, inner: object | None = None, pose: np.ndarray = POSE, seed: int = 1) -> None:
        self.bodies = Walking(pose)
        self.schedule, self.events = Schedule(self.bodies.state()), []
        context = setting_of(len(pose), seed=seed)
        inner = PerfectChannel() if inner is None else inner
        parts = Parts(*[None] * 5, inner, None, self.bodies, None, None, self.schedule, None)
        for number, fault in enumerate(faults):
            parts = fault.build(replace(context, number=number)).install(parts)
        self.parts = parts
        self._advance()
        self.sent: set[Letter] = set()
        self.deliveries: list[Delivery] = []

    def tick(self, iterations: int = 1) -> Trial:
        for _ in range(iterations):
            state = self.bodies.state()
            live = np.flatnonzero(state.alive)
            links = np.array([(i, j) for i in live for j in live if i != j], np.int32).reshape(-1, 2)
            self.sent |= {(int(i), int(j), state.iteration) for i, j in links}
            sizes = np.resize(SIZES, len(state.alive))
            self.deliveries.append(self.parts.channel.deliver(state, links, sizes))
            self.parts.bodies.drive(None, 1.0)
            self._advance()
        return self

    def _advance(self) -> None:
        state = self.bodies.state()
        self.events += self.schedule.advance(Tick(state.iteration, state, state, 0.0))

    def heard(self, iteration: int) -> set[Letter]:
        return {tuple(row[:3]) for row in self.deliveries[iteration].heard.tolist()}

    def lost(self, iteration: int) -> dict[Letter, str]:
        return {tuple(row[:3]): reason for reason, rows in self.deliveries[iteration].lost for row in rows.tolist()}


def latent(iterations: int) -> LatentChannel:
    return LatentChannel(PerfectChannel(), lambda arrived: np.full(len(arrived), iterations))


def pairs(iteration: int, robots: int = 4) -> set[Letter]:
    return {(i, j, iteration) for i in range(robots) for j in range(robots) if i != j}


@pytest.mark.parametrize(("failure", "ends"), [("transmit", {1}), ("receive", {0}), ("off", {0, 1})])
def test_a_dead_radio_loses_what_it_should_from_the_onset_to_the_end(failure: str, ends: set[int]) -> None:
    trial = Trial(Radio(failure=failure, at=2, duration=3, robots=[1])).tick(7)
    for t in range(7):
        lost = {letter for letter in pairs(t) if any(letter[end] == 1 for end in ends)} if 2 <= t < 5 else set()
        assert trial.lost(t) == dict.fromkeys(lost, "radio off")
        assert trial.heard(t) == pairs(t) - lost
    assert trial.events == [Begins(2, 0, (1,)), Ends(5, 0, (1,))]


def test_lost_messages_keep_their_size_and_the_rest_its_order() -> None:
    delivery = Trial(Radio(failure="transmit", at=0, robots=[1])).tick().deliveries[0]
    ((_, rows),) = delivery.lost
    assert rows.tolist() == [[0, 1, 0, 20], [2, 1, 0, 20], [3, 1, 0, 20]]
    assert delivery.heard.tolist() == sorted(delivery.heard.tolist())
    assert delivery.heard.dtype == np.int32


def test_what_is_under_way_to_a_robot_that_goes_deaf_is_lost_when_it_would_arrive() -> None:
    trial = Trial(Radio(failure="receive", at=4, duration=2, robots=[1]), inner=latent(3)).tick(10)
    for t in range(10):
        due = pairs(t - 3) if t >= 3 else set()
        lost = {letter for letter in due if letter[0] == 1} if 4 <= t < 6 else set()
        assert trial.lost(t) == dict.fromkeys(lost, "radio off")
        assert trial.heard(t) == due - lost


def test_what_is_under_way_from_a_robot_that_falls_silent_still_arrives() -> None:
    trial = Trial(Radio(failure="transmit", at=4, duration=2, robots=[1]), inner=latent(3)).tick(10)
    for t in range(10):
        silent = {letter for letter in pairs(t) if letter[1] == 1} if 4 <= t < 6 else set()
        assert trial.lost(t) == dict.fromkeys(silent, "radio off")
        muted = {letter for letter in pairs(t - 3) if letter[1] == 1} if 4 <= t - 3 < 6 else set()
        assert trial.heard(t) == (pairs(t - 3) - muted if t >= 3 else set())


def test_nothing_acting_leaves_the_channel_alone() -> None:
    calls = []

    class Spy(PerfectChannel):
        def deliver(self, state, links, sizes):
            calls.append((links, sizes))
            self.last = super().deliver(state, links, sizes)
            return self.last

    spy = Spy()
    trial = Trial(Radio(failure="loss", loss=0.5, at=3, robots=[1]), inner=spy)
    links, state = np.array([[0, 1], [1, 0]], np.int32), trial.bodies.state()
    assert trial.parts.channel.deliver(state, links, SIZES) is spy.last
    assert calls[0][0] is links
    assert calls[0][1] is SIZES


def test_messages_to_and_from_a_bad_radio_are_lost_as_often_as_asked() -> None:
    trial = Trial(Radio(failure="loss", loss=0.3, at=0, robots=[1])).tick(3000)
    lost = {letter for t in range(3000) for letter in trial.lost(t)}
    assert all(1 in letter[:2] for letter in lost)
    assert {reason for t in range(3000) for reason in trial.lost(t).values()} == {"loss"}
    draws = 6 * 3000
    low, high = stats.binom.interval(0.99, draws, 0.3)
    assert low <= len(lost) <= high
    for end in (0, 1):
        assert abs(sum(letter[end] == 1 for letter in lost) / (draws / 2) - 0.3) < 0.03


def test_a_loss_of_one_loses_everything() -> None:
    trial = Trial(Radio(failure="loss", loss=1.0, at=0, robots=[0, 1, 2, 3], min_alive=0)).tick(5)
    assert all(set(trial.lost(t)) == pairs(t) for t in range(5))


def test_one_more_robot_shifts_nobody_elses_losses() -> None:
    fault = Radio(failure="loss", loss=0.5, at=0, robots=[1])
    few, many = Trial(fault).tick(50), Trial(fault, pose=np.vstack([POSE, [[9.0, 9.0, 0.0]]])).tick(50)
    for t in range(50):
        assert set(few.lost(t)) == {letter for letter in many.lost(t) if 4 not in letter[:2]}
    assert any(few.lost(t) for t in range(50))


def test_losses_depend_on_the_seed_and_on_the_fault() -> None:
    fault = Radio(failure="loss", loss=0.5, at=0, robots=[1])
    one, again, other = Trial(fault).tick(30), Trial(fault).tick(30), Trial(fault, seed=2).tick(30)
    twice = Trial(fault, fault).tick(300)
    assert [one.lost(t) for t in range(30)] == [again.lost(t) for t in range(30)]
    assert [one.lost(t) for t in range(30)] != [other.lost(t) for t in range(30)]
    share = sum(len(twice.lost(t)) for t in range(300)) / (6 * 300)
    assert abs(share - 0.75) < 0.04  # two draws each, independent


def test_a_slow_radio_holds_messages_and_tells_how_old_they_are() -> None:
    trial = Trial(Radio(failure="delay", delay=2, at=1, duration=3, robots=[1])).tick(8)
    for t in range(8):
        prompt = {letter for letter in pairs(t) if not (1 in letter[:2] and 1 <= t < 4)}
        late = {letter for letter in pairs(t - 2) if 1 in letter[:2]} if 1 <= t - 2 < 4 else set()
        assert trial.heard(t) == prompt | late
        assert trial.lost(t) == {}
        held = [sent for sent in range(1, 4) if sent <= t < sent + 2]
        assert trial.deliveries[t].oldest == min([*held, t])
        rows = trial.deliveries[t].heard[:, :3].tolist()
        assert rows == sorted(rows)


def test_delays_of_two_faults_and_of_the_channel_add_up() -> None:
    faults = (Radio(failure="delay", delay=2, at=0, robots=[1]), Radio(failure="delay", delay=1, at=0, robots=[1, 2]))
    trial = Trial(*faults, inner=latent(1)).tick(8)
    when = {letter: t for t in range(8) for letter in trial.heard(t)}
    assert when[0, 3, 0] == 1
    assert when[0, 2, 0] == 2
    assert when[1, 0, 0] == when[2, 1, 0] == 4


def test_a_message_held_for_a_robot_that_dies_is_lost() -> None:
    trial = Trial(Radio(failure="delay", delay=3, at=0, robots=[1])).tick(2)
    trial.bodies.alive[1] = False
    trial.tick(4)
    for t in (3, 4):
        assert trial.lost(t) == {letter: "receiver dead" for letter in pairs(t - 3) if letter[0] == 1}
    assert {letter for letter in pairs(0) if letter[1] == 1} <= trial.heard(3)


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_a_held_message_meets_a_deaf_receiver_in_either_order_of_the_faults(order: tuple[int, int]) -> None:
    faults = (Radio(failure="delay", delay=3, at=0, duration=1, robots=[1]), Radio(failure="receive", at=3, robots=[1]))
    trial = Trial(*(faults[i] for i in order)).tick(5)
    assert {letter for letter in pairs(0) if letter[0] == 1} <= set(trial.lost(3))
    assert {letter for letter in pairs(0) if letter[1] == 1} <= trial.heard(3)


def test_whoever_is_in_a_jammed_area_neither_sends_nor_hears_while_there() -> None:
    trial = Trial(Radio(failure="jam", area=(2.0, 0.0, 6.0, 2.0), at=1, duration=4)).tick(2)
    assert trial.lost(0) == {}
    for _ in range(4):  # robot 1 walks out of the area, robot 3 into it
        trial.bodies.pose[1, 0] -= 0.4
        trial.bodies.pose[3, 1] -= 0.4
        t, pose = trial.bodies.iteration, trial.bodies.pose
        inside = {i for i in range(4) if 2.0 <= pose[i, 0] <= 6.0 and 0.0 <= pose[i, 1] <= 2.0} if t < 5 else set()
        trial.tick()
        assert trial.lost(t) == {letter: "jammed" for letter in pairs(t) if inside & set(letter[:2])}
    assert trial.events == [Begins(1, 0), Ends(5, 0)]


def test_what_is_under_way_into_a_jammed_area_is_lost_on_arrival() -> None:
    trial = Trial(Radio(failure="jam", area=(2.0, 0.0, 6.0, 2.0), at=3, duration=1), inner=latent(2)).tick(7)
    assert trial.lost(3) == {letter: "jammed" for letter in pairs(1) if letter[0] in (1, 2)} | {
        letter: "jammed" for letter in pairs(3) if letter[1] in (1, 2)
    }
    assert trial.lost(2) == trial.lost(4) == {}


def test_a_swarm_in_groups_hears_nothing_from_other_groups() -> None:
    trial = Trial(Radio(failure="partition", groups=[[0, 2], [1]], at=1, duration=2)).tick(4)
    part = {0: "a", 2: "a", 1: "b", 3: "c"}
    for t in range(4):
        between = {letter for letter in pairs(t) if part[letter[0]] != part[letter[1]]} if 1 <= t < 3 else set()
        assert trial.lost(t) == dict.fromkeys(between, "partition")
        assert trial.heard(t) == pairs(t) - between


@pytest.mark.parametrize(("line", "left"), [({"x": 4.0}, {0, 1}), ({"y": 2.0}, {0, 1, 2})])
def test_a_line_parts_the_swarm_as_it_stands_at_the_onset(line: dict[str, float], left: set[int]) -> None:
    trial = Trial(Radio(failure="partition", at=1, duty=(3, 1), **line))
    trial.tick(1)
    trial.bodies.pose[:] = POSE[::-1]  # too late to change sides
    trial.tick(3)
    for t in range(1, 4):
        assert trial.lost(t) == {
            letter: "partition" for letter in pairs(t) if (letter[0] in left) != (letter[1] in left)
        }
    trial.tick(2)
    assert trial.lost(4) == {}
    other = {3 - robot for robot in left}  # when it strikes again, all have moved
    assert trial.lost(5) == {letter: "partition" for letter in pairs(5) if (letter[0] in other) != (letter[1] in other)}


def test_a_message_has_one_reason_whatever_happens_to_it() -> None:
    everything = (
        Radio(failure="partition", groups=[[0, 1]], at=0),
        Radio(failure="jam", area=(0.0, 0.0, 9.0, 9.0), at=0),
        Radio(failure="off", at=0, robots=[0, 1, 2, 3], min_alive=0),
    )
    trial = Trial(*everything).tick(3)
    for t in range(3):
        rows = [tuple(row[:3]) for _, letters in trial.deliveries[t].lost for row in letters.tolist()]
        assert sorted(rows) == sorted(pairs(t))
        assert {reason for reason, letters in trial.deliveries[t].lost if len(letters)} == {"partition", "jammed"}


WHEN = st.fixed_dictionaries({"at": st.integers(0, 8), "duration": st.integers(1, 6)})
WHO = st.fixed_dictionaries({"robots": st.lists(st.integers(0, 3), min_size=1, unique=True), "min_alive": st.just(0)})
KINDS = st.one_of(
    *(st.tuples(st.just({"failure": failure}), WHEN, WHO) for failure in ("transmit", "receive", "off")),
    st.tuples(st.fixed_dictionaries({"failure": st.just("loss"), "loss": st.floats(0.01, 1.0)}), WHEN, WHO),
    st.tuples(st.fixed_dictionaries({"failure": st.just("delay"), "delay": st.integers(1, 5)}), WHEN, WHO),
    st.tuples(st.just({"failure": "jam", "area": (2.0, 0.0, 6.0, 2.0)}), WHEN),
    st.tuples(st.just({"failure": "partition", "x": 4.0}), WHEN),
)


@settings(derandomize=True, deadline=None, max_examples=60)
@given(st.lists(KINDS, min_size=1, max_size=4), st.integers(0, 3), st.lists(st.integers(0, 11), max_size=4))
def test_every_message_is_heard_or_lost_exactly_once(kinds, latency: int, deaths: list[int]) -> None:
    faults = [Radio(**{key: value for part in kind for key, value in part.items()}) for kind in kinds]
    trial = Trial(*faults, inner=latent(latency))
    for t in range(12 + 30):
        for robot, death in enumerate(deaths):
            if death == t:
                trial.bodies.alive[robot] = False
        if t == 12:
            trial.bodies.alive[:] = False  # nobody says anything any more; what is under way ends
        trial.tick()
    ended = [letter for t in range(len(trial.deliveries)) for letter in (*trial.heard(t), *trial.lost(t))]
    assert sorted(ended) == sorted(trial.sent)
    for t, delivery in enumerate(trial.deliveries):
        later = [sent for s in range(t + 1, len(trial.deliveries)) for *_, sent in (*trial.heard(s), *trial.lost(s))]
        assert all(sent >= min(delivery.oldest, t) for sent in later)


def moments(*faults: str, iterations: int = 12) -> tuple[list[Moment], Digests]:
    found: list[Moment] = []

    class Keep:
        def sample(self, moment: Moment) -> None:
            found.append(moment)

    listed = ", ".join(f'{{use="radio", {fault}}}' for fault in faults)
    digests = Digests()
    made(f"stop.iterations={iterations}", f"faults=[{listed}]").simulation.run([Keep(), digests])
    return found, digests


def test_in_a_run_late_tiles_are_those_that_were_sent() -> None:
    late, _ = moments('failure="delay", delay=3, at=0, fraction=1.0, min_alive=0')
    for t, moment in enumerate(late):
        assert len(moment.inbox.receivers) == (len(late[t - 3].links) if t >= 3 else 0)
        for sender, values, sensed in zip(
            moment.inbox.senders, moment.inbox.content.values, moment.inbox.content.sensed, strict=True
        ):
            assert sensed == t - 3
            np.testing.assert_array_equal(values, late[t - 3].readings.tiles.values[sender])


def test_in_a_run_nothing_differs_before_the_onset() -> None:
    _, plain = moments()
    struck, digests = moments('failure="off", at=5, robots=[1]', 'failure="loss", loss=0.5, at=6')
    assert digests.rows[:5] == plain.rows[:5]
    assert digests.rows[5] != plain.rows[5]
    assert not (struck[5].delivery.heard[:, :2] == 1).any()
    assert any(1 in link for link in struck[5].links.tolist())


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"failure": "loss"}, "^loss: required key is missing"),
        ({"failure": "delay"}, "^delay: required key is missing"),
        ({"failure": "jam"}, "^area: required key is missing"),
        ({"failure": "partition"}, "^groups: required key is missing; expected groups or x or y"),
        ({"failure": "off", "loss": 0.5}, "^loss: a radio with 'off' has none; expected failure = 'loss'"),
        ({"failure": "loss", "loss": 0.5, "area": (0.0, 0.0, 1.0, 1.0)}, "^area: a radio with 'loss' has none"),
        ({"failure": "partition", "x": 1.0, "y": 2.0}, "^y: x says where the network parts already"),
        ({"failure": "partition", "groups": [[0], [4]]}, "^groups: there is no robot 4; expected ids from 0 to 3"),
        ({"failure": "partition", "groups": [[0], [1, 0]]}, "^groups: robot 0 is named twice"),
        ({"failure": "partition", "groups": [[0, 1, 2, 3]]}, "^groups: all robots are in one"),
        ({"failure": "jam", "area": (1.0, 0.0, 1.0, 1.0)}, "^area: .*has no size"),
        ({"failure": "jam", "area": (0.0, 0.0, 1.0, 1.0), "robots": [1]}, "^robots: 'jam' strikes the network"),
        ({"failure": "jam", "area": (0.0, 0.0, 1.0, 1.0), "min_alive": 0}, "^min_alive: 'jam' strikes the network"),
        ({"failure": "partition", "x": 1.0, "count": 2}, "^count: 'partition' strikes the network"),
        ({"failure": "partition", "x": 1.0, "target": "hub"}, "^target: 'partition' strikes the network"),
    ],
)
def test_a_fault_that_cannot_work_is_refused(keys: dict[str, object], words: str) -> None:
    context = setting_of(4)
    with pytest.raises(InputError, match=words):
        Radio(at=1, **keys).build(context)


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ('failure="silent", at=1', r"faults\[0\]\.failure"),
        ('failure="loss", loss=1.5, at=1', r"faults\[0\]\.loss.*<= 1"),
        ('failure="loss", loss=0.0, at=1', r"faults\[0\]\.loss.*> 0"),
        ('failure="delay", delay=0, at=1', r"faults\[0\]\.delay.*>= 1"),
        ('failure="jam", area=[0.0, 1.0], at=1', r"faults\[0\]\.area"),
        ('failure="partition", groups=[[]], at=1', r"faults\[0\]\.groups"),
        ('failure="off"', r"faults\[0\]\.at: required key is missing"),
    ],
)
def test_a_key_out_of_range_is_refused_with_its_path(fault: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        moments(fault)
