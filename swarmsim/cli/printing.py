"""Options of the verbs that draw figures for print."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import wraps
from typing import Annotated, Final, Literal

import typer

Form = Annotated[
    Literal["markdown", "latex", "csv"] | None,
    typer.Option("--format", help="Print tables for documents instead: markdown, latex (booktabs) or csv."),
]

PRINTED: Final[tuple[Literal["pdf", "svg"], ...]] = ("pdf", "svg")


def _options(
    *,
    pdf: Annotated[bool, typer.Option("--pdf", help="Write a PDF, with text as text.")] = False,
    svg: Annotated[bool, typer.Option("--svg", help="Write an SVG, with text as text.")] = False,
    width: Annotated[
        str | None, typer.Option(metavar="252pt", help="Width of the figure, in pt, mm, cm or in; default: by content.")
    ] = None,
    font: Annotated[str | None, typer.Option(metavar="FAMILY", help="An installed font.")] = None,
    no_title: Annotated[bool, typer.Option("--no-title", help="Leave out the title.")] = False,
    style: Annotated[
        Literal["paper", "slides", "dark"], typer.Option(help="Letters and colours for paper, slides or a dark ground.")
    ] = "paper",
) -> None:
    """The options, which `for_print` adds to a verb."""


def for_print(verb: Callable[..., None]) -> Callable[..., None]:
    """The same verb with the options of figures for print."""
    own = inspect.signature(verb, eval_str=True)
    added = inspect.signature(_options, eval_str=True).parameters

    @wraps(verb)
    def printed(**given: object) -> None:
        asked = {name: given.pop(name) for name in added}
        if all(value == added[name].default for name, value in asked.items()):  # matplotlib is slow to import
            verb(**given)
            return
        from swarmsim.view.plots import printing

        kinds = [kind for kind in PRINTED if asked[kind]]
        keys = {"width": asked["width"], "font": asked["font"], "style": asked["style"]}
        with printing(kinds=kinds, title=not asked["no_title"], **keys):  # type: ignore[arg-type]
            verb(**given)

    parameters = [*own.parameters.values(), *added.values()]
    printed.__signature__ = own.replace(parameters=parameters)  # type: ignore[attr-defined]
    printed.__annotations__ = {one.name: one.annotation for one in parameters}
    return printed
