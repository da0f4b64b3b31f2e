"""The job that finds a source, in scenarios: contracts, what robots have not heard, bytes, measures and refusals."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, moments_of

from swarmsim.core.errors import InputError
from swarmsim.core.messages import HEADER, Inbox
from swarmsim.core.readings import Channel, Channels, Readings
from swarmsim.core.scenario.file import load
from swarmsim.core.state import Senses
from swarmsim.engine.build import BuiltRun, build
from swarmsim.jobs.facts.board import FactBoard
from swarmsim.jobs.facts.tellers import Tellers
from swarmsim.jobs.facts.wire import ENTRY, FORM, Fact, Facts
from swarmsim.operations.models.truth import EmittedField
from swarmsim.operations.sources.locate import Located, LocateSource
from swarmsim.operations.sources.searcher import SAMPLE, Searcher
from swarmsim.testing import check_locality, check_one_robot, check_permutation, check_strictly

ROOM = """<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 4 4" width="4m" height="4m">
  <g id="walls"><path fill-rule="evenodd" d="M0 0H4V4H0Z M0.2 0.2V3.8H3.8V0.2Z"/></g>
  <g id="spawn"><rect id="floor" x="0.5" y="0.5" width="3" height="3"/></g>
</svg>"""
MODEL = '{use = "diffusion", diffusivity = 0.02}'
SEARCH = f"""
world = "room.svg"
robots = {{count = 4, spawn = "floor"}}
grid.cell = 0.2
network.topology = {{use = "full"}}
stop = {{iterations = 30, when_done = "continue"}}
sensor = {{use = "none"}}
mind = {{computation = {{use = "reactive"}}, strategy = {{use = "random-waypoint"}}}}
task = {{use = "source-found", hold = 3, ahead = [4.0, 10.0]}}

[field]
use = "model"
model = {MODEL}
sources = [{{x = 1.5, y = 2.3, strength = 0.3, begin = 2.0}}]
noise = 0.002

[[jobs]]
use = "locate-source"
model = {MODEL}
dt = 1.0
pulse = 2.0
duration = 34.0
spacing = 1.0
noise = 0.002
change = 0.05
every = 1
interval = 4
"""


def built(path: Path, *overrides: str) -> BuiltRun:
    return build(load(path, overrides), str(path))


@pytest.fixture
def path(tmp_path: Path) -> Path:
    (tmp_path / "room.svg").write_text(ROOM)
    (tmp_path / "search.toml").write_text(SEARCH)
    return tmp_path / "search.toml"


@pytest.mark.parametrize("check", [check_strictly, check_locality, check_one_robot, check_permutation])
def test_it_keeps_its_contracts_in_several_exchanges_under_loss_and_delay(path: Path, check) -> None:
    channel = 'network.channel={use="latency", delay=2, over={use="bernoulli", loss=0.2}}'
    check(path, ("network.rounds=2", channel), 9, True)


def test_robots_find_the_source_and_tell_how_good_predictions_are(path: Path) -> None:
    run = built(path)
    (observer,) = run.simulation.parts.task.summaries()
    moments = moments_of(run)
    for moment in moments:
        observer.sample(moment)
    found, last = observer.summary(), moments[-1].measured
    assert np.isnan(moments[0].measured.robots["distances"]).all()
    assert (last.robots["distances"] < 0.5).all()
    assert last.finished
    assert found["near_share_end"] == 1.0
    assert found["source_near_since"] < 27
    assert found["skill_4s"] > 0.5
    assert found["error_10s"] < found["persistence_10s"]
    assert found["truth_persistence_10s"] > 0.1
    assert 0.0 < found["work_shared"] < found["work_alone"]
    assert last.values["sample_age"] == 0.0


def test_who_hears_nobody_knows_its_own_samples_alone_and_others_poison_does_not_reach_it(path: Path) -> None:
    runs = []
    for poison in (0.0, 7.0):
        job = search(path)
        for now in range(9):
            value = np.array([1.0 + now + 7.0 * poison, 0.3 * now, 0.0, 0.001])
            known = heard(job, now, value)
        runs.append(known)
    assert runs[0].place[1:].tobytes() == runs[1].place[1:].tobytes()
    assert runs[0].strength[0] != runs[1].strength[0]
    assert runs[0].samples.tolist() == [9] * 4
    assert np.isnan(runs[0].age).all()
    assert np.isnan([runs[0].strength[2], *runs[0].place[3]]).all(), "nothing measured, so nothing found"
    assert np.isfinite(runs[0].place[:2]).all()


@pytest.mark.parametrize("told", [(0,), (1, 3), (0, 1, 2, 3)])
def test_the_truth_where_a_robot_was_not_told_of_it_reaches_nobody(
    path: Path, told: tuple[int, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is NaN but for the samples of some robots, which hear each other and nobody else: they find the same."""
    apart = ["robots.count=4", 'network.topology={use="none"}'] if len(told) == 1 else []
    if len(told) == 2:  # the others are dead before their first sample
        apart = ['faults=[{use="remove", at=0, robots=[0, 2], min_alive=0}]']
    plain = moments_of(built(path, *apart))[-1].jobs[0].knowledge
    run, value = built(path, *apart), EmittedField.value

    def poisoned(field: EmittedField, time: float, points: np.ndarray) -> np.ndarray:
        asked = np.full(len(points), np.nan)
        if len(points) == 4:  # the robots' sensors ask
            asked[list(told)] = value(field, time, points)[list(told)]
        return asked

    monkeypatch.setattr(EmittedField, "value", poisoned)
    found = moments_of(run)[-1].jobs[0].knowledge
    for one, other in zip(plain.arrays()[:6], found.arrays()[:6], strict=True):
        assert one[list(told)].tobytes() == other[list(told)].tobytes()
    assert np.isfinite(found.place[list(told)]).all()


def test_with_a_quarter_dead_the_rest_find_the_same_place_and_keep_what_the_dead_have_told(path: Path) -> None:
    eight, crash = "robots.count=8", 'faults=[{use="crash", at=16, robots=[2, 5], min_alive=0}]'
    whole = moments_of(built(path, eight))[-1].jobs[0].knowledge
    moments = moments_of(built(path, eight, crash))
    last, alive = moments[-1].jobs[0].knowledge, moments[-1].state.alive
    assert alive.tolist() == [True, True, False, True, True, False, True, True]
    assert (last.samples[alive] == 6 * 30 + 2 * 16).all()
    assert (last.made[alive] == 28).all()
    assert np.ptp(whole.place, axis=0).max() == 0.0
    assert (last.place[alive] == whole.place[0]).all()


def test_robots_that_go_where_candidates_disagree_find_it_with_their_mind_alone(path: Path) -> None:
    run = built(seeking(path))
    moments = moments_of(run)
    assert isinstance(moments[-1].knowledge, Located)
    assert not moments[-1].jobs
    assert (moments[-1].measured.robots["distances"] < 0.5).all()
    driven = [np.array([one.state.pose[:, :2] for one in ran]) for ran in (moments, moments_of(built(path)))]
    found = next(number for number, one in enumerate(moments) if np.isfinite(one.knowledge.strength).any())
    np.testing.assert_array_equal(driven[0][:found], driven[1][:found], "random ways until then")
    assert np.abs(driven[0][-1] - driven[1][-1]).max() > 0.1


@pytest.mark.parametrize("check", [check_strictly, check_locality, check_one_robot, check_permutation])
def test_as_a_mind_it_keeps_its_contracts(path: Path, check) -> None:
    check(seeking(path), ('network.channel={use="bernoulli", loss=0.2}',), 9, True)


@pytest.mark.thorough
def test_where_robots_go_is_drawn_by_what_a_sample_tells_and_how_far_it_is(path: Path) -> None:
    """Of many draws of one robot, cells get their shares of ln(1 + v / noise^2) exp(-d / nearness)."""
    run = built(seeking(path))
    known = moments_of(run)[12].knowledge
    strategy, finding, inversion = run.simulation.parts.strategy, known.findings[1], known.plan.inversion
    senses = Senses(12, np.full((4, 3), 1.2), np.zeros((4, 3)), np.ones(4, bool), read(np.zeros(4)))
    places = inversion.candidates.places
    inside = np.flatnonzero(((places >= 0.4) & (places <= 3.6)).all(axis=1))
    away = np.hypot(*(places[inside] - 1.2).T)
    speed = run.context.robots.speed
    variance = finding.variance(inversion.greens, np.minimum(12.0 + away / speed, 34.0), inside)
    share = np.log1p(variance / 0.002**2) * np.exp(-away / 3.0)
    dice = (np.arange(2000) + 0.5) / 2000
    drawn = np.array([strategy._place(1, finding, known.plan, senses, die) for die in dice.tolist()])
    counts = [int((np.abs(drawn - places[cell]).max(axis=1) < 1e-9).sum()) for cell in inside.tolist()]
    np.testing.assert_allclose(np.array(counts) / 2000, share / share.sum(), atol=1.01 / 2000)


def seeking(path: Path) -> Path:
    """The scenario in which the job is the robots' mind, which says where they go."""
    text = path.read_text()
    head, job = text.split("[[jobs]]")
    mind = head.index("mind = ")
    head = head[:mind] + head[head.index("\n", mind) + 1 :]
    path.with_name("seek.toml").write_text(f'{head}[mind.strategy]\nuse = "most-disputed"\n[mind.computation]{job}')
    return path.with_name("seek.toml")


def test_a_robot_without_a_finite_sample_says_so(path: Path) -> None:
    job = search(path)
    for now in range(9):
        known = heard(job, now, np.full(4, np.nan))
    assert known.samples.tolist() == [0] * 4
    assert np.isnan(known.place).all()
    assert known.share(np.ones(4, bool)) == 0.0


def search(path: Path) -> Tellers[Searcher]:
    """The job alone, of four robots in the room."""
    run = built(path)
    keys = run.scenario.jobs[0].parameters
    assert isinstance(keys, LocateSource)
    return keys.build(run.context)


def read(values: np.ndarray) -> Readings:
    return Readings(Channels(Channel("field")), (values,))


def heard(job: Tellers[Searcher], now: int, values: np.ndarray):
    """What robots know that stand in four places, measure these values and hear nobody."""
    pose = np.array([[1.0, 1.0, 0.0], [3.0, 1.0, 0.0], [1.0, 3.0, 0.0], [3.0, 3.0, 0.0]])
    senses = Senses(now, pose, np.zeros((4, 3)), np.ones(4, bool), read(values))
    job.say(senses)
    nobody = np.zeros(0, np.int32)
    return job.hear(senses, Inbox(nobody, nobody, nobody, Facts.of([])))


def test_a_sample_takes_21_bytes_and_messages_are_as_long_as_they_say(path: Path) -> None:
    job = search(path)
    senses = Senses(0, np.full((4, 3), 1.0), np.zeros((4, 3)), np.ones(4, bool), read(np.arange(4.0)))
    said = job.say(senses)
    assert FORM.size + SAMPLE.size == 21
    assert said.sizes.tolist() == [HEADER.size + FORM.size + 21] * 4
    for robot in range(4):
        packed = job.codec.pack(robot, 0, said.of(robot))
        assert len(packed) == said.sizes[robot]
        assert job.codec.unpack(packed)[2].rows() == said.of(robot).rows()


def test_a_budget_holds_and_samples_come_through(path: Path) -> None:
    run = built(path, 'jobs=[{use="locate-source", model={use="diffusion"}, dt=1, pulse=2, duration=34, budget=62}]')
    moments = moments_of(run)
    assert max(moment.jobs[0].sent for moment in moments) == 4 * (HEADER.size + FORM.size + 2 * 21)
    assert moments[-1].jobs[0].knowledge.samples.min() >= 20


def test_samples_that_cannot_be_are_left_out(path: Path) -> None:
    plan = search(path)._parts[0]._plan
    one = Searcher(plan, 0, FactBoard(0, 10))
    sound = Fact(ENTRY, 1 << 16, 3, 1, SAMPLE.pack(5, 5, 0.5))
    wrong = [
        Fact(ENTRY, 2 << 16, 9, 2, SAMPLE.pack(5, 5, 0.5)),  # from the future
        Fact(ENTRY, 3 << 16, 3, 3, SAMPLE.pack(500, 5, 0.5)),
        Fact(ENTRY, 4 << 16, 3, 4, SAMPLE.pack(5, 5, math.inf)),
        Fact(ENTRY, 5 << 16, 3, 5, b"ab"),
    ]
    one.hear([sound, *wrong], 5, 5)
    samples = one.samples(5)
    assert (samples.times.tolist(), samples.values.tolist()) == ([3.0], [0.5])


def test_hidden_sources_are_other_ones_for_each_seed_and_within_their_limits(path: Path) -> None:
    hidden = 'field={use="model", model={use="diffusion"}, hidden=[{strength=0.1, within=[1.0, 1.0, 2.0, 3.0]}]}'
    drawn = [built(path, hidden, f"seed={seed}").context.scalar_field.emitters[0] for seed in (1, 1, 2)]
    assert drawn[0] == drawn[1] != drawn[2]
    assert all(0.9 <= one.x <= 2.1 and 0.9 <= one.y <= 3.1 for one in drawn)


HIDDEN = 'field={{use="model", model={{use="diffusion"}}, hidden=[{}]}}'
JOB = 'jobs=[{{use="locate-source", model={{use="diffusion"}}, dt=1, pulse=2, duration=34{}}}]'


@pytest.mark.parametrize(
    ("overrides", "told"),
    [
        (["field={}", 'task={use="settled"}'], r"jobs\[0\]\.use: 'locate-source' .* expected a table \[field\]"),
        (['field={use="formula", formula="x"}'], r"task\.use: 'source-found' .* with sources or hidden ones"),
        (['field={use="model", model={use="diffusion"}}'], r"task\.use: 'source-found' .* with sources"),
        ([HIDDEN.format("{within=[9.0, 9.0, 9.5, 9.5]}")], r"field\.hidden\[0\]\.within: .* holds no free cell"),
        ([HIDDEN.format("{begin=5.0, end=4.0}")], r"field\.hidden\[0\]\.end: 4 s; expected a time after"),
        ([JOB.format(", budget=30")], r"jobs\[0\]\.budget: 30 bytes a message; .* expected 40 or more"),
        ([JOB.format(", spacing=0.1")], r"jobs\[0\]\.spacing: 0\.1 m is less than a cell"),
        ([JOB.format(", noise=0")], r"jobs\[0\]\.noise: .*> 0"),
        ([JOB.replace("pulse=2", "pulse=2.5").format("")], r"jobs\[0\]\.pulse: 2\.5 s; expected a whole number"),
        ([JOB.replace("diffusion", "wave").format("")], r"jobs\[0\]\.model: responses"),
    ],
)
def test_what_cannot_be_is_refused_before_the_run(path: Path, overrides: list[str], told: str) -> None:
    with pytest.raises(InputError, match=told):
        built(path, *overrides)


@pytest.mark.parametrize("jobs", ['[{use="stigmergy"}]', "[]"])
def test_another_job_in_its_place_or_none_ends_the_run_with_a_sentence(path: Path, jobs: str) -> None:
    with pytest.raises(
        InputError, match=r"task\.use: 'source-found' measures 'locate-source', and it is neither a job nor"
    ):
        built(path, f"jobs={jobs}").simulation.run()


@pytest.mark.parametrize("name", ["buoys", "basilica-source"])
def test_the_shipped_ones_run(name: str) -> None:
    run = built(ROOT / "scenarios" / "computing" / f"{name}.toml", "stop.iterations=2")
    assert len(moments_of(run)) == 2


def test_a_source_that_moves_is_where_it_is(path: Path) -> None:
    moving = replace_text(path, "begin = 2.0", "begin = 2.0, end = 12.0, velocity = [0.1, 0.0]")
    emitter = built(moving).context.scalar_field.emitters[0]
    assert [emitter.place(time)[0] for time in (0.0, 2.0, 7.0, 99.0)] == [1.5, 1.5, 2.0, 2.5]


def replace_text(path: Path, old: str, new: str) -> Path:
    """The scenario with another text in one place."""
    path.write_text(path.read_text().replace(old, new))
    return path
