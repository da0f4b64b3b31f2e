"""W(N) through swarmsim's own tick, beside an obvious first loop and other simulators."""

from __future__ import annotations

import os
import subprocess
import time
from pathlib import Path

import numpy as np
import obvious
import pytest
import workload
from conftest import ROOT, Figures

from swarmsim.core.scenario.file import load
from swarmsim.engine.build import BuiltRun, build

SIZES = (20, 100, 500, 1000, 2000, 5000)
ROUNDS = 3
WORK = 100_000  # robot-steps in a round
PEERS = {"IR-SIM 2.12": "irsim", "VMAS 1.5": "vmas"}


def opened(folder: Path, robots: int, mapping: bool, steps: int) -> BuiltRun:
    path = workload.written(folder, robots, mapping, (ROUNDS + 1) * steps)
    return build(load(path), str(path))


def rates(run: BuiltRun, steps: int) -> list[float]:
    """Robot-steps per second of CPU time in each round but the first."""
    found = []
    simulation, count = run.simulation, run.scenario.robots.count
    for _ in range(ROUNDS + 1):
        begun = time.process_time()
        for _ in range(steps):
            simulation.tick()
        found.append(count * steps / (time.process_time() - begun))
    assert simulation.over
    assert run.astray() == []
    moved = np.hypot(*(simulation.state.pose - run.context.start)[:, :2].T)
    assert moved.mean() > 0.05  # m
    return found[1:]


@pytest.mark.bench
def test_robot_steps_per_second(tmp_path: Path, figures: Figures) -> None:
    found: dict[tuple[str, int], float] = {}
    for robots in SIZES:
        steps = max(20, WORK // robots)
        for mind, mapping in (("reactive", False), ("mapping", True)):
            found[mind, robots] = float(np.median(rates(opened(tmp_path, robots, mapping, steps), steps)))
        found["obvious", robots] = obvious.rate(robots, max(2, 4000 // robots)) if robots <= 1000 else np.nan
    asked = {"mapping": "200 000 up to 2000 robots", "reactive": "500 000 from 100 robots on"}
    for mind, words in asked.items():
        for robots in SIZES:
            figures.add("W(N), robot-steps per CPU second", f"{mind}, N = {robots}", found[mind, robots], "", words)
    for robots in SIZES[:4]:
        figures.add("W(N), robot-steps per CPU second", f"obvious loop, N = {robots}", found["obvious", robots])
    for mind, least in (("mapping", 10), ("reactive", 25)):
        for robots in SIZES[:4]:
            ratio = found[mind, robots] / found["obvious", robots]
            figures.add("W(N), times the obvious loop", f"{mind}, N = {robots}", ratio, "", f"{least}")
            assert ratio >= least
    for mind in asked:
        some = [found[mind, robots] for robots in SIZES[:5]]
        figures.add("Growth", f"W, {mind}: fastest over slowest, N = 20 to 2000", max(some) / min(some), "", "1.5")
        sizes = np.array([robots for robots in SIZES if robots >= 100], float)
        times = [robots / found[mind, robots] for robots in SIZES if robots >= 100]
        slope = np.polyfit(np.log(sizes), np.log(times), 1)[0]
        figures.add("Growth", f"W, {mind}: exponent of time against N, 100 to 5000", slope, "", "1.15")


@pytest.mark.bench
def test_growth_with_neighbours_beams_and_area(tmp_path: Path, figures: Figures) -> None:
    """Exponents of the time of an iteration against one thing that grows while all else stays."""

    def seconds(robots: int, overrides: list[str], area: float = 1.0, steps: int = 40) -> float:
        path = workload.written(tmp_path, robots, True, 2 * steps, area)
        run = build(load(path, overrides), str(path))
        for _ in range(steps):
            run.simulation.tick()
        begun = time.process_time()
        for _ in range(steps):
            run.simulation.tick()
        assert run.simulation.parts.task.curve.name == "coverage"
        return time.process_time() - begun

    def exponent(name: str, values: list[float], times: list[float]) -> None:
        figures.add("Growth", name, np.polyfit(np.log(values), np.log(times), 1)[0])

    ks = [2, 4, 8, 16, 32]
    exponent("500 robots: exponent against k, 2 to 32", ks, [seconds(500, [f"network.topology.k={k}"]) for k in ks])
    beams = [24, 48, 96, 192]
    exponent(
        "500 robots: exponent against beams, 24 to 192", beams, [seconds(500, [f"sensor.beams={b}"]) for b in beams]
    )
    areas = [1.0, 4.0, 16.0, 64.0]
    exponent("100 robots: exponent against area, 100 to 6400 m^2", areas, [seconds(100, [], a, 200) for a in areas])


@pytest.mark.bench
def test_opening_is_linear_in_cells(tmp_path: Path, figures: Figures) -> None:
    cells, times = [], []
    for area in (1.0, 4.0, 16.0):
        path = workload.written(tmp_path, 100, True, 1, 100 * area)
        begun = time.process_time()
        run = build(load(path), str(path))
        times.append(time.process_time() - begun)
        cells.append(run.arena.lattice.rows * run.arena.lattice.columns)
    figures.add(
        "Growth",
        "opening a world: exponent against cells, 0.25 to 4 million",
        np.polyfit(np.log(cells), np.log(times), 1)[0],
        "",
        "1",
    )
    figures.add("Growth", "opening a world of 4 million cells", times[-1], "s")


@pytest.mark.bench
@pytest.mark.parametrize("name", list(PEERS))
def test_beside_other_simulators(name: str, tmp_path: Path, figures: Figures) -> None:
    """The same work, as far as they allow; benchmarks/peers/README.md names the differences."""
    python = ROOT / f".venv-{PEERS[name]}" / "bin" / "python"
    if not python.exists():
        pytest.skip(f"no {python.parent.parent.name}: make bench-peers makes it")
    script = ROOT / "benchmarks" / "peers" / f"{PEERS[name]}_w.py"
    kinds = {"irsim": ["contact", "stop"], "vmas": ["1", "64"]}[PEERS[name]]
    for robots, steps in ((20, 100), (1000, 5)) if PEERS[name] == "irsim" else ((20, 10),):
        for kind in kinds:
            command = [str(python), str(script), str(robots), str(steps), kind]
            environment = {**os.environ, "OMP_NUM_THREADS": "1", "MPLBACKEND": "agg"}
            done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
            theirs = float(done.stdout.split()[-1])
            ours = float(np.median(rates(opened(tmp_path, robots, True, WORK // robots), WORK // robots)))
            word = {"1": "one arena", "64": "64 arenas at once"}.get(kind, f"collisions {kind!r}")
            figures.add(f"W(N) beside {name}", f"N = {robots}, {word}: theirs, robot-steps per CPU second", theirs)
            asked = {20: "100", 1000: "200"}[robots] if PEERS[name] == "irsim" else ""
            figures.add(
                f"W(N) beside {name}", f"N = {robots}, {word}: ours with mapping, times that", ours / theirs, "", asked
            )
