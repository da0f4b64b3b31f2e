"""Every shipped scenario repeats to the last bit, and its request is unchanged.

Digests are from one machine. Some depend on the versions only, since no function in them depends on the processor. The
others are compared on equal processors.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import threadpoolctl
from conftest import ROOT, made
from typer.testing import CliRunner

from swarmsim.cli import app
from swarmsim.core.scenario.decoding import convert
from swarmsim.core.scenario.file import load
from swarmsim.core.scenario.toml import read_toml
from swarmsim.core.streams import Streams
from swarmsim.recording.digests import Digests, versions
from swarmsim.recording.reader import Recording
from swarmsim.recording.recorder import text_of
from swarmsim.studies.plan import Study, changed, changes_of
from swarmsim.studies.requests import asked

SCENARIOS = sorted(
    str(path.relative_to(ROOT / "scenarios").with_suffix(""))
    for folder in ("", "faults", "operations", "worlds")
    for path in (ROOT / "scenarios" / folder).glob("*.toml")
)
STUDIES = sorted((ROOT / "scenarios" / "studies").rglob("*.toml"))
GOLDEN = Path(__file__).parent / "golden.json"  # iterations and digest of each; rewritten by make golden
BEGUN = 100  # iterations that are verified of a run whose digest is known
TEXTS = Path(__file__).parent / "golden_texts.json"  # scenarios as recordings and studies keep them


def machine() -> dict[str, str]:
    """What digests depend on: versions, and the processor types for which numpy and BLAS choose functions."""
    simd = " ".join(np.show_config(mode="dicts")["SIMD Extensions"]["found"])
    cores = [f"{one['internal_api']} {one.get('architecture', '')}" for one in threadpoolctl.threadpool_info()]
    return {**versions(), "simd": simd, "algebra": ", ".join(sorted(set(cores)))}


def is_comparable(name: str, golden: dict[str, Any]) -> bool:
    """Whether a scenario's digest must be the same here."""
    here, there = machine(), golden["machine"]
    if name not in golden["processor"]:
        here |= {key: there[key] for key in ("simd", "algebra")}
    return here == there


def text_of_scenario(name: str) -> str:
    path = ROOT / "scenarios" / f"{name}.toml"
    return text_of(load(path)).replace(str(ROOT), "")


def asked_by(path: Path) -> str:
    """A hash of the requests of a study's conditions."""
    study = convert(read_toml(path, "a study"), Study)
    base = path.parent / study.scenario
    table, asks = read_toml(base, "a scenario"), hashlib.blake2b(digest_size=16)
    for change in changes_of(path, study).values():
        asks.update(asked(changed(str(path), table, {**study.set, **change}, base.parent)))
    return asks.hexdigest()


def recorded(name: str, folder: Path, *overrides: str) -> Recording:
    folder.mkdir(exist_ok=True)
    run = made(*overrides, scenario=name)
    with run.recorder(folder / "recording.h5") as recorder:
        run.simulation.run([recorder])
    return Recording(folder)


def verified(folder: Path) -> tuple[int, str]:
    done = CliRunner().invoke(app, ["verify", str(folder)])
    return done.exit_code, done.output


def is_verified(folder: Path, recording: Recording) -> None:
    code, told = verified(folder)
    assert code == 0, told
    assert f"equal in all {recording.iterations} iterations, digest {recording.digest()}" in " ".join(told.split())


#: What takes some seconds more than the others.
DEAR = {
    "merging", "faults/doors-close", "faults/doors-close-remembered", "faults/drift", "operations/moving-field",
}  # fmt: skip


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.thorough] if name in DEAR else []) for name in SCENARIOS]
)
def test_verify_passes_and_runs_are_what_they_were(name: str, tmp_path: Path) -> None:
    """Where processors make digests differ, whole runs are verified, and take about as many iterations."""
    whole, begun = tmp_path / "whole", tmp_path / "begun"
    recording, golden = recorded(name, whole), json.loads(GOLDEN.read_text())
    assert recording.scenario == made(scenario=name).scenario
    known = is_comparable(name, golden)
    if known:
        assert [recording.iterations, recording.digest()] == golden["runs"][name]
    if known and recording.iterations > BEGUN:
        is_verified(begun, recorded(name, begun, f"stop.iterations={BEGUN}"))
    else:
        is_verified(whole, recording)
    assert 0.5 < recording.iterations / golden["runs"][name][0] < 2.0


def test_every_scenario_has_its_digests() -> None:
    golden = json.loads(GOLDEN.read_text())
    assert set(golden["runs"]) == set(SCENARIOS) > set(golden["processor"])


@pytest.mark.parametrize("name", SCENARIOS)
def test_recordings_keep_the_same_text_of_a_scenario(name: str) -> None:
    assert text_of_scenario(name) == json.loads(TEXTS.read_text())["scenarios"][name]


@pytest.mark.parametrize("path", STUDIES, ids=lambda path: path.stem)
def test_studies_ask_for_what_they_asked_for(path: Path) -> None:
    """Otherwise stores would lose a study's rows."""
    assert asked_by(path) == json.loads(TEXTS.read_text())["studies"][str(path.relative_to(ROOT))]


def test_random_numbers_that_depend_on_the_order_of_parts_are_caught(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One stream for all parts, in the order of their requests: one more request shifts all draws."""
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
    """Record the current runs, and the requests of scenarios and studies."""
    runs = {}
    for name in SCENARIOS:
        run, digests = made(scenario=name), Digests()
        run.simulation.run([digests])
        runs[name] = [run.simulation.state.iteration, digests.total()]
    processor = json.loads(GOLDEN.read_text())["processor"]
    GOLDEN.write_text(json.dumps({"machine": machine(), "processor": processor, "runs": runs}, indent=1) + "\n")
    scenarios = {name: text_of_scenario(name) for name in SCENARIOS}
    studies = {str(path.relative_to(ROOT)): asked_by(path) for path in STUDIES}
    TEXTS.write_text(json.dumps({"scenarios": scenarios, "studies": studies}, indent=1) + "\n")


if __name__ == "__main__":
    main()
