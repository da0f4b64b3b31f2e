"""Robots without a common frame of reference believe no stranger, find frames where they meet, and pass them on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conftest import called, made, moments_of, seen_as, setting_of
from mappers import Grids
from numpy.testing import assert_allclose, assert_array_equal

from swarmsim.core.lattice import Lattice
from swarmsim.core.messages import Delivery, Inbox, MessageBuffer
from swarmsim.core.readings import Tiles
from swarmsim.core.state import FREE, OCCUPIED, UNKNOWN
from swarmsim.engine import contracts
from swarmsim.operations.mapping.maps import Frames, MapAuditor, Maps, PlainTiles
from swarmsim.operations.mapping.measures.frames import FrameMeasures
from swarmsim.operations.mapping.measures.quality import MapMeasures
from swarmsim.operations.mapping.measures.sightings import Sightings
from swarmsim.operations.mapping.sharing.frames import moved, presented
from swarmsim.operations.mapping.sharing.introductions import LINK, MAP, TILE, MergeItems, as_told
from swarmsim.operations.mapping.sharing.links import Link
from swarmsim.operations.mapping.sharing.merging import Merge, MergeSharing
from swarmsim.operations.mapping.sharing.places import Transform

SHAPE = (30, 40)
LATTICE = Lattice(0.0, 0.0, 0.15, *SHAPE)
TILE_SHAPE = (6, 7)


def test_a_tile_that_is_placed_rightly_stays_as_it_is() -> None:
    random = np.random.default_rng(1)
    values = random.integers(0, 3, (9, *TILE_SHAPE)).astype(np.uint8)
    origins = random.integers(-3, 30, (9, 2)).astype(np.int32)
    placed, at = moved(values, origins, np.zeros((9, 3)))
    assert_array_equal(placed, values)
    assert_array_equal(at, origins)


def test_a_tile_is_moved_by_whole_cells() -> None:
    values = np.random.default_rng(2).integers(0, 3, (1, *TILE_SHAPE)).astype(np.uint8)
    placed, at = moved(values, np.array([[4, 5]], np.int32), np.array([[0.0, 3.2, -2.4]]))
    assert_array_equal(placed, values)
    assert_array_equal(at, [[7, 3]])


def test_a_tile_is_turned_about_the_corner_of_the_grid() -> None:
    """A quarter turn counter-clockwise takes row r, column c to row c, column -r."""
    values = np.random.default_rng(3).integers(0, 3, (1, 7, 7)).astype(np.uint8)
    placed, at = moved(values, np.array([[10, 20]], np.int32), np.array([[np.pi / 2.0, 0.0, 40.0]]))
    assert_array_equal(at, [[20, 40 - 17]])
    for row in range(7):
        for column in range(7):
            assert placed[0, column, 6 - row] == values[0, row, column]


def test_a_map_is_presented_in_the_frame_of_its_robot() -> None:
    cells = np.full(SHAPE, UNKNOWN, np.uint8)
    cells[10:20, 12:30] = FREE
    cells[10, 12:30] = OCCUPIED
    frame = Transform(np.pi / 2.0, 0.0, 0.0)
    shown, corner = presented(cells, frame)
    for row, column in ((10, 12), (10, 29), (19, 12), (15, 20)):
        there = np.floor(frame.apply(np.array([[row + 0.5, column + 0.5]])))[0].astype(int) - corner
        assert shown[tuple(there)] == cells[row, column]
    assert np.count_nonzero(shown) == np.count_nonzero(cells)


def sharing(robots: int, **keys) -> MergeSharing:
    start = np.random.default_rng(6).uniform((1.0, 1.0, -3.0), (4.0, 3.0, 3.0), (robots, 3))
    return Merge(**keys).build(setting_of(robots, SHAPE, 1, start=start, tile=TILE_SHAPE))


def planted(policy: MergeSharing, hearer: int, other: int, excess: int, now: int, aside: float) -> Link:
    """A link as a robot finds it, right but for a shift by some cells."""
    own, (first, second) = policy._own, sorted((hearer, other))
    shift = Transform(0.0, aside if hearer < other else -aside, 0.0)
    place = own[first].after(shift).after(own[second].inverse())
    return Link((first, second), now, excess, as_told(place))


class Swarm:
    """A policy whose robots stand and hear each other along given links."""

    def __init__(self, robots: int) -> None:
        self.policy, self.post, self.maps = (
            sharing(robots),
            MessageBuffer(),
            Grids(robots, LATTICE, 0.9, 0.4, 0.12, 0.97),
        )
        self.alive, self.now = np.ones(robots, np.bool_), 0
        self.pose = np.stack([np.arange(robots) * 3.0, np.zeros(robots), np.zeros(robots)], axis=1)

    def known(self) -> Maps:
        grids, nobody = self.maps, np.empty(0, np.int32)
        nothing = PlainTiles(np.empty((0, 0, 0), np.uint8), np.empty((0, 2), np.int32), nobody, nobody)
        news = np.zeros(len(self.alive), np.int32)
        return Maps(grids.observed, grids.log_odds, grids.changes, news, Inbox(nobody, nobody, nobody, nothing))

    def hear(self, *links: tuple[int, int]):
        values = np.full((len(self.alive), *TILE_SHAPE), FREE, np.uint8)
        tiles = Tiles(values, np.full((len(self.alive), 2), 5, np.int32))
        observed = seen_as(self.now, self.pose, self.alive, tiles)
        said = self.policy.say(observed, self.known())
        assert contracts.message_sizes(said, self.policy.codec, self.now) is None
        self.post.post(self.now, said)
        rows = [(receiver, sender, self.now, int(said.sizes[sender])) for receiver, sender in sorted(links)]
        letters = np.array(rows, np.int32).reshape(-1, 4)
        inbox = self.post.open(self.now, Delivery(letters, (), self.now))
        self.now += 1
        return self.policy.accepted(observed, inbox)

    def find(self, hearer: int, other: int, excess: int, aside: float = 0.0) -> None:
        """Let a robot find a frame, rightly but for a shift by some cells."""
        self.policy._learn(hearer, planted(self.policy, hearer, other, excess, self.now, aside))

    def error(self, hearer: int, other: int) -> np.ndarray:
        assert self.policy.frames.known[hearer, other]
        return self.policy.frames.errors[hearer, other]


def test_what_strangers_say_is_not_taken_in() -> None:
    swarm = Swarm(3)
    assert len(swarm.hear((0, 1), (1, 0), (2, 1))) == 0
    swarm.find(0, 1, 100)
    heard = swarm.hear((0, 1), (1, 0), (2, 1))
    assert set(zip(heard.receivers.tolist(), heard.senders.tolist(), strict=True)) >= {(0, 1)}
    assert not ((heard.receivers == 2) | (heard.senders == 2)).any()


def test_the_other_one_learns_of_a_frame_that_was_found() -> None:
    swarm = Swarm(2)
    swarm.find(0, 1, 100)
    swarm.hear((1, 0))
    assert_allclose(swarm.error(1, 0), 0.0, atol=1e-4)


def test_frames_are_passed_on_by_those_in_between() -> None:
    swarm = Swarm(3)
    swarm.find(0, 1, 100)
    swarm.find(1, 2, 60)
    for _ in range(4):
        swarm.hear((0, 1), (1, 0), (1, 2), (2, 1))
    for hearer in range(3):
        for other in range(3):
            assert_allclose(swarm.error(hearer, other), 0.0, atol=1e-4)


def test_what_is_passed_on_is_no_better_founded() -> None:
    """However often it is heard, and from however many, a link stays the one piece of evidence that it was."""
    swarm = Swarm(4)
    swarm.find(0, 1, 30)
    swarm.find(1, 2, 20)
    for _ in range(12):
        swarm.hear((0, 1), (1, 0), (1, 2), (2, 1), (3, 0), (0, 3), (3, 2), (2, 3), (3, 1), (1, 3))
    for links in swarm.policy._links:
        assert {pair: link.excess for pair, link in links._newest.items()} == {(0, 1): 30, (1, 2): 20}


def test_a_later_test_replaces_an_earlier_one_and_old_news_does_not() -> None:
    swarm = Swarm(2)
    swarm.find(0, 1, 50, aside=3.0)
    assert swarm.error(0, 1)[1] == pytest.approx(3.0, abs=1e-4)
    before = planted(swarm.policy, 0, 1, 90, -1, 6.0)
    swarm.policy._learn(0, before)
    assert swarm.error(0, 1)[1] == pytest.approx(3.0, abs=1e-4)
    swarm.hear()
    swarm.find(0, 1, 40)
    assert_allclose(swarm.error(0, 1), 0.0, atol=1e-4)


def test_a_robot_that_loses_a_frame_forgets_hearsay_and_believes_it_no_more() -> None:
    swarm = Swarm(2)
    swarm.find(0, 1, 50, aside=9.0)
    assert len(swarm.hear((0, 1)))
    swarm.policy._learn(0, swarm.policy._links[0].of((0, 1)).withdrawn(swarm.now))
    assert swarm.policy.frames.spoilt.tolist() == [True, False]
    assert swarm.policy.frames.withdrawn.tolist() == [1, 0]
    assert len(swarm.hear((0, 1))) == 0


def test_news_of_a_withdrawal_reaches_those_who_had_the_link() -> None:
    swarm = Swarm(3)
    swarm.find(0, 1, 50)
    swarm.hear((1, 0), (2, 0))
    assert swarm.policy.frames.known[1, 0]
    swarm.policy._learn(0, swarm.policy._links[0].of((0, 1)).withdrawn(swarm.now))
    swarm.hear((1, 0), (2, 0))
    assert not swarm.policy.frames.known[1, 0]
    assert swarm.policy._links[2].of((0, 1)) is None


def test_what_an_acquaintance_says_is_put_where_it_is_believed_to_be() -> None:
    swarm = Swarm(2)
    swarm.find(0, 1, 50, aside=3.0)
    heard = swarm.hear((0, 1))
    assert_array_equal(heard.content.origins[heard.content.sources == 1], [[8, 5]])


def test_a_message_packs_to_its_bytes_with_all_its_parts() -> None:
    swarm = Swarm(2)
    random = np.random.default_rng(8)
    values = random.integers(0, 3, (3, *TILE_SHAPE)).astype(np.uint8)
    origins = np.array([[3, 4], [6, 7], [12, 14]], np.int32)
    link = Link((0, 1), 4, 77, Transform(0.5, -3.25, 60.0))
    told = MergeItems.telling([link], TILE_SHAPE, 5)
    tiles = PlainTiles(values, origins, np.array([1, -1, -1], np.int32), np.full(3, 5, np.int32))
    parts = [MergeItems.of(tiles.take(np.arange(2)), TILE), told, MergeItems.of(tiles.take(np.arange(2, 3)), MAP)]
    items = MergeItems.joined(parts)
    assert np.flatnonzero(items.part == LINK).tolist() == [2]
    assert items.link(2) == link
    swarm.hear()
    codec = swarm.policy.codec
    sender, iteration, back = codec.unpack(codec.pack(1, 5, items))
    assert (sender, iteration) == (1, 5)
    for before, after in zip(items.arrays(), back.arrays(), strict=True):
        assert_array_equal(before, after)


@pytest.mark.thorough
def test_robots_find_each_others_frames_and_finish_with_all_truly_sensed() -> None:
    run = made(scenario="merging")
    probe, quality = FrameMeasures(run.explorable), MapMeasures(7, run.explorable, run.context.lattice)
    assert run.simulate([probe, quality])
    summary = probe.summary()
    assert summary["frames_found"] == 42
    assert summary["frames_false"] == summary["frames_undecided"] == 0
    assert summary["frames_error"] < 1.0
    assert 1 < summary["frames_joined"] <= run.simulation.state.iteration
    assert quality.summary()["sensed"] == 1.0


def test_a_false_frame_adds_no_coverage_and_later_meetings_withdraw_it() -> None:
    """All of robot 1's data land 15 cells from their place, until the maps refute that."""
    run = made("robots.count=2", "stop.iterations=400", scenario="merging")
    mapping, sightings, known = run.simulation.parts.computation, Sightings(run.context.lattice), []
    sharing = mapping._sharing
    sharing._learn(0, planted(sharing, 0, 1, 13, -1, 15.0))
    for _ in range(400):
        moment = run.simulation.tick()
        sightings.add(moment)
        sensed = np.count_nonzero(sightings.seen & run.explorable) / np.count_nonzero(run.explorable)
        assert moment.measured.values["coverage"] <= sensed + 1e-12
        frames = moment.knowledge.frames
        known.append(bool(frames.known[0, 1]) and float(np.hypot(*frames.errors[0, 1, 1:])) > 5.0)
        if frames.spoilt[0]:
            assert not (moment.knowledge.observed[0] & ~frames.sensed[0]).any() or frames.known[0, 1]
            break
    assert known[0]
    assert not known[-1]
    assert frames.withdrawn[0] == 1


def test_robots_that_never_meet_know_what_they_sensed_alone() -> None:
    run = made(
        "seed=1", 'mind.computation.sharing={use="merge", within=0.001}', "stop.iterations=60", scenario="merging"
    )
    moments = moments_of(run)
    frames = moments[-1].knowledge.frames
    assert_array_equal(frames.known, np.eye(7, dtype=bool))
    assert all(len(moment.knowledge.accepted) == 0 for moment in moments)
    assert all(moment.measured.values["coverage"] == moment.measured.robots["covered"].max() for moment in moments)


def test_maps_that_are_still_compared_are_not_done() -> None:
    """All of the share is covered, but two robots that hear each other do not know how their maps fit together."""
    run = made("robots.count=2", "task.share=0.005", 'stop={iterations=3, when_done="continue"}', scenario="merging")
    moment, measure = moments_of(run)[-1], run.simulation.parts.task.measure
    assert moment.measured.finished
    compared = replace(
        moment.knowledge.frames, places=np.array([[0, 3], [0, 0]], np.int32), known=np.eye(2, dtype=bool)
    )
    knowledge = replace(moment.knowledge, frames=compared)
    for links, done in (([[0, 1], [1, 0]], False), ([[1, 0]], True), ([], True)):
        heard = np.array(links, np.int32).reshape(-1, 2)
        assert measure(replace(moment, knowledge=knowledge, links=heard)).finished is done


def test_maps_that_one_robot_can_put_together_count_as_one() -> None:
    run = made("robots.count=3", 'stop={iterations=20, when_done="continue"}', scenario="merging")
    moment, measure = moments_of(run)[-1], run.simulation.parts.task.measure
    counted = []
    for pairs in ((), ((0, 1),), ((0, 1), (0, 2)), ((0, 1), (1, 2))):
        known = np.eye(3, dtype=bool)
        for hearer, other in pairs:
            known[hearer, other] = True
        frames = replace(moment.knowledge.frames, known=known)
        counted.append(measure(replace(moment, knowledge=replace(moment.knowledge, frames=frames))).values["coverage"])
    alone, two, all_three, chain = counted
    assert max(moment.measured.robots["covered"]) == alone < two < all_three
    assert chain < all_three


def test_other_policies_have_no_frames_to_measure(room) -> None:
    run = made("seed=1", "stop.iterations=5")
    probe = FrameMeasures(run.explorable)
    run.simulation.run([probe])
    assert probe.summary() == {}


def test_the_audit_finds_what_nobody_has_told() -> None:
    run = made("seed=1", "stop.iterations=3", scenario="exploring")
    moment = moments_of(run)[-1]
    accepted = moment.knowledge.accepted.take(np.arange(1))
    observed = seen_as(3, moment.state.pose, moment.state.alive, moment.readings.tiles)
    nothing = np.zeros(12, np.int32)
    frames = Frames(
        np.eye(12, dtype=bool), np.zeros((12, 12, 3)), np.zeros((12, 12), np.int32), nothing, nothing > 0,
        np.zeros((12, *run.context.lattice.shape), bool),
    )  # fmt: skip
    knowledge = replace(moment.knowledge, accepted=accepted, frames=frames)
    assert "has not told it" in (MapAuditor(run.context).audit(knowledge, observed, accepted.take(np.arange(0))) or "")


def test_a_film_of_frames_is_written_and_refused_for_other_runs(tmp_path, room) -> None:
    out = tmp_path / "run"
    scenario = "scenarios/merging.toml"
    assert (
        called("run", scenario, "--out", str(out), "--set", "stop.iterations=30", "--quiet").returncode == 1
    )  # not finished
    film = tmp_path / "frames.mp4"
    done = called("video", str(out), str(film), "--frames", "--size", "480x270", "--speed", "60", "--quiet")
    assert (done.returncode, done.stderr) == (0, "")
    assert film.stat().st_size > 2000
    refused = called("video", str(out), str(tmp_path / "frames.gif"), "--frames", "--quiet")
    assert refused.returncode == 2
    assert "ends in .mp4" in refused.stderr
    refused = called("video", str(out), str(film), "--frames", "--focus", "1", "--quiet")
    assert refused.returncode == 2
    assert "such films have their own look" in refused.stderr
    refused = called("video", str(room), str(tmp_path / "no.mp4"), "--frames", "--quiet")
    assert refused.returncode == 2
    assert "expected mind.computation.sharing.use = merge" in refused.stderr
