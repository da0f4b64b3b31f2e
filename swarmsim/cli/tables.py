"""Tables on the terminal, and in files and pipes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from swarmsim.core.tables import WRITERS, Form

WIDE: Final = 160  # columns of a table without a terminal


def print_table(title: str, head: Sequence[str], rows: Sequence[Sequence[str]], form: Form | None = None) -> None:
    """Print a table with names in its first column and numbers in the others, or in a `form` for documents."""
    if form is not None:
        print(WRITERS[form](head, rows))
        return
    from rich.table import Table

    from swarmsim.cli.console import VisibleConsole

    console = VisibleConsole()
    if not console.is_terminal:
        console = VisibleConsole(width=WIDE)  # files and pipes have no width
    shown = Table(title=title, title_justify="left")
    for number, name in enumerate(head):
        shown.add_column(name, justify="left" if number == 0 else "right", overflow="fold")
    for row in rows:
        shown.add_row(*row)
    console.print(shown)
