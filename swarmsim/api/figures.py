"""Printable figures of a recorded run: single moments, and its network."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from swarmsim.core.errors import InputError, unwritten
from swarmsim.core.state import UNKNOWN
from swarmsim.engine.build import build
from swarmsim.network.report import Graph, NetworkReport
from swarmsim.operations.mapping.measures.provenance import MapProvenance
from swarmsim.operations.mapping.replay import MapReplay
from swarmsim.recording.reader import Recording
from swarmsim.view import plots
from swarmsim.view.scene import Scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PRINT: Final = 300  # dots per inch
MOST: Final = 12  # readable maps in one figure


def local_maps(recording: Recording, name: str, robots: Sequence[int], at: int, out: Path | None) -> list[Path]:
    """Draw robots' maps at an iteration; `name` is the run's in messages. Raises InputError."""
    check_maps(recording, name)
    _check_robots(recording, robots)
    _check_iteration(recording, "--at", at)
    replay = MapReplay(recording)
    replay.advance(at)
    known = (replay.maps[:, recording["domain"]] != UNKNOWN).mean(axis=1)
    count = recording.scenario.robots.count
    shares = (recording.rows("covered", count)[at] if "covered" in recording else known).tolist()
    title = f"Local maps: {_titled(recording)}, iteration {at}"
    figure = plots.local_maps(Scene(recording), replay.maps, shares, list(dict.fromkeys(robots)), at, title)
    return _save({out or recording.path.parent / f"local-maps-{at}": figure}, "--out", PRINT)


def rewiring(recording: Recording, at: int, and_: int, out: Path | None) -> list[Path]:
    """Draw the links at two iterations. Raises InputError."""
    for option, iteration in (("--at", at), ("--and", and_)):
        _check_iteration(recording, option, iteration)
    if at == and_:
        raise InputError(f"--and {and_}: the same iteration as --at; expected another one")
    letters = {iteration: recording.letters(iteration) for iteration in (at, and_)}
    heard = {iteration: rows[rows[:, 4] == 0, :2] for iteration, rows in letters.items()}
    figure = plots.rewiring(
        Scene(recording), heard, f"Who hears whom: {_titled(recording)}, iterations {at} and {and_}"
    )
    return _save({out or recording.path.parent / f"network-{at}-{and_}": figure}, "--out", PRINT)


def provenance(recording: Recording, name: str, robot: int, at: int | None, out: Path | None) -> list[Path]:
    """Repeat the run, and draw where a robot's knowledge came from. Raises InputError."""
    check_maps(recording, name)
    last = recording.iterations - 1 if at is None else at
    _check_iteration(recording, "--at", last)
    _check_robots(recording, [robot])
    made = build(recording.scenario, name, recording.world)
    probe = MapProvenance(recording.scenario.robots.count, made.context.lattice)
    while made.simulation.state.iteration <= last and not made.simulation.over:
        made.simulation.tick([probe])
    title = f"What robot {robot} knows: {_titled(recording)}, iteration {last}"
    by, hops = probe.origins.by[robot], probe.origins.hops[robot]
    figure = plots.provenance(Scene(recording), robot, by, hops, probe.age(robot), np.array(probe.ages), title)
    return _save({out or recording.path.parent / f"provenance-{robot}-{last}": figure}, "--out", PRINT)


def network_figures(report: NetworkReport, folder: Path) -> list[Path]:
    """Draw the four figures of a network into a folder. Raises InputError."""
    numbers = report.numbers
    caption = f"{numbers['title']}\nseed {numbers['seed']}, n = {numbers['robots']} robots, iterations "
    drawn = _of_network(report.graphs, numbers["from"], f"{caption}{numbers['from']} to {numbers['to'] - 1}")
    return _save({folder / name: figure for name, figure in drawn.items()}, "--plots")


def _of_network(graphs: Mapping[str, Graph], first: int, caption: str) -> dict[str, Figure]:
    """The four figures by name; one curve if all links were heard."""
    same = np.array_equal(graphs["linked"].reach.first_heard, graphs["heard"].reach.first_heard) and all(
        np.array_equal(one.degrees, other.degrees)
        for one, other in zip(graphs["linked"].snapshots, graphs["heard"].snapshots, strict=True)
    )
    shown = {"linked and heard": graphs["heard"]} if same else graphs
    snapshots = {name: graph.snapshots for name, graph in shown.items()}
    heard = graphs["heard"]
    return {
        "course": plots.network_course(snapshots, first, f"The network over time: {caption}"),
        "degrees": plots.degrees(snapshots, f"How many each robot hears, and is heard by: {caption}"),
        "who-heard-whom": plots.who_heard_whom(heard.reach, f"Who heard whom: {caption}"),
        "contact-times": plots.contact_times(
            {"two robots": heard.unordered, "one way": heard.ordered}, f"How long robots hear each other: {caption}"
        ),
    }


def save_picture(figure: Figure, path: Path) -> Path:
    """Save a figure as PNG and return its path. Raises InputError, and StorageError for a full disk."""
    try:
        figure.savefig(path, format="png", metadata={"Software": None})
    except OSError as problem:
        raise unwritten(path, problem, "a place for a picture") from problem
    return path


def check_maps(recording: Recording, name: str) -> None:
    """Raise InputError unless the robots of a run kept maps."""
    if "changes" not in recording:
        raise InputError(f"{name}: these robots kept no maps; expected the run of a swarm that maps")


def _check_robots(recording: Recording, robots: Sequence[int]) -> None:
    count, words = recording.scenario.robots.count, ",".join(map(str, robots))
    if missing := [robot for robot in robots if not 0 <= robot < count]:
        raise InputError(f"--robots {words}: no robot {missing[0]} in the run; expected numbers from 0 to {count - 1}")
    if (maps := len(set(robots))) > MOST:
        raise InputError(f"--robots {words}: {maps} maps cannot be read side by side; expected at most {MOST}")


def _check_iteration(recording: Recording, option: str, iteration: int) -> None:
    if not recording.iterations:
        raise InputError(f"{recording.path}: no whole iteration was recorded; expected at least one")
    if not 0 <= iteration < recording.iterations:
        raise InputError(f"{option} {iteration}: no such iteration; expected 0 to {recording.iterations - 1}")


def _titled(recording: Recording) -> str:
    return f"{recording.scenario.title}\nseed {recording.scenario.seed}"


def _save(figures: Mapping[Path, Figure], option: str, dpi: int = 150) -> list[Path]:
    """Save figures under their stems as PNG and SVG, and return the files. Raises InputError, naming the option."""
    try:
        return [path for stem, figure in figures.items() for path in plots.save(figure, stem, dpi)]
    except OSError as problem:
        raise unwritten(f"{option} {problem.filename}", problem, "a place for figures") from problem
