"""A table as a picture."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle

from swarmsim.view.plots.sheet import sheet
from swarmsim.view.plots.style import DPI, PALE, styled


@styled
def table(columns: Sequence[str], rows: Sequence[Sequence[str]], title: str) -> Figure:
    """A table as a picture; columns fit their widest text, and all but the first are right-aligned."""
    figure = sheet(1.0, 1.0, "")
    lines = [[figure.text(0, 0, text, va="center") for text in row] for row in (columns, *rows)]
    heading = figure.text(0, 0, title, size=12, weight="bold", va="center")
    for text in lines[0]:
        text.set_fontweight("bold")
    widths = [max(text.get_window_extent().width / DPI for text in column) for column in zip(*lines, strict=True)]
    line, gap, margin = 0.28, 0.36, 0.25
    ends = margin - 0.5 * gap + np.cumsum(np.array(widths) + gap)  # the right edge of each column's text
    width = max(ends[-1] + 0.5 * gap, margin + heading.get_window_extent().width / DPI) + margin
    height = 2 * margin + line * (len(lines) + 1.3)
    figure.set_size_inches(width, height)
    heading.set_position((margin / width, 1 - (margin + 0.4 * line) / height))
    for row, texts in enumerate(lines):
        middle = 1 - (margin + line * (1.8 + row)) / height
        for at, text in enumerate(texts):
            text.set(x=(ends[at] if at else margin) / width, y=middle, ha="right" if at else "left")
        if row % 2:
            stripe = Rectangle((0.5 * margin / width, middle - 0.5 * line / height), 1 - margin / width, line / height)
            figure.add_artist(stripe).set(facecolor=PALE, alpha=0.6, zorder=0)
    figure.add_artist(
        Line2D((0.5 * margin / width, 1 - 0.5 * margin / width), 2 * [1 - (margin + 2.3 * line) / height])
    )
    figure.set_layout_engine("none")
    return figure
