"""Keeps benchmarks' figures in a dated file and in the table of docs/performance.md."""

from __future__ import annotations

import datetime as dt
import json
import os
import platform
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path

import pytest

from swarmsim.recording.digests import versions

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "performance.md"
BEGIN, END = "<!-- figures begin -->", "<!-- figures end -->"


@dataclass
class Figure:
    group: str
    name: str
    value: float
    unit: str
    asked: str = ""  # the target, in words


@dataclass
class Figures:
    rows: list[Figure] = field(default_factory=list)

    def add(self, group: str, name: str, value: float, unit: str = "", asked: str = "") -> float:
        """Store and print a figure; gives its value."""
        self.rows.append(Figure(group, name, float(value), unit, asked))
        print(f"{group}: {name}: {worded(value)} {unit}{f' (asked: {asked})' if asked else ''}")
        return value


def worded(value: float) -> str:
    return f"{value:,.0f}".replace(",", " ") if abs(value) >= 1000 else f"{value:.3g}"


def machine() -> dict[str, object]:
    model = [line for line in Path("/proc/cpuinfo").read_text().splitlines() if line.startswith("model name")]
    processor = model[0].partition(": ")[2] if model else platform.processor()
    return {"processor": processor, "cores": os.cpu_count(), **versions()}


@pytest.fixture(scope="session")
def figures() -> Iterator[Figures]:
    found = Figures()
    yield found
    if not found.rows:
        return
    today = dt.datetime.now(dt.UTC).date().isoformat()
    path = ROOT / "benchmarks" / "results" / f"{today}.json"
    path.parent.mkdir(exist_ok=True)
    rows = [asdict(row) for row in found.rows]
    said = json.loads(path.read_text()) if path.exists() else []
    said.append({"machine": machine(), "figures": rows})
    path.write_text(json.dumps(said, indent=1) + "\n")
    page = PAGE.read_text()
    before, _, rest = page.partition(BEGIN)
    _, _, after = rest.partition(END)
    PAGE.write_text(f"{before}{BEGIN}\n{_table(found.rows, today)}\n{END}{after}")


def _table(rows: list[Figure], today: str) -> str:
    told = machine()
    lines = [
        f"*{today}: {told['processor']}, {told['cores']} cores, {told['platform']}, Python {told['python']}, numpy "
        f"{told['numpy']}, numba {told['numba']}, pymunk {told['pymunk']}.*",
    ]
    for group in dict.fromkeys(row.group for row in rows):
        lines += ["", f"**{group}**", "", "| what | figure | asked for |", "|---|---|---|"]
        lines += [f"| {r.name} | {worded(r.value)} {r.unit} | {r.asked} |" for r in rows if r.group == group]
    return "\n".join(lines)
