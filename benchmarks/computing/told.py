"""python benchmarks/computing/told.py table | crossing | figures OUT.jsonl [FOLDER]: what `ways.py run` found.

Runs count bytes, operations and iterations. Times on processors and energies are arithmetic from these, with the rates
below; those marked so are assumed.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from scipy import stats

mpl.use("Agg")
EVERY, LEVELS, SWEEPS, ROUNDS, CELLS = 20, 5, 16, 4, 2500
SHOWN = 1392  # values that 12 pieces show in a sweep, by `ways.py sweeps`
RADIO = 1e6  # bit/s, of which one robot at a time has all
#: Operations a second (assumed) and bytes of data memory: Espressif's and Raspberry Pi's product pages.
PROCESSORS = {"ESP32": (35e6, 320e3), "Pi Zero 2": (0.5e9, 512e6)}
#: J a byte sent and heard at 1 Mbit/s: 240 and 100 mA at 3.3 V (Espressif, ESP32 Series Datasheet, RF consumption).
SENT, HEARD = 240e-3 * 3.3 * 8e-6, 100e-3 * 3.3 * 8e-6
#: J an operation: 68 mA at 3.3 V (the same, both cores at 240 MHz), at the assumed rate.
OPERATION = 68e-3 * 3.3 / 35e6
DRIVING = 1.0  # W, assumed
VECTORS = 6 * 4  # bytes a cell: what conjugate gradients keep, in single precision
WAYS = (
    "alone",
    "replicated",
    "cloud, own piece",
    "cloud, field",
    "edge, own piece",
    "collective",
    "collective, migrating",
)
#: Conditions of six robots that figures show, with their names and the colours of Okabe and Ito.
LOSSES = {
    "6 robots": ("undisturbed", "#999999"),
    "6 robots, loss 0.3": ("30 % lost, not 10", "#f0e442"),
    "6 robots, jam": ("jam", "#cc79a7"),
    "6 robots, wall of silence": ("wall of silence", "#0072b2"),
    "6 robots, base dies": ("robot 0 dies", "#d55e00"),
}
Row = dict[str, Any]


def rows(path: Path) -> list[Row]:
    """The runs of a file, way by way."""
    return sorted(map(json.loads, path.read_text().splitlines()), key=lambda row: WAYS.index(row["way"]))


def groups(found: Sequence[Row]) -> Iterator[tuple[str, str, list[Row]]]:
    """The runs of each condition and way, in order."""
    for condition in dict.fromkeys(one["condition"] for one in found):
        for way in dict.fromkeys(one["way"] for one in found):
            mine = [one for one in found if (one["condition"], one["way"]) == (condition, way)]
            if mine:
                yield condition, way, mine


def robots(row: Row) -> int:
    """How many robots a run had."""
    return 6 if row["condition"].startswith("6 robots") else 12


def of_level(row: Row) -> float:
    """Operations that the busiest robot does for a level."""
    return float(row["most_work"]) / max(1.0, row["share"] * LEVELS)


def waited(row: Row) -> float:
    """Seconds for a level besides computing: until answers are there, or for all exchanges of halos."""
    if row["way"].startswith("collective"):
        return float(row["iterations"]) / LEVELS
    return float(row["age_own"]) - (EVERY - 1) / 2


def power(row: Row) -> float:
    """W of a robot for its radio and for computing, on average."""
    work = row["work"] / robots(row) / row["iterations"]
    return float(row["sent"] * SENT + row["heard"] * HEARD + work * OPERATION)


def level_time(processor: str) -> Callable[[Row], float]:
    """Seconds for a level on a processor, answers included."""
    rate = PROCESSORS[processor][0]
    return lambda row: of_level(row) / rate + waited(row)


MEASURES: dict[str, Callable[[Row], float]] = {
    "sent, B/s": lambda row: row["sent"],
    "heard, B/s": lambda row: row["heard"],
    "Mflop a level, all robots": lambda row: row["work"] / 1e6 / max(1.0, row["share"] * LEVELS),
    "busiest robot": lambda row: of_level(row) / 1e6,
    "a level on ESP32, s": level_time("ESP32"),
    "on Pi Zero 2, s": level_time("Pi Zero 2"),
    "age of own piece, s": lambda row: row["age_own"],
    "of the floor, s": lambda row: row.get("age_floor", np.nan),
    "error, own piece": lambda row: row.get("error_own", np.nan),
    "samples used": lambda row: row["used"],
    "radio and computing, mW": lambda row: 1e3 * power(row),
    "with driving, mW": lambda row: 1e3 * (power(row) + DRIVING),
    "levels known at the end, %": lambda row: 100.0 * row["share"],
}


def mean(values: Sequence[float]) -> tuple[float, float]:
    """The mean, and half of its 95 % interval (Student)."""
    if len(values) < 2:
        return float(values[0]), np.nan
    spread = float(np.std(values, ddof=1)) / np.sqrt(len(values))
    return float(np.mean(values)), float(stats.t.ppf(0.975, len(values) - 1)) * spread


def told(values: Sequence[float]) -> str:
    """A mean with its interval, in three digits."""
    middle, half = mean(values)
    if np.isnan(middle):
        return "-"
    return f"{middle:.4g}" + ("" if np.isnan(half) else f" ± {half:.2g}")


def table(found: Sequence[Row]) -> None:
    """A table for each condition, a way a row."""
    before = ""
    for condition, way, mine in groups(found):
        if condition != before:
            print(f"\n{condition}\n| way | n | " + " | ".join(MEASURES) + " | finished |")
            print("|---" * (len(MEASURES) + 3) + "|")
            before = condition
        columns = " | ".join(told([measure(row) for row in mine]) for measure in MEASURES.values())
        done = sum(row["finished"] for row in mine)
        print(f"| {way} | {len(mine)} | {columns} | {done} of {len(mine)} |")


def plain(found: Sequence[Row], way: str) -> list[Row]:
    """The undisturbed runs of a way."""
    return [row for row in found if row["condition"] == "plain" and row["way"] == way]


def waits(found: Sequence[Row]) -> float:
    """Exchanges for a sweep."""
    return mean([row["iterations"] * ROUNDS / (LEVELS * SWEEPS) for row in plain(found, "collective")])[0]


def crossing(found: Sequence[Row]) -> None:
    """Where sharing is faster, and where it is the only way."""
    age = waits(found)
    whole = mean([of_level(row) for row in plain(found, "replicated")])[0]
    share = mean([of_level(row) for row in plain(found, "collective")])[0]
    print(f"{age:.2f} exchanges a sweep; one robot {whole / 1e6:.2f} Mflop a level, {whole / CELLS:.0f} a cell; "
          f"a piece {share / 1e6:.2f} Mflop")  # fmt: skip
    said = mean([row["sent"] * 12 * row["iterations"] / LEVELS for row in plain(found, "collective")])[0]
    edges = SHOWN * 4 * SWEEPS
    print(f"{said / 1e3:.0f} kB a level said by all, and at least {edges / 1e3:.0f} kB of edges; on a radio of "
          f"{RADIO / 1e6:g} Mbit/s where one speaks at a time that takes {said * 8 / RADIO:.1f} s")  # fmt: skip
    for name, (rate, memory) in PROCESSORS.items():
        for period in (1.0, 0.25, 0.01):
            shared = SWEEPS * age * period
            work = rate * shared / (1.0 - share / whole)
            print(
                f"{name}, an exchange each {period:g} s: a level shared takes {shared:.3g} s or more; faster from "
                f"{work / 1e6:.3g} Mflop a level, {work / whole * CELLS:.3g} cells; one memory holds "
                f"{memory / VECTORS:.3g}"
            )


def bars(axis: Axes, found: Sequence[Row], measure: Callable[[Row], float], label: str) -> None:
    """A bar with its interval for each way, of twelve robots and, beside it, of six."""
    ways = list(dict.fromkeys(row["way"] for row in found))
    for number, (condition, color, name) in enumerate(
        (("plain", "#0072b2", "12 robots"), ("6 robots", "#e69f00", "6 robots"))
    ):
        its = [[measure(row) for row in found if (row["condition"], row["way"]) == (condition, way)] for way in ways]
        means = [mean(one) if one else (np.nan, np.nan) for one in its]
        at = np.arange(len(ways)) + 0.38 * number
        middles, halves = zip(*means, strict=True)
        axis.barh(at, middles, 0.36, xerr=halves, color=color, ecolor="black", capsize=2, label=name)
    axis.set_yticks(np.arange(len(ways)) + 0.19, ways)
    axis.set_ylim(len(ways), -0.4)
    axis.set_xlabel(label)
    axis.grid(axis="x", alpha=0.3)


def figures(found: Sequence[Row], folder: Path) -> None:
    """Bytes and energy; time against size; what deaths and silence cost."""
    folder.mkdir(parents=True, exist_ok=True)
    _costs(found, folder / "computing-ways-costs.png")
    _sizes(found, folder / "computing-ways-sizes.png")
    _losses(found, folder / "computing-ways-losses.png")


def _costs(found: Sequence[Row], path: Path) -> None:
    figure, axes = plt.subplots(1, 3, figsize=(11, 4.0), sharey=True, layout="constrained")
    bars(axes[0], found, lambda row: row["sent"], "bytes sent, a robot and second")
    bars(axes[1], found, level_time("ESP32"), "a level on ESP32s, answers included (s)")
    bars(axes[2], found, lambda row: 1e3 * power(row), "radio and computing (mW a robot)")
    axes[1].legend(fontsize=8, loc="upper right")
    for axis in axes:
        axis.set_xscale("symlog", linthresh=10.0 if axis is axes[0] else 0.1)
        axis.set_xlim(0.0, axis.get_xlim()[1] * 2.0)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _sizes(found: Sequence[Row], path: Path) -> None:
    whole = mean([of_level(row) for row in plain(found, "replicated")])[0] / CELLS
    share = mean([of_level(row) for row in plain(found, "collective")])[0] / CELLS
    cells, age = np.geomspace(1e3, 1e8, 100), waits(found)
    figure, axes = plt.subplots(1, 2, figsize=(10, 3.8), sharey=True, layout="constrained")
    for axis, (name, (rate, memory)) in zip(axes, PROCESSORS.items(), strict=True):
        axis.loglog(cells, whole * cells / rate, color="black", label="one robot, the whole model")
        for period, color, style in ((1.0, "#0072b2", "-"), (0.25, "#009e73", "--"), (0.01, "#d55e00", ":")):
            shared = SWEEPS * age * period + share * cells / rate
            axis.loglog(
                cells, shared, color=color, linestyle=style, label=f"12 share it, an exchange each {period:g} s"
            )
        for count, label in ((1, "one memory"), (12, "twelve")):
            axis.axvline(count * memory / VECTORS, color="gray", linewidth=1)
            axis.text(
                count * memory / VECTORS,
                3e-3,
                f" {label}",
                rotation=90,
                ha="right",
                va="bottom",
                color="dimgray",
                fontsize=8,
            )
        axis.set_title(name)
        axis.set_xlabel("cells of the model")
        axis.set_ylim(1e-3, 1e5)
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("a level (s)")
    axes[0].legend(fontsize=8, loc="upper left")
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _losses(found: Sequence[Row], path: Path) -> None:
    ways = ("replicated", "cloud, own piece", "edge, own piece", "collective")
    there = [condition for condition in LOSSES if any(row["condition"] == condition for row in found)]
    figure, axes = plt.subplots(1, 2, figsize=(11, 3.4), layout="constrained")
    for axis, label, measure in (
        (axes[0], "levels known in the end (%)", lambda row: 100.0 * row["share"]),
        (axes[1], "age of own piece, 20 to 100 s (s)", lambda row: row["age_own"]),
    ):
        for number, condition in enumerate(there):
            mine = [[measure(r) for r in found if (r["condition"], r["way"]) == (condition, way)] for way in ways]
            middles, halves = zip(*(mean(one) if one else (np.nan, np.nan) for one in mine), strict=True)
            name, color = LOSSES[condition]
            at = np.arange(len(ways)) + 0.17 * (number - (len(there) - 1) / 2)
            axis.bar(at, middles, 0.16, color=color, label=name)
            axis.errorbar(at, middles, halves, fmt="none", color="black", capsize=2)
        axis.set_xticks(range(len(ways)), [way.replace(", ", ",\n") for way in ways])
        axis.set_ylabel(label)
        axis.set_ylim(0, 100 if axis is axes[0] else None)
    axes[1].legend(loc="upper left", fontsize=8, ncols=2)
    figure.savefig(path, dpi=110)
    plt.close(figure)


if __name__ == "__main__":
    runs = rows(Path(sys.argv[2]))
    if sys.argv[1] == "figures":
        figures(runs, Path(sys.argv[3]))
    else:
        {"table": table, "crossing": crossing}[sys.argv[1]](runs)
