"""The verb of films."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from swarmsim.cli.interruption import told_if_interrupted
from swarmsim.cli.options import AllowCode
from swarmsim.cli.progress import progress_bar

if TYPE_CHECKING:
    from rich.progress import Progress

    from swarmsim.recording.reader import Recording
    from swarmsim.view.video import Film

DRAWN = ("beams", "tiles", "links", "ways", "people", "events", "panel", "own")  # as view.style has them


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
        str | None, typer.Option(metavar="LAYER,...", help=f"What is drawn; by default {','.join(DRAWN)}.")
    ] = None,
    hide: Annotated[str | None, typer.Option(metavar="LAYER,...", help="What is not drawn.")] = None,
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
    from swarmsim.core.errors import InputError
    from swarmsim.recording.reader import Recording
    from swarmsim.view.style import look
    from swarmsim.view.video import Film, check_film

    how = Film(fps, speed, _size(size), look(theme, show, hide, focus, robots), cards)
    check_film(out, how)
    if frames:
        if any(given is not None for given in (show, hide, focus, robots, beside)):
            raise InputError("--frames: such a film has a look of its own; expected --fps, --speed, --size or --theme")
        with progress_bar(quiet) as progress, told_if_interrupted(lambda: f"{out} was not written"):
            _film_of_frames(recording, out, progress, how)
        return
    with progress_bar(quiet) as progress:
        other = None if beside is None else Recording(beside)
        with told_if_interrupted(lambda: f"{out} was not written"):
            film(Recording(recording), out, progress, how, other)


def film(
    recording: Recording, out: Path, progress: Progress, how: Film | None = None, beside: Recording | None = None
) -> None:
    """Write a film with a progress bar, and say where it is."""
    from swarmsim.view.layers.own import left_out
    from swarmsim.view.video import write_film

    if told := left_out(recording.scenario):
        progress.console.print(told)
    task = progress.add_task("filming", total=None, text="")

    def at(frame: int, frames: int) -> None:
        progress.update(task, completed=frame, total=frames, text=f"frame {frame} of {frames}")

    write_film(recording, out, how, beside, at)
    progress.console.print(f"film: {out}")


def _film_of_frames(path: Path, out: Path, progress: Progress, how: Film) -> None:
    from swarmsim.core.errors import InputError
    from swarmsim.engine.build import build
    from swarmsim.recording.reader import Recording
    from swarmsim.view.frames_film import Gathering
    from swarmsim.view.scene import Scene
    from swarmsim.view.video import write_pictures

    opened = Recording(path)
    if not opened.scenario.mind.computation.declares("merges", False):
        raise InputError(
            f"--frames: the robots of {path} have one frame of reference; expected mind.computation.sharing.use = merge"
        )
    made = build(opened.scenario, str(path), opened.world)
    gathering = Gathering(Scene(opened), made.context.start, how)
    task = progress.add_task("filming", total=None, text="")

    def at(frame: int, of: int) -> None:
        progress.update(task, completed=frame, total=of, text=f"frame {frame} of {of}")

    def tick() -> bool:
        if not made.simulation.over:
            made.simulation.tick([gathering])
        return not made.simulation.over

    write_pictures(out, how, lambda taken: gathering.pictures(tick, at, taken))
    progress.console.print(f"film: {out}")


def _size(text: str) -> tuple[int, int]:
    from swarmsim.core.errors import InputError

    width, _, height = text.partition("x")
    if not (width.isdecimal() and height.isdecimal()):
        raise InputError(f"--size {text}: expected width x height in pixels, as in 1280x720")
    return int(width), int(height)
