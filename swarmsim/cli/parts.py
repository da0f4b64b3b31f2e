"""The verbs of parts: list them, and start a new one."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from swarmsim.api import skeletons

if TYPE_CHECKING:
    from collections.abc import Sequence

    from swarmsim.core.scenario.describe import Parameter, PartDescription


def parts(
    which: Annotated[
        str | None, typer.Argument(metavar="[SEAM[.NAME]|KEY]", help="A seam, one part of it, or a key.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")] = False,
) -> None:
    """List the parts that scenarios can name, built-in and third-party, with their keys; or tell a scenario's key.

    Example: swarmsim parts topology.knn

    A key, or a table with its keys: swarmsim parts robots.wheel_base
    """
    from swarmsim.api import reference
    from swarmsim.core.scenario import describe
    from swarmsim.core.seams import SEAMS

    if which is not None and which.partition(".")[0] not in SEAMS and reference.has(which):
        told = reference.key(which)
        if as_json:
            print(json.dumps([dataclasses.asdict(one) for one in told], indent=2))
        else:
            _keys(told)
        return
    found = describe.parts(which)
    if as_json:
        print(json.dumps([describe.plain(one) for one in found], indent=2))
    elif "." in (which or ""):
        _one(found[0])
    else:
        for each in SEAMS:
            _all(each, [one for one in found if one.seam == each])


def _all(seam: str, found: list[PartDescription]) -> None:
    from rich.markup import escape
    from rich.table import Table

    from swarmsim.cli.console import VisibleConsole

    if not found:
        return
    table = Table(title=f"{seam} (* is the default)", title_justify="left", expand=True)
    table.add_column("part", no_wrap=True)
    table.add_column("what it is", ratio=1, overflow="fold")
    table.add_column("from", no_wrap=True)
    for one in found:
        table.add_row(f"{one.name}{' *' if one.default else ''}", escape(one.first), escape(one.origin))
    VisibleConsole().print(table)


def _one(one: PartDescription) -> None:
    from rich.markup import escape

    from swarmsim.cli.console import VisibleConsole

    console = VisibleConsole()
    console.print(f"[bold]{one.seam}.{one.name}[/bold], from {escape(one.origin)}{', the default' * one.default}\n")
    for paragraph in one.text.split("\n\n"):
        console.print(escape(" ".join(paragraph.split())) + "\n")
    if not one.parameters:
        console.print("It has no keys.")
        return
    _keys(one.parameters)


def _keys(found: Sequence[Parameter]) -> None:
    from rich.markup import escape
    from rich.table import Table

    from swarmsim.cli.console import VisibleConsole

    table = Table(expand=True)
    table.add_column("key", no_wrap=True)
    for head, share in (("value", 5), ("default", 3), ("meaning", 6)):
        table.add_column(head, ratio=share, overflow="fold")
    for each in found:
        default = "required" if each.default is None else each.default
        table.add_row(*(escape(cell) for cell in (each.key, each.kind, default, each.meaning)))
    VisibleConsole().print(table)


def new(
    kind: Annotated[str, typer.Argument(help=f"{', '.join(skeletons.kinds()[:-1])} or {skeletons.kinds()[-1]}.")],
    name: Annotated[str, typer.Argument(help="A word such as my_rule; the part is called MyRule.")],
    to: Annotated[Path, typer.Option(help="Folder, such as that of your scenario.")] = Path(),
) -> None:
    """Write a custom part to start from, with a passing test.

    Example: swarmsim new mind explorer --to .
    """
    for path in skeletons.new(kind, name, to):
        print(path)
    print(skeletons.advice(kind, name))
