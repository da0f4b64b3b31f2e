"""A reproduction as a page: Markdown and HTML with figures and provenance."""

from __future__ import annotations

import os
from base64 import b64encode
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from markdown_it import MarkdownIt

from swarmsim.core.errors import InputError
from swarmsim.core.scenario import shipped
from swarmsim.core.scenario.files import write_whole
from swarmsim.core.tables import markdown
from swarmsim.recording.digests import versions
from swarmsim.studies import fit
from swarmsim.studies import reproduction as rep
from swarmsim.studies.paper import Figure
from swarmsim.studies.plan import one_period
from swarmsim.studies.report import page, sweep_figure
from swarmsim.studies.reproduction import Reproduction
from swarmsim.studies.results import Result
from swarmsim.view import plots

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

NOWHERE = (np.nan, np.nan)
FILES = ("report.md", "report.html")  #: written beside the figures


def write(found: Sequence[Reproduction], folder: Path) -> None:
    """Write figures, report.md and report.html, one reading after the other."""
    figures = {name: caption for one in found for name, caption in _figures(one, folder).items()}
    text = _text(found, figures)
    markdown, html = (folder / name for name in FILES)
    write_whole(markdown, text)
    body = MarkdownIt("commonmark").enable("table").render(text)
    for name in figures:  # so that the page is one file that can be mailed
        data = b64encode((folder / f"{name}.png").read_bytes()).decode()
        body = body.replace(f'src="{name}.png"', f'src="data:image/png;base64,{data}"')
    write_whole(html, page(_title(found), body))


def _title(found: Sequence[Reproduction]) -> str:
    return f"{found[0].paper.about.cite}, reproduced"


def _figures(found: Reproduction, folder: Path) -> dict[str, str]:
    """Draw the figures; gives their captions by file name."""
    captions, reading = {}, found.reading
    if found.numbers and found.paper.about.published == "iterations":
        name = f"{reading.name}-comparison"
        plots.save(_comparison(found), folder / name)
        captions[name] = "Means, their 95 % intervals, 95 % of single runs, published numbers"
    for figure in found.paper.about.figure:
        name = f"{reading.name}-{figure.name}"
        plots.save(_drawn(found, figure), folder / name)
        captions[name] = figure.caption
    return captions


def _comparison(found: Reproduction) -> Drawing:
    numbers = found.numbers
    return plots.comparison(
        [number.condition for number in numbers],
        np.array([np.nan if n.ours.mean is None else n.ours.mean for n in numbers]),
        np.array([n.ours.interval or NOWHERE for n in numbers]),
        np.array([n.ours.prediction or NOWHERE for n in numbers]),
        np.array([n.published for n in numbers]),
        f"Published numbers beside ours, {found.reading.title}",
        [n.ours.n for n in numbers],
    )


def _drawn(found: Reproduction, figure: Figure) -> Drawing:
    results, title = found.results[figure.study], f"{figure.title}, {found.reading.title}"
    if figure.kind == "curves":
        curves = {name: result.curves for name, result in results.items()}
        if not all(curves.values()):
            raise InputError(f"{found.plans[figure.study].path}: keeps no curves, which the figure {figure.name} shows")
        periods = {name: result.condition.scenario.period for name, result in results.items()}
        return plots.curves(curves, title, figure.marks, next(iter(results.values())).condition.curve, periods)
    if figure.kind == "sweep":
        return sweep_figure(found.plans[figure.study].study, results, title, figure.measure)
    numbers = found.numbers if found.paper.about.published == "iterations" else ()
    names = found.reading.conditions
    published = {names.get(n.condition, n.condition): n.published for n in numbers if n.study == figure.study}
    if figure.kind == "scaling":
        return _scaling(results, published, title)
    return plots.distributions(
        {name: result.times for name, result in results.items()},
        {name: result.finished for name, result in results.items()},
        title,
        published,
        period=one_period(result.condition for result in results.values()),
    )


def _scaling(results: Mapping[str, Result], published: Mapping[str, float], title: str) -> Drawing:
    described = [result.describe() for result in results.values()]
    robots = {name: result.condition.scenario.robots.count for name, result in results.items()}
    if len(set(robots.values())) < 2:
        raise InputError(f"{title}: expected swarms of two sizes or more, got {', '.join(results)}")
    return plots.scaling(
        np.array(list(robots.values())),
        np.array([np.nan if d.mean is None else d.mean for d in described]),
        np.array([d.interval or NOWHERE for d in described]),
        rep.scaling_fit(results),
        {robots[name]: value for name, value in published.items()},
        title,
        [len(result.rows) for result in results.values()],
        one_period(result.condition for result in results.values()),
    )


def _text(found: Sequence[Reproduction], figures: dict[str, str]) -> str:
    first = found[0]
    parts = [f"# {_title(found)}", f"{first.seed_count} seeds of each condition.", "## Readings side by side"]
    if first.numbers:
        head = ("condition", "published", *(cell for one in found for cell in (one.reading.title, "ratio")))
        parts.append(markdown(head, rep.side_by_side(found)))
    verdicts = [
        (decided.claim.text, *(one.claims[place].verdict for one in found))
        for place, decided in enumerate(first.claims)
    ]
    parts.append(markdown(("claim", *(one.reading.title for one in found)), verdicts))
    for one in found:
        parts += _of_reading(one, figures)
    digests = [(f"digest of the runs, {one.reading.title}", one.digest) for one in found]
    provenance = [*digests, ("seeds", first.seeds), *versions().items()]
    runs = " or ".join(f"`swarmsim run {one} --seed N --set ...`" for one in _scenarios(first))
    studies = " and ".join(dict.fromkeys(f"`{_shown(plan.path.parent)}/`" for plan in first.plans.values()))
    parts += ["## Provenance", markdown(("what", "value"), provenance)]
    parts.append(f"Each run is repeated by {runs}; the studies are in {studies}.")
    return "\n\n".join(parts) + "\n"


def _of_reading(found: Reproduction, figures: dict[str, str]) -> list[str]:
    reading, name = found.reading, f"{found.reading.name}-comparison"
    mine = [figure for figure in figures if figure.startswith(f"{reading.name}-") and figure != name]
    parts = [f"## The reading {reading.title}"]
    if reading.given:
        parts.append(markdown(("what the paper says", "how it is read"), reading.given))
    changes = ", ".join(f"`{key} = {value}`" for key, value in reading.changes.items())
    where = " and ".join(f"`{one}`" for one in _scenarios(found))
    chosen = "" if reading.calibration is None else f"; chosen by `{_shown(found.paper.folder / reading.calibration)}`"
    parts.append(f"What it leaves open: {changes}{' and ' if changes else ''}as {where} has it{chosen}.")
    if found.numbers:
        fitted = found.fit
        parts += [found.error_sentences(fitted), markdown((*rep.HEAD[:-1], "kind"), rep.lines(found))]
        if fitted is not None:
            parts += [f"{fit.TITLE}:", markdown(fit.HEAD, fit.lines(fitted)), fit.MEANING]
    if reading.calibrated:
        parts.append(
            "`calibrated` marks the numbers that the choices left open by the paper were fitted to, with other "
            "seeds than these; the others are predicted."
        )
    if name in figures:
        parts.append(_image(name, figures))
    for listing in found.paper.about.table:
        parts += [f"{listing.title}:", markdown(rep.LISTED, rep.listed(found, listing))]
    parts.append(
        markdown(("claim", "verdict", "test"), [(claim.text, verdict, test) for claim, verdict, test in found.claims])
    )
    parts += [_image(figure, figures) for figure in mine]
    for figure in found.paper.about.figure:
        if figure.kind == "scaling":
            results = found.results[figure.study]
            a, b = rep.scaling_fit(results)
            head = ("swarm", f"speed-up over {next(iter(results))}", "efficiency", "Karp-Flatt serial share")
            parts.append(f"T = {a:.0f} + {b:.0f} / N iterations, least squares over all runs.")
            parts.append(markdown(head, rep.scaling_lines(results)))
    return parts


def _scenarios(found: Reproduction) -> list[str]:
    """The studies' scenarios."""
    files = [shipped.found(plan.study.scenario, folder=plan.path.parent) for plan in found.plans.values()]
    return list(dict.fromkeys(_shown(file) for file in files))


def _shown(path: Path) -> str:
    """A path relative to the shipped scenarios if it is among them; else unchanged."""
    home = shipped.root()
    whole = Path(os.path.normpath(Path.cwd() / path))
    return (whole.relative_to(home) if whole.is_relative_to(home) else Path(os.path.normpath(path))).as_posix()


def _image(name: str, figures: dict[str, str]) -> str:
    return f"![{figures[name]}]({name}.png)\n\n*{figures[name]}.*"
