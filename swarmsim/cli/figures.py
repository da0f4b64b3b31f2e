"""The verbs of figures: single moments of a run, as in the reference paper."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from swarmsim.cli.network import save_all
from swarmsim.cli.options import AllowCode

if TYPE_CHECKING:
    from swarmsim.recording.reader import Recording

app = typer.Typer(
    help="Draw single moments of a run for print: PNG (300 dots per inch) and SVG.\n\n"
    "Example: swarmsim figure local-maps runs/basilica-1 --robots 1,2,3 --at 100",
    no_args_is_help=True,
    rich_markup_mode=None,
)

PRINT = 300  # dots per inch
MOST = 12  # maps in one figure that can still be read

Run = Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run, or its recording.")]
Stem = Annotated[
    Path | None, typer.Option(metavar="FOLDER/NAME", help="Figure to write, without .png and .svg; default: in RUN.")
]


@app.command()
def local_maps(
    recording: Run,
    robots: Annotated[str, typer.Option(metavar="I,J,...", help="The robots, by number from 0.")],
    at: Annotated[int, typer.Option(metavar="N", help="The iteration.")],
    out: Stem = None,
) -> None:
    """Draw the maps that single robots have at the end of an iteration, side by side (the paper's Fig. 3).

    Example: swarmsim figure local-maps runs/basilica-1 --robots 1,2,3 --at 100
    """
    from swarmsim.core.errors import InputError
    from swarmsim.core.state import UNKNOWN
    from swarmsim.operations.mapping.replay import MapReplay
    from swarmsim.recording.reader import Recording
    from swarmsim.view import plots
    from swarmsim.view.scene import Scene

    opened = Recording(recording)
    if "changes" not in opened:
        raise InputError(f"{recording}: these robots kept no maps; expected the run of a swarm that maps")
    chosen = _robots(opened, robots)
    _check_iteration(opened, "--at", at)
    replay = MapReplay(opened)
    replay.advance(at)
    known = (replay.maps[:, opened["domain"]] != UNKNOWN).mean(axis=1)
    shares = (opened.rows("covered", opened.scenario.robots.count)[at] if "covered" in opened else known).tolist()
    title = f"Local maps: {opened.scenario.title}\nseed {opened.scenario.seed}, iteration {at}"
    figure = plots.local_maps(Scene(opened), replay.maps, shares, chosen, at, title)
    stem = out or opened.path.parent / f"local-maps-{at}"
    for path in save_all({stem: figure}, "--out", PRINT):
        print(path)


@app.command()
def network(
    recording: Run,
    at: Annotated[int, typer.Option(metavar="N", help="The iteration on the left.")],
    and_: Annotated[int, typer.Option("--and", metavar="M", help="The iteration on the right.")],
    out: Stem = None,
) -> None:
    """Draw who hears whom at two iterations, and whose neighbours differ (the paper's Fig. 5).

    Example: swarmsim figure network runs/basilica-1 --at 100 --and 110
    """
    from swarmsim.core.errors import InputError
    from swarmsim.recording.reader import Recording
    from swarmsim.view import plots
    from swarmsim.view.scene import Scene

    opened = Recording(recording)
    for option, iteration in (("--at", at), ("--and", and_)):
        _check_iteration(opened, option, iteration)
    if at == and_:
        raise InputError(f"--and {and_}: the same iteration as --at; expected another one")
    letters = {iteration: opened.letters(iteration) for iteration in (at, and_)}
    heard = {iteration: rows[rows[:, 4] == 0, :2] for iteration, rows in letters.items()}
    title = f"Who hears whom: {opened.scenario.title}\nseed {opened.scenario.seed}, iterations {at} and {and_}"
    stem = out or opened.path.parent / f"network-{at}-{and_}"
    for path in save_all({stem: plots.rewiring(Scene(opened), heard, title)}, "--out", PRINT):
        print(path)


@app.command()
def provenance(
    recording: Run,
    robot: Annotated[int, typer.Option(metavar="I", help="The robot, by number from 0.")],
    at: Annotated[int | None, typer.Option(metavar="N", help="The iteration; default: the last.")] = None,
    out: Stem = None,
    allow_code: AllowCode = False,
) -> None:
    """Draw who sensed what a robot knows, over how many links it came and how old it is; the run is simulated again.

    Example: swarmsim figure provenance runs/basilica-1 --robot 3 --at 200
    """
    import numpy as np

    from swarmsim.core.errors import InputError
    from swarmsim.engine.build import build
    from swarmsim.operations.mapping.measures.provenance import MapProvenance
    from swarmsim.recording.reader import Recording
    from swarmsim.view import plots
    from swarmsim.view.scene import Scene

    opened = Recording(recording)
    if "changes" not in opened:
        raise InputError(f"{recording}: these robots kept no maps; expected the run of a swarm that maps")
    last = opened.iterations - 1 if at is None else at
    _check_iteration(opened, "--at", last)
    _robots(opened, str(robot))
    made = build(opened.scenario, str(recording), opened.world)
    probe = MapProvenance(opened.scenario.robots.count, made.context.lattice)
    while made.simulation.state.iteration <= last and not made.simulation.over:
        made.simulation.tick([probe])
    title = f"What robot {robot} knows: {opened.scenario.title}\nseed {opened.scenario.seed}, iteration {last}"
    by, hops = probe.origins.by[robot], probe.origins.hops[robot]
    figure = plots.provenance(Scene(opened), robot, by, hops, probe.age(robot), np.array(probe.ages), title)
    stem = out or opened.path.parent / f"provenance-{robot}-{last}"
    for path in save_all({stem: figure}, "--out", PRINT):
        print(path)


def _robots(recording: Recording, text: str) -> list[int]:
    """The robots in a list such as 1,2,3, each once. Raises InputError."""
    from swarmsim.core.errors import InputError

    count = recording.scenario.robots.count
    words = [word.strip() for word in text.split(",")]
    if not all(word.isdecimal() for word in words):
        raise InputError(f"--robots {text}: not a list of robots; expected numbers from 0 to {count - 1}, as in 0,1")
    robots = list(dict.fromkeys(map(int, words)))
    if missing := [robot for robot in robots if robot >= count]:
        raise InputError(f"--robots {text}: no robot {missing[0]} in the run; expected numbers from 0 to {count - 1}")
    if len(robots) > MOST:
        raise InputError(f"--robots {text}: {len(robots)} maps cannot be read side by side; expected at most {MOST}")
    return robots


def _check_iteration(recording: Recording, option: str, iteration: int) -> None:
    from swarmsim.core.errors import InputError

    if not recording.iterations:
        raise InputError(f"{recording.path}: no whole iteration was recorded; expected at least one")
    if not 0 <= iteration < recording.iterations:
        raise InputError(f"{option} {iteration}: no such iteration; expected 0 to {recording.iterations - 1}")
