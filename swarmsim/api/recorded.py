"""A recorded run: its numbers, pictures and exports."""

from __future__ import annotations

import html
import io
from base64 import b64encode
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

import numpy as np
from numpy.typing import NDArray

from swarmsim.api import frames as tables
from swarmsim.api.overrides import Overrides, keys_of
from swarmsim.core.durations import told
from swarmsim.core.scenario import registry
from swarmsim.recording.reader import Recording, Summary

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from swarmsim.api.verification import Verification
    from swarmsim.fleet.diaries import LogReplay
    from swarmsim.network.report import NetworkReport
    from swarmsim.view.style import LookKeys

Progress = Callable[[int, int], None]  # called with the amount done and the total


def untold(done: int, of: int) -> None:
    """Ignore progress."""


class Run:
    """A recorded run."""

    def __init__(self, recording: Recording, path: Path | None = None) -> None:
        #: The recording.
        self.recording = recording
        #: The opened folder or file, as messages name it.
        self.path = path or recording.path

    @cached_property
    def summary(self) -> Summary:
        """The run in a few numbers, as in its `summary.json` and as `swarmsim show --json` prints it."""
        return self.recording.summary()

    @property
    def finished(self) -> bool:
        """Whether the task was done."""
        return bool(self.summary["status"] == "finished")

    @property
    def iterations(self) -> int:
        """The number of recorded iterations."""
        return self.recording.iterations

    @property
    def measures(self) -> dict[str, NDArray[np.float64]]:
        """The task's measures of the swarm after each iteration (t,), by name."""
        return {name: self.recording[name] for name in self.recording.measures}

    def curve(self) -> NDArray[np.float64]:
        """The task's main measure after each iteration (t,), in the unit of its label."""
        curve = self.recording.curve
        return np.asarray(curve.scale * self.recording[curve.name], np.float64)

    def frame(self, name: str | None = None) -> pd.DataFrame:
        """One row for each iteration; columns are named with their units. Needs pandas.

        With the name of a probe, as in the scenario, one row for each sample and robot. With a sensor's or actuator's
        channel, such as `neighbours` or `led`, one for each iteration and robot, and each item if it has several.
        Raises InputError for an unknown name.
        """
        return tables.framed(tables.columns(self.recording, name))

    def plot(self, figure: str = "curve", *, overrides: Overrides | None = None, allow_code: bool = False) -> Figure:
        """A figure of the run, by default what the task is about over the iterations: `swarmsim plot`.

        `figure` is the name of an installed one (`sw.parts("figure")`), or "./file.py:name", which needs `allow_code`;
        `overrides` are its keys, {"at": 20}, or the same in words, as for `--set`. Raises InputError for names and keys
        that there are not, PartError for a figure of others that fails.
        """
        from swarmsim.api.figures import drawn

        with registry.own_code(allow_code):
            return drawn(self.recording, figure, keys_of(overrides))

    def figure(
        self,
        figure: str = "curve",
        out: str | Path | None = None,
        *,
        overrides: Overrides | None = None,
        allow_code: bool = False,
    ) -> list[Path]:
        """Draw a figure of the run for print, and give the files, PNG and SVG: `swarmsim plot`.

        `out` is its path without suffix, by default its name in the run's folder; `figure`, `overrides`, `allow_code`
        and errors are those of `plot`, besides InputError and StorageError for a place that cannot be written.
        """
        from swarmsim.api.figures import written

        with registry.own_code(allow_code):
            return written(self.recording, figure, keys_of(overrides), _path(out))

    def verify(self, *, allow_code: bool = False, progress: Progress = untold) -> Verification:
        """Repeat the run and compare every field of every iteration: `swarmsim verify`.

        `allow_code` lets it run its own code. `progress` is called with the iterations compared and all of them.
        Raises InputError for a run that cannot be repeated, PartError for third-party parts that fail.
        """
        from swarmsim.api.verification import verified

        with registry.own_code(allow_code):
            return verified(self.recording, str(self.path), progress)

    def replay(
        self, *, id_: int = 0, out: str | Path | None = None, allow_code: bool = False, progress: Progress = untold
    ) -> LogReplay:
        """Let a robot alone sense and hear what it did in the run, and compare what it does: `swarmsim robot replay`.

        For what it sensed and heard, the world is simulated again, with all robots told bytes alone, and compared with
        the recording in every field. Then a new robot with the number `id` goes through its part. The file `out` keeps
        that, as a log for `swarmsim-robot replay` on another computer. `allow_code` lets the run's own code run;
        `progress` is called with the iterations simulated and all of them.
        Raises InputError for a run that cannot be repeated, or comes out otherwise, and StorageError for a full disk.
        """
        from swarmsim.api.replays import lived_again

        with registry.own_code(allow_code):
            return lived_again(self.recording, str(self.path), id_, _path(out), progress)

    def network(self, *, from_: int = 0, to: int | None = None, plots: str | Path | None = None) -> NetworkReport:
        """Measure links, received and lost messages, and their changes: `swarmsim network`.

        The window begins with iteration `from_` and ends before `to`, by default with the run. Figures are drawn into
        the folder `plots`, as PNG and SVG. Raises InputError for a window outside the run.
        """
        from swarmsim.api.figures import network_figures
        from swarmsim.network.report import network_report

        found = network_report(self.recording, from_, to)
        return found if plots is None else replace(found, figures=tuple(network_figures(found, Path(plots))))

    def figure_local_maps(self, robots: Sequence[int], at: int, out: str | Path | None = None) -> list[Path]:
        """Draw the robots' maps at the end of an iteration, side by side: `swarmsim figure local-maps`.

        `robots` are numbers from 0, `out` is the figure's path without suffix, by default in the run's folder. Returns
        the files, PNG and SVG for print. Raises InputError for unknown robots or iterations.
        """
        keys = {"robots": [int(robot) for robot in robots], "at": at}
        return self._figure("local-maps", keys, f"local-maps-{at}", out)

    def figure_network(self, at: int, and_: int, out: str | Path | None = None) -> list[Path]:
        """Draw the links at two iterations, and the robots whose neighbours differ: `swarmsim figure network`.

        `out`, result and errors are those of `figure_local_maps`.
        """
        return self._figure("network", {"at": at, "and": and_}, f"network-{at}-{and_}", out)

    def figure_provenance(
        self, robot: int, at: int | None = None, out: str | Path | None = None, *, allow_code: bool = False
    ) -> list[Path]:
        """Draw the source, hops and age of a robot's knowledge: `swarmsim figure provenance`.

        The run is repeated up to iteration `at`, by default the last; `allow_code` lets it run its own code.
        `out`, result and errors are those of `figure_local_maps`.
        """
        last = self.iterations - 1 if at is None else at
        with registry.own_code(allow_code):
            return self._figure("provenance", {"robot": robot, "at": at}, f"provenance-{robot}-{last}", out)

    def _figure(self, figure: str, keys: Mapping[str, object], stem: str, out: str | Path | None) -> list[Path]:
        """Draw a figure that has a verb of its own, whose options are its keys."""
        from swarmsim.api.figures import written

        return written(self.recording, figure, keys, _path(out) or self.recording.path.parent / stem, "--")

    def export(
        self,
        *,
        map_: str | Path | None = None,
        mcap: str | Path | None = None,
        rerun: str | Path | None = None,
        ros2: str | Path | None = None,
        robot: int | None = None,
        at: int | None = None,
        allow_code: bool = False,
        progress: Progress = untold,
    ) -> list[Path]:
        """Write the run for other programs and return the files: `swarmsim export`.

        `map_` is a map for ROS: .yaml for map_server or .json for an OccupancyGrid, of one `robot` or of all, at the
        end of an iteration, by default the last. `mcap` is a file for Foxglove and Lichtblick, `rerun` one for the
        Rerun viewer, `ros2` a new folder with a rosbag2; `progress` is called with the iterations written and all of
        them. `allow_code` lets the scenario's own layers be drawn, which are left out otherwise. Raises InputError for
        files that cannot be written, PartError for layers that fail, StorageError for a full disk.
        """
        from swarmsim.api.exports import exported

        with registry.own_code(allow_code):
            files = _path(map_), _path(mcap), _path(rerun), _path(ros2)
            return exported(self.recording, str(self.path), *files, robot, at, progress)

    def report(self, out: str | Path, *, beside: Run | None = None, allow_code: bool = False) -> Path:
        """Write the page `out`, which replays the run in any browser, and return its path: `swarmsim report`.

        `beside` is a second run to replay in step; `allow_code` and PartError are those of `export`. Raises InputError
        for a name that does not end in .html, and for runs without iterations.
        """
        from swarmsim.api.pages import replay_page

        runs = [self] if beside is None else [self, beside]
        with registry.own_code(allow_code):
            return replay_page([(str(run.path), run.recording) for run in runs], Path(out))

    def film(
        self,
        path: str | Path,
        *,
        fps: int = 30,
        speed: float = 20.0,
        size: tuple[int, int] = (1280, 720),
        cards: bool = True,
        beside: Run | None = None,
        frames: bool = False,
        allow_code: bool = False,
        progress: Progress = untold,
        **look: Unpack[LookKeys],
    ) -> Path:
        """Write a film and return its `path`: .mp4, .gif or, for numbered pictures, .png: `swarmsim video`.

        It has `fps` frames per second, `speed` simulated seconds per second, and a `size` of width and height in
        pixels. `cards` show the scenario first and the result last; `beside` is a second run to show in step;
        `frames` repeats the run and shows how robots that share by merge find each other's frames; `progress`
        is called with the pictures drawn and all of them; `look` are the fields of `swarmsim.view.style.Style`: theme,
        layers, focus, robots. `allow_code` and PartError are those of `export`; with `frames` the run's own code needs
        it too. Raises InputError for what cannot work, StorageError for a full disk.
        """
        from swarmsim.api.films import filmed
        from swarmsim.view.style import Style
        from swarmsim.view.video import Film

        how = Film(fps, speed, size, Style(**look), cards)
        other = None if beside is None else beside.recording
        with registry.own_code(allow_code):
            return filmed(self.recording, str(self.path), Path(path), how, other, frames, progress)

    def picture(
        self,
        iteration: float | None = None,
        size: tuple[int, int] = (1280, 720),
        *,
        allow_code: bool = False,
        **look: Unpack[LookKeys],
    ) -> NDArray[np.uint8]:
        """The picture (height, width, 3) after `iteration` iterations, by default all.

        `size`, `allow_code` and `look` are those of `film`. Raises InputError for a moment outside the run.
        """
        from swarmsim.view.style import Style
        from swarmsim.view.video import frame

        with registry.own_code(allow_code):
            return frame(self.recording, self.iterations if iteration is None else iteration, size, Style(**look))

    def __repr__(self) -> str:
        curve, status = self.recording.curve, self.summary["status"]
        last = f", {tables.named(curve)} {self.curve()[-1]:{curve.format}}" if self.iterations else ""
        return f"<Run {self.recording.scenario.title!r}: {status} after {self.iterations} iterations{last}>"

    def _repr_html_(self) -> str:
        shown = ("status", "iterations", "robots", "alive", "messages", "seed")
        rows = {name: value for name, value in self.summary.items() if name in shown}
        rows["iterations"] = f"{self.iterations}, {told(self.iterations * self.recording.scenario.period)} simulated"
        rows |= {name: f"{value:.4g}" for name, value in self.summary["measures"].items()}
        table = "".join(f"<tr><td>{html.escape(k)}</td><td>{html.escape(str(v))}</td></tr>" for k, v in rows.items())
        title = html.escape(self.recording.scenario.title)
        picture = f'<img alt="{title}, at the end" width="720" src="{_png(self.picture())}">' if self.iterations else ""
        return f"<div><b>{title}</b><br>{picture}<table>{table}</table></div>"


def _path(given: str | Path | None) -> Path | None:
    return None if given is None else Path(given)


def _png(picture: NDArray[np.uint8]) -> str:
    """A picture (height, width, 3) as a data URL."""
    from PIL import Image

    file = io.BytesIO()
    Image.fromarray(picture).save(file, "PNG", optimize=True)
    return f"data:image/png;base64,{b64encode(file.getvalue()).decode()}"
