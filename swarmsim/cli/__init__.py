"""The command line: verbs that parse, call and print."""

from __future__ import annotations

import sys
from contextlib import suppress
from typing import Annotated

import typer

from swarmsim.cli import (
    benchmark,
    comparisons,
    doctor,
    examples,
    expectations,
    exports,
    figures,
    films,
    fleets,
    logs,
    network,
    parts,
    radios,
    reports,
    reproductions,
    robots,
    runs,
    sizes,
    studies,
    views,
    worlds,
)
from swarmsim.cli.interruption import end_if_asked, end_upon_signals, told_if_interrupted
from swarmsim.cli.printed import drop_unwritten, printed
from swarmsim.cli.waiting import told_how_long
from swarmsim.core.errors import InputError, PartError, StorageError, is_of_the_machine

BAD_INPUT, PART_FAILED, NO_ROOM = 2, 3, 4  # exit codes
CLOSED = 141  # a shell's exit code for SIGPIPE

app = typer.Typer(
    help="Simulate robot swarms: a scenario in, a recording, a summary and a film out.\n\n"
    "Example: swarmsim run basilica --out runs/basilica --video runs/basilica.mp4",
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
    logs.import_log,
    comparisons.compare,
    expectations.test,
    sizes.size,
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
app.add_typer(benchmark.app, name="benchmark")
app.add_typer(figures.app, name="figure")
app.add_typer(worlds.app, name="world")
app.add_typer(examples.app, name="examples")
app.add_typer(radios.app, name="radio")
app.add_typer(fleets.fleet, name="fleet")
app.add_typer(robots.robot, name="robot")


def main() -> None:
    """Run the command line.

    Bad input ends with a message and exit code 2, a failing third-party part with 3, a full disk or unwritable
    standard output with 4. A closed pipe ends it quietly. SIGTERM ends it like Ctrl-C, with exit code 143 instead
    of 130.
    """
    end_upon_signals()
    with printed():
        code = _code()
    drop_unwritten()
    sys.exit(code)


def _code() -> int | str | None:
    """Run the command and return its exit code."""
    try:
        with told_if_interrupted():
            try:
                app()
            finally:
                end_if_asked()  # typer swallows the exception that ended it
                sys.stdout.flush()  # here, where a failure can be reported
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
    except OSError as problem:  # errors about files that no code of ours checked first
        if is_of_the_machine(problem):
            return _said(f"{problem.filename or 'a file'}: {problem.strerror}", NO_ROOM)
        if problem.filename is None:
            raise
        return _said(f"{str(problem.filename)[:200]}: {problem.strerror}", BAD_INPUT)
    return None


def _said(problem: object, code: int) -> int:
    with suppress(OSError, StorageError):  # the disk may be too full for this too
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
