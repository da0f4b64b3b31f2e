"""Pandas tables of a recorded run: its iterations, a probe's samples, a channel's readings."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from swarmsim.core.errors import InputError, nearest
from swarmsim.core.parts import Curve
from swarmsim.core.probes import Row
from swarmsim.recording.columns import columns_of, recorded
from swarmsim.recording.reader import Recording

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import pandas as pd


def framed(rows: Mapping[str, object] | Sequence[Mapping[str, object]]) -> pd.DataFrame:
    """Columns or records as a pandas DataFrame. Raises ImportError without pandas."""
    try:
        import pandas as pd
    except ImportError as problem:
        raise ImportError("frame() needs pandas; install it with: pip install pandas") from problem
    return pd.DataFrame(rows)


def columns(recording: Recording, name: str | None) -> Mapping[str, object]:
    """The columns of the iterations or, by name, of a channel or a probe. Raises InputError for an unknown name."""
    if name is None:
        return _iterations(recording)
    of_robots = name in recording.channels or name in recording.actuators
    return columns_of(recording, name) if of_robots else _sampled(recording, name)


def _iterations(recording: Recording) -> dict[str, object]:
    curve = recording.curve
    iteration = np.arange(1, recording.iterations + 1)
    found: dict[str, object] = {"iteration": iteration, "time (s)": iteration * recording.scenario.period}
    for name in recording.measures:
        title, scale = (named(curve), curve.scale) if name == curve.name else (name, 1.0)
        found[title] = np.asarray(scale * recording[name], np.float64)
    return {
        **found,
        "progress (%)": 100.0 * recording.progress,
        "robots alive": recording["alive"].sum(axis=1),
        "messages": recording["messages"],
    }


def _sampled(recording: Recording, name: str) -> dict[str, Row]:
    """The columns of a probe or job: next to a table with a row per robot, others' numbers are repeated.

    Tables with a rate of their own are left out.
    """
    known = {one.name: one for one in recording.probes}
    if name not in known:
        there = {**known, **recorded(recording)}
        raise InputError(f"{recording.path}: no probe or channel is called {name!r}; {nearest(name, there)}")
    declared, robots = known[name], recording.scenario.robots.count
    tables = [table for table in declared.tables if not table.every]
    of_each = [table.shape[:1] == ("robots",) for table in tables]
    repeats = robots if any(of_each) else 1
    iteration = declared.every * np.arange(declared.samples(recording.iterations))
    found: dict[str, Row] = {"iteration": iteration, "time (s)": iteration * recording.scenario.period}
    found = {title: np.repeat(values, repeats) for title, values in found.items()}
    if any(of_each):
        found["robot"] = np.tile(np.arange(robots), len(iteration))
    for table, each in zip(tables, of_each, strict=True):
        rows = recording[declared.called(table)]
        width = int(np.prod(rows.shape[2 if each else 1 :]))
        flat = np.repeat(rows.reshape(-1, width) if width else np.empty((0, 0)), 1 if each else repeats, axis=0)
        labels = table.columns if len(table.columns) == width else [str(i) for i in range(width)]
        for label, values in zip(labels, flat.T, strict=True):
            title = f"{table.name} {label}" if width > 1 or table.columns else table.name
            found[f"{title} ({table.unit})" if table.unit else title] = values
    return found


def named(curve: Curve) -> str:
    """A curve's measure with its unit: `coverage (%)`."""
    name, _, unit = curve.label.partition(", ")
    return f"{name} ({unit})" if unit else name
