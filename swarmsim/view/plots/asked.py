"""A figure that is asked for by name: a part of ours or of others, which fails under its name."""

from __future__ import annotations

from matplotlib.figure import Figure

from swarmsim.core.errors import InputError, PartError
from swarmsim.core.own import brief, is_failure, told
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.part import Part
from swarmsim.recording.reader import Recording
from swarmsim.view.figure import RunFigure
from swarmsim.view.plots.dark import darken
from swarmsim.view.plots.style import asked_for, styled


@styled
def asked(part: Part[RunFigure], recording: Recording) -> Figure:
    """What a figure draws of a run, in the style of ours.

    Raises InputError, which starts with the key at fault, and PartError for a part of others that fails.
    """
    if registry.is_ours(part.parameters):
        return part.build(recording).draw(recording)
    name = f"figure {part.use}"
    try:
        found = part.build(recording).draw(recording)
        if isinstance(found, Figure):
            found.draw_without_rendering()  # what cannot be drawn fails here
            if asked_for().look == "dark":
                darken(found)
            return found
    except InputError:
        raise
    except BaseException as problem:
        if not is_failure(problem):
            raise
        raise PartError(f"{name}: {told(problem)}", "figure") from problem
    raise PartError(f"{name}: gave {brief(found)}; expected a matplotlib.figure.Figure", "figure")
