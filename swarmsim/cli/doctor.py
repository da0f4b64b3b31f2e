"""The verb that checks the installation, and says how to fix it."""

from __future__ import annotations

import typer

from swarmsim.cli.progress import compiling, progress_bar

BROKEN = 1  # exit code


def doctor() -> None:
    """Check the installation: versions, simulation, film, letters, compiled code, folders, display.

    Exit code 0: everything needed works; 1: something does not, and the table says what to do.

    Example: swarmsim doctor
    """
    from swarmsim.api.doctor import doctor as findings
    from swarmsim.cli.tables import print_table

    with progress_bar(quiet=False) as progress, compiling(progress):
        found = findings()
    states = {True: "works", False: "no"}
    rows = [(one.what, "BROKEN" if one.needed and not one.works else states[one.works], one.found) for one in found]
    print_table("swarmsim doctor", ("what", "state", "found, or what to do"), rows)
    raise typer.Exit(BROKEN if any(one.needed and not one.works for one in found) else 0)
