"""Options that several verbs have."""

from __future__ import annotations

from typing import Annotated

import typer

from swarmsim.cli.completion import fault_words, set_keys


def _let_code_run(context: typer.Context, allowed: bool) -> bool:
    """For as long as the verb runs, whether scenarios may name code of their own."""
    from swarmsim.core import registry

    context.with_resource(registry.own_code(allowed))
    return allowed


AllowCode = Annotated[
    bool,
    typer.Option(
        "--allow-code",
        callback=_let_code_run,
        help="Let the scenario run code of its own: parts named as ./file.py:Name or module:Name.",
    ),
]

Overrides = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", autocompletion=set_keys, help="Override a key; the value is TOML."),
]
Faults = Annotated[
    list[str] | None,
    typer.Option(
        "--fault", metavar="'KIND KEY=VALUE ...'", autocompletion=fault_words, help="One more fault, in words."
    ),
]
Seed = Annotated[int | None, typer.Option(help="Seed, instead of the scenario's.")]
