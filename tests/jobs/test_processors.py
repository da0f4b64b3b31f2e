"""Processors: what robots cannot compute in time comes late and is the same; what does not fit is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import moments_of
from networks import Heat, Swarm
from test_jobs_beside_minds import built, heat, mapping  # noqa: F401 - a fixture

from swarmsim.core.errors import InputError
from swarmsim.core.processors import Processor
from swarmsim.core.scenario.boards import BOARDS
from swarmsim.core.scenario.file import load, table_of
from swarmsim.recording.digests import Digests
from swarmsim.testing import check_one_robot

WORK = 9.0 * max(len(one.cells) for one in Swarm().runtime._plan.pieces)  # operations of the largest piece's step


def summary(swarm: Swarm) -> dict:
    return swarm.processors.summary(swarm.parcel.counts[:, 0].sum())


def digest(run) -> str:
    found = Digests()
    for moment in moments_of(run):
        found.sample(moment)
    return found.total()


# --- time


def test_without_a_number_nothing_changes_and_ample_ones_change_no_answer(mapping: Path) -> None:  # noqa: F811
    assert "processor" not in table_of(load(mapping))["robots"]
    plain = digest(built(mapping, heat()))
    assert digest(built(mapping, heat(), "robots.processor={energy=1e-9, memory=1e9}")) == plain
    assert Swarm(processor=Processor(rate=1e12)).run().ended == Swarm().run().ended


def test_half_the_rate_takes_twice_as_long_and_the_answer_has_the_same_bits() -> None:
    slow = [Swarm(processor=Processor(rate=WORK / by)).run() for by in (4, 8)]
    assert slow[1].ended / slow[0].ended == pytest.approx(2.0, rel=0.05)
    assert all(one.exact for one in slow)
    assert summary(slow[1])["processor_late"] == pytest.approx(7.0, rel=0.1)  # iterations of each step, of 8


def test_late_and_lost_the_answer_has_the_same_bits() -> None:
    network = {"topology": "ring", "channel": {"use": "bernoulli", "loss": 0.3}, "job": Heat(steps=10)}
    fast, slow = (Swarm(processor=Processor(rate=rate), **network).run() for rate in (1e9, WORK / 4))
    assert fast.exact
    assert slow.exact
    assert fast.ended + 20 < slow.ended < fast.ended + 50  # 3 longer for each step, some beside others


def test_what_is_not_asked_for_is_gone_and_what_is_begun_goes_on() -> None:
    ended = [Swarm(processor=Processor(rate=WORK * by), rounds=2, limit=90).run().ended for by in (2.0, 1.5, 1.0)]
    assert ended == [10, 20, 20]  # a step of one exchange, of a third more than one, and of two


def test_work_is_steps_times_that_of_each_and_costs_energy() -> None:
    swarm = Swarm(processor=Processor(rate=WORK / 2, energy=2e-9)).run()
    pieces = swarm.runtime._plan.pieces
    work = sum(9.0 * len(one.cells) for one in pieces) * swarm.job.steps
    assert swarm.parcel.counts[:, 4].sum() == work
    assert summary(swarm)["computing_energy"] == pytest.approx(2e-9 * work, rel=1e-12)
    assert summary(swarm)["processor_used"] == pytest.approx(work / (7 * WORK / 2 * swarm.ended), rel=1e-12)
    assert 0.8 < summary(swarm)["processor_used"] <= 1.0


def test_waiting_for_the_processor_is_not_the_age_of_halos() -> None:
    fast, slow = (Swarm(processor=Processor(rate=rate)).run() for rate in (1e9, WORK / 4))
    assert fast.parcel.counts[:, 1].sum() == slow.parcel.counts[:, 1].sum() == 0
    assert summary(fast)["processor_late"] == 0.0 < summary(slow)["processor_late"]


def test_with_a_clock_a_slow_processor_has_an_older_answer() -> None:
    keys = {"fence": "clock"}
    ended = [Swarm(keys=keys, processor=Processor(rate=rate)).run().ended for rate in (1e9, WORK / 3)]
    assert ended == [20, 60]


def test_a_faster_kind_of_robot_waits_for_the_slower_one() -> None:
    kinds = [Processor(rate=WORK)] * 6 + [Processor(rate=WORK / 3)]
    swarm = Swarm(processor=kinds).run()
    assert swarm.exact
    assert swarm.ended == pytest.approx(60, abs=3)
    assert swarm.processors.used()[:6].max() < 0.5 < swarm.processors.used()[6]


@pytest.mark.parametrize(("rate", "shorter"), [(WORK / 2, True), (1e9, False)])
def test_joins_shorten_what_computing_takes_and_nothing_else(rate: float, shorter: bool) -> None:
    job, keys = Heat(parts=4, steps=60), {"copies": 3}
    alone, joined = (
        Swarm(job, keys=keys, processor=Processor(rate=rate), deaths={8: [1, 2, 3]}, comes={at: [4, 5, 6]}, limit=900)
        for at in (900, 25)
    )
    assert alone.run().exact
    assert joined.run().exact
    assert (joined.ended < 0.75 * alone.ended) if shorter else joined.ended == alone.ended


# --- faults


def test_slow_processors_from_some_iteration_on_make_the_rest_longer() -> None:
    swarm = Swarm(processor=Processor(rate=WORK), slow={10: (0.25, [3])}).run()
    assert swarm.exact
    assert swarm.ended == pytest.approx(10 + 4 * 10, abs=3)


def test_the_pieces_of_a_stopped_processor_are_taken_over() -> None:
    swarm = Swarm(processor=Processor(rate=WORK), slow={5: (0.0, [2])}).run()
    assert swarm.exact
    assert swarm.ended > 20
    assert swarm.holders(2)[1:]  # beside what is in the memory of robot 2
    assert swarm.parcel.counts[:, 2].sum() >= 1
    assert swarm.parcel.counts[2, 0] <= 5


def test_a_processor_that_starts_again_goes_on() -> None:
    swarm = Swarm(keys={"copies": 0}, processor=Processor(rate=WORK), slow={5: (0.0, [2]), 25: (1.0, [2])}).run()
    assert swarm.exact
    assert swarm.ended == pytest.approx(40, abs=2)


def test_robots_with_a_stopped_processor_go_on_mapping_and_say_nothing_of_jobs(mapping: Path) -> None:  # noqa: F811
    fault = 'faults=[{use="processor", failure="stopped", at=0, robots=[1]}]'
    alone, stopped = moments_of(built(mapping)), moments_of(built(mapping, heat(), fault))
    for one, other in zip(alone, stopped, strict=True):
        assert one.state.pose.tobytes() == other.state.pose.tobytes()
        assert other.jobs[0].knowledge.counts[1].sum() == 0
    check_one_robot(mapping, (heat(), fault.replace("at=0", "at=2"), "robots.processor.rate=2"), 6, True)


@pytest.mark.parametrize(
    ("overrides", "told"),
    [
        ((heat(), "failure='slow'"), "'slow' changes nothing of unlimited processors; expected robots"),
        (
            ("failure='stopped'",),
            r"faults\[0\]\.use: processors compute jobs, and there are none; expected \[\[jobs\]\]",
        ),
        ((heat(), "failure='stopped', factor=0.5"), "factor: a processor that is 'stopped' has none"),
        ((heat(), "failure='slow', factor=0.0"), r"faults\[0\]\.factor: expected `float` > 0\.0"),
    ],
)
def test_faults_without_effect_are_refused(mapping: Path, overrides: tuple, told: str) -> None:  # noqa: F811
    fault = f"faults=[{{use='processor', at=1, {overrides[-1]}}}]"
    with pytest.raises(InputError, match=told):
        built(mapping, *overrides[:-1], fault)


# --- memory


@pytest.mark.parametrize(
    ("overrides", "told"),
    [
        (["robots.processor.memory=5000"], r"robots\.processor\.memory: 5000 bytes on robot 0, which has to hold "
         r"24480: its mind 24480 \(1440 cells of 17 bytes\); expected more memory, or larger cells"),
        ([heat(), "robots.processor.memory=28000"], r"24480 \(1440 .*\), the job 'heat' \d{4}; expected"),
        ([heat(parts=1), "robots.processor.memory=28000"], "the job 'heat' .* or smaller pieces"),
        ([heat(), "robots=[{count=2, spawn='floor'}, {count=2, processor={memory=28000}}]"],
         r"robots\[1\]\.processor\.memory: 28000 bytes on robot 2"),
        (["robots.processor.use='esp8266'"], r"robots\.processor\.use: no processor is called 'esp8266'; .*esp32"),
        (["robots.processor.rate=0"], r"robots\.processor\.rate: expected `float` > 0\.0"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_refused_with_its_numbers(mapping: Path, overrides: list[str], told: str) -> None:  # noqa: F811
    with pytest.raises(InputError, match=told):
        built(mapping, *overrides)


def test_robots_hold_no_more_than_fits_and_the_answer_is_the_same() -> None:
    runtime = Swarm().runtime
    least = float(runtime.needs.max())
    tight, ample = (Swarm(processor=Processor(memory=by * least), keys={"copies": "all"}).run() for by in (1.0, 50))
    assert tight.exact
    assert summary(tight)["memory_peak"] <= least < summary(ample)["memory_peak"]
    assert (tight.parcel.kept >= 0).sum() < (ample.parcel.kept >= 0).sum()


# --- numbers of real ones, and what is told


def test_a_real_processor_has_its_numbers_where_none_are_given(mapping: Path) -> None:  # noqa: F811
    given = load(mapping, ["robots.processor={use='esp32', memory=1e6}"])
    assert given.robots.processors == (Processor(use="esp32", rate=6e7, memory=1e6, energy=3.7e-9),)
    groups = "robots={processor={use='pi-zero-2'}, groups=[{count=1}, {count=1, processor={rate=5}}]}"
    assert [one.rate for one in load(mapping, [groups]).robots.processors] == [5e8, 5.0]
    for name in BOARDS:
        assert load(mapping, [f"robots.processor.use='{name}'"]).robots.processors[0].energy > 0.0


def test_summary_and_gauges_tell_what_processors_did(mapping: Path) -> None:  # noqa: F811
    run = built(mapping, heat(), "robots.processor={rate=1, energy=0.5}", 'task={use="computed"}', "stop.iterations=40")
    (cost,) = run.simulation.parts.task.summaries()
    run.simulation.run([cost])
    found = cost.summary()
    assert found["work"] == 2.0 * 4 * 8
    assert found["computing_energy"] == 0.5 * found["work"]
    assert (found["processor_late"], found["memory_peak"]) == (1.0, None)
    read = {gauge.name: gauge.read() for gauge in run.simulation.parts.gauges}
    assert read["computing energy"].sum() == found["computing_energy"]
    assert np.allclose(read["processor used"], found["processor_used"])
    assert read["processor late"].sum() == found["processor_late"] * found["steps_computed"]
