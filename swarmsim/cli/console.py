"""The console of tables and progress bars: rich's, safe from control characters in text from files."""

from __future__ import annotations

from collections.abc import Iterable
from typing import IO, cast

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment

from swarmsim.cli.printed import Printed, visible


class VisibleConsole(Console):
    """A console that strips control characters from text, but writes its own."""

    def __init__(self, quiet: bool = False, width: int | None = None) -> None:
        super().__init__(quiet=quiet, width=width)

    @property
    def file(self) -> IO[str]:
        """Its output: the current standard output."""
        found = super().file
        return cast(IO[str], found.unchanged()) if isinstance(found, Printed) else found

    @file.setter
    def file(self, new: IO[str]) -> None:
        raise AttributeError("a console writes to standard output")

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """The visible segments of a renderable."""
        for segment in super().render(renderable, options):
            yield segment if segment.control else segment._replace(text=visible(segment.text))
