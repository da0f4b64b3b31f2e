"""The verb `world import`: asks on the terminal for what a floor plan does not say."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


class Terminal:
    """Asks on the terminal."""

    def choice(self, question: str, default: bool) -> bool:
        """Yes or no."""
        return bool(typer.confirm(question, default=default))

    def length(self, question: str, key: str) -> float:
        """A number of metres above 0; asks until it gets one."""
        while True:
            text = self.text(question, key).removesuffix("m").replace(",", ".").strip()
            try:
                value = float(text)
            except ValueError:
                value = 0.0
            if 0.0 < value < 1e4:
                return value
            print(f"{text!r} is not a number of metres; expected for example 24.5")

    def text(self, question: str, key: str) -> str:
        """A name."""
        return str(typer.prompt(question, type=str, prompt_suffix=" ")).strip()

    def tell(self, sentence: object) -> None:
        """Print what was read."""
        print(sentence)


def import_(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A drawing, a map, a building model, an indoor map ...")],
    out: Annotated[
        Path | None, typer.Option(metavar="OUT.toml", help="Scenario to write; by default here, named after FILE.")
    ] = None,
    width: Annotated[float | None, typer.Option(metavar="METRES", help="Width of the page.")] = None,
    level: Annotated[str, typer.Option(metavar="NAME", help="The storey, of a file with several.")] = "",
    yes: Annotated[bool, typer.Option("--yes", help="Take every default, and ask nothing.")] = False,
) -> None:
    """Make a scenario from a floor plan, one question at a time.

    Each answer becomes a key of [world] in the written scenario; a picture beside it shows the result. A width that
    the file does not give is never guessed.

    Example: swarmsim world import plan.svg --width 24 --yes
    """
    from swarmsim.api.imports import Defaults, world_import
    from swarmsim.core.errors import InputError

    try:
        made = world_import(file, out, width=width, level=level, answers=Defaults(print) if yes else Terminal())
    except typer.Abort:
        raise InputError("not all questions were answered; nothing was written (--yes takes the defaults)") from None
    print(f"Wrote {made.scenario} and {made.picture}; look at the picture.")
    if made.problem:
        print(f"It does not run yet: {made.problem}")
        raise typer.Exit(2)
    took = f"  (about {made.seconds:.0f} s)" if made.seconds >= 1.0 else ""
    print(f"Next: swarmsim run {made.scenario} --video {made.scenario.stem}.mp4{took}")
