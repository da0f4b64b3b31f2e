"""The verbs of shipped scenarios: list, run, copy."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from swarmsim.cli.completion import example_names

app = typer.Typer(
    help="List, run and copy the scenarios that come with swarmsim.\n\nExample: swarmsim examples run room",
    invoke_without_command=True,
    rich_markup_mode=None,
)

Name = Annotated[str, typer.Argument(metavar="NAME", autocompletion=example_names, help="As in the list.")]


@app.callback()
def _listed(context: typer.Context) -> None:
    if context.invoked_subcommand is not None:
        return
    from swarmsim.cli.tables import print_table
    from swarmsim.core.scenario import shipped

    print_table("examples", ("name", "what it shows"), list(shipped.examples().items()))
    print("run one:  swarmsim examples run room --video room.mp4\ncopy one: swarmsim examples copy room my-folder")


@app.command()
def run(
    name: Name,
    seed: Annotated[int | None, typer.Option(help="Seed, instead of the scenario's.")] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for the recording; it must not exist yet.")] = None,
    video: Annotated[Path | None, typer.Option(help="Film to write: .mp4 or .gif.")] = None,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print nothing but errors.")] = False,
) -> None:
    """Run a scenario that comes with swarmsim, as `swarmsim run` does.

    Example: swarmsim examples run faults/blind --video blind.mp4
    """
    from swarmsim.cli.runs import run as run_scenario
    from swarmsim.core.scenario import shipped

    run_scenario(shipped.example(name), seed=seed, out=out, video=video, quiet=quiet)


@app.command()
def copy(
    name: Name,
    folder: Annotated[Path, typer.Argument(help="Folder for the copy; created if missing.")],
) -> None:
    """Copy a scenario with its world, to change it.

    Example: swarmsim examples copy basilica my-folder
    """
    from swarmsim.core.scenario import shipped

    copies = shipped.copy(name, folder)
    for path in copies:
        print(path)
    print(f"run it: swarmsim run {copies[0]}")
