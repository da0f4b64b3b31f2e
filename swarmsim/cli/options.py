"""Options shared by several verbs."""

from __future__ import annotations

from typing import Annotated

import typer

from swarmsim.cli.completion import fault_words, set_keys
from swarmsim.cli.waiting import told_how_long


def _let_code_run(context: typer.Context, allowed: bool) -> bool:
    """Set whether scenarios may name their own code while the verb runs."""
    from swarmsim.core.scenario import registry

    context.with_resource(registry.own_code(allowed))
    return allowed


def _be_quiet(context: typer.Context, quiet: bool) -> bool:
    if quiet:
        context.with_resource(told_how_long(quiet))
    return quiet


Quiet = Annotated[bool, typer.Option("--quiet", callback=_be_quiet, help="Print nothing but errors.")]
AllowCode = Annotated[
    bool,
    typer.Option(
        "--allow-code",
        callback=_let_code_run,
        help="Let the scenario run its own code: parts named as ./file.py:Name or module:Name.",
    ),
]
KeepOld = Annotated[bool, typer.Option("--keep-old", help="Count runs of other code where there are no others.")]

Overrides = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        autocompletion=set_keys,
        help="Override a key; the value is TOML, and text needs no quotes.",
    ),
]
Faults = Annotated[
    list[str] | None,
    typer.Option(
        "--fault", metavar="'KIND KEY=VALUE ...'", autocompletion=fault_words, help="An additional fault, in words."
    ),
]
Seed = Annotated[int | None, typer.Option(help="Seed, instead of the scenario's.")]
