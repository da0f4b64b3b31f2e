"""The console of tables and progress bars: rich's, through which text from files cannot steer the terminal."""

from __future__ import annotations

from collections.abc import Iterable
from typing import IO, cast

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment

from swarmsim.cli.printed import Printed, visible


class VisibleConsole(Console):
    """A console that shows the text it is given without control characters; those of its own it writes."""

    def __init__(self, quiet: bool = False, width: int | None = None) -> None:
        super().__init__(quiet=quiet, width=width)

    @property
    def file(self) -> IO[str]:
        """Where it writes: standard output, whatever that is at the time."""
        found = super().file
        return cast(IO[str], found.unchanged()) if isinstance(found, Printed) else found

    @file.setter
    def file(self, new: IO[str]) -> None:
        raise AttributeError("a console writes to standard output")

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """The segments of what is to be shown."""
        for segment in super().render(renderable, options):
            yield segment if segment.control else segment._replace(text=visible(segment.text))
