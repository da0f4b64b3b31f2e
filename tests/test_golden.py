"""Every shipped scenario repeats itself to the last bit, on this machine and on those whose digests are kept."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import threadpoolctl
from conftest import ROOT, made
from typer.testing import CliRunner

from swarmsim.cli import app
from swarmsim.core.streams import Streams
from swarmsim.recording.digests import Digests, versions
from swarmsim.recording.reader import Recording

SCENARIOS = sorted(
    str(path.relative_to(ROOT / "scenarios").with_suffix(""))
    for folder in ("", "faults", "operations", "worlds")
    for path in (ROOT / "scenarios" / folder).glob("*.toml")
)
GOLDEN = Path(__file__).parent / "golden.json"  # iterations and digest of each; made anew by make golden


def machine() -> dict[str, str]:
    """What digests depend on: versions, and the processors that numpy and its linear algebra choose functions for."""
    simd = " ".join(np.show_config(mode="dicts")["SIMD Extensions"]["found"])
    cores = [f"{one['internal_api']} {one.get('architecture', '')}" for one in threadpoolctl.threadpool_info()]
    return {**versions(), "simd": simd, "algebra": ", ".join(sorted(set(cores)))}


def recorded(name: str, folder: Path, *overrides: str) -> Recording:
    run = made(*overrides, scenario=name)
    with run.recorder(folder / "recording.h5") as recorder:
        run.simulation.run([recorder])
    return Recording(folder)


def verified(folder: Path) -> tuple[int, str]:
    done = CliRunner().invoke(app, ["verify", str(folder)])
    return done.exit_code, done.output


@pytest.mark.parametrize("name", SCENARIOS)
def test_verify_passes_and_runs_are_what_they_were(name: str, tmp_path: Path) -> None:
    """Elsewhere than on the machine of the digests, runs take about as long; floating point differs a little there."""
    recording = recorded(name, tmp_path)
    code, told = verified(tmp_path)
    assert code == 0, told
    assert f"equal in all {recording.iterations} iterations, digest {recording.digest()}" in " ".join(told.split())
    golden = json.loads(GOLDEN.read_text())
    if golden["machine"] == machine():
        assert [recording.iterations, recording.digest()] == golden["runs"][name]
    assert 0.5 < recording.iterations / golden["runs"][name][0] < 2.0


def test_every_scenario_has_its_digests() -> None:
    assert set(json.loads(GOLDEN.read_text())["runs"]) == set(SCENARIOS)


def test_random_numbers_that_depend_on_the_order_of_parts_are_caught(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One stream for everybody, in the order in which parts ask for theirs: one more asks, and all draws shift."""
    count = 0

    def in_order(self: Streams, purpose: str, robot: int = -1) -> np.random.Generator:
        nonlocal count
        count += 1
        return np.random.default_rng([self.seed, count])

    monkeypatch.setattr(Streams, "open", in_order)
    recorded("room", tmp_path, "stop.iterations=20")
    code, told = verified(tmp_path)
    assert code == 1
    assert "different: iteration 0, field 'pose'" in told


def test_who_looks_on_changes_nothing(tmp_path: Path) -> None:
    alone, watched = Digests(), Digests()
    made("stop.iterations=20").simulation.run([alone])
    run = made("stop.iterations=20")
    with run.recorder(tmp_path / "recording.h5") as recorder:
        run.simulation.run([recorder, watched])
    film = ["--video", str(tmp_path / "film.gif"), "--set", "stop.iterations=20", "--out", str(tmp_path / "run")]
    CliRunner().invoke(app, ["run", str(ROOT / "scenarios" / "room.toml"), *film])
    assert alone.total() == watched.total() == Recording(tmp_path).digest() == Recording(tmp_path / "run").digest()


def main() -> None:
    """Write down what runs are now."""
    runs = {}
    for name in SCENARIOS:
        run, digests = made(scenario=name), Digests()
        run.simulation.run([digests])
        runs[name] = [run.simulation.state.iteration, digests.total()]
    GOLDEN.write_text(json.dumps({"machine": machine(), "runs": runs}, indent=1) + "\n")


if __name__ == "__main__":
    main()
