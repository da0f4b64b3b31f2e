"""Exports for robotics viewers, read back by the formats' own libraries: poses and grids are the recording's."""

from __future__ import annotations

import json
import math
import subprocess
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
import shapely
from conftest import called
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from swarmsim.core.state import FREE, OCCUPIED, UNKNOWN
from swarmsim.operations.mapping.replay import MapReplay
from swarmsim.recording.reader import Recording
from swarmsim.view.scene import Scene
from swarmsim.view.viewers.foxglove import OWN_MAPS, write_mcap

VALUES = {UNKNOWN: 255, FREE: 0, OCCUPIED: 100}


@pytest.fixture(scope="module")
def recording(room: Path) -> Recording:
    return Recording(room)


def worth(cells: np.ndarray) -> np.ndarray:
    return np.vectorize(VALUES.get)(cells).astype(np.uint8)


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
            topics=["/tf", "/poses", "/map", "/robot_1/map", "/links", "/walls", "/robots", "/events"]
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
        grid = found["/map"][row][1]
        cells = np.frombuffer(grid.data, np.uint8).reshape(-1, grid.column_count)
        assert np.array_equal(cells, worth(replay.collective()))
        assert (grid.pose.position.x, grid.cell_size.x) == (recording.lattice.x0, recording.lattice.cell)
        heard, lost = Scene(recording).messages(row) if row % 20 == 0 else (numbers[row]["heard"], numbers[row]["lost"])
        assert numbers[row] == {"coverage": 100.0 * recording["coverage"][row], "heard": heard, "lost": lost}
        ends = found["/links"][row][1].entities[0].lines[0].points
        assert len(ends) == 2 * (recording.letters(row)[:, 4] == 0).sum()
    assert len(found["/robot_1/map"]) == -(-recording.iterations // OWN_MAPS) + (
        (recording.iterations - 1) % OWN_MAPS > 0
    )
    last = np.frombuffer(found["/robot_1/map"][-1][1].data, np.uint8)
    assert np.array_equal(last, worth(replay.maps[1]).ravel())
    layers = Scene(recording).layers.values()
    corners = sum(len(shapely.get_coordinates(layer)) for layer in layers)
    assert sum(len(line.points) for line in found["/walls"][0][1].entities[0].lines) == corners
    assert found["/events"][-1][1].message == "finished: 100 % coverage reached"


def test_rerun_holds_what_was_recorded(recording: Recording, tmp_path: Path) -> None:
    from rerun.chunk import RrdReader

    from swarmsim.view.viewers.rerun import write_rrd

    write_rrd(recording, tmp_path / "run.rrd")
    places, maps = {}, {}
    for chunk in RrdReader(tmp_path / "run.rrd").stream():
        if chunk.entity_path not in ("/world/robots", "/world/map"):
            continue
        table = pa.Table.from_batches([chunk.to_record_batch()])
        name = next(name for name in table.column_names if name.endswith((":positions", ":data")))
        kept = places if chunk.entity_path == "/world/robots" else maps
        kept |= dict(zip(table["iteration"].to_pylist(), table[name].to_pylist(), strict=True))
    assert sorted(places) == sorted(maps) == list(range(recording.iterations))
    replay = MapReplay(recording)
    for row in range(recording.iterations):
        replay.advance(row)
        assert np.array(places[row]) == pytest.approx(recording["pose"][row][:, :2] * (1.0, -1.0), abs=1e-5)
        (data,) = maps[row]
        shape = recording.lattice.shape
        assert np.array_equal(np.array(data, np.uint8).reshape(shape)[::-1], worth(replay.collective()))


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
