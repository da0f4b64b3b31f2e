"""The style of all figures: colours, markers, letters and resolution."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final, Literal

import numpy as np
from matplotlib import style
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.typing import LineStyleType

Reals = NDArray[np.float64]
Line = Literal["", "-", "--", ":"]

DPI: Final = 150  # of a saved PNG
FINEST: Final = 900  # points along a curve: more than a picture has pixels only make its file larger
TIME: Final = "iterations until done"
#: Okabe and Ito's colours, as on the map, without yellow, which is lost on white paper, and four of Tol's muted ones.
COLOURS: Final = (
    "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000",
    "#882255", "#999933", "#332288", "#44AA99",
)  # fmt: skip
BLUE, VERMILLION, GREEN, PURPLE, _, _, BLACK = COLOURS[:7]
GREY: Final = "#6B7280"
PALE: Final = "#DCEBF5"
#: With eleven colours and nine markers no two of the first 99 curves look alike.
MARKERS: Final = ("o", "s", "^", "D", "v", "P", "X", "<", ">")
DASHES: Final[Sequence[LineStyleType]] = ("-", (0, (6, 2)), (0, (2, 1.5)), (0, (7, 2, 1.5, 2)))
STYLE: Final[dict[str, object]] = {
    "font.size": 10.0, "axes.labelsize": 10.0, "legend.fontsize": 9.0, "xtick.labelsize": 9.0, "ytick.labelsize": 9.0,
    "figure.titlesize": 12.0, "figure.titleweight": "bold", "text.parse_math": False,
    "axes.spines.top": False, "axes.spines.right": False, "axes.edgecolor": GREY, "axes.axisbelow": True,
    "axes.grid": True, "grid.color": "#E3E6EB", "grid.linewidth": 0.8, "xtick.color": GREY, "ytick.color": GREY,
    "xtick.labelcolor": BLACK, "ytick.labelcolor": BLACK, "legend.frameon": False, "legend.handlelength": 2.8,
    "svg.hashsalt": "swarmsim", "svg.fonttype": "path",
}  # fmt: skip
#: Every figure starts from matplotlib's own settings, whatever the user's are, and leaves those as they were.
styled = style.context(STYLE, after_reset=True)
