from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from conftest import building, made, readings_of
from hypothesis import given
from hypothesis import strategies as st
from mappers import inbox_of

from swarmsim.core.events import Ended
from swarmsim.core.lattice import Lattice
from swarmsim.core.messages import Delivery
from swarmsim.core.readings import Tiles
from swarmsim.core.scenario.robots import Robots
from swarmsim.core.state import Intents, Measured, Moment, State
from swarmsim.network.channel import letters
from swarmsim.operations.mapping.grids import OccupancyGrids
from swarmsim.operations.mapping.measures.coverage import CURVE as CURVED
from swarmsim.operations.mapping.measures.quality import (
    MapMeasures,
    Pool,
    Quality,
    brier,
    discovery_time,
    entropy,
    overlap,
    probability,
    quality,
)
from swarmsim.operations.mapping.replay import MapReplay
from swarmsim.operations.mapping.sharing.codecs import current_tile_bytes
from swarmsim.recording.measures import RunMeasures, jain, mean_value, reached
from swarmsim.recording.reader import Recording

LOG4 = math.log(4.0)  # the log-odds of p = 0.8
H = 0.7219280948873623  # bits, the entropy of p = 0.8


@dataclass
class Believer:
    """What robots know that only believe."""

    observed: np.ndarray
    log_odds: np.ndarray
    accepted: object = None


def grid(rows: str) -> np.ndarray:
    return np.array([[int(cell) for cell in row] for row in rows.split()], np.uint8)


# 5 x 5 cells, of which the last column is outside the domain; its wall is column 3.
DOMAIN = grid("11110 11110 11110 11110 11110") == 1
TRUTH = grid("00011 00011 00011 00011 00011") == 1
HALL = building((), DOMAIN, TRUTH)
LATTICE = Lattice(0.0, 0.0, 0.15, *DOMAIN.shape)
PAIR = Robots(count=2, spawn="hall", speed=20.0)

# 0 unknown, 1 free, 2 occupied. Robot 0 errs in (0, 0) and (1, 3); both of its rows reach out of the domain.
MAPS = np.stack([grid("21122 11112 00000 00000 00000"), grid("00000 11120 11120 00000 00000")])


def believer() -> Believer:
    return Believer(MAPS > 0, np.choose(MAPS, [0.0, -LOG4, LOG4]).astype(np.float32))


def moment(iteration, xy, alive, tiles, origins, links, heard, covered, events=()) -> Moment:
    """`heard` says which of the links delivered."""
    values, origins = np.stack([grid(tile) for tile in tiles]), np.array(origins, np.int32)
    links = np.array(links, np.int32).reshape(-1, 2)
    arrived = links[np.array(heard, bool)] if len(links) else links
    senders = arrived[:, 1]
    pose = np.column_stack([np.array(xy, np.float64), np.zeros(2)])
    state = State(iteration, pose, np.zeros((2, 3)), np.zeros((2, 2)), np.array(alive))
    inbox = inbox_of(arrived[:, 0], senders, values[senders], origins[senders], iteration)
    sizes = np.full(2, current_tile_bytes(2, 3), np.int32)
    delivery = Delivery(letters(iteration, arrived, sizes), (), iteration)
    intents = Intents(np.zeros((2, 2)), np.zeros((2, 1, 2)), np.zeros(2, np.int32), np.zeros(2, np.bool_))
    share = covered[0] / 20
    measured = Measured({"coverage": share}, {"covered": np.array(covered[1:]) / 20}, share)
    knowledge = replace(believer(), accepted=inbox)
    readings = readings_of(Tiles(values, origins))
    return Moment(state, tuple(events), HALL, readings, links, delivery, inbox, knowledge, intents, measured=measured)


def story(last_events=()) -> list[Moment]:
    """Four iterations of two robots with tiles of 2 x 3 cells; robot 1 dies before the third."""
    both, one, dark, links = [True, True], [True, False], "000 000", [(0, 1), (1, 0)]
    return [
        # Robot 0 hears 5 new cells, one of them outside the domain; robot 1's message is lost.
        moment(0, [(0, 0), (0, 0)], both, ["111 111", "120 122"], [(0, 0), (3, 2)], links, [1, 0], (10, 10, 4)),
        # Of 4 cells that robot 0 hears it has just seen 2 itself; likewise robot 1 of 6.
        moment(1, [(3, 4), (1, 0)], both, ["112 112", "120 120"], [(0, 1), (1, 2)], links, [1, 1], (14, 14, 12)),
        # Half of robot 0's tile lies off the grid, and nobody looks at a dead robot's.
        moment(2, [(3, 6), (1, 1)], one, ["222 111", "111 111"], [(-1, 0), (3, 0)], [], [], (14, 14, 12)),
        moment(3, [(3, 6), (50, 50)], one, [dark, dark], [(0, 0), (0, 0)], [], [], (14, 14, 12), last_events),
    ]  # fmt: skip


def told(last_events=()) -> dict:
    run, maps = RunMeasures(PAIR, 0.5, CURVED), MapMeasures(2, DOMAIN, LATTICE)
    for each in story(last_events):
        run.sample(each)
        maps.sample(each)
    return {**run.summary(), **maps.summary()}


def test_summary_of_a_hand_made_run():
    expected = {
        "finished": 0, "iterations": None, "iterations_run": 4, "seconds": None, "coverage": 0.7,
        "t50": 1, "t75": None, "t90": None, "t95": None, "t99": None, "t100": None, "tail_ratio": None,
        "mean_coverage": 2.6 / 4,
        "discovery_time": 2.1,  # 10 cells after 1 iteration, 4 after 2, 6 never, counted as 4
        "sensed": 14 / 20,
        # Of 14 cells on the union (0, 0) was seen free, and (0, 4), (1, 4), (2, 0) and (2, 1) not at all.
        "correct": 9 / 14,
        # The union: TP (0, 3), (1, 3), (2, 3); FP (0, 0); 12 cells seen, of which the robots split on (1, 3).
        "union_precision": 3 / 4, "union_recall": 1.0, "union_f1": 6 / 7, "union_iou": 3 / 4,
        "union_false_occupied": 1, "union_false_called": 1 / 4, "union_false_known": 1 / 12,
        "union_entropy": 11 * H + 1 + 8,
        "union_brier": (0.64 + 0.25 + 10 * 0.04) / 12,
        # Robot 0: TP 1, FP 1, FN 1 of 8 cells; robot 1: TP 2 of 8 cells.
        "robot_precision": (1 / 2 + 1) / 2, "robot_recall": (1 / 2 + 1) / 2, "robot_f1": (1 / 2 + 1) / 2,
        "robot_iou": (1 / 3 + 1) / 2, "robot_false_occupied": 0.5,
        "robot_false_called": 1 / 4, "robot_false_known": 1 / 16,
        "robot_entropy": 8 * H + 12,
        "robot_brier": ((2 * 0.64 + 6 * 0.04) / 8 + 0.04) / 2,
        "disagreement": 1 / 4,  # row 1 is known to both
        "overlap_maps": 16 / 12 - 1,
        # Robot 0 sensed rows 0 and 1 (8), robot 1 columns 2 and 3 of rows 1 to 4 (8); both (1, 2) and (1, 3).
        "overlap_sensed": 16 / 14 - 1,
        "heard_share": 10 / 26,  # robot 0 knows 14 cells, robot 1 knows 12
        "redundancy": (10 + 10 + 3) / 14,
        "path_sum": 9.0, "path_longest": 7.0, "path_mean": 4.5,  # robot 1 still walked 1 m in its last iteration
        "jain_path": 81 / (2 * 53), "jain_sensed": 1.0,
        "messages": 3, "bytes": 3 * 12, "delivered_share": 3 / 4,
        "lost": 0,
        "age": 0.0,
        "fresh_share": (5 + 2 + 4) / (5 + 4 + 6),
    }  # fmt: skip
    found = told()
    assert found.keys() == expected.keys()
    for name, value in expected.items():
        assert found[name] == (None if value is None else pytest.approx(value, rel=1e-6)), name  # float32 beliefs


def test_a_finished_run_has_a_length():
    found = told([Ended(3, True)])
    assert (found["finished"], found["iterations"], found["seconds"]) == (1, 4, 2.0)


def test_a_run_at_its_limit_has_none():
    found = told([Ended(3, False)])
    assert (found["finished"], found["iterations"], found["iterations_run"]) == (0, None, 4)


def test_what_nothing_defines_is_none():
    run, maps = RunMeasures(PAIR, 1.0, CURVED), MapMeasures(2, DOMAIN, LATTICE)
    nothing = {**run.summary(), **maps.summary()}
    assert (nothing["coverage"], nothing["path_sum"], nothing["messages"]) == (0.0, 0.0, 0)
    assert {nothing[name] for name in ("mean_coverage", "discovery_time", "jain_path", "delivered_share")} == {None}
    empty = Believer(np.zeros((2, 5, 5), np.bool_), np.zeros((2, 5, 5), np.float32), story()[3].inbox)
    maps.sample(replace(story()[3], knowledge=empty))
    found = maps.summary()
    assert found["union_entropy"] == 20.0
    assert found["union_false_occupied"] == 0
    undefined = {name for name, value in found.items() if value is None}
    assert {"union_f1", "robot_brier", "disagreement", "overlap_maps"} <= undefined
    assert {"redundancy", "heard_share", "jain_sensed", "fresh_share"} <= undefined


CURVE = np.array([0.25, 0.5, 0.5, 1.0])


def test_times_to_a_share():
    assert [reached(CURVE, share) for share in (0.2, 0.5, 0.51, 1.0)] == [1, 2, 4, 4]
    assert reached(CURVE[:3], 1.0) is None


def test_mean_coverage_holds_the_last_value_up_to_a_horizon():
    assert mean_value(CURVE) == 2.25 / 4
    assert mean_value(CURVE, 2) == 0.75 / 2
    assert mean_value(CURVE, 10) == 8.25 / 10
    assert mean_value(CURVE[:0]) is None


def test_discovery_time_is_the_mean_over_cells():
    assert discovery_time(CURVE) == (1 + 2 + 4 + 4) / 4
    assert discovery_time(np.array([1.0])) == 1.0
    assert discovery_time(CURVE[:0]) is None


def test_quality_counts_only_where_asked():
    occupied, truth = np.array([1, 1, 0, 0, 1], bool), np.array([1, 0, 1, 0, 0], bool)
    where = np.array([1, 1, 1, 1, 0], bool)
    assert quality(occupied, truth, where) == Quality(0.5, 0.5, 0.5, 1 / 3, 1)
    assert quality(occupied, truth, np.zeros(5, bool)) == Quality(None, None, None, None, 0)


def test_entropy_of_certainty_and_of_ignorance():
    assert entropy(np.array([0.0, 1.0])) == 0.0
    assert entropy(np.array([0.5, 0.5, 0.8])) == pytest.approx(2.0 + H)


def test_brier_score_of_ignorance_is_a_quarter():
    everywhere = np.ones(4, bool)
    assert brier(np.full(4, 0.5), np.array([1, 0, 0, 1], bool), everywhere) == 0.25
    assert brier(np.full(4, 0.5), everywhere, ~everywhere) is None


def pooled(observed: np.ndarray, log_odds: np.ndarray) -> Pool:
    pool = Pool(observed.shape[1])
    for one in zip(observed, log_odds, strict=True):
        pool.add(*one)
    return pool


def test_union_of_maps_takes_the_word_of_those_who_looked():
    observed = np.array([[1, 1, 0], [1, 0, 0]], bool)
    log_odds = np.array([[LOG4, -LOG4, LOG4], [-LOG4, LOG4, 0.0]], np.float32)
    pool = pooled(observed, log_odds)
    assert pool.observed.tolist() == [True, True, False]
    assert pool.occupied.tolist() == [True, False, False]
    np.testing.assert_allclose(pool.probability, [0.5, 0.2, 0.5], rtol=1e-6)


def test_overlap_and_fairness():
    assert overlap(np.array([3, 3, 1, 0])) == pytest.approx(7 / 3 - 1)
    assert overlap(np.zeros(4, np.int64)) is None
    assert jain(np.array([2.0, 2.0, 2.0])) == 1.0
    assert jain(np.array([5.0, 0.0])) == 0.5
    assert jain(np.zeros(2)) is None


def test_size_of_a_message():
    assert current_tile_bytes(6, 7) == 10 + 11  # 84 bits
    assert current_tile_bytes(2, 2) == 10 + 1
    assert current_tile_bytes(3, 3) == 10 + 3  # 18 bits


cells = st.lists(st.lists(st.integers(0, 2), min_size=6, max_size=6), min_size=1, max_size=4)


@given(cells)
def test_disagreement_is_the_mean_over_pairs(maps):
    held = np.array(maps)
    shares = []
    for first, second in combinations(held, 2):
        joint = [(a, b) for a, b in zip(first, second, strict=True) if a and b]
        if joint:
            shares.append(sum(a != b for a, b in joint) / len(joint))
    found = pooled(held > 0, np.where(held == 2, 1.0, -1.0).astype(np.float32)).disagreement
    assert found == (pytest.approx(np.mean(shares)) if shares else None)


def entropy_of(log_odds: np.ndarray, domain: np.ndarray) -> float:
    p = probability(log_odds)[domain]
    return float(-(p * np.log2(p) + (1 - p) * np.log2(1 - p)).sum())


def walked(recording: Recording) -> np.ndarray:
    """How far each robot went, one step after the other."""
    pose, alive = recording["pose"], recording["alive"]
    paths = np.zeros(pose.shape[1])
    for t, robot in np.ndindex(len(pose) - 1, pose.shape[1]):
        if alive[t, robot]:
            paths[robot] += math.dist(pose[t, robot, :2], pose[t + 1, robot, :2])
    return paths


def sensed(recording: Recording) -> tuple[list[set[tuple[int, int]]], int]:
    """The cells of the domain that each robot's own tiles showed, and how often any did."""
    domain, tiles, origins = recording["domain"], recording["tiles"], recording["origins"]
    seen: list[set[tuple[int, int]]] = [set() for _ in range(tiles.shape[1])]
    readings = 0
    for t, robot, row, column in np.argwhere(tiles != 0):
        cell = (int(origins[t, robot, 0] + row), int(origins[t, robot, 1] + column))
        if domain[cell]:
            seen[robot].add(cell)
            readings += 1
    return seen, readings


def heard(recording: Recording) -> tuple[int, int, int]:
    """Messages, the cells they carried, and those of them that their receivers' maps had not held."""
    robots = recording.scenario.robots.count
    grids = OccupancyGrids(robots, recording.lattice, 0.9, 0.4, 0.12, 0.97)
    messages = carried = fresh = 0
    for t in range(recording.iterations):
        values, origins, links = recording["tiles"][t], recording["origins"][t], recording.links(t)
        inbox = inbox_of(links[:, 0], links[:, 1], values[links[:, 1]], origins[links[:, 1]])
        fresh += int(grids.update(recording["alive"][t], Tiles(values, origins), inbox)[robots:].sum())
        messages += len(links)
        carried += int((inbox.content.values != 0).sum())
    return messages, carried, fresh


def test_a_whole_run_agrees_with_its_recording(tmp_path: Path):
    run = made("network.topology.k=2")
    domain, truth, robots, parts = run.explorable, run.arena.occupied, run.scenario.robots.count, run.simulation.parts
    probes = [RunMeasures(run.scenario.robots, run.scenario.period, parts.task.curve), *parts.task.summaries()]
    path = tmp_path / "recording.h5"
    with run.recorder(path) as recorder:
        run.simulation.run([recorder, *probes])
    found = {name: value for probe in probes for name, value in probe.summary().items()}
    recording = Recording(path)

    reference = recording.summary()
    assert found["iterations"] == found["iterations_run"] == recording.iterations
    assert [found[f"t{share}"] for share in (50, 75, 90, 95, 99, 100)] == list(reference["reached"].values())

    replay = MapReplay(recording)
    for t in range(recording.iterations):  # what was measured is what the maps of the recording say
        replay.advance(t)
        held = (replay.maps > 0) & domain
        np.testing.assert_allclose(recording["covered"][t], held.sum(axis=(1, 2)) / domain.sum())
        assert recording["coverage"][t] == held.any(axis=0).sum() / domain.sum()
    union = replay.collective()[domain]
    hits = int(((union == 2) & truth[domain]).sum())
    assert found["union_precision"] == hits / int((union == 2).sum())
    assert found["union_recall"] == hits / int(truth[domain].sum())  # all of the domain is observed
    entropies = [entropy_of(row, domain) for row in run.simulation.parts.computation.maps.log_odds]
    assert found["robot_entropy"] == pytest.approx(np.mean(entropies))
    held = (replay.maps > 0) & domain
    assert found["overlap_maps"] == pytest.approx(held.sum() / held.any(axis=0).sum() - 1)

    seen, readings = sensed(recording)
    distinct = len(set.union(*seen))
    assert found["redundancy"] == pytest.approx(readings / distinct)
    assert found["overlap_sensed"] == pytest.approx(sum(map(len, seen)) / distinct - 1)
    assert found["heard_share"] == pytest.approx(1 - sum(map(len, seen)) / held.sum())
    counts = np.array([len(each) for each in seen])
    assert found["jain_sensed"] == pytest.approx(counts.sum() ** 2 / (robots * (counts**2).sum()))

    paths = walked(recording)
    assert found["path_sum"] == pytest.approx(paths.sum())
    assert found["path_longest"] == pytest.approx(paths.max())
    messages, carried, fresh = heard(recording)
    assert (found["messages"], found["bytes"]) == (messages, 21 * messages)
    assert found["fresh_share"] == fresh / carried
