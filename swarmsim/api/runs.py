"""Runs from Python: simulate, record, look at."""

from __future__ import annotations

import html
import io
import shutil
import tempfile
import weakref
from base64 import b64encode
from collections.abc import Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.errors import InputError, nearest, unwritten
from swarmsim.core.parts import Curve
from swarmsim.core.probes import Row
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.file import load
from swarmsim.core.state import Knowledge, Moment
from swarmsim.engine import build as engine
from swarmsim.recording.columns import columns_of, recorded
from swarmsim.recording.reader import Recording, Summary

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from swarmsim.view.style import LookKeys

Overrides = Mapping[str, object]  # dotted key: value, as in {"robots.count": 20}


def run(
    scenario: str | Path,
    *,
    seed: int | None = None,
    overrides: Overrides | None = None,
    out: str | Path | None = None,
    allow_code: bool = False,
) -> Run:
    """Simulate a scenario to its end, and record it.

    `overrides` are values at dotted keys; a table replaces the whole table. The recording goes into the new folder
    `out` or, without one, into a temporary one that lives as long as the run that is given. `allow_code` lets the
    scenario run code of its own. Raises InputError for what cannot work, PartError for parts of others that fail,
    StorageError for a full disk, on which what was flushed can be read.
    """
    with registry.own_code(allow_code):
        made = _made(scenario, seed, overrides)
        folder = Path(tempfile.mkdtemp(prefix="swarmsim-")) if out is None else _new(Path(out))
        try:
            with made.recorder(folder / "recording.h5") as recorder:
                made.simulate([recorder])
            done = Run(Recording(folder))
        except BaseException:
            if out is None:
                shutil.rmtree(folder, ignore_errors=True)
            raise
    if out is None:
        weakref.finalize(done, shutil.rmtree, folder, ignore_errors=True)
    return done


def _new(folder: Path) -> Path:
    try:
        folder.mkdir(parents=True)
    except FileExistsError as problem:
        raise InputError(f"{folder}: exists already; expected a new folder, no run is overwritten") from problem
    except OSError as problem:
        raise unwritten(folder, problem, "a new folder") from problem
    return folder


def simulate(
    scenario: str | Path,
    *,
    seed: int | None = None,
    overrides: Overrides | None = None,
    allow_code: bool = False,
) -> Iterator[Moment[Knowledge]]:
    """Step a scenario to its end: everything that happened in each iteration, and nothing is recorded.

    Parameters and errors are those of `run`. The swarm is made before the first step is asked for.
    """
    with registry.own_code(allow_code):
        simulation = _made(scenario, seed, overrides).simulation

    def steps() -> Iterator[Moment[Knowledge]]:
        while not simulation.over:
            yield simulation.tick()

    return steps()


def open(path: str | Path) -> Run:  # noqa: A001
    """Read back a recording, or the folder of a run that holds one. Raises InputError."""
    return Run(Recording(Path(path)))


def _made(scenario: str | Path, seed: int | None, overrides: Overrides | None) -> engine.Run:
    changes = {**(overrides or {}), **({} if seed is None else {"seed": seed})}
    return engine.build(load(Path(scenario), changes=changes), str(scenario))


class Run:
    """A recorded run."""

    def __init__(self, recording: Recording) -> None:
        #: All that was recorded.
        self.recording = recording

    @cached_property
    def summary(self) -> Summary:
        """The run in a few numbers, as in its `summary.json`."""
        return self.recording.summary()

    @property
    def finished(self) -> bool:
        """Whether the task was done."""
        return bool(self.summary["status"] == "finished")

    @property
    def iterations(self) -> int:
        """How many iterations were recorded."""
        return self.recording.iterations

    @property
    def measures(self) -> dict[str, NDArray[np.float64]]:
        """What the task measured of the swarm after each iteration (t,), by name."""
        return {name: self.recording[name] for name in self.recording.measures}

    def curve(self) -> NDArray[np.float64]:
        """The measure that the task is about, after each iteration (t,), in the unit of its label."""
        curve = self.recording.curve
        return np.asarray(curve.scale * self.recording[curve.name], np.float64)

    def frame(self, name: str | None = None) -> pd.DataFrame:
        """One row for each iteration; columns are named with their units. Needs pandas.

        With the name of a probe, as in the scenario, one row for each sample and robot. With that of a channel of the
        robots' sensors or actuators, such as `neighbours` or `led`, one for each iteration and robot and, where there
        are several of something, for each of them. Raises InputError for what is neither.
        """
        try:
            import pandas as pd
        except ImportError as problem:
            raise ImportError("frame() needs pandas; install it with: pip install pandas") from problem
        if name is not None and (name in self.recording.channels or name in self.recording.actuators):
            return pd.DataFrame(columns_of(self.recording, name))
        if name is not None:
            return pd.DataFrame(self._sampled(name))
        recording, curve = self.recording, self.recording.curve
        iteration = np.arange(1, self.iterations + 1)
        columns: dict[str, object] = {"iteration": iteration, "time (s)": iteration * recording.scenario.period}
        for name, values in self.measures.items():
            columns |= {named(curve): self.curve()} if name == curve.name else {name: values}
        columns |= {
            "progress (%)": 100.0 * recording.progress,
            "robots alive": recording["alive"].sum(axis=1),
            "messages": recording["messages"],
        }
        return pd.DataFrame(columns)

    def _sampled(self, name: str) -> dict[str, Row]:
        """The columns of a probe: where it has a table with a row for each robot, others' numbers are repeated."""
        known = {one.name: one for one in self.recording.probes}
        if name not in known:
            there = {**known, **recorded(self.recording)}
            raise InputError(f"{self.recording.path}: no probe or channel is called {name!r}; {nearest(name, there)}")
        declared, robots = known[name], self.recording.scenario.robots.count
        of_each = [table.shape[:1] == ("robots",) for table in declared.tables]
        repeats = robots if any(of_each) else 1
        iteration = declared.every * np.arange(declared.samples(self.iterations))
        columns: dict[str, Row] = {"iteration": iteration, "time (s)": iteration * self.recording.scenario.period}
        columns = {title: np.repeat(values, repeats) for title, values in columns.items()}
        if any(of_each):
            columns["robot"] = np.tile(np.arange(robots), len(iteration))
        for table, each in zip(declared.tables, of_each, strict=True):
            rows = self.recording[declared.called(table)]
            width = int(np.prod(rows.shape[2 if each else 1 :]))
            flat = np.repeat(rows.reshape(-1, width) if width else np.empty((0, 0)), 1 if each else repeats, axis=0)
            labels = table.columns if len(table.columns) == width else [str(i) for i in range(width)]
            for label, values in zip(labels, flat.T, strict=True):
                title = f"{table.name} {label}" if width > 1 or table.columns else table.name
                columns[f"{title} ({table.unit})" if table.unit else title] = values
        return columns

    def plot(self) -> Figure:
        """What the task is about, over the iterations."""
        from swarmsim.view import plots

        recording = self.recording
        title = recording.scenario.title
        return plots.curves({f"seed {recording.scenario.seed}": [recording[recording.curve.name]]}, title,
                            curve=recording.curve)  # fmt: skip

    def film(
        self,
        path: str | Path,
        *,
        fps: int = 30,
        speed: float = 20.0,
        size: tuple[int, int] = (1280, 720),
        cards: bool = True,
        beside: Run | None = None,
        **look: Unpack[LookKeys],
    ) -> Path:
        """Write a film, .mp4, .gif or numbered .png, and give its path.

        `speed` is in simulated seconds per second; `beside` is a second run to show in step; `look` are the fields of
        `swarmsim.view.style.Look`: theme, layers, focus, robots. Raises InputError.
        """
        from swarmsim.view.style import Style
        from swarmsim.view.video import Film, write_film

        film = Film(fps, speed, size, Style(**look), cards)
        write_film(self.recording, Path(path), film, None if beside is None else beside.recording)
        return Path(path)

    def picture(
        self, iteration: float | None = None, size: tuple[int, int] = (1280, 720), **look: Unpack[LookKeys]
    ) -> NDArray[np.uint8]:
        """The picture (height, width, 3) after so many iterations, by default at the end. Raises InputError.

        `look` is as for a film.
        """
        from swarmsim.view.style import Style
        from swarmsim.view.video import frame

        return frame(self.recording, self.iterations if iteration is None else iteration, size, Style(**look))

    def __repr__(self) -> str:
        curve, status = self.recording.curve, self.summary["status"]
        last = f", {named(curve)} {self.curve()[-1]:{curve.format}}" if self.iterations else ""
        return f"<Run {self.recording.scenario.title!r}: {status} after {self.iterations} iterations{last}>"

    def _repr_html_(self) -> str:
        shown = ("status", "iterations", "robots", "alive", "messages", "seed")
        rows = {name: value for name, value in self.summary.items() if name in shown}
        rows |= {name: f"{value:.4g}" for name, value in self.summary["measures"].items()}
        table = "".join(f"<tr><td>{html.escape(k)}</td><td>{html.escape(str(v))}</td></tr>" for k, v in rows.items())
        title = html.escape(self.recording.scenario.title)
        picture = f'<img alt="{title}, at the end" width="720" src="{png(self.picture())}">' if self.iterations else ""
        return f"<div><b>{title}</b><br>{picture}<table>{table}</table></div>"


def named(curve: Curve) -> str:
    """What a curve shows, with its unit: `coverage (%)`."""
    name, _, unit = curve.label.partition(", ")
    return f"{name} ({unit})" if unit else name


def png(picture: NDArray[np.uint8]) -> str:
    """A picture (height, width, 3) as the address of an image in a page."""
    from PIL import Image

    file = io.BytesIO()
    Image.fromarray(picture).save(file, "PNG", optimize=True)
    return f"data:image/png;base64,{b64encode(file.getvalue()).decode()}"
