"""Exports for robotics viewers, read back by the formats' own libraries: poses and grids are the recording's."""

from __future__ import annotations

import json
import math
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
import shapely
from conftest import called
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from swarmsim.operations.mapping.replay import MapReplay
from swarmsim.recording.reader import Recording
from swarmsim.view.layers.known import SEEN
from swarmsim.view.scene import Scene
from swarmsim.view.theme import DARK
from swarmsim.view.viewers.foxglove import write_mcap


@pytest.fixture(scope="module")
def recording(room: Path) -> Recording:
    return Recording(room)


def newest(messages: list[tuple[int, object]], row: int, recording: Recording) -> Any:
    """What a topic holds in an iteration: the newest of its messages."""
    return [message for time, message in messages if time <= round(1e9 * row * recording.scenario.period)][-1]


def test_mcap_holds_what_was_recorded(recording: Recording, tmp_path: Path) -> None:
    write_mcap(recording, tmp_path / "run.mcap")
    found: dict[str, list[tuple[int, object]]] = {}
    numbers = []
    with (tmp_path / "run.mcap").open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            if channel.topic == "/numbers":
                numbers.append(json.loads(message.data))
            else:
                assert schema is not None
                assert schema.name.startswith("foxglove.")
    with (tmp_path / "run.mcap").open("rb") as file:
        for decoded in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages(
            topics=[
                "/tf",
                "/poses",
                "/map/known",
                "/robot_1/map/own",
                "/links",
                "/building/still",
                "/robots",
                "/events",
            ]
        ):
            found.setdefault(decoded.channel.topic, []).append((decoded.message.log_time, decoded.decoded_message))
    rows = range(recording.iterations)
    assert [time for time, _ in found["/poses"]] == [round(1e9 * row * recording.scenario.period) for row in rows]
    replay = MapReplay(recording)
    for row in rows:
        replay.advance(row)
        pose = recording["pose"][row]
        poses = found["/poses"][row][1].poses
        assert [(p.position.x, p.position.y) for p in poses] == [(x, y) for x, y, _ in pose.tolist()]
        for transform, (x, y, yaw) in zip(found["/tf"][row][1].transforms, pose.tolist(), strict=True):
            assert (transform.parent_frame_id, transform.translation.x, transform.translation.y) == ("world", x, y)
            turned = 2.0 * math.atan2(transform.rotation.z, transform.rotation.w)
            assert math.remainder(turned - yaw, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-9)
        grid = newest(found["/map/known"], row, recording)
        cells = np.frombuffer(grid.data, np.uint8).reshape(-1, grid.column_count, 5)
        known = np.where(replay.held_occupied > 0, SEEN, replay.known)
        assert np.array_equal(cells[:, :, 0], known)
        assert {tuple(colour) for colour in cells[known == SEEN][:, 1:].tolist()} <= {(*DARK.seen, 255)}
        assert (grid.pose.position.x, grid.cell_size.x) == (recording.lattice.x0, recording.lattice.cell)
        heard, lost = Scene(recording).messages(row) if row % 20 == 0 else (numbers[row]["heard"], numbers[row]["lost"])
        assert numbers[row] == {"coverage": 100.0 * recording["coverage"][row], "heard": heard, "lost": lost}
        ends = [len(line.points) for line in newest(found["/links"], row, recording).entities[0].lines]
        shot = Scene(recording).at(row)
        assert sum(ends) == 2 * (len(shot.mutual) + len(shot.one_way))
        discs = newest(found["/robots"], row, recording).entities[0].cylinders
        assert [(disc.pose.position.x, disc.pose.position.y) for disc in discs] == [(x, y) for x, y, _ in pose.tolist()]
    last = np.frombuffer(found["/robot_1/map/own"][-1][1].data, np.uint8)[::5]
    assert np.array_equal(last, replay.maps[1].ravel())
    layers = Scene(recording).layers.values()
    corners = sum(len(shapely.get_coordinates(layer)) for layer in layers)
    assert sum(len(line.points) for line in found["/building/still"][0][1].entities[0].lines) > corners
    assert found["/events"][-1][1].message == "finished: 100 % coverage reached"


def test_rerun_holds_what_was_recorded(recording: Recording, tmp_path: Path) -> None:
    from rerun.chunk import RrdReader

    from swarmsim.view.viewers.rerun import write_rrd

    write_rrd(recording, tmp_path / "run.rrd")
    places, maps = {}, {}
    for chunk in RrdReader(tmp_path / "run.rrd").stream():
        if chunk.entity_path not in ("/world/robots/robot", "/world/map/known"):
            continue
        table = pa.Table.from_batches([chunk.to_record_batch()])
        name = next(name for name in table.column_names if name.endswith((":positions", ":data")))
        kept = places if chunk.entity_path == "/world/robots/robot" else maps
        kept |= dict(zip(table["iteration"].to_pylist(), table[name].to_pylist(), strict=True))
    assert sorted(places) == list(range(recording.iterations))
    replay, shape = MapReplay(recording), recording.lattice.shape
    for row in range(recording.iterations):
        replay.advance(row)
        assert np.array(places[row]) == pytest.approx(recording["pose"][row][:, :2] * (1.0, -1.0), abs=1e-5)
        (data,) = maps.get(row, maps[max(at for at in maps if at <= row)])
        opaque = np.array(data, np.uint8).reshape(*shape, 4)[::-1, :, 3]
        assert np.array_equal(opaque > 0, replay.known > 0)


def test_the_verb_writes_whole_files_and_names_what_is_wrong(recording: Recording, tmp_path: Path) -> None:
    def export(*arguments: object) -> subprocess.CompletedProcess[str]:
        return called("export", recording.path, *arguments, cwd=tmp_path)

    done = export("--mcap", "a.mcap", "--rerun", "a.rrd", "--map", "a.yaml", "--quiet")
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.mcap", "a.pgm", "a.rrd", "a.yaml"]
    for arguments, words in ((("--mcap", "a.bag"), "ends in .mcap"), ((), "nothing to write; name a file with --map")):
        done = export(*arguments)
        assert done.returncode == 2
        assert words in done.stderr
