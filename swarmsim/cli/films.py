"""The verb of films."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from swarmsim.cli.interruption import told_if_interrupted
from swarmsim.cli.options import AllowCode
from swarmsim.cli.progress import Counted, progress_bar

if TYPE_CHECKING:
    from rich.progress import Progress

    from swarmsim.api.recorded import Run
    from swarmsim.view.video import Film

DRAWN = ("beams", "tiles", "links", "ways", "people", "events", "panel", "jobs", "own")  # as view.style has them


def video(
    recording: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run, or its recording.")],
    out: Annotated[
        Path, typer.Argument(metavar="OUT.mp4", help="Film to write: .mp4 or .gif; .png for numbered pictures.")
    ],
    fps: Annotated[int, typer.Option(help="Frames per second of film.")] = 30,
    speed: Annotated[float, typer.Option(help="Simulated seconds per second of film.")] = 20.0,
    size: Annotated[str, typer.Option(help="Width x height in pixels.")] = "1280x720",
    theme: Annotated[str, typer.Option(help="Colours: dark or light.")] = "dark",
    show: Annotated[
        str | None, typer.Option(metavar="LAYER,...", help=f"Layers to draw; by default {','.join(DRAWN)}.")
    ] = None,
    hide: Annotated[str | None, typer.Option(metavar="LAYER,...", help="Layers not to draw.")] = None,
    focus: Annotated[int | None, typer.Option(metavar="I", help="Show the map of one robot, and magnify it.")] = None,
    robots: Annotated[
        str | None, typer.Option(metavar="I,J,...", help="Show tiles, beams and ways of these robots alone.")
    ] = None,
    beside: Annotated[
        Path | None, typer.Option("--side-by-side", metavar="RUN_B", help="A second run to show in step.")
    ] = None,
    frames: Annotated[
        bool, typer.Option("--frames", help="Show how robots that share by merge find each other's frames.")
    ] = False,
    cards: Annotated[bool, typer.Option(help="Begin with the scenario and end with the result.")] = True,
    allow_code: AllowCode = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print nothing but errors.")] = False,
) -> None:
    """Make a film from a recording.

    Example: swarmsim video runs/basilica-1 basilica.mp4 --speed 40

    One robot's own map, on paper: swarmsim video runs/basilica-1 three.mp4 --focus 3 --theme light

    With --frames the run is simulated again.
    """
    from swarmsim.api.runs import open as open_run
    from swarmsim.view.style import look
    from swarmsim.view.video import Film

    how = Film(fps, speed, _size(size), look(theme, show, hide, focus, robots), cards)
    run = open_run(recording)
    other = None if beside is None else open_run(beside)
    with progress_bar(quiet) as progress, told_if_interrupted(lambda: f"{out} was not written"):
        film(run, out, progress, how, other, frames)


def film(
    run: Run, out: Path, progress: Progress, how: Film | None = None, beside: Run | None = None, frames: bool = False
) -> None:
    """Write a film with a progress bar, and print its path."""
    from swarmsim.api.films import filmed
    from swarmsim.view.layers.own import left_out
    from swarmsim.view.video import Film

    other = None if beside is None else beside.recording
    if notice := left_out(run.recording.scenario):
        progress.console.print(notice)
    told = Counted(progress, "filming", "frame {} of {}")
    filmed(run.recording, str(run.path), out, how or Film(), other, frames, told)
    progress.console.print(f"film: {out}")


def _size(text: str) -> tuple[int, int]:
    from swarmsim.core.errors import InputError

    width, _, height = text.partition("x")
    if not (width.isdecimal() and height.isdecimal()):
        raise InputError(f"--size {text}: expected width x height in pixels, as in 1280x720")
    return int(width), int(height)
