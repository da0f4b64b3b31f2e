"""The verbs of figures of a run: any of them by name and, as in the reference paper, single moments."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from swarmsim.cli.options import AllowCode
from swarmsim.cli.printing import for_print

if TYPE_CHECKING:
    from swarmsim.api.recorded import Run as RecordedRun

app = typer.Typer(
    help="Draw single moments of a run for print: PNG (300 dots per inch), SVG and PDF.\n\n"
    "Example: swarmsim figure local-maps runs/basilica-1 --robots 1,2,3 --at 100",
    no_args_is_help=True,
    rich_markup_mode=None,
)

Run = Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run, or its recording.")]
Stem = Annotated[
    Path | None,
    typer.Option(
        metavar="FOLDER/NAME",
        help="Figure to write, by its suffix or as PNG and SVG; default: in RUN.",
    ),
]


@for_print
def plot(
    recording: Run,
    figure: Annotated[
        str,
        typer.Option(metavar="NAME", help="One that 'swarmsim parts figure' lists, or ./file.py:NAME of your own."),
    ] = "curve",
    set_: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="A key of the figure; the value is TOML, or a text."),
    ] = None,
    out: Stem = None,
    allow_code: AllowCode = False,
) -> None:
    """Draw a figure of a run for print: what its task is about, or any other by its name.

    Example: swarmsim plot runs/basilica-1 --figure local-maps --set robots=[1,2,3] --set at=100

    For a column of a paper: --out maps.pdf --width 252pt --no-title
    """
    from swarmsim.api.runs import open as open_run

    _print(open_run(recording).figure(figure, out, overrides=set_, allow_code=allow_code))


@app.command()
@for_print
def local_maps(
    recording: Run,
    robots: Annotated[str, typer.Option(metavar="I,J,...", help="The robots, by number from 0.")],
    at: Annotated[int, typer.Option(metavar="N", help="The iteration.")],
    out: Stem = None,
) -> None:
    """Draw single robots' maps at the end of an iteration, side by side (the paper's Fig. 3).

    Example: swarmsim figure local-maps runs/basilica-1 --robots 1,2,3 --at 100
    """
    from swarmsim.api.runs import open as open_run

    run = open_run(recording)
    _print(run.figure_local_maps(_numbers(robots, run), at, out))


@app.command()
@for_print
def network(
    recording: Run,
    at: Annotated[int, typer.Option(metavar="N", help="The iteration on the left.")],
    and_: Annotated[int, typer.Option("--and", metavar="M", help="The iteration on the right.")],
    out: Stem = None,
) -> None:
    """Draw who hears whom at two iterations, and the robots whose neighbours differ (the paper's Fig. 5).

    Example: swarmsim figure network runs/basilica-1 --at 100 --and 110
    """
    from swarmsim.api.runs import open as open_run

    _print(open_run(recording).figure_network(at, and_, out))


@app.command()
@for_print
def provenance(
    recording: Run,
    robot: Annotated[int, typer.Option(metavar="I", help="The robot, by number from 0.")],
    at: Annotated[int | None, typer.Option(metavar="N", help="The iteration; default: the last.")] = None,
    out: Stem = None,
    allow_code: AllowCode = False,
) -> None:
    """Draw where a robot's knowledge comes from: its sensing robots, links and age. The run is simulated again.

    Example: swarmsim figure provenance runs/basilica-1 --robot 3 --at 200
    """
    from swarmsim.api.runs import open as open_run

    _print(open_run(recording).figure_provenance(robot, at, out, allow_code=allow_code))


def _print(paths: list[Path]) -> None:
    for path in paths:
        print(path)


def _numbers(text: str, run: RecordedRun) -> list[int]:
    """The numbers in a list such as 1,2,3. Raises InputError."""
    from swarmsim.core.errors import InputError

    words = [word.strip() for word in text.split(",")]
    if not all(word.isdecimal() for word in words):
        last = run.recording.scenario.robots.count - 1
        raise InputError(f"--robots {text}: not a list of robots; expected numbers from 0 to {last}, as in 0,1")
    return [int(word) for word in words]
