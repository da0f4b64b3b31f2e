"""The command line: verbs only, which parse, call and print."""

from __future__ import annotations

import sys
from contextlib import suppress
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
from swarmsim.cli.interruption import end_if_asked, end_upon_signals, told_if_interrupted
from swarmsim.cli.printed import drop_unwritten, printed
from swarmsim.cli.waiting import told_how_long
from swarmsim.core.errors import InputError, PartError, StorageError, is_of_the_machine

BAD_INPUT, PART_FAILED, NO_ROOM = 2, 3, 4  # exit codes
CLOSED = 141  # as shells give it for SIGPIPE

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
    figures.plot,
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

    Bad input ends with its message and exit code 2, a part that is not ours with 3, a disk that is full with 4, also
    where it is standard output that cannot be written. A reader that closes the pipe ends it quietly. The end that
    SIGTERM asks for is that of Ctrl-C, with exit code 143 instead of 130.
    """
    end_upon_signals()
    with printed():
        code = _code()
    drop_unwritten()
    sys.exit(code)


def _code() -> int | str | None:
    """Do what was typed, and say how it ended."""
    try:
        with told_if_interrupted():
            try:
                app()
            finally:
                end_if_asked()  # typer keeps to itself what it was ended by
                sys.stdout.flush()  # here, where it can be told if that fails
    except typer.Exit as end:
        return end.exit_code
    except SystemExit as end:
        return CLOSED if isinstance(end.__context__, BrokenPipeError) else end.code
    except BrokenPipeError:
        return CLOSED
    except InputError as problem:
        return _said(problem, BAD_INPUT)
    except PartError as problem:
        return _said(problem, PART_FAILED)
    except StorageError as problem:
        return _said(problem, NO_ROOM)
    except OSError as problem:  # what the system says of files that parts of ours have not looked at first
        if is_of_the_machine(problem):
            return _said(f"{problem.filename or 'a file'}: {problem.strerror}", NO_ROOM)
        if problem.filename is None:
            raise
        return _said(f"{str(problem.filename)[:200]}: {problem.strerror}", BAD_INPUT)
    return None


def _said(problem: object, code: int) -> int:
    with suppress(OSError, StorageError):  # a disk may be too full for that too
        print(f"swarmsim: {problem}", file=sys.stderr)
    return code


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
