"""Throughput of robots that share the air, beside the closed forms: prints a table and draws the page's figure."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from swarmsim.core.building import Building, Survey
from swarmsim.core.context import BuildContext
from swarmsim.core.lattice import Lattice
from swarmsim.core.scenario.part import Part
from swarmsim.core.scenario.robots import Robots
from swarmsim.core.state import State
from swarmsim.core.streams import Streams

ROBOTS, BYTES, ITERATIONS = 200, 20, 400
LOADS = (0.05, 0.1, 0.2, 0.35, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0)
FORMS = {
    "aloha": ("pure ALOHA", lambda load: load * math.exp(-2.0 * load), "#0072b2", "o"),
    "slotted": ("slotted ALOHA", lambda load: load * math.exp(-load), "#e69f00", "s"),
    "csma": ("listening first, no retries", lambda load: load / (1.0 + load), "#009e73", "^"),
}


def heard(access: str, load: float) -> tuple[float, float]:
    """The share of time with a frame that is received, and half the width of its 95 % interval over iterations."""
    nothing = np.empty((0, 4))
    survey = Survey(nothing, np.zeros((4, 8), np.bool_), np.empty((0, 2)), lambda: np.zeros((4, 8), np.bool_))
    context = BuildContext.of(
        Robots(count=ROBOTS, spawn="room"),
        Lattice(0.0, 0.0, 1.0, 4, 8),
        1.0,
        Streams(1),
        Building(survey, lambda _: survey),
    )
    rate = BYTES * ROBOTS / load
    table = {"use": "contention", "bytes_per_second": rate, "access": access, "retries": 0}
    channel = Part("channel", table).build(context)
    links = np.array([((robot + 1) % ROBOTS, robot) for robot in range(ROBOTS)], np.int32)
    links = links[np.lexsort((links[:, 1], links[:, 0]))]
    sizes, pose = np.full(ROBOTS, BYTES, np.int32), np.zeros((ROBOTS, 3))
    shares = []
    for t in range(ITERATIONS):
        state = State(t, pose, np.zeros_like(pose), np.zeros((ROBOTS, 2)), np.ones(ROBOTS, np.bool_))
        shares.append(load * len(channel.deliver(state, links, sizes).heard) / ROBOTS)
    return float(np.mean(shares)), 1.96 * float(np.std(shares, ddof=1)) / math.sqrt(ITERATIONS)


def main() -> None:
    figure = Figure(figsize=(6.4, 3.8), layout="constrained")
    axes = figure.subplots()
    worst = 0.0
    dense = np.linspace(0.01, max(LOADS), 300)
    print(f"{'load':>5}", *(f"{access:>24}" for access in FORMS))
    found = {access: [heard(access, load) for load in LOADS] for access in FORMS}
    for number, load in enumerate(LOADS):
        cells = []
        for access, (_, form, _, _) in FORMS.items():
            share, half = found[access][number]
            worst = max(worst, abs(share - form(load)))
            cells.append(f"{share:.4f} +- {half:.4f} ({form(load):.4f})")
        print(f"{load:5.2f}", *(f"{cell:>24}" for cell in cells))
    print(f"largest difference {worst:.4f} of the time")
    for access, (name, form, colour, marker) in FORMS.items():
        axes.plot(dense, [form(load) for load in dense], color=colour, linewidth=1.5)
        axes.plot(LOADS, [share for share, _ in found[access]], marker, color=colour, label=name, markersize=5)
    axes.set_xlabel("load G: frames begun in the time of one")
    axes.set_ylabel("share of the time with a frame received")
    axes.set_xlim(0.0, max(LOADS) + 0.1)
    axes.set_ylim(0.0)
    axes.grid(alpha=0.3)
    axes.legend(frameon=False)
    figure.savefig(Path(__file__).parents[2] / "docs/figures/contention.png", dpi=150)


if __name__ == "__main__":
    main()
