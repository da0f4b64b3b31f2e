"""Sensors and what they declare: one or several, of all robots or of groups, recorded, struck and observed."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from conftest import made, moments_of, setting_of

from swarmsim.core import declarations
from swarmsim.core.errors import InputError
from swarmsim.core.readings import Channel, Channels, Readings, ragged, range_channel, tile_channels
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.decoding import convert
from swarmsim.core.state import State
from swarmsim.recording.columns import columns_of
from swarmsim.recording.digests import hashed
from swarmsim.recording.reader import Recording
from swarmsim.robots.bump import Bump
from swarmsim.robots.ground import GroundColour
from swarmsim.robots.neighbours import Neighbours
from swarmsim.robots.suites import MixedSensor, Suite
from swarmsim.testing.witness import chosen

NEAR = 'sensors=[{use="neighbours", reach=9.0}]'
RING = 'sensor={use="ir-ring"}'
WALL = [[1.0, -5.0, 1.0, 5.0]]


def state_of(pose, alive=None, iteration=0) -> State:
    pose = np.asarray(pose, float)
    alive = np.ones(len(pose), bool) if alive is None else np.asarray(alive)
    return State(iteration, pose, np.zeros_like(pose), np.zeros((len(pose), 2)), alive)


def seen(keys: dict, pose, alive=None, walls=()) -> Readings:
    sensor = convert({"reach": 5.0, **keys}, Neighbours).build(setting_of(len(pose), walls=walls))
    return sensor.sense(state_of(pose, alive))


# Neighbours


def test_the_nearest_come_first_with_distance_bearing_and_heading() -> None:
    found = seen({}, [[0.0, 0.0, 0.5 * np.pi], [0.0, 2.0, 0.0], [1.0, 0.0, np.pi]])
    assert found["neighbours_count"].tolist() == [2, 2, 2]
    np.testing.assert_allclose(found["neighbours"][0], [[1.0, -0.5 * np.pi, 0.5 * np.pi], [2.0, 0.0, -0.5 * np.pi]])


def test_of_equally_near_ones_the_lower_number_is_told_and_the_rest_cut_off() -> None:
    found = seen({"most": 2}, [[0.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    assert found["neighbours"].shape == (4, 2, 3)
    assert found["neighbours_count"][0] == 2
    np.testing.assert_allclose(found["neighbours"][0, :, 1], [-np.pi, 0.5 * np.pi])


def test_walls_hide_and_a_field_of_view_ends() -> None:
    pose = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [-2.0, 0.0, 0.0]]
    assert seen({}, pose, walls=WALL)["neighbours_count"].tolist() == [1, 0, 1]
    assert seen({"walls": False}, pose, walls=WALL)["neighbours_count"].tolist() == [2, 2, 2]
    assert seen({"view": 90.0}, pose)["neighbours_count"].tolist() == [1, 0, 2]


def test_the_dead_neither_see_nor_are_seen_and_what_is_not_used_is_blank() -> None:
    found = seen({}, [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]], [True, False, True])
    assert found["neighbours_count"].tolist() == [1, 0, 1]
    assert np.isnan(found["neighbours"][1]).all()
    assert np.isnan(found["neighbours"][0, 1:]).all()


def test_misses_and_errors_are_drawn_for_the_pair_and_the_iteration() -> None:
    pose = np.column_stack([np.arange(40) * 0.1, np.zeros(40), np.zeros(40)])
    missing = seen({"missed": 0.5, "most": 39}, pose)["neighbours_count"]
    assert 12 < missing.mean() < 27
    sensors = [convert({"reach": 5.0, "error": 0.1, "most": 39}, Neighbours).build(setting_of(n)) for n in (20, 40)]
    few, many = (one.sense(state_of(pose[:n])) for one, n in zip(sensors, (20, 40), strict=True))
    off = seen({"most": 39}, pose)["neighbours"][..., 0] - many["neighbours"][..., 0]
    assert 0.05 < np.nanstd(off) < 0.15
    assert few["neighbours"][0, 5, 0] == many["neighbours"][0, 5, 0]  # one more robot shifts nobody's draws


# Ground and bump


def test_the_floor_is_told_in_steps_and_in_colours() -> None:
    formula = {"use": "formula", "formula": "x"}
    state = state_of([[0.2, 0.2, 0.0], [1.0, 0.2, 0.0], [2.0, 0.2, 0.0]], [True, True, False])
    ground = convert({"floors": [formula], "steps": [0.5]}, GroundColour).build(setting_of(3)).sense(state)["ground"]
    np.testing.assert_array_equal(ground, [0.0, 1.0, np.nan])
    colour = convert({"floors": [formula] * 3}, GroundColour).build(setting_of(3)).sense(state)["ground"]
    np.testing.assert_array_equal(colour[:2], [[0.2] * 3, [1.0] * 3])
    with pytest.raises(InputError, match=r"steps: .*expected numbers that rise"):
        convert({"floors": [formula], "steps": [2.0, 1.0]}, GroundColour).build(setting_of(1))
    with pytest.raises(InputError, match=r"floors\[0\]\.use: no field is called 'carpet'"):
        convert({"floors": [{"use": "carpet"}]}, GroundColour).build(setting_of(1))


def test_contacts_are_told_by_the_side_on_which_they_are() -> None:
    sensor = convert({}, Bump).build(setting_of(3, walls=WALL))
    pose = [[0.945, 0.0, 0.5 * np.pi], [0.0, 0.0, 0.0], [0.0, 0.11, 0.0]]
    assert sensor.sense(state_of(pose))["bump"].tolist() == [
        [False, False, False, True],  # the wall is on its right
        [False, True, False, False],
        [False, False, False, True],
    ]
    assert not sensor.sense(state_of(pose, [False, False, True]))["bump"].any()


# One after the other: recorded, digested, struck, seen


def test_further_channels_are_recorded_digested_struck_and_read_back(tmp_path: Path) -> None:
    fault = 'faults=[{use="sensor", failure="off", channels=["neighbours"], at=3, robots=[1]}]'
    run = made(NEAR, RING, fault, "stop.iterations=6")
    with run.recorder(tmp_path / "recording.h5") as recorder:
        moments = []
        run.simulation.run([recorder, type("Keep", (), {"sample": lambda self, one: moments.append(one)})()])
    recording = Recording(tmp_path)
    counts = recording["neighbours_count"]
    assert (counts[:3, 1] == counts[:3].max(axis=1)).all()
    assert counts[3:, 1].tolist() == [0, 0, 0]
    assert np.isnan(recording["neighbours"][3:, 1]).all()
    assert (recording["tiles"][3:, 1] > 0).any()
    arrays = moments[0].readings.arrays()
    assert len(arrays) == 4
    assert hashed(*arrays) != hashed(*arrays[:2])
    frame = columns_of(recording, "neighbours")
    assert list(frame) == ["iteration", "time (s)", "robot", "row", "range (m)", "bearing (rad)", "heading (rad)"]
    assert len(frame["robot"]) == counts.sum()
    with pytest.raises(InputError, match=r"'evidence' is not recorded; .*known: .*neighbours"):
        columns_of(recording, "evidence")
    assert [channel.name for channel in recording.channels][-2:] == ["neighbours", "neighbours_count"]


MIND = """
class Mine:
    requires = ("neighbours",)
    recorded = ("nearest", "rows", "corner")

    def hear(self, me):
        self.rows = len(me.neighbours)
        self.nearest = me.readings.neighbours[0][0] if self.rows else -1.0
        self.corner = 0.0 if me.tile is None else 1.0
        try:
            me.neighbors
        except AttributeError as problem:
            assert "has no attribute 'neighbors'" in str(problem)
            assert "neighbours" in dir(me)
        else:
            raise AssertionError

    def step(self, me):
        pass
"""


def test_a_mind_of_ones_own_finds_them_by_name(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(MIND)
    own = f'{{use="{tmp_path}/mine.py:Mine"}}'
    tasks = ('task={use="travelled", distance=9.0}', "stop.iterations=4", f"mind={own}")
    with registry.own_code(True):
        moments = moments_of(made(NEAR, RING, *tasks))
        for moment in moments:
            count, found = moment.readings["neighbours_count"], moment.readings["neighbours"][:, 0, 0]
            assert (moment.knowledge.shown["rows"] == count).all()
            assert (moment.knowledge.shown["nearest"] == np.where(count > 0, found, -1.0)).all()
        assert count.any()
        with pytest.raises(InputError, match=r"needs 'neighbours' from the sensors.* give tiles; expected .*'nei"):
            made(RING, *tasks)


def test_stuck_and_noisy_strike_numbers_alone_and_leave_structure() -> None:
    ranges = 'sensor={use="ir-ring", ranges=true}'
    plain = moments_of(made(NEAR, ranges, "stop.iterations=6"))
    stuck, noisy = (
        moments_of(made(NEAR, ranges, f"faults=[{{use='sensor', at=2, robots=[1], {keys}}}]", "stop.iterations=6"))
        for keys in ("failure='stuck', channels=['neighbours', 'ranges']", "failure='noisy', sigma=0.1")
    )
    for name in ("neighbours", "neighbours_count", "ranges"):
        for moment in stuck[2:]:
            np.testing.assert_array_equal(moment.readings[name][1], stuck[2].readings[name][1])
    one, other = plain[2].readings, noisy[2].readings
    for name in ("tiles.values", "tiles.origins", "neighbours_count"):
        np.testing.assert_array_equal(one[name], other[name])
    for name in ("neighbours", "ranges"):
        np.testing.assert_array_equal(one[name][[0, 2]], other[name][[0, 2]])
        was, now = one[name][1], other[name][1]
        np.testing.assert_array_equal(np.isfinite(was), np.isfinite(now))
        assert (was != now)[np.isfinite(was)].any()


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ("failure='off', channels=['echo']", r"faults\[0\]\.channels: .* no channel 'echo'; they have tiles"),
        ("failure='off', channels=['neighbours_count']", "'neighbours_count' cannot be off; expected what is measured"),
        ("failure='off', channels=['tiles.origins']", r"'tiles\.origins' cannot be off"),
        ("failure='noisy', sigma=0.1, channels=['tiles']", "'tiles' cannot be noisy; .*: neighbours$"),
        ("failure='stuck', channels=['tiles']", "'tiles' cannot be stuck"),
        ("failure='stuck', value='free', channels=['neighbours']", "channels: a sensor that has a value has none"),
        ("failure='garbage', channels=['tiles']", "channels: a sensor that is 'garbage' has none"),
        ("failure='noisy'", "sigma: required key is missing"),
    ],
)
def test_a_failure_that_a_channel_cannot_have_is_refused(keys: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        made(NEAR, RING, f"faults=[{{use='sensor', at=1, {keys}}}]")


def test_noise_without_numbers_is_refused() -> None:
    with pytest.raises(InputError, match=r"none of what these robots measure is a number \(tiles\)"):
        made("faults=[{use='sensor', failure='noisy', sigma=0.1, at=1}]")


def test_dead_beams_keep_their_columns() -> None:
    dead = "faults=[{use='sensor', failure='beams', beams=[0, 5], at=1, robots=[1]}]"
    ranges = 'sensor={use="ir-ring", ranges=true}'
    (_, plain), (_, maimed) = (moments_of(made(ranges, "stop.iterations=2", *more)) for more in ((), (dead,)))
    left = np.delete(np.arange(72), [0, 5])
    assert np.isnan(maimed.readings["ranges"][1, [0, 5]]).all()
    np.testing.assert_array_equal(maimed.readings["ranges"][1, left], plain.readings["ranges"][1, left])
    np.testing.assert_array_equal(maimed.readings["ranges"][[0, 2]], plain.readings["ranges"][[0, 2]])


# Several sensors, and groups


def test_two_sensors_of_one_kind_need_names_and_err_differently() -> None:
    two = 'sensors=[{use="ir-ring", preset="gternal", ranges=true}, {use="ir-ring", preset="gternal", ranges=true%s}]'
    with pytest.raises(InputError, match=r"sensors\[1\]\.name: gives 'tiles', as sensors\[0\] does; expected a name"):
        made(two % "")
    (moment,) = moments_of(made(two % ', name="rear"', "stop.iterations=1"))
    assert [channel.name for channel in moment.readings.channels][3:6] == [
        "ranges",
        "rear_tiles.values",
        "rear_tiles.origins",
    ]
    assert (moment.readings["ranges"] != moment.readings["rear_ranges"]).any()
    with pytest.raises(InputError, match=r"sensors\[1\]\.name"):
        made(two % ', name="Rear"')


def groups(*sensors: str) -> str:
    return f"robots=[{', '.join(f'{{count={i + 1}, {one}}}' for i, one in enumerate(sensors))}]"


WANDER = ('mind={computation={use="reactive"}, strategy={use="wander"}}', 'task={use="travelled", distance=1.0}')


def test_groups_with_equal_rings_wander_and_unequal_ones_are_refused() -> None:
    same = 'sensor={use="ir-ring", ranges=true, tile=[%d, 5]}'
    moments = moments_of(made(groups(same % 4, same % 6), *WANDER, "stop.iterations=3"))
    assert moments[0].readings["ranges"].shape == (3, 72)
    assert moments[0].readings.tiles.values.shape == (3, 6, 5)
    with pytest.raises(InputError, match=r"'wander' needs 'ranges'.*groups .* different ones \(ranges\.0, ranges\.1\)"):
        made(groups("sensor={ranges=true}", "sensor={ranges=true, reach=0.7}"), *WANDER)
    with pytest.raises(InputError, match=r"'wander' needs 'ranges'.*'ir-ring' with ranges = true"):
        made(*WANDER)


def test_what_one_group_alone_has_is_blank_for_the_others_and_found_by_its_own_name(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text("""
class Mine:
    recorded = ("rows",)

    def hear(self, me):
        self.rows = len(me.readings.neighbours) if me.id else -hasattr(me, "neighbours") - 1

    def step(self, me):
        pass
""")
    of = groups('sensor={use="none"}', 'sensors=[{use="neighbours", reach=9.0}]')
    with registry.own_code(True):
        run = made(of, f'mind={{use="{tmp_path}/mine.py:Mine"}}', 'task={use="travelled", distance=9.0}',
                   "stop.iterations=3")  # fmt: skip
        with run.recorder(tmp_path / "recording.h5") as recorder:
            run.simulation.run([recorder])
    recording = Recording(tmp_path)
    counts, found = recording["neighbours_count.1"], recording["neighbours.1"]
    assert counts[:, 0].tolist() == [0, 0, 0]
    assert np.isnan(found[:, 0]).all()
    assert counts[:, 1:].max() > 0
    np.testing.assert_array_equal(recording["rows"][:, 1:], counts[:, 1:])
    assert (recording["rows"][:, 0] == -1).all()
    assert set(columns_of(recording, "neighbours.1")["robot"].tolist()) <= {1, 2}


def test_evidence_of_mixed_tiles_is_there_whatever_is_measured() -> None:
    ideal, erring = ({"use": "ir-ring", "tile": size} for size in ([4, 5], [6, 7]))
    context = setting_of(2, shape=(40, 40))
    sensors = [convert({k: v for k, v in {**one, **more}.items() if k != "use"}, registry.find("sensor", "ir-ring"))
               for one, more in ((ideal, {}), (erring, {"preset": "gternal"}))]  # fmt: skip
    mixed = MixedSensor([(one.build(context), np.array([i])) for i, one in enumerate(sensors)])
    names = ["tiles.values", "tiles.origins", "tiles.evidence"]
    assert [channel.name for channel in mixed.channels] == names
    found = mixed.sense(state_of([[3.0, 3.0, 0.0], [2.0, 2.0, 0.0]], [True, False])).tiles
    assert found.values.shape == (2, 6, 7)
    assert np.isnan(found.evidence[0]).all()
    assert found.origins[0].tolist() == [17, 17]  # its own begins at 18, 18


# Frames


def test_what_lies_in_the_world_moves_rigidly_with_its_robot_and_the_rest_by_cells_or_not_at_all() -> None:
    context = setting_of(2, shape=(99, 99))
    lattice = context.lattice
    channels = Channels(
        Channel("place", shape=(2,), frame="world"), Channel("poses", shape=(4, 3), frame="world"),
        Channel("heading", frame="world"), Channel("cell", "i4", (2,), frame="cells", structure=True), Channel("own"),
    )  # fmt: skip
    pose = np.array([[5.0, 5.0, 0.0], [7.0, 3.0, 1.0]])
    believed = pose + np.array([[0.5, -0.4, 0.5 * np.pi], [0.0, 0.0, 0.0]])
    place = pose[:, :2] + [1.0, 0.0]
    poses = np.repeat(np.column_stack([place, np.zeros(2)])[:, None], 4, axis=1)
    columns = (place, poses, np.array([0.1, 0.2]), lattice.cells(place).astype(np.int32), np.array([4.0, 5.0]))
    put = Readings(channels, columns).put(pose, believed, lattice)
    np.testing.assert_allclose(put["place"][0], [5.5, 5.6])
    np.testing.assert_allclose(put["poses"][0], [[5.5, 5.6, 0.5 * np.pi]] * 4)
    assert put["heading"][0] == pytest.approx(0.1 + 0.5 * np.pi)
    assert (put["cell"] - columns[3]).tolist() == (lattice.cells(believed[:, :2]) - lattice.cells(pose[:, :2])).tolist()
    assert put["cell"].dtype == np.int32
    np.testing.assert_array_equal(put["own"], columns[4])
    np.testing.assert_allclose(put["place"][1], place[1])
    assert Readings(channels, columns).put(pose, pose, lattice).columns is columns


def test_stacked_errors_of_localisation_move_tiles_once_by_the_sum_of_their_cells() -> None:
    one, other = (f"{{use='localisation', failure='bias', at=0, {by}}}" for by in ("dx=0.4", "dy=-0.3"))
    two = f"faults=[{one}, {other}]"
    run = made('localisation={use="noisy", sigma=0.3}', two, "stop.iterations=4")
    for moment in moments_of(run):
        lattice, state = run.arena.lattice, moment.state
        aside = lattice.cells(moment.believed[:, :2]) - lattice.cells(state.pose[:, :2])
        sensed = run.simulation.parts.sensor.sense(state).tiles.origins
        np.testing.assert_array_equal(moment.readings.tiles.origins, sensed + aside)
        assert aside.any()


def test_a_localisation_of_ones_own_is_recorded_as_erring_and_steered_by(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text("""
from msgspec import Struct

class Mine(Struct, frozen=True):
    def build(self, context):
        return self

    def locate(self, state):
        return state.pose + [0.3, 0.0, 0.4]
""")
    with registry.own_code(True):
        run = made(f'localisation={{use="{tmp_path}/mine.py:Mine"}}', "stop.iterations=5")
        with run.recorder(tmp_path / "recording.h5") as recorder:
            run.simulation.run([recorder])
    recording = Recording(tmp_path)
    np.testing.assert_allclose(recording["believed"] - recording["pose"], np.tile([0.3, 0.0, 0.4], (5, 3, 1)))
    right = made("stop.iterations=5")
    right.simulation.run([])
    assert (right.simulation.state.pose[:, 2] != run.simulation.state.pose[:, 2]).any()


# Declarations


@pytest.mark.parametrize(
    ("channel", "words"),
    [
        (Channel("id"), "me.id is taken; expected 'my_id'"),
        (Channel("heard"), "me.heard is taken"),
        (Channel("own", table="pose"), "'pose' names a table of the recording's own"),
        (Channel("own", table="tiles"), "'tiles' is float64 of shape"),
        (Channel("../own"), "does not match|matching regex|pattern"),
        (Channel("own", "f2"), "Invalid enum value 'f2'"),
        (Channel("own", shape=(10**9,)), "<= 100000"),
        (Channel("own", shape=(10**5, 10**5)), "bytes an iteration; expected"),
        (Channel("own", low=2.0, high=1.0), "bounds"),
        (Channel("own", shape=(3,), axis=(1.0,)), "an axis of 1"),
        (Channel("own", shape=(3,), frame="cells"), "lies on cells; expected i4"),
        (Channel("own", shape=(4,), frame="world"), "lies in the world"),
        (Channel("own", shape=(4,), count="counts"), "is counted by 'counts'; expected a channel of type i4"),
        (Channel("own", group="mine"), "is in the group 'mine'; expected what tile_channels gives"),
        (Channel("ranges", shape=(4,)), "is the name of what beams or a field give"),
        (Channel("energy"), "'energy' is already recorded by the sensor"),
    ],
)
def test_a_declaration_that_cannot_be_is_refused_at_build(channel: Channel, words: str, tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(f"""
import numpy as np
from math import inf
from msgspec import Struct
from swarmsim.core.readings import Channel, Channels, Readings

class Mine(Struct, frozen=True):
    def build(self, context):
        return Sensing()

class Sensing:
    channels = Channels({channel!r})

    def sense(self, state):
        return Readings(self.channels, (np.zeros(state.robots),))

class Mind:
    recorded = ("energy",)
    energy = 0.0

    def step(self, me):
        pass
""")
    use = f'use="{tmp_path}/mine.py'
    with registry.own_code(True), pytest.raises(InputError, match=words):
        made(f'sensors=[{{{use}:Mine"}}]', f'mind={{{use}:Mind"}}', 'task={use="travelled", distance=9.0}')


def test_a_column_that_is_not_as_declared_ends_the_run(tmp_path: Path) -> None:
    from swarmsim.engine import contracts

    channels = Channels(*ragged("own", 2, ("a",), "m", 0.0, 1.0))
    state = state_of(np.zeros((3, 3)))
    good = tuple(channel.blanks(3) for channel in channels)
    assert contracts.readings(Readings(channels, good), state, channels) is None
    for place, wrong, words in (
        (0, np.full((3, 2, 1), 2.0), r"own: 2.0 at [0, 0, 0]; expected 0 to 1"),
        (0, np.zeros((3, 3, 1)), "own: float64 of shape (3, 3, 1); expected float64 of shape (3, 2, 1)"),
        (1, np.array([0, 3, 0], np.int32), "own_count: 3 at [1]; expected 0 to 2"),
        (1, np.zeros(3), "own_count: float64 of shape (3,); expected int32"),
    ):
        columns = tuple(wrong if i == place else one for i, one in enumerate(good))
        assert words in contracts.readings(Readings(channels, columns), state, channels)


def test_declarations_come_back_from_their_text() -> None:
    ring = range_channel(np.array([0.0, 1.5]), 2.0)
    channels = Channels(*tile_channels((6, 7), True), ring, Channel("field", table="samples"), Channel("a", "?", (4,)))
    assert declarations.read(declarations.text_of(channels), 3) == channels
    assert math.isinf(declarations.read(declarations.text_of(channels), 3)["ranges"].empty)


@pytest.mark.parametrize(
    "text",
    [
        '{"name": "a"}', '[{"name": "a", "dtype": "O"}]', '[{"name": "../a"}]', '[{"name": "a", "table": "a/b"}]',
        '[{"name": "a", "table": "pose"}]', '[{"name": "a", "shape": [99999, 99999]}]', '[{"name": "a", "x": 1}]',
        "[" * 100_000, "[]]", '[{"name": "a"}, {"name": "a"}]', '[{"name": "a", "table": "b"}, {"name": "b"}]',
        f"[{', '.join(['{}'] * 201)}]", '[{"name": "lost"}]', '[{"name": "a", "table": "b_end"}]',
    ],
)  # fmt: skip
def test_a_strangers_declaration_is_refused(text: str, room: Path, tmp_path: Path) -> None:
    (tmp_path / "recording.h5").write_bytes(room.read_bytes())
    with h5py.File(tmp_path / "recording.h5", "r+") as file:
        del file.attrs["channels"]
        file.attrs["channels"] = np.bytes_(text.encode())
    with pytest.raises(InputError, match="not a whole recording"):
        Recording(tmp_path)


def test_recordings_without_declarations_are_read_as_before(room: Path, tmp_path: Path) -> None:
    (tmp_path / "recording.h5").write_bytes(room.read_bytes())
    with h5py.File(tmp_path / "recording.h5", "r+") as file:
        del file.attrs["channels"]
    assert Recording(tmp_path)["tiles"].shape[1:] == (3, 6, 7)


def test_numbers_beyond_what_is_declared_are_found_when_they_are_read(tmp_path: Path) -> None:
    run = made(NEAR, RING, "stop.iterations=3")
    with run.recorder(tmp_path / "recording.h5") as recorder:
        run.simulation.run([recorder])
    with h5py.File(tmp_path / "recording.h5", "r+") as file:
        file["neighbours_count"][1, 1] = 99
    recording = Recording(tmp_path)
    assert recording["neighbours"].shape[0] == 3
    with pytest.raises(InputError, match="'neighbours_count' has invalid numbers"):
        recording["neighbours_count"]


# Others


def test_locality_checks_keep_every_column() -> None:
    ring = 'sensor={use="ir-ring", preset="gternal", ranges=true}'
    (moment,) = moments_of(made(NEAR, ring, "stop.iterations=1"))
    seen_by = type("Seen", (), {})
    from swarmsim.core.state import Senses

    senses = Senses(0, moment.state.pose, moment.state.velocity, moment.state.alive, moment.readings)
    rows = np.array([2, 0, 1])
    for one, other in zip(chosen(senses, rows).readings.columns, moment.readings.columns, strict=True):
        np.testing.assert_array_equal(one, other[rows])
    assert len(moment.readings.columns) == 6
    assert seen_by


def test_a_suite_gives_what_its_sensors_give_alone() -> None:
    context = setting_of(3)
    near, bump = convert({"reach": 5.0}, Neighbours).build(context), convert({}, Bump).build(context)
    state = state_of([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [1.0, 1.0, 0.0]])
    suite = Suite([near, bump], ["", "front"]).sense(state)
    np.testing.assert_array_equal(suite["neighbours"], near.sense(state)["neighbours"])
    np.testing.assert_array_equal(suite["front_bump"], bump.sense(state)["bump"])
    with pytest.raises(InputError, match="no channel 'bump'; they have neighbours, neighbours_count, front_bump"):
        suite["bump"]
    assert replace(suite).channels is suite.channels


def test_the_sensor_on_the_page_is_recorded_struck_and_seen(tmp_path: Path, root: Path) -> None:
    listing = (root / "docs" / "sensors.md").read_text().split("```python\n")[1].split("```")[0]
    (tmp_path / "light.py").write_text(listing)
    (tmp_path / "mind.py").write_text("""
class Mine:
    requires = ("light",)
    recorded = ("left",)

    def hear(self, me):
        self.left = me.light[0]

    def step(self, me):
        pass
""")
    with registry.own_code(True):
        run = made(
            f'sensors=[{{use="{tmp_path}/light.py:Light"}}]', f'mind={{use="{tmp_path}/mind.py:Mine"}}',
            'task={use="travelled", distance=9.0}', "stop.iterations=4",
            'faults=[{use="sensor", failure="off", channels=["light"], at=2, robots=[1]}]',
        )  # fmt: skip
        with run.recorder(tmp_path / "recording.h5") as recorder:
            run.simulation.run([recorder])
    recording = Recording(tmp_path)
    light = recording["light"]
    assert np.isnan(light[2:, 1]).all()
    assert np.isfinite(light[:, [0, 2]]).all()
    np.testing.assert_array_equal(recording["left"], light[:, :, 0])
    assert list(columns_of(recording, "light"))[3:] == ["left", "right"]
