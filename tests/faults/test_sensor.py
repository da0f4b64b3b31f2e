from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conftest import made, moments_of, readings_of

from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.events import Begins, Ends
from swarmsim.core.parts import Parts
from swarmsim.core.readings import Readings, Tiles
from swarmsim.core.state import FREE, OCCUPIED, UNKNOWN, Moment, State
from swarmsim.core.streams import Streams
from swarmsim.engine.build import BuiltRun
from swarmsim.faults.sensor import SensorFault

STRUCK = "at=4, duration=3, robots=[1]"
WITH = range(4, 7)  # the iterations with the fault
ITERATIONS = 9


class Keep:
    def __init__(self) -> None:
        self.moments: list[Moment] = []

    def sample(self, moment: Moment) -> None:
        self.moments.append(moment)


def watch(*faults: str, iterations: int = ITERATIONS) -> list[Moment]:
    listed = ", ".join(f'{{use="sensor", {fault}}}' for fault in faults)
    keep = Keep()
    made(f"stop.iterations={iterations}", f"faults=[{listed}]").simulation.run([keep])
    return keep.moments


@pytest.fixture(scope="module")
def plain() -> BuiltRun:
    return made()


@pytest.fixture(scope="module")
def parts(plain: BuiltRun) -> Parts:
    return plain.simulation.parts


def context(run: BuiltRun, robots: int = 3) -> BuildContext:
    assert run.scenario.robots.count == robots
    return BuildContext.of(run.scenario.robots, run.arena.lattice, 1.0, Streams(1), run.simulation.parts.building)


def check_the_rest(moments: list[Moment], parts: Parts) -> list[tuple[State, Tiles, Tiles]]:
    """All rows but robot 1's while it has the fault are as sensed; gives state, tiles sensed and tiles given then."""
    struck = []
    for moment in moments:
        sensed, given = parts.sensor.sense(moment.state).tiles, moment.readings.tiles
        rows = np.ones(len(sensed.values), bool)
        if moment.state.iteration in WITH:
            rows[1] = False
            struck.append((moment.state, sensed, given))
        np.testing.assert_array_equal(given.values[rows], sensed.values[rows])
        np.testing.assert_array_equal(given.origins[rows], sensed.origins[rows])
    assert len(struck) == len(WITH)
    return struck


@pytest.mark.parametrize(
    ("failure", "value"),
    [('failure="off"', UNKNOWN), ('failure="stuck", value="free"', FREE),
     ('failure="stuck", value="occupied"', OCCUPIED)],
)  # fmt: skip
def test_all_cells_have_one_value_from_the_onset_to_the_end(failure: str, value: int, parts: Parts) -> None:
    for _, sensed, given in check_the_rest(watch(f"{failure}, {STRUCK}"), parts):
        assert (given.values[1] == value).all()
        np.testing.assert_array_equal(given.origins, sensed.origins)


def test_garbage_is_any_value_and_new_in_every_iteration(parts: Parts) -> None:
    struck = check_the_rest(watch(f'failure="garbage", {STRUCK}'), parts)
    values = np.stack([given.values[1] for _, _, given in struck])
    counts = np.bincount(values.reshape(-1), minlength=3)
    assert len(counts) == 3
    assert (counts > 0.2 * values.size).all()
    assert (values[0] != values[1]).any()
    assert (values[1] != values[2]).any()


def test_garbage_of_one_robot_depends_neither_on_others_nor_on_other_faults() -> None:
    def first(*faults: str) -> np.ndarray:
        return watch(*faults, iterations=5)[4].readings.tiles.values[1]

    alone = first(f'failure="garbage", {STRUCK}')
    together = first('failure="garbage", at=4, robots=[0, 1, 2], min_alive=0')
    beside = first(f'failure="garbage", {STRUCK}', 'failure="garbage", at=4, robots=[2]')
    np.testing.assert_array_equal(alone, together)
    np.testing.assert_array_equal(alone, beside)
    second = first('failure="off", at=4, robots=[2]', f'failure="garbage", {STRUCK}')
    assert (alone != second).any()  # each fault has numbers of its own


def test_a_short_range_hides_the_cells_beyond_it(parts: Parts) -> None:
    lattice = made().arena.lattice
    hidden = kept = 0
    for state, sensed, given in check_the_rest(watch(f'failure="range", range=0.3, {STRUCK}'), parts):
        expected = sensed.values[1].copy()
        for row in range(expected.shape[0]):
            for column in range(expected.shape[1]):
                x = lattice.x0 + (sensed.origins[1, 1] + column + 0.5) * lattice.cell
                y = lattice.y0 + (sensed.origins[1, 0] + row + 0.5) * lattice.cell
                if (x - state.pose[1, 0]) ** 2 + (y - state.pose[1, 1]) ** 2 > 0.3**2:
                    expected[row, column] = UNKNOWN
        np.testing.assert_array_equal(given.values[1], expected)
        hidden += np.count_nonzero(expected != sensed.values[1])
        kept += np.count_nonzero(expected)
    assert hidden > 0
    assert kept > 0


def test_an_offset_puts_the_tile_aside_as_it_is(parts: Parts) -> None:
    for _, sensed, given in check_the_rest(watch(f'failure="offset", offset=[2, -3], {STRUCK}'), parts):
        np.testing.assert_array_equal(given.values[1], sensed.values[1])
        assert (given.origins[1] - sensed.origins[1]).tolist() == [2, -3]
        assert given.origins.dtype == np.int32


@pytest.mark.parametrize("offset", [[1000, 1000], [-1000, 1000], [1000, -1000], [-1000, -1000]])
def test_tiles_that_are_put_off_the_lattice_map_nothing(offset: list[int], tmp_path) -> None:
    run = made(
        "stop.iterations=12",
        f'faults=[{{use="sensor", failure="offset", offset={offset}, at=0, fraction=1.0, min_alive=0}}]',
    )
    keep = Keep()
    with run.recorder(tmp_path / "recording.h5") as recorder:
        run.simulation.run([keep, recorder])
    assert [moment.measured.values["coverage"] for moment in keep.moments] == [0] * 12


def test_two_halves_of_the_ring_see_together_what_the_whole_ring_sees(parts: Parts) -> None:
    front, back = (check_the_rest(watch(f'failure="beams", beams={dead}, {STRUCK}'), parts)[0]
                   for dead in (list(range(18, 54)), [*range(18), *range(54, 72)]))  # fmt: skip
    sensed, one, other = front[1].values[1], front[2].values[1], back[2].values[1]
    np.testing.assert_array_equal(front[0].pose, back[0].pose)
    occupied = (one == OCCUPIED) | (other == OCCUPIED)
    free = ((one == FREE) | (other == FREE)) & ~occupied
    np.testing.assert_array_equal(np.select([occupied, free], [OCCUPIED, FREE], UNKNOWN), sensed)
    assert (one != sensed).any()
    assert (other != sensed).any()
    np.testing.assert_array_equal(front[2].origins, front[1].origins)


def test_a_ring_of_dead_beams_alone_sees_nothing(parts: Parts) -> None:
    for _, _, given in check_the_rest(watch(f'failure="beams", beams={list(range(72))}, {STRUCK}'), parts):
        assert not given.values[1].any()


def test_dead_beams_add_up_over_faults(parts: Parts) -> None:
    ahead, behind = list(range(18)), list(range(36, 54))
    both = watch(f'failure="beams", beams={ahead}, {STRUCK}', f'failure="beams", beams={behind}, at=4, robots=[1, 2]')
    whole = watch(f'failure="beams", beams={ahead + behind}, {STRUCK}')
    other = watch(f'failure="beams", beams={behind}, at=4, robots=[2]')
    np.testing.assert_array_equal(both[4].readings.tiles.values[1], whole[4].readings.tiles.values[1])
    np.testing.assert_array_equal(both[4].readings.tiles.values[2], other[4].readings.tiles.values[2])
    assert (both[4].readings.tiles.values != parts.sensor.sense(both[4].state).tiles.values).any(axis=(1, 2)).tolist()[
        1:
    ] == [True] * 2
    assert (
        whole[4].readings.tiles.values[1]
        != watch(f'failure="beams", beams={ahead}, {STRUCK}')[4].readings.tiles.values[1]
    ).any()


def test_dead_beams_lie_beneath_what_spoils_the_tile_in_either_order() -> None:
    dead, garbage = f'failure="beams", beams={list(range(36))}, {STRUCK}', f'failure="range", range=0.4, {STRUCK}'
    for one, other in zip(watch(dead, garbage), watch(garbage, dead), strict=True):
        np.testing.assert_array_equal(one.readings.tiles.values, other.readings.tiles.values)


def test_the_dead_see_nothing_whatever_their_sensor_does() -> None:
    keep = Keep()
    faults = '{use="crash", at=2, robots=[1]}, {use="sensor", failure="stuck", value="occupied", at=0, robots=[1]}'
    made("stop.iterations=4", f"faults=[{faults}]").simulation.run([keep])
    assert (keep.moments[1].readings.tiles.values[1] == OCCUPIED).all()
    assert not keep.moments[2].readings.tiles.values[1].any()


def test_nothing_differs_before_the_onset_and_the_events_say_when() -> None:
    keep = Keep()
    made(f"stop.iterations={ITERATIONS}").simulation.run([keep])
    moments = watch(f'failure="garbage", {STRUCK}')
    for ours, theirs in zip(moments[:4], keep.moments[:4], strict=True):
        np.testing.assert_array_equal(ours.state.pose, theirs.state.pose)
        np.testing.assert_array_equal(ours.intents.goals, theirs.intents.goals)
        np.testing.assert_array_equal(ours.inbox.content.values, theirs.inbox.content.values)
    events = [event for moment in moments for event in moment.events]
    assert events[:2] == [Begins(4, 0, (1,)), Ends(7, 0, (1,))]


def test_the_sensor_beneath_keeps_its_own_tiles(parts: Parts, plain: BuiltRun) -> None:
    state = parts.bodies.state()
    own = parts.sensor.sense(state).tiles

    class Same:
        channels = parts.sensor.channels

        def sense(self, state: State) -> Readings:
            return readings_of(own)

    before = own.values.copy(), own.origins.copy()
    for fault in (
        SensorFault(failure="garbage", at=0),
        SensorFault(failure="offset", offset=(1, 1), at=0),
        SensorFault(failure="stuck", value="free", at=0),
    ):
        spoilt = fault.build(context(plain)).install(replace(parts, sensor=Same())).sensor.sense(state).tiles
        assert (spoilt.values != own.values).any() or (spoilt.origins != own.origins).any()
    np.testing.assert_array_equal(own.values, before[0])
    np.testing.assert_array_equal(own.origins, before[1])


def test_a_sensor_without_beams_cannot_lose_any(parts: Parts, plain: BuiltRun) -> None:
    class Blind:
        channels = parts.sensor.channels

        def sense(self, state: State) -> Readings:
            return readings_of(Tiles(np.zeros((3, 6, 7), np.uint8), np.zeros((3, 2), np.int32)))

    fault = SensorFault(failure="beams", beams=[1], at=0).build(context(plain))
    with pytest.raises(InputError, match=r"failure: this sensor has no beams.*ir-ring"):
        fault.install(replace(parts, sensor=Blind()))


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ('failure="blind", at=1', r"faults\[0\]\.failure"),
        ("at=1", r"faults\[0\]\.failure: required key is missing"),
        ('failure="off"', r"faults\[0\]\.at: required key is missing"),
        ('failure="stuck", at=1', r"faults\[0\]\.value: required key is missing"),
        ('failure="off", value="free", at=1', r"faults\[0\]\.value: a sensor that is 'off' has none.*'stuck'"),
        ('failure="stuck", value="unknown", at=1', r"faults\[0\]\.value"),
        ('failure="range", at=1', r"faults\[0\]\.range: required key"),
        ('failure="range", range=0.0, at=1', r"faults\[0\]\.range.*> 0"),
        ('failure="offset", offset=[1], at=1', r"faults\[0\]\.offset"),
        ('failure="offset", offset=[1001, 0], at=1', r"faults\[0\]\.offset.*1000"),
        ('failure="beams", beams=[], at=1', r"faults\[0\]\.beams"),
    ],
)
def test_a_fault_that_cannot_work_is_refused(fault: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        watch(fault)


def test_a_beam_that_is_not_there_is_refused_by_its_number(parts: Parts, plain: BuiltRun) -> None:
    fault = SensorFault(failure="beams", beams=[3, 72], at=0).build(context(plain))
    with pytest.raises(InputError, match="beams: there is no beam 72; expected 0 to 71"):
        fault.install(parts)


@pytest.mark.parametrize(
    "more",
    [
        ('field={use="formula", formula="x"}',),
        ('robots=[{count=1}, {count=2, sensor={use="ir-ring", tile=[4, 4]}}]',),
    ],
)
def test_beams_die_of_sensors_that_sample_a_field_too_and_of_mixed_swarms(more: tuple[str, ...]) -> None:
    dead = f'faults=[{{use="sensor", failure="beams", beams={list(range(72))}, at=2, robots=[0, 1, 2], min_alive=0}}]'
    moments = moments_of(made(*more, dead, "stop.iterations=4"))
    seen = [moment.readings.tiles.values.any(axis=(1, 2)).tolist() for moment in moments]
    assert seen == [[True] * 3] * 2 + [[False] * 3] * 2
