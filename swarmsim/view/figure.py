"""The seam of figures: what is drawn of a recorded run for print."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, Protocol, cast

from swarmsim.core.adapters.forms import FunctionForm
from swarmsim.core.seams import Seam

if TYPE_CHECKING:  # who asks for seams needs neither files nor figures
    from matplotlib.figure import Figure

    from swarmsim.recording.reader import Recording


class RunFigure(Protocol):
    """Draws what was recorded of a run, for print."""

    def draw(self, recording: Recording) -> Figure:
        """The figure, one of matplotlib's. Raises InputError, which starts with the key at fault."""
        ...


class FunctionFigure(FunctionForm):
    """`def figure(recording, *, key=default)`: a figure of matplotlib's."""

    def draw(self, recording: Recording) -> Figure:
        """What the function gives."""
        return cast("Figure", self._ask(recording))  # it is checked where it is asked for


SEAM: Final = Seam(
    "figure", (), RunFigure, "curve", elsewhere="`swarmsim plot --figure`", function=FunctionFigure
)  # fmt: skip
