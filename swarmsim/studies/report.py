"""A study in pictures, and the reproduction as a page: Markdown and HTML with figures and provenance."""

from __future__ import annotations

import math
from base64 import b64encode
from collections.abc import Sequence
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from markdown_it import MarkdownIt

from swarmsim.core.errors import InputError, unwritten
from swarmsim.core.scenario.files import write_whole
from swarmsim.recording.digests import versions
from swarmsim.studies import reproduction as rep
from swarmsim.studies.methods import TAUS, Compared
from swarmsim.studies.plan import Study
from swarmsim.studies.reproduction import Reproduction
from swarmsim.studies.results import HEAD, Result, filled, lines
from swarmsim.view import plots
from swarmsim.view.page.document import hashed

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; max-width: 62rem; margin: 2rem auto; padding: 0 1rem; color: #1b1b1b }
table { border-collapse: collapse; margin: 1rem 0; font-variant-numeric: tabular-nums; font-size: 0.9rem }
th, td { border-bottom: 1px solid #ccc; padding: 0.25rem 0.7rem; text-align: left; vertical-align: top }
img { max-width: 100% } code { background: #f3f3f3; padding: 0 0.2rem }
"""


def study_figures(study: Study, results: dict[str, Result], folder: Path, measures: Sequence[str] = ()) -> list[Path]:
    """Draw a study's distributions, curves and table, and measures along its axis, into a folder; gives the files.

    Raises InputError if there is nothing to draw or no place for it.
    """
    try:
        drawn = _drawn(study, results, measures).items()
        return [path for name, figure in drawn for path in plots.save(figure, folder / name)]
    except OSError as problem:
        raise unwritten(folder, problem, "a folder for figures") from problem


def study_pictures(study: Study, results: dict[str, Result]) -> dict[str, str]:
    """The same, but for the table, as addresses of pictures for a page, by caption."""
    drawn = _drawn(study, results, ())
    return {name.replace("_", " ").capitalize(): plots.address(drawn[name]) for name in drawn if name != "table"}


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
    figures = {
        "iterations": plots.distributions(
            {name: result.times for name, result in there.items()},
            {name: result.finished for name, result in there.items()},
            title,
        ),
        "table": plots.table(*filled(HEAD, lines(there)), title),
    }
    if any(result.condition.x is not None for result in there.values()):
        axis = study.axis or study.vary[0].key
        figures["sweep"] = plots.sweep(*_series(there), axis, title)
        for name in measures:
            words = name.replace("_", " ")
            figures[name] = plots.sweep(*_series(there, name), axis, title, words)
    elif measures:
        raise InputError(f"{title}: no axis to draw {measures[0]} along; expected numbers varied, or 'x' of conditions")
    if all(result.curves for result in there.values()):
        for curve in {result.condition.curve.name: result.condition.curve for result in there.values()}.values():
            alike = {name: result.curves for name, result in there.items() if result.condition.curve.name == curve.name}
            figures[curve.name] = plots.curves(alike, title, curve=curve)
    return figures


def _series(there: dict[str, Result], measure: str = "") -> tuple[dict[str, plots.Steps], dict[str, plots.Steps]]:
    """The lines of a plot over the study's axis, of iterations or a measure, and the conditions with no place on it."""
    lines_: dict[str, list[tuple[float, Result]]] = {}
    for result in there.values():
        if result.condition.x is not None:
            lines_.setdefault(result.condition.series, []).append((result.condition.x, result))
    series = {
        name: _steps([x for x, _ in placed], [result for _, result in placed], measure)
        for name, placed in ((name, sorted(placed, key=itemgetter(0))) for name, placed in lines_.items())
    }
    levels = {name: _steps((0.0,), (result,), measure) for name, result in there.items() if result.condition.x is None}
    return series, levels


def _steps(values: Sequence[float], results: Sequence[Result], measure: str) -> plots.Steps:
    """Means and intervals at each value: of finished runs' iterations, with the shares of the rest, or of a measure."""
    described = [result.describe_measure(measure) if measure else result.describe() for result in results]
    nowhere = (math.nan, math.nan)
    return plots.Steps(
        values=np.array(values, np.float64),
        means=np.array([math.nan if d.mean is None else d.mean for d in described]),
        intervals=np.array([nowhere if d.interval is None else d.interval for d in described]),
        unfinished=np.array([1.0 - d.finished / d.n for d in described]),
        runs=[d.n for d in described],
    )


def write(found: Sequence[Reproduction], folder: Path) -> list[Path]:
    """Write figures, report.md and report.html, with the readings one after the other; gives the files."""
    figures = {name: caption for one in found for name, caption in _figures(one, folder).items()}
    text = _text(found, figures)
    write_whole(folder / "report.md", text)
    body = MarkdownIt("commonmark").enable("table").render(text)
    for name in figures:  # so that the page is one file, to be mailed
        data = b64encode((folder / f"{name}.png").read_bytes()).decode()
        body = body.replace(f'src="{name}.png"', f'src="data:image/png;base64,{data}"')
    write_whole(folder / "report.html", page("Kit, Mateo and Bouffanais (2018), reproduced", body))
    return [folder / "report.md", folder / "report.html"]


def page(title: str, body: str) -> str:
    """A page of text and of pictures that are in it, which may do nothing else."""
    policy = f"default-src 'none'; style-src {hashed(STYLE)}; img-src data:; base-uri 'none'; form-action 'none'"
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta http-equiv="Content-Security-Policy" content="{policy}">
<title>{title}</title><style>{STYLE}</style></head><body>
{body}</body></html>
"""


def _figures(found: Reproduction, folder: Path) -> dict[str, str]:
    """Draw the figures; gives their captions by file name."""
    numbers, results, reading = found.numbers, found.results, found.reading
    nothing = (np.nan, np.nan)
    plots.save(
        plots.comparison(
            [number.condition for number in numbers],
            np.array([np.nan if n.ours.mean is None else n.ours.mean for n in numbers]),
            np.array([n.ours.interval or nothing for n in numbers]),
            np.array([n.ours.prediction or nothing for n in numbers]),
            np.array([n.published for n in numbers]),
            f"Published numbers beside ours, {reading.title}",
            [n.ours.n for n in numbers],
        ),
        folder / f"{reading.name}-comparison",
    )
    curves = {name: result.curves for name, result in results["robustness"].items()}
    marks = {"20-15-10-5 units": [50, 100, 150]}
    plots.save(
        plots.curves(curves, f"Robustness (Fig. 4), k = 2, {reading.title}", marks),
        folder / f"{reading.name}-robustness",
    )
    for study, title in (
        ("scalability", f"Table I, k = 1, {reading.title}"),
        ("network", f"Table II, 15 robots, {reading.title}"),
    ):
        found_here = results[study]
        published = {
            reading.chain if n.condition == "chain" else n.condition: n.published for n in numbers if n.study == study
        }
        figure = plots.distributions(
            {name: result.times for name, result in found_here.items()},
            {name: result.finished for name, result in found_here.items()},
            title,
            published,
        )
        plots.save(figure, folder / f"{reading.name}-{study}")
    size = results["scalability"].values()
    described = [result.describe() for result in size]
    figure = plots.scaling(
        np.array([result.condition.scenario.robots.count for result in size]),
        np.array([np.nan if d.mean is None else d.mean for d in described]),
        np.array([d.interval or nothing for d in described]),
        rep.scaling_fit(found),
        {r.condition.scenario.robots.count: n.published for r, n in zip(size, numbers, strict=False)},
        f"Scaling, k = 1, {reading.title}",
        [len(result.rows) for result in size],
    )
    plots.save(figure, folder / f"{reading.name}-scaling")
    return {
        f"{reading.name}-comparison": "Means, their 95 % intervals, 95 % of single runs, published numbers",
        f"{reading.name}-robustness": "Coverage: mean and 95 % band over runs; the lines mark removals",
        f"{reading.name}-scalability": "Iterations of every run against the number of robots",
        f"{reading.name}-network": "Iterations of every run against the network",
        f"{reading.name}-scaling": "Mean iterations against the number of robots, and T = a + b/N",
    }


def _text(found: Sequence[Reproduction], figures: dict[str, str]) -> str:
    seeds = len(next(iter(found[0].plans.values())).seeds)
    parts = [
        "# Kit, Mateo and Bouffanais (2018), reproduced",
        f"{seeds} seeds of each condition.",
        "## Readings side by side",
        _table(
            ("condition", "published", *(cell for one in found for cell in (one.reading.title, "ratio"))),
            rep.side_by_side(found),
        ),
        _table(
            ("claim", *(one.reading.title for one in found)),
            [(text, *(one.claims[place].verdict for one in found)) for place, text in enumerate(rep.CLAIMS)],
        ),
    ]
    for one in found:
        parts += _of_reading(one, figures)
    parts += [
        "## Provenance",
        _table(
            ("what", "value"),
            [
                *((f"digest of the runs, {one.reading.title}", one.digest) for one in found),
                ("seeds", f"1 to {seeds}"), *versions().items(),
            ],
        ),
        "Each run is repeated by `swarmsim run scenarios/kit2018.toml --seed N --set ...`; the studies stand in "
        "`scenarios/studies/kit2018/`.",
    ]  # fmt: skip
    return "\n\n".join(parts) + "\n"


def _of_reading(found: Reproduction, figures: dict[str, str]) -> list[str]:
    a, b = rep.scaling_fit(found)
    name = found.reading.name
    mine = [figure for figure in figures if figure.startswith(f"{name}-")]
    return [
        f"## The reading {found.reading.title}",
        _table(("what the paper says", "how it is read"), found.reading.given),
        "What it leaves open: "
        + ", ".join(f"`{key} = {value}`" for key, value in found.reading.changes.items())
        + f"{' and ' if found.reading.changes else ''}as `scenarios/kit2018.toml` has it; chosen by "
        f"`scenarios/studies/kit2018/{found.reading.calibration}`.",
        f"{_capital(found.error_sentence)}.",
        _table((*rep.HEAD[:-1], "kind"), rep.lines(found)),
        "`calibrated` marks the numbers by which the choices that the paper leaves open were made, with other seeds "
        "than these; the others are predicted.",
        _image(f"{name}-comparison", figures),
        _table(("claim", "verdict", "test"), [claim.line for claim in found.claims]),
        *(_image(figure, figures) for figure in mine if figure != f"{name}-comparison"),
        f"T = {a:.0f} + {b:.0f} / N iterations, least squares over all runs.",
        _table(("swarm", "speed-up over N=5", "efficiency", "Karp-Flatt serial share"), rep.scaling_lines(found)),
    ]


def _capital(sentence: str) -> str:
    return sentence[:1].upper() + sentence[1:]


def _image(name: str, figures: dict[str, str]) -> str:
    return f"![{figures[name]}]({name}.png)\n\n*{figures[name]}.*"


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    body = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(str(cell).replace("|", "/") for cell in row) + " |" for row in body)
