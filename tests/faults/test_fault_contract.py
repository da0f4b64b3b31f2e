"""What every kind of fault promises, whatever it does: one table of parameters, the same checks for each."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, get_args, get_origin, get_type_hints

import numpy as np
import pytest
import shapely
from conftest import made, worded_of
from numpy.testing import assert_array_equal

from swarmsim.core.errors import InputError
from swarmsim.core.scenario import registry
from swarmsim.faults.byzantine import OF_ANY, Byzantine
from swarmsim.operations.mapping.lies import LIES
from swarmsim.recording.digests import Digests

RADIUS = 0.055  # m: the default of robots
ITERATIONS = {"room": 30, "basilica": 40, "operations/wandering": 30, "computing/heat": 22}
HEAT = ("robots.count=3", "robots.processor.rate=3e4", 'network={channel.use="perfect", topology.use="full"}')
MORE = {
    "room": (), "basilica": ("robots.count=4",), "operations/wandering": ("robots.count=4", "sensor.reach=9.0"),
    "computing/heat": HEAT,
}  # fmt: skip
DOORWAY = "[3.15, 1.65, 3.3, 2.55]"  # of the room
WHEN = "at=8, duration=12"


@dataclass(frozen=True)
class Case:
    """One fault as a TOML table, and what it does to the run."""

    keys: str
    onset: int = 8  # everything before this iteration is as without it
    words: tuple[str, str] | None = None  # its events with a robot: begin and end; None if it has none
    lives: bool = False  # whether its events are when robots are dead
    silent: bool = False  # whether who has it sends nothing
    deaf: bool = False  # whether who has it hears nothing
    scenario: str = "room"

    @property
    def table(self) -> dict[str, object]:
        return tomllib.loads(f"fault = {{{self.keys}}}")["fault"]

    @property
    def name(self) -> str:
        return f"{self.scenario}: {self.keys}".replace('"', "")


def over(word: str) -> tuple[str, str]:
    return word, f"{word} over"


def wheels(failure: str, keys: str = "") -> Case:
    return Case(f'use="motor", failure="{failure}", count=2, {WHEN}{keys}', words=over(f"motor {failure}"))


def sensor(failure: str, keys: str = "", **more) -> Case:
    return Case(f'use="sensor", failure="{failure}", count=2, {WHEN}{keys}', words=over(f"sensor {failure}"), **more)


def radio(failure: str, keys: str = "", **more) -> Case:
    return Case(f'use="radio", failure="{failure}", {WHEN}{keys}', words=over(f"radio {failure}"), **more)


def slower(failure: str, keys: str = "") -> Case:
    words = over(f"processor {failure}")
    return Case(f'use="processor", failure="{failure}", {WHEN}{keys}', words=words, scenario="computing/heat")


def lost(failure: str, keys: str = "", **more) -> Case:
    return Case(f'use="localisation", failure="{failure}", {WHEN}{keys}', words=over(f"localisation {failure}"), **more)


def mind(failure: str, keys: str = "") -> Case:
    return Case(f'use="mind", failure="{failure}", count=2, {WHEN}{keys}', words=over(f"mind {failure}"))


def liar(failure: str, keys: str = "", **more) -> Case:
    return Case(f'use="byzantine", failure="{failure}", {WHEN}{keys}', words=over(f"byzantine {failure}"), **more)


REMOVED, CRASHED, LATE = ("removed", "returned"), ("crashed", "repaired"), ("late", "joined")
OUT = {"lives": True, "silent": True, "deaf": True}
CASES = [
    Case(f'use="remove", count=2, {WHEN}', words=REMOVED, **OUT),
    Case('use="remove", at=8, every=9, duration=4, map="lost"', words=REMOVED, **OUT),
    Case('use="remove", at=8, duty=[3, 2], count=2', words=REMOVED, scenario="basilica", **OUT),
    Case(f'use="crash", count=2, {WHEN}', words=CRASHED, **OUT),
    Case('use="crash", between=[8, 20], duty=[2, 3], map="lost"', words=CRASHED, **OUT),
    Case('use="crash", rate=0.2, duration=5', onset=0, words=CRASHED, scenario="basilica", **OUT),
    Case('use="join", at=8, every=5, times=2', onset=0, words=LATE, **OUT),
    Case('use="join", at=8, count=3, map="copied"', onset=0, words=LATE, scenario="basilica", **OUT),
    Case('use="push", at=8, velocity=[0.3, 0.1], count=2', words=("pushed", "steady again")),
    wheels("off"),
    wheels("off", ', wheel="right"'),
    wheels("slow"),
    wheels("slow", ", factor=3.0"),
    wheels("slow", ', factor=0.2, wheel="left"'),
    wheels("stuck"),
    wheels("stuck", ", speed=-0.1"),
    wheels("stuck", ', wheel="left"'),
    sensor("off"),
    sensor("stuck", ', value="free"'),
    sensor("stuck", ', value="occupied"'),
    sensor("noisy", ", sigma=0.1", scenario="operations/wandering"),
    sensor("garbage"),
    sensor("range", ", range=0.3"),
    sensor("offset", ", offset=[2, -3]"),
    sensor("beams", ", beams=[0, 1, 2]"),
    radio("transmit", ", count=2", silent=True),
    radio("receive", ", count=2", deaf=True),
    radio("off", ", count=2", silent=True, deaf=True),
    radio("off", ", duty=[2, 2], fraction=0.5", silent=True, deaf=True, scenario="basilica"),
    radio("loss", ", loss=0.5, count=2"),
    radio("delay", ", delay=3, count=2"),
    radio("jam", ", area=[0.3, 0.3, 3.2, 3.6]"),
    radio("partition", ", groups=[[0, 1]]"),
    radio("partition", ", groups=[[0, 2], [1]]", scenario="basilica"),
    radio("partition", ", x=2.0"),
    radio("partition", ", y=2.0"),
    lost("bias", ", dx=0.3, dy=-0.2, dyaw=0.4"),
    lost("drift", ", sigma=0.05, sigma_yaw=0.1, dx=0.01, count=2"),
    lost("kidnap", ", count=2"),
    lost("kidnap", ", count=3", scenario="basilica"),
    mind("frozen"),
    mind("random-walk", ", reach=2.0"),
    mind("reboot"),
    slower("slow", ", fraction=1.0, factor=0.1, min_alive=0"),
    slower("stopped"),
    liar("inverted"),
    liar("free"),
    liar("occupied", ", count=2"),
    liar("origin", ", offset=[3, 3]"),
    liar("replay", ", age=4"),
    liar("spoof", ", id=0"),
    liar("spoof", scenario="basilica"),
    Case(
        'use="battery", capacity=20.0, spread=0.3, per_metre=2.0, per_byte=0.002, idle=0.9',
        onset=0,
        words=("battery empty", "battery charged"),
        **OUT,
    ),
    Case(
        'use="battery", capacity=20.0, per_metre=0.0, per_byte=0.0, idle=1.6, empty="remove"',
        onset=13,
        words=("battery empty", "battery charged"),
        **OUT,
    ),
    Case(f'use="door", box={DOORWAY}, {WHEN}'),
    Case('use="door", box=[3.15, 1.65, 3.3, 2.55], progress=0.3, duration=5', onset=1),
    Case(f'use="furniture", box=[0.6, 0.6, 1.0, 0.9], {WHEN}'),
    Case(f'use="furniture", box=[0.6, 0.6, 1.0, 0.9], to=[2.4, 2.6, 2.8, 3.0], {WHEN}', onset=0),
    Case('use="rubble", region=[0.3, 0.3, 4.8, 3.6], count=4, at=8, every=6, duration=9'),
    Case('use="people", count=3', onset=0),
    Case('use="people", count=2, radius=0.25, speed=1.0, patience=1.0', onset=0, scenario="basilica"),
]
LATE_CHANNEL = 'network.channel={use="latency", delay=2}'
each_case = pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)


class Watch:
    """Keeps the moments, with what stood where and whose bodies were there in each."""

    def __init__(self, run) -> None:
        self.run, self.moments, self.digests = run, [], Digests()
        self.boxes, self.walls, self.solid = [], [], []

    def _seen(self):
        parts = self.run.simulation.parts
        return parts.building.boxes, parts.building.walls, parts.bodies.solid

    def sample(self, moment) -> None:
        self.digests.sample(moment)
        self.moments.append(moment)
        for kept, value in zip((self.boxes, self.walls, self.solid), self._seen(), strict=True):
            kept.append(value)

    @property
    def events(self):
        """Those of faults that the moments show."""
        return [event for event in worded_of(self.moments, self.run) if event.kind not in ("finished", "not finished")]


@lru_cache(maxsize=256)
def watched(case: Case | None, scenario: str, *more: str, seed: int = 1) -> Watch:
    """A run with the fault, or without any for None."""
    faults = f"faults=[{{{case.keys}}}]" if case else "faults=[]"
    settings = ('stop.when_done="continue"', f"stop.iterations={ITERATIONS[scenario]}", f"seed={seed}")
    run = made(*settings, *MORE[scenario], *more, faults, scenario=scenario)
    watch = Watch(run)
    run.simulation.run([watch])
    return watch


def failures(kind: type) -> set[str]:
    """All that a kind's key `failure` can be, or the empty word for a kind without one."""
    if kind is Byzantine:  # whose kinds of lies are the computation's, but for two
        return {*OF_ANY, *LIES}
    annotation = get_type_hints(kind).get("failure")
    return set(get_args(annotation)) if get_origin(annotation) is Literal else {""}


def test_the_table_has_every_kind_and_every_failure_that_there_is() -> None:
    there = {(name, failure) for name, kind in registry.known("fault").items() for failure in failures(kind)}
    here = {(case.table["use"], case.table.get("failure", "")) for case in CASES}
    missing = sorted(" ".join(pair).strip() for pair in there - here)
    assert not missing, f"CASES lacks an entry for each of: {', '.join(missing)}"
    assert not here - there


@each_case
def test_a_fault_does_the_same_each_time_and_something_at_all(case: Case) -> None:
    first = watched(case, case.scenario)
    again = watched.__wrapped__(case, case.scenario)
    assert first.digests.total() == again.digests.total()
    assert first.digests.total() != watched(None, case.scenario).digests.total()


@each_case
def test_until_its_onset_all_is_as_without_the_fault(case: Case) -> None:
    ours, theirs = watched(case, case.scenario), watched(None, case.scenario)
    first = min((event.iteration for event in ours.events), default=0)
    assert first >= case.onset
    if case.onset > 1:
        assert first == case.onset
    until = max(case.onset, first)
    assert ours.digests.rows[:until] == theirs.digests.rows[:until]
    for one, other in zip(ours.moments[:until], theirs.moments, strict=False):
        assert_array_equal(one.delivery.heard, other.delivery.heard)
        assert one.delivery.lost == other.delivery.lost == ()


@each_case
def test_no_body_is_in_a_wall_at_any_time(case: Case) -> None:
    assert deepest(watched(case, case.scenario)) <= 0.05 * RADIUS


def deepest(watch: Watch) -> float:
    """How far any body of any moment reaches into the walls or boxes of that moment, in m."""
    plan, worst = watch.run.arena.plan.walls, -np.inf
    bodies: dict[tuple[object, ...], tuple[shapely.Geometry, shapely.Geometry]] = {}  # of each state of the building
    for moment, boxes, walls, solid in zip(watch.moments, watch.boxes, watch.walls, watch.solid, strict=True):
        if boxes not in bodies:
            matter = shapely.union_all([plan, *(shapely.box(*box) for box in boxes)])  # 0 m away from whoever is inside
            bodies[boxes] = (matter, shapely.multilinestrings(walls.reshape(-1, 2, 2)))
            shapely.prepare(bodies[boxes])
        centres = shapely.points(moment.state.pose[solid, :2])
        for body in bodies[boxes]:
            worst = max(worst, float((RADIUS - shapely.distance(body, centres)).max(initial=-np.inf)))
    return worst


@pytest.mark.parametrize("channel", ["perfect", "late"])
@each_case
def test_the_dead_and_those_without_radio_send_and_hear_nothing_meanwhile(case: Case, channel: str) -> None:
    watch = watched(case, case.scenario, *([LATE_CHANNEL] if channel == "late" else []))
    having = struck(case, watch)
    for t, moment in enumerate(watch.moments):
        deaf = ~moment.state.alive | (having[t] & case.deaf)
        receivers, senders, sent, _ = moment.delivery.heard.T
        silent = np.array([~watch.moments[s].state.alive | (having[s] & case.silent) for s in range(t + 1)])
        assert not deaf[receivers].any()
        assert not silent[sent, senders].any()
        assert not np.isin(moment.links, np.flatnonzero(~moment.state.alive)).any()


def struck(case: Case, watch: Watch) -> np.ndarray:
    """Who has the fault in each iteration (t, n), as the events tell it; fails unless begin and end take turns."""
    having = np.zeros((len(watch.moments), watch.moments[0].state.robots), bool)
    if case.words is None:
        return having
    for event in watch.events:
        begins = event.kind == case.words[0]
        assert event.kind in case.words
        row = slice(None) if event.robot < 0 else event.robot
        before = having[event.iteration - 1, row] if event.iteration else np.zeros(1, bool)
        assert (having[event.iteration, row] == before).all(), f"twice in one iteration: {event}"
        assert (before != begins).all(), f"out of turn: {event}"
        having[event.iteration :, row] = begins
    return having


@each_case
def test_events_take_turns_and_tell_what_happened(case: Case) -> None:
    watch = watched(case, case.scenario)
    having = struck(case, watch)
    assert having.any() == (case.words is not None)
    if WHEN in case.keys and "duty" not in case.keys and case.words is not None:
        assert np.flatnonzero(having.any(axis=1)).tolist() == list(range(8, 20))
    if case.words is not None:
        given = [f"{key}=" for key in case.table if key not in ("use", "failure")]
        for event in watch.events:
            assert event.cause.startswith(f"{case.table['use']} {case.table.get('failure', '')}".strip())
            assert all(key in event.cause for key in given)
    alive = np.array([moment.state.alive for moment in watch.moments])
    assert_array_equal(alive, ~having if case.lives else np.ones_like(alive))


@each_case
def test_a_fault_with_a_key_that_it_does_not_have_is_refused_by_name(case: Case) -> None:
    with pytest.raises(InputError, match=r"room\.toml: faults\[0\]\.colour: unknown key"):
        made(f"faults=[{{{case.keys}, colour=3}}]")
