"""A figure's size, legend and files, the same bytes every time."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path

from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from swarmsim.view.plots.style import DPI, styled


@styled
def save(figure: Figure, path: Path, dpi: int = DPI) -> tuple[Path, Path]:
    """Write the figure as `path`.png (`dpi` dots per inch) and `path`.svg, and give both paths.

    Equal figures give equal bytes: neither a date, nor a version, nor random names are written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    png, svg = (path.with_name(f"{path.name}.{kind}") for kind in ("png", "svg"))
    figure.savefig(png, format="png", dpi=dpi, metadata={"Software": None})
    figure.savefig(svg, format="svg", metadata={"Date": None, "Creator": None})
    return png, svg


@styled
def address(figure: Figure, dpi: int = DPI) -> str:
    """The figure as a data URL for a page."""
    file = BytesIO()
    figure.savefig(file, format="png", dpi=dpi, metadata={"Software": None})
    return f"data:image/png;base64,{b64encode(file.getvalue()).decode()}"


def sheet(width: float, height: float, title: str) -> Figure:
    """An empty figure in inches, outside any window or global list of figures."""
    figure = Figure((width, height), dpi=DPI)
    FigureCanvasAgg(figure)
    figure.set_layout_engine("constrained", w_pad=0.1, h_pad=0.08, wspace=0.05)
    figure.suptitle(title, x=0.02, ha="left", wrap=True)
    return figure


def settled(figure: Figure, handles: Sequence[Artist] = ()) -> Figure:
    """The figure with a legend below it, laid out once and for all: drawing it again moves nothing."""
    for rows in range(1, len(handles) + 1):  # as few rows as the width allows
        legend = figure.legend(handles=handles, loc="outside lower center", ncols=-(-len(handles) // rows))
        if rows == len(handles) or legend.get_window_extent().width < 0.96 * figure.bbox.width:
            break
        legend.remove()
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    return figure
