"""The command line: verbs only, which parse, call and print."""

from __future__ import annotations

import os
import sys
from typing import Annotated

import typer

from swarmsim.cli import (
    comparisons,
    doctor,
    examples,
    exports,
    figures,
    films,
    network,
    parts,
    reports,
    reproductions,
    runs,
    studies,
    views,
    worlds,
)
from swarmsim.cli.waiting import told_how_long

BAD_INPUT, PART_FAILED, NO_ROOM = 2, 3, 4  # exit codes

app = typer.Typer(
    help="Simulate robot swarms: a scenario in, a recording, a summary and a film out.\n\n"
    "Example: swarmsim run scenarios/basilica.toml --out runs/basilica --video runs/basilica.mp4",
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)
for verb in (
    runs.run,
    films.video,
    reports.report,
    views.view,
    runs.show,
    runs.verify,
    exports.export,
    comparisons.compare,
    reproductions.reproduce,
    network.network,
    parts.parts,
    parts.new,
    runs.schema,
    doctor.doctor,
):
    app.command()(verb)
app.add_typer(studies.app, name="study")
app.add_typer(figures.app, name="figure")
app.add_typer(worlds.app, name="world")
app.add_typer(examples.app, name="examples")


def main() -> None:
    """Run the command line.

    Bad input ends with its message and exit code 2, a part that is not ours with 3, a disk that is full with 4. The end
    that SIGTERM asks for is that of Ctrl-C, with exit code 143 instead of 130.
    """
    from swarmsim.cli.interruption import end_upon_signals
    from swarmsim.core.errors import InputError, PartError, StorageError

    end_upon_signals()
    try:
        app()
    except InputError as problem:
        print(f"swarmsim: {problem}", file=sys.stderr)
        sys.exit(BAD_INPUT)
    except OSError as problem:  # what the system says of files that parts of ours have not looked at first
        if problem.filename is None:
            raise
        print(f"swarmsim: {str(problem.filename)[:200]}: {problem.strerror}", file=sys.stderr)
        sys.exit(BAD_INPUT)
    except PartError as problem:
        print(f"swarmsim: {problem}", file=sys.stderr)
        sys.exit(PART_FAILED)
    except StorageError as problem:
        print(f"swarmsim: {problem}", file=sys.stderr)
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(NO_ROOM)  # HDF5 would try to write the rest when the interpreter ends, and crash


def _version(asked: bool) -> None:
    if asked:
        from swarmsim import __version__

        print(f"swarmsim {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and stop.")
    ] = False,
) -> None:
    context.with_resource(told_how_long(quiet=False))
