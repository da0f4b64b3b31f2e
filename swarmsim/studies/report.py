"""A study's figures, and the page for figures and tables of studies."""

from __future__ import annotations

import html
import math
from collections.abc import Sequence
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from swarmsim.core.errors import InputError, unwritten
from swarmsim.core.scenario.describe import axis_label
from swarmsim.core.tables import SUFFIXES, WRITERS
from swarmsim.studies.methods import TAUS, Compared
from swarmsim.studies.plan import Study, one_period
from swarmsim.studies.results import HEAD, Result, filled, lines
from swarmsim.view import plots
from swarmsim.view.page.document import hashed

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SECONDS = "seconds until done"  # where conditions have several periods

STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; max-width: 62rem; margin: 2rem auto; padding: 0 1rem; color: #1b1b1b }
table { border-collapse: collapse; margin: 1rem 0; font-variant-numeric: tabular-nums; font-size: 0.9rem }
th, td { border-bottom: 1px solid #ccc; padding: 0.25rem 0.7rem; text-align: left; vertical-align: top }
img { max-width: 100% } code { background: #f3f3f3; padding: 0 0.2rem }
"""


def study_figures(study: Study, results: dict[str, Result], folder: Path, measures: Sequence[str] = ()) -> list[Path]:
    """Draw a study's distributions, curves and measures along its axis into a folder, with its table; gives the files.

    Raises InputError if there is nothing to draw or the folder cannot be written.
    """
    try:
        drawn = _drawn(study, results, measures).items()
        return [path for name, figure in drawn for path in plots.save(figure, folder / name)] + _tables(results, folder)
    except OSError as problem:
        raise unwritten(folder, problem, "a folder for figures") from problem


def _tables(results: dict[str, Result], folder: Path) -> list[Path]:
    """Write the table of all conditions with runs for documents."""
    table = filled(HEAD, lines({name: result for name, result in results.items() if result.rows}))
    files = []
    for form, write in WRITERS.items():
        files.append(folder / f"table{SUFFIXES[form]}")
        files[-1].write_text(f"{write(*table)}\n", encoding="utf-8")
    return files


def study_pictures(study: Study, results: dict[str, Result]) -> dict[str, str]:
    """The same figures as data URLs for a page, by caption."""
    drawn = _drawn(study, results, ())
    return {name.replace("_", " ").capitalize(): plots.address(figure) for name, figure in drawn.items()}


def method_figures(found: Compared, title: str, folder: Path) -> list[Path]:
    """Draw the ratios and the performance profiles of methods into a folder; gives the files. Raises InputError."""
    groups = {
        group: [plots.Ratios(one.method, one.ratio, one.interval, TAUS, one.profile) for one in standings]
        for group, standings in found.groups.items()
    }
    figures = {"ratios": plots.ratios(groups, title), "profiles": plots.profiles(groups, title)}
    try:
        return [path for name, figure in figures.items() for path in plots.save(figure, folder / name)]
    except OSError as problem:
        raise unwritten(folder, problem, "a folder for figures") from problem


def _drawn(study: Study, results: dict[str, Result], measures: Sequence[str]) -> dict[str, Figure]:
    title, there = study.title, {name: result for name, result in results.items() if result.rows}
    if not there:
        raise InputError(f"{title}: no runs yet; do them with: swarmsim study run")
    period = one_period(result.condition for result in there.values())
    ends = {name: result.seconds if period is None else result.endings for name, result in there.items()}
    figures = {
        "iterations": plots.distributions(
            {name: one.times for name, one in ends.items()},
            {name: one.finished for name, one in ends.items()},
            title,
            period=period,
            label=plots.TIME if period else SECONDS,
        ),
    }
    if measures or any(result.condition.x is not None for result in there.values()):
        figures["sweep"] = sweep_figure(study, there, title)
        figures |= {name: sweep_figure(study, there, title, name) for name in measures}
    if all(result.curves for result in there.values()):
        for curve in {result.condition.curve.name: result.condition.curve for result in there.values()}.values():
            alike = {name: result.curves for name, result in there.items() if result.condition.curve.name == curve.name}
            periods = {name: there[name].condition.scenario.period for name in alike}
            figures[curve.name] = plots.curves(alike, title, curve=curve, periods=periods)
    return figures


def sweep_figure(study: Study, there: dict[str, Result], title: str, measure: str = "") -> Figure:
    """Draw iterations, or a measure, along a study's axis. Raises InputError without an axis."""
    if all(result.condition.x is None for result in there.values()):
        what = measure or "iterations"
        raise InputError(f"{title}: no axis to draw {what} along; expected numbers varied, or 'x' of conditions")
    first = next(result.condition for result in there.values() if result.condition.x is not None)
    axis = study.axis or (axis_label(first.scenario, study.vary[0].key) if study.vary else "x")
    if measure:
        return plots.sweep(*_series(there, measure), axis, title, measure.replace("_", " "))
    period = one_period(result.condition for result in there.values())
    if period is None:
        return plots.sweep(*_series(there, in_seconds=True), axis, title, SECONDS)
    return plots.sweep(*_series(there), axis, title, period=period)


def _series(
    there: dict[str, Result], measure: str = "", in_seconds: bool = False
) -> tuple[dict[str, plots.Steps], dict[str, plots.Steps]]:
    """The plot's lines over the study's axis, of iterations or a measure, and the conditions with no place on it."""
    lines_: dict[str, list[tuple[float, Result]]] = {}
    for result in there.values():
        if result.condition.x is not None:
            lines_.setdefault(result.condition.series, []).append((result.condition.x, result))
    series = {
        name: _steps([x for x, _ in placed], [result for _, result in placed], measure, in_seconds)
        for name, placed in ((name, sorted(placed, key=itemgetter(0))) for name, placed in lines_.items())
    }
    levels = {
        name: _steps((0.0,), (result,), measure, in_seconds)
        for name, result in there.items()
        if result.condition.x is None
    }
    return series, levels


def _steps(values: Sequence[float], results: Sequence[Result], measure: str, in_seconds: bool) -> plots.Steps:
    """Means and intervals at each value: of a measure, or of times where all runs finished, with unfinished shares."""
    described = [result.describe_measure(measure) if measure else result.describe() for result in results]
    nowhere = (math.nan, math.nan)
    scale = np.array([one.condition.scenario.period if in_seconds else 1.0 for one in results])
    return plots.Steps(
        values=np.array(values, np.float64),
        means=scale * np.array([math.nan if d.mean is None else d.mean for d in described]),
        intervals=scale[:, None] * np.array([nowhere if d.interval is None else d.interval for d in described]),
        unfinished=np.array([1.0 - d.finished / d.n for d in described]),
        runs=[d.n for d in described],
    )


def page(title: str, body: str) -> str:
    """A page with text and embedded pictures; its policy forbids all else."""
    policy = f"default-src 'none'; style-src {hashed(STYLE)}; img-src data:; base-uri 'none'; form-action 'none'"
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta http-equiv="Content-Security-Policy" content="{policy}">
<title>{html.escape(title)}</title><style>{STYLE}</style></head><body>
{body}</body></html>
"""
