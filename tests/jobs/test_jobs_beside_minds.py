"""Jobs beside minds: in scenarios, in envelopes, in recordings and in summaries."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import called, moments_of

from swarmsim.core.bundle import Envelope, EnvelopeCodec, Nothing, whole
from swarmsim.core.errors import InputError, PartError
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.file import load, table_of
from swarmsim.engine.build import build
from swarmsim.recording.measures import RunMeasures
from swarmsim.recording.reader import Recording
from swarmsim.testing import check_locality, check_one_robot, check_permutation, check_strictly

ROOM = """<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 4 4" width="4m" height="4m">
  <g id="walls"><path fill-rule="evenodd" d="M0 0H4V4H0Z M0.2 0.2V3.8H3.8V0.2Z"/></g>
  <g id="spawn"><rect id="floor" x="0.5" y="0.5" width="3" height="3"/></g>
</svg>"""
MAPPING = """
world = "room.svg"
robots = {count = 4, spawn = "floor"}
grid.cell = 0.2
network.topology = {use = "full"}
stop = {iterations = 12, when_done = "continue"}
"""
HEAT = """
import numpy as np
from swarmsim.jobs.pieces import bisected


class Heat:
    halo, level = 1, 2

    def __init__(self, *, parts: int = 4, steps: int = 8, name: str = "", copies: int = 2):
        self.parts, self.steps = parts, steps

    def pieces(self, domain):
        return bisected(domain, self.parts, self.halo)

    def start(self, piece, sensed):
        return sensed + piece.cells[:, 0]

    def shows(self, piece, state, step):
        return state[piece.rim]

    def step(self, piece, state, around, step):
        return 0.9 * state + 0.1 * around.mean() if len(around) else state

    def work(self, piece):
        return 2.0

    def answer(self, piece, state):
        return state


class Broken(Heat):
    def step(self, piece, state, around, step):
        return state / 0 if step < 3 else self.nothing


class Shorter(Heat):
    def shows(self, piece, state, step):
        return state[piece.rim][step > 0 :]


class Idle:
    pass
"""


@pytest.fixture
def mapping(tmp_path: Path) -> Path:
    (tmp_path / "room.svg").write_text(ROOM)
    (tmp_path / "heat.py").write_text(HEAT)
    (tmp_path / "mapping.toml").write_text(MAPPING)
    return tmp_path / "mapping.toml"


def built(path: Path, *overrides: str, strict: bool = False):
    with registry.own_code(True):
        return build(load(path, overrides), str(path), strict=strict)


def heat(name: str = "Heat", **keys: object) -> str:
    more = "".join(f", {key} = {str(value).lower() if value is True else repr(value)}" for key, value in keys.items())
    return f'jobs=[{{use = "./heat.py:{name}"{more}}}]'


def test_a_job_changes_nothing_of_what_robots_map_and_do(mapping: Path) -> None:
    alone, beside = moments_of(built(mapping)), moments_of(built(mapping, heat(), "network.rounds=3"))
    for one, other in zip(alone, beside, strict=True):
        assert one.state.pose.tobytes() == other.state.pose.tobytes()
        assert [a.tobytes() for a in one.knowledge.arrays()] == [b.tobytes() for b in other.knowledge.arrays()]
        assert [a.tobytes() for a in one.inbox.arrays()] == [b.tobytes() for b in other.inbox.arrays()]
        assert (one.jobs, other.inbox.beside) == ((), ())
    assert beside[-1].jobs[0].knowledge.progress(beside[-1].state.alive).tolist() == [8] * 4


def test_a_scenario_without_jobs_has_the_text_that_it_had(mapping: Path) -> None:
    table = table_of(load(mapping))
    assert "jobs" not in table
    assert set(table["network"]) == {"topology", "channel"}


def test_bytes_are_told_apart_and_add_up(mapping: Path) -> None:
    run = built(mapping, heat(), "network.rounds=3")
    measures = RunMeasures(run.scenario.robots, 1.0, run.simulation.parts.task.curve)
    moments = moments_of(built(mapping, heat(), "network.rounds=3"))
    for moment in moments:
        measures.sample(moment)
        (told,) = moment.jobs
        parts, heard = moment.traffic, moment.delivery.heard
        envelopes = (6 + 2 * 4) * parts.offered // 3  # header and two lengths of each message that was said
        assert parts.sent - told.sent == envelopes + 4 * 21  # and a tile each
        assert heard[:, 3].sum() == 3 * parts.sent  # each of four is heard by three
        assert told.heard == 3 * told.sent
        assert (np.diff(heard[:, 0]) >= 0).all()
        assert set(heard[:, 2].tolist()) == {moment.state.iteration}
    summary = measures.summary()
    assert summary["bytes"] == 3 * summary["bytes_sent"]
    assert summary["delivered_share"] == 1.0


def _senses(run):
    return run.simulation.perceive().senses


def test_envelopes_survive_packing_also_without_a_part(mapping: Path) -> None:
    run = built(mapping, heat())
    computation = run.simulation.parts.computation
    said = computation.say(_senses(run))
    codec: EnvelopeCodec = computation.codec
    for robot, size in enumerate(said.sizes.tolist()):
        packed = codec.pack(robot, 0, whole(said, robot))
        assert len(packed) == size
        sender, sent, back = codec.unpack(packed)
        assert (sender, sent) == (robot, 0)
        for one, other in zip(whole(said, robot).arrays(), back.arrays(), strict=True):
            np.testing.assert_array_equal(one, other)
    empty = Envelope((Nothing(), whole(said, 0).parts[1]))
    assert len(codec.unpack(codec.pack(0, 1, empty))[2].parts[0]) == 0
    with pytest.raises(ValueError, match=r"an envelope of .* bytes with parts up to"):
        codec.unpack(codec.pack(0, 1, empty)[:-5])


@pytest.mark.parametrize("check", [check_strictly, check_locality, check_one_robot, check_permutation])
def test_jobs_keep_their_contracts_in_several_exchanges_under_loss_and_delay(mapping: Path, check) -> None:
    channel = 'network.channel={use="latency", delay=2, over={use="bernoulli", loss=0.2}}'
    check(mapping, (heat(), "network.rounds=3", channel), 6, True)


@pytest.mark.parametrize("sharing", ["map", "relay", "merge"])
def test_envelopes_of_all_exchanges_keep_the_dates_of_what_minds_say(mapping: Path, sharing: str) -> None:
    """Also the bytes of a mind that has nothing to say yet, as one that tells its map by parts."""
    check_strictly(mapping, (heat(), "network.rounds=3", f'mind.computation.sharing.use="{sharing}"'), 6, True)


def test_messages_of_minds_are_late_by_exchanges(mapping: Path) -> None:
    late = 'network.channel={use="latency", delay=3}'
    moments = moments_of(built(mapping, heat(), "network.rounds=3", late))
    assert [len(set(one.inbox.sent.tolist())) for one in moments[:3]] == [0, 1, 1]
    assert set(moments[2].inbox.sent.tolist()) == {1}


def test_a_recording_holds_what_robots_compute_and_what_it_took(mapping: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    with_jobs = mapping.with_name("jobs.toml")
    with_jobs.write_text(MAPPING + '[[jobs]]\nuse = "./heat.py:Heat"\nname = "warmth"\n[task]\nuse = "computed"\n')
    told = called("run", with_jobs, "--out", out, "--allow-code", "--set", "stop.when_done=stop")
    assert told.returncode == 0, told.stdout + told.stderr
    recording = Recording(next(out.rglob("recording.h5")))
    assert recording.iterations == 8
    assert recording["warmth_step"].shape == (8, 4, 4)
    assert recording["warmth_step"][-1].max(axis=0).tolist() == [8] * 4
    assert recording["warmth_bytes_heard"].sum() == 3 * recording["warmth_bytes_sent"].sum() > 0
    assert recording.summary()["measures"]["computed_share"] == 1.0


@pytest.mark.parametrize(
    ("overrides", "told"),
    [
        (['task={use="computed"}'], r"task\.use: 'computed' measures jobs, and there are none; expected \[\[jobs\]\]"),
        (["network.rounds=2"], r"network\.rounds: 2 exchanges in an iteration, .*; expected \[\[jobs\]\], or 1"),
        ([heat(steps=7)], r"jobs\[0\]\.steps: 7 in levels of 2; expected a whole number of levels"),
        ([heat(parts=10**4)], r"jobs\[0\]\.pieces: 10000 of \d+ free cells; expected 1 to"),
        ([f"{heat()[:-1]}, {heat()[6:]}"], r"jobs\[1\]\.name: 'heat' is that of an earlier job; expected another name"),
        ([heat("Idle")], r"jobs\[0\]\.use: '.*heat\.py:Idle' is not a job: expected"),
        (
            [heat(), 'network.channel={use="tdma", bytes=40.0}'],
            r"jobs\[0\]\.use: what a piece says takes \d+ bytes at once, and the channel 'tdma' lets messages of 80 ",
        ),
        ([heat(copies=-1)], r"jobs\[0\]\."),
    ],
)
def test_jobs_that_cannot_be_done_are_refused_before_the_run(mapping: Path, overrides: list[str], told: str) -> None:
    with pytest.raises(InputError, match=told):
        built(mapping, *overrides)


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("Shorter", r"job heat\.py:Shorter, iteration 0: .*shows: piece \d at step 1 gives shape"),
        ("Broken", r"job heat\.py:Broken, iteration \d: "),
    ],
)
def test_a_job_that_breaks_its_contract_ends_the_run_by_name(mapping: Path, name: str, told: str) -> None:
    with pytest.raises((PartError, InputError), match=told):
        built(mapping, heat(name)).simulation.run()


def test_a_broadcast_is_charged_once(mapping: Path) -> None:
    narrow = 'network.channel={use="bandwidth", bytes_per_second=900.0}'
    heard = [
        moments_of(built(mapping, heat(), narrow, f"network.charged={charged}"))[-1]
        .jobs[0]
        .knowledge.counts[:, 0]
        .sum()
        for charged in ("heard", "sent")
    ]
    assert heard[0] < heard[1]
