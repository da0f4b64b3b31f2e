"""Figures of a recorded run for print: ours, which are parts like those of others, and how all of them are drawn."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, Literal

import numpy as np
from msgspec import Meta, Struct, field

from swarmsim.core.errors import InputError, PlacedError, unwritten
from swarmsim.core.scenario.part import Part

if TYPE_CHECKING:  # who asks what figures there are draws none
    from matplotlib.figure import Figure

    from swarmsim.network.report import Graph, NetworkReport
    from swarmsim.recording.reader import Recording
    from swarmsim.view.figure import RunFigure

PRINT: Final = 300  # dots per inch
MOST: Final = 12  # maps in one figure that can still be read
Iteration = Annotated[int, Meta(ge=0)]
Robot = Annotated[int, Meta(ge=0)]


def drawn(recording: Recording, use: str, keys: Mapping[str, object], called: str | None = None) -> Figure:
    """The figure of this name, with the values of its keys.

    Messages about keys begin with `called`, by default with the name. Raises InputError, and PartError for a part of
    others that fails.
    """
    from swarmsim.view import plots

    asked: Part[RunFigure] = Part("figure", {"use": use, **keys})
    try:
        return plots.asked(asked.beside(Path.cwd()).decoded(), recording)
    except PlacedError:
        raise
    except InputError as problem:
        about = f"--figure {use}: " if called is None else called
        raise InputError(f"{about}{str(problem).removeprefix('use: ')}") from problem


def written(
    recording: Recording, use: str, keys: Mapping[str, object], out: Path | None, called: str | None = None
) -> list[Path]:
    """Draw the figure of this name into files, by default beside the recording. Raises as `drawn` does."""
    stem = out or recording.path.parent / use.rpartition(":")[2]
    return save({stem: drawn(recording, use, keys, called)}, "--out", PRINT)


class TaskCurve(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What the task is about, over the iterations."""

    def draw(self, recording: Recording) -> Figure:
        """One curve, in the unit of its axis."""
        from swarmsim.view import plots

        curve, scenario = recording.curve, recording.scenario
        name = f"seed {scenario.seed}"
        return plots.curves(
            {name: [recording[curve.name]]}, scenario.title, curve=curve, periods={name: scenario.period}
        )


class LocalMaps(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The maps that robots have at the end of an iteration, side by side, as in the reference paper's third figure."""

    robots: tuple[Robot, ...]  # by number from 0
    at: Iteration  # the iteration

    def draw(self, recording: Recording) -> Figure:
        """A panel for each robot."""
        from swarmsim.core.state import UNKNOWN
        from swarmsim.operations.mapping.replay import MapReplay
        from swarmsim.view import plots
        from swarmsim.view.scene import Scene

        check_maps(recording, str(recording.path))
        _check_robots(recording, "robots", self.robots)
        _check_iteration(recording, "at", self.at)
        replay = MapReplay(recording)
        replay.advance(self.at)
        known = (replay.maps[:, recording["domain"]] != UNKNOWN).mean(axis=1)
        count = recording.scenario.robots.count
        shares = (recording.rows("covered", count)[self.at] if "covered" in recording else known).tolist()
        title, robots = f"Local maps: {_titled(recording)}, iteration {self.at}", list(dict.fromkeys(self.robots))
        return plots.local_maps(Scene(recording), replay.maps, shares, robots, self.at, title)


class Rewiring(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Who hears whom at two iterations, and whose neighbours differ, as in the reference paper's fifth figure."""

    at: Iteration  # the iteration on the left
    and_: Iteration = field(name="and")  # the iteration on the right

    def draw(self, recording: Recording) -> Figure:
        """Two panels, with what differs in colour."""
        from swarmsim.view import plots
        from swarmsim.view.scene import Scene

        for key, iteration in (("at", self.at), ("and", self.and_)):
            _check_iteration(recording, key, iteration)
        if self.at == self.and_:
            raise InputError(f"and {self.and_}: the same iteration as at; expected another one")
        letters = {iteration: recording.letters(iteration) for iteration in (self.at, self.and_)}
        heard = {iteration: rows[rows[:, 4] == 0, :2] for iteration, rows in letters.items()}
        title = f"Who hears whom: {_titled(recording)}, iterations {self.at} and {self.and_}"
        return plots.rewiring(Scene(recording), heard, title)


class Provenance(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Who sensed what a robot knows, over how many links it came and how old it is; the run is simulated again."""

    robot: Robot  # by number from 0
    at: Iteration | None = None  # the iteration; without it the last one

    def draw(self, recording: Recording) -> Figure:
        """Three maps, and the age of what each robot knows over time."""
        from swarmsim.engine.build import build
        from swarmsim.operations.mapping.measures.provenance import MapProvenance
        from swarmsim.view import plots
        from swarmsim.view.scene import Scene

        check_maps(recording, str(recording.path))
        last = recording.iterations - 1 if self.at is None else self.at
        _check_iteration(recording, "at", last)
        _check_robots(recording, "robot", [self.robot])
        made = build(recording.scenario, str(recording.path), recording.world)
        probe = MapProvenance(recording.scenario.robots.count, made.context.lattice)
        while made.simulation.state.iteration <= last and not made.simulation.over:
            made.simulation.tick([probe])
        title = f"What robot {self.robot} knows: {_titled(recording)}, iteration {last}"
        by, hops = probe.origins.by[self.robot], probe.origins.hops[self.robot]
        return plots.provenance(
            Scene(recording), self.robot, by, hops, probe.age(self.robot), np.array(probe.ages), title
        )


class NetworkMeasures(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The network in a window of iterations: its course, how many each robot hears, who heard whom, for how long."""

    shows: Literal["course", "degrees", "who-heard-whom", "contact-times"] = "course"
    from_: Iteration = field(name="from", default=0)  # the first iteration of the window
    to: Iteration | None = None  # the one after its last; without it the end of the run

    def draw(self, recording: Recording) -> Figure:
        """One of the four figures of `swarmsim network --plots`."""
        from swarmsim.network.report import network_report

        return _of_network(network_report(recording, self.from_, self.to))[self.shows]()


def network_figures(report: NetworkReport, folder: Path) -> list[Path]:
    """Draw the four figures of a network into a folder. Raises InputError."""
    return save({folder / name: draw() for name, draw in _of_network(report).items()}, "--plots")


def _of_network(report: NetworkReport) -> dict[str, Callable[[], Figure]]:
    """What draws the four figures, by name; one curve where what was heard is just what was linked."""
    from swarmsim.view import plots

    numbers, graphs = report.numbers, report.graphs
    first = numbers["from"]
    caption = f"{numbers['title']}\nseed {numbers['seed']}, n = {numbers['robots']} robots, iterations "
    caption += f"{first} to {numbers['to'] - 1}"
    same = np.array_equal(graphs["linked"].reach.first_heard, graphs["heard"].reach.first_heard) and all(
        np.array_equal(one.degrees, other.degrees)
        for one, other in zip(graphs["linked"].snapshots, graphs["heard"].snapshots, strict=True)
    )
    shown: Mapping[str, Graph] = {"linked and heard": graphs["heard"]} if same else graphs
    snapshots = {name: graph.snapshots for name, graph in shown.items()}
    heard = graphs["heard"]
    return {
        "course": lambda: plots.network_course(snapshots, first, f"The network over time: {caption}"),
        "degrees": lambda: plots.degrees(snapshots, f"How many each robot hears, and is heard by: {caption}"),
        "who-heard-whom": lambda: plots.who_heard_whom(heard.reach, f"Who heard whom: {caption}"),
        "contact-times": lambda: plots.contact_times(
            {"two robots": heard.unordered, "one way": heard.ordered}, f"How long robots hear each other: {caption}"
        ),
    }


def check_maps(recording: Recording, name: str) -> None:
    """Raise InputError unless the robots of a run kept maps."""
    if "changes" not in recording:
        raise PlacedError(f"{name}: these robots kept no maps; expected the run of a swarm that maps")


def _check_robots(recording: Recording, key: str, robots: Sequence[int]) -> None:
    count, words = recording.scenario.robots.count, ",".join(map(str, robots))
    if missing := [robot for robot in robots if robot >= count]:
        raise InputError(f"{key} {words}: no robot {missing[0]} in the run; expected numbers from 0 to {count - 1}")
    if (maps := len(set(robots))) > MOST:
        raise InputError(f"{key} {words}: {maps} maps cannot be read side by side; expected at most {MOST}")


def _check_iteration(recording: Recording, key: str, iteration: int) -> None:
    if not recording.iterations:
        raise PlacedError(f"{recording.path}: no whole iteration was recorded; expected at least one")
    if iteration >= recording.iterations:
        raise InputError(f"{key} {iteration}: no such iteration; expected 0 to {recording.iterations - 1}")


def _titled(recording: Recording) -> str:
    return f"{recording.scenario.title}\nseed {recording.scenario.seed}"


def save(figures: Mapping[Path, Figure], option: str = "", dpi: int = 150) -> list[Path]:
    """Save figures as the files that are asked for; gives these. Raises InputError, naming the option."""
    from swarmsim.view import plots

    try:
        return [path for stem, figure in figures.items() for path in plots.save(figure, stem, dpi)]
    except OSError as problem:
        raise unwritten(f"{option} {problem.filename}".strip(), problem, "a place for figures") from problem
