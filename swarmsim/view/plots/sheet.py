"""A figure's size, panels, legend and files, the same bytes every time."""

from __future__ import annotations

import textwrap
from base64 import b64encode
from collections.abc import Iterator, Sequence
from io import BytesIO
from pathlib import Path
from typing import Final, get_args

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.path import Path as Outline
from matplotlib.transforms import BboxTransformTo

from swarmsim.view.plots.dark import darken
from swarmsim.view.plots.style import COLUMN, DPI, Kind, asked_for, styled

UNDATED: Final[dict[Kind, dict[str, None]]] = {
    "png": {"Software": None},
    "svg": {"Date": None, "Creator": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}
CORNERS: Final = ("upper right", "lower right", "upper left", "lower left", "center right", "center left")
INSIDE: Final = 0.3  # of a panel's area, at most, for a legend inside it
TALLEST: Final = 12.0  # inches


@styled
def save(figure: Figure, path: Path, dpi: int = DPI) -> list[Path]:
    """Write the figure and give its files: those asked for, by the suffix of `path`, or PNG and SVG beside each other.

    A PNG has `dpi` dots per inch. Equal figures give equal bytes: neither a date, nor a version, nor random names are
    written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    suffixed = [kind for kind in get_args(Kind) if path.suffix.lower() == f".{kind}"]
    stem = path.with_suffix("") if suffixed else path
    files = []
    for kind in asked_for().kinds or suffixed or ("png", "svg"):
        files.append(stem.with_name(f"{stem.name}.{kind}"))
        figure.savefig(files[-1], format=kind, dpi=dpi, metadata=UNDATED[kind])
    return files


@styled
def address(figure: Figure, dpi: int = DPI) -> str:
    """The figure as a data URL for a page."""
    file = BytesIO()
    figure.savefig(file, format="png", dpi=dpi, metadata=UNDATED["png"])
    return f"data:image/png;base64,{b64encode(file.getvalue()).decode()}"


def sheet(width: float, height: float, title: str) -> Figure:
    """An empty figure, outside any window or global list of figures.

    `width` and `height`, in inches and without its legend, are what it needs if no other width is asked for.
    """
    asked = asked_for()
    if asked.width is not None:
        width, height = asked.width, height * (asked.width / width) ** 0.75  # letters do not shrink with the sheet
    figure = Figure((width, height), dpi=DPI)
    FigureCanvasAgg(figure)
    figure.set_layout_engine("constrained", w_pad=0.04, h_pad=0.04, wspace=0.05)
    if asked.title and title:
        figure.suptitle(title, x=0.02, ha="left", wrap=True)
    return figure


def is_narrow(figure: Figure) -> bool:
    """Whether panels have to stand below each other."""
    return figure.get_figwidth() < COLUMN


def side_by_side(figure: Figure, ratios: Sequence[float] = (1, 1), *, shared: bool = False) -> list[Axes]:
    """Two panels beside each other, with widths in `ratios`, or below each other on a narrow sheet.

    With `shared`, they have one y axis beside each other, and one x axis below each other.
    """
    if is_narrow(figure):
        figure.set_figheight(1.9 * figure.get_figheight())
        found: list[Axes] = figure.subplots(2, 1, sharey=shared).tolist()
    else:
        found = figure.subplots(1, 2, width_ratios=ratios, sharey=shared).tolist()
    return found


def settled(figure: Figure, handles: Sequence[Artist] = (), within: Axes | None = None) -> Figure:
    """The figure with a legend, laid out once and for all: drawing it again moves nothing.

    The legend stands in a corner of the panel `within` where it covers nothing, or below the figure.
    """
    if handles and not (within and _inside(figure, within, handles)):
        _below(figure, handles)
    figure.draw_without_rendering()
    for _ in range(3):  # panels of maps keep their proportions: no empty sheet around them
        if abs(spare := _spare_height(figure)) < 0.05:
            break
        figure.set_figheight(min(figure.get_figheight() - spare, TALLEST))
        figure.draw_without_rendering()
    figure.set_layout_engine("none")
    if asked_for().look == "dark":
        darken(figure)
    return figure


def _inside(figure: Figure, axes: Axes, handles: Sequence[Artist]) -> bool:
    """Put a legend into the first corner where it covers nothing and is small; whether there is one."""
    for corner in CORNERS:
        legend = axes.legend(handles=handles, loc=corner, handlelength=1.8, borderaxespad=0.3)
        figure.draw_without_rendering()
        box = legend.get_window_extent()
        small = box.width * box.height < INSIDE * axes.bbox.width * axes.bbox.height
        if not small or box.width > 0.98 * axes.bbox.width:
            break
        if not any(one.intersects_bbox(box.padded(2.0), filled=False) for one in _outlines(axes)):
            return True
    legend.remove()
    return False


def _outlines(axes: Axes) -> Iterator[Outline]:
    """All that is drawn in a panel, in pixels; a marker as a point."""
    for line in axes.lines:
        yield line.get_transform().transform_path(line.get_path())
    for patch in axes.patches:
        yield patch.get_transform().transform_path(patch.get_path())
    for collection in axes.collections:
        for path in collection.get_paths():
            yield collection.get_transform().transform_path(path)
    for text in axes.texts:
        yield BboxTransformTo(text.get_window_extent()).transform_path(Outline.unit_rectangle())


def _below(figure: Figure, handles: Sequence[Artist]) -> Legend:
    """A legend below the figure, which grows by it, in as few rows as the width allows."""
    for rows in range(1, len(handles) + 1):
        legend = figure.legend(handles=handles, loc="outside lower center", ncols=-(-len(handles) // rows))
        if legend.get_window_extent().width < 0.98 * figure.bbox.width:
            break
        if rows < len(handles):
            legend.remove()
    else:  # a single column is still too wide
        letters = int(figure.get_figwidth() * 72 / (0.5 * asked_for().letters)) - 8
        for text in legend.get_texts():
            text.set_text("\n".join(textwrap.wrap(text.get_text(), letters)))
    figure.set_figheight(figure.get_figheight() + legend.get_window_extent().height / DPI)
    return legend


def _spare_height(figure: Figure) -> float:
    """The inches of the sheet's height that panels with fixed proportions leave empty; negative if they need more."""
    width, height = figure.get_size_inches()
    fixed = [axes for axes in figure.axes if axes.get_aspect() == 1.0 and axes.get_visible()]
    if not fixed:
        return 0.0
    spare: dict[float, float] = {}
    for axes in fixed:
        given, taken = axes.get_position(original=True), axes.get_position()
        low, high = (given.height - taken.height) * height, (given.width - taken.width) * width
        spare[round(given.y0, 3)] = low if low > 0.02 else -high * taken.height * height / (taken.width * width)
    return sum(spare.values())
