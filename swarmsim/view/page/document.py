"""The page itself: HTML around the numbers of one run or two, or the tables and figures of a study."""

from __future__ import annotations

import hashlib
import html
import json
from base64 import b64encode
from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import Final

from swarmsim.recording.reader import Recording
from swarmsim.view.page.payload import payload

ALWAYS: Final = ("building", "robots")  # layers that cannot be hidden
HIDDEN: Final = ("beams",)  # layers that are not shown at first
CANVAS: Final = "The building with its robots; numbers are beside it"
THEME: Final = (
    'document.documentElement.dataset.theme = matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light"'
)
SPEEDS: Final = (1, 5, 20, 60, 200)


def replay_page(recording: Recording, beside: Recording | None = None) -> str:
    """One self-contained HTML page that replays a run, or two in step."""
    runs = [recording, *([] if beside is None else [beside])]
    packed = [payload(run) for run in runs]
    title = html.escape(recording.scenario.title)
    names = [""] if len(runs) == 1 else ["A: ", "B: "]
    views = "".join(
        f'<div class="view" id="view-{k}">'
        + (f"<h2>{names[k]}{html.escape(run.scenario.title)}</h2>" if beside else "")
        + f'<canvas role="img" aria-label="{CANVAS}"></canvas>'
        '<div class="tip" role="status"></div></div>'
        for k, run in enumerate(runs)
    )
    data = "".join(
        f'<script type="application/json" data-words="{k}">{one["words"]}</script>'
        f'<script type="text/plain" id="numbers-{k}">{one["numbers"]}</script>'
        for k, one in enumerate(packed)
    )
    told = [_below(json.loads(one["words"]), name) for one, name in zip(packed, names, strict=True)]
    scales = "".join(
        f'<p class="scale"><i></i>{name}{html.escape(text)}</p>'
        for one, name in zip(packed, names, strict=True) for text in json.loads(one["words"])["scales"]
    )  # fmt: skip
    below = "".join(f"<section>{one}</section>" for one in told)
    curve = recording.curve.label.partition(", ")[0]
    body = f"""<header><h1>{title}</h1>
<button id="theme" type="button" aria-label="Change colours">Dark</button></header>
<main><div class="stage"><div>
<div class="views">{views}</div><div class="key" id="key"></div>{scales}
<div class="scrub"><canvas id="curve" aria-hidden="true"></canvas>
<input id="scrubber" type="range" min="0" max="1" step="1" value="0"
 aria-label="Time, on the curve of {html.escape(curve)}"></div>
<div class="bar"><button class="play" id="play" type="button">Play</button>
<button id="back" type="button" aria-label="One iteration back">&lsaquo;</button>
<button id="ahead" type="button" aria-label="One iteration ahead">&rsaquo;</button>
<label>speed <select id="speed">{_speeds()}</select></label><output id="note"></output></div>
</div><div>
<output class="big" id="value"></output> <span>{html.escape(curve)}</span>
<dl id="numbers"></dl>
<p><label>look at <select id="robot"><option value="-1">all robots</option></select></label></p>
<dl id="about"></dl>
<fieldset id="layers"><legend>show</legend>{_boxes([json.loads(one["words"]) for one in packed])}</fieldset>
<p class="hint">Space plays; arrows step; Home and End; i shows whole iterations only; click a robot to see its map;
Escape shows all. Robots are drawn larger than they are where there is room.</p>
</div></div>
<div class="below">{below}</div></main>
{data}"""
    return _page(recording.scenario.title, body, _text("page.js"))


def study_page(
    title: str, tables: Mapping[str, tuple[Sequence[str], Sequence[Sequence[str]]]], figures: Mapping[str, str],
    links: Mapping[str, str],
) -> str:  # fmt: skip
    """A study's tables (head and rows, by heading) and figures (picture addresses, by caption).

    `links` gives the page of a run for the text of a cell, such as `k=2, seed 7`.
    """

    def cell(text: str) -> str:
        shown = html.escape(text)
        return f'<a href="{html.escape(links[text])}">{shown}</a>' if text in links else shown

    parts = [f"<header><h1>{html.escape(title)}</h1></header><main>"]
    for heading, (head, rows) in tables.items():
        lines = "".join(f"<tr>{''.join(f'<td>{cell(str(text))}</td>' for text in row)}</tr>" for row in rows)
        columns = "".join(f'<th scope="col">{html.escape(name)}</th>' for name in head)
        table = f'<div class="wide"><table><thead><tr>{columns}</tr></thead><tbody>{lines}</tbody></table></div>'
        many = len(rows) > 40
        parts.append(
            f"<h2>{html.escape(heading)}</h2>"
            + (f"<details><summary>{len(rows)} lines</summary>{table}</details>" if many else table)
        )
        if heading == next(iter(tables)):
            parts += [
                f'<h2>{html.escape(caption)}</h2><img alt="{html.escape(caption)}" src="{source}">'
                for caption, source in figures.items()
            ]
    return _page(title, "\n".join([*parts, "</main>"]), THEME)


def _page(title: str, body: str, script: str) -> str:
    """A page with this script, our style and embedded pictures; its policy forbids all else."""
    style = _text("page.css")
    policy = f"default-src 'none'; script-src {hashed(script)}; style-src {hashed(style)}; img-src data:"
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="{policy}; base-uri 'none'; form-action 'none'">
<title>{html.escape(title)}</title><link rel="icon" href="data:,"><style>{style}</style></head>
<body>{body}<script>{script}</script></body></html>
"""


def hashed(text: str) -> str:
    """The SHA-256 of a script or style for a page's policy, so that no other one runs."""
    return f"'sha256-{b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def _text(name: str) -> str:
    return files(__package__).joinpath(name).read_text(encoding="utf-8")


def _speeds() -> str:
    return "".join(
        f'<option value="{speed}"{" selected" if speed == 20 else ""}>{speed} iterations a second</option>'
        for speed in SPEEDS
    )


def _boxes(runs: Sequence[dict[str, list[dict[str, str]]]]) -> str:
    """A checkbox for each layer with something to draw."""
    names = [track["layer"] for words in runs for track in words["tracks"]]
    return "".join(
        f'<label><input type="checkbox" name="{name}"{"" if name in HIDDEN else " checked"}>{name}</label>'
        for name in dict.fromkeys(map(html.escape, names))
        if name not in ALWAYS
    )


def _below(words: dict[str, object], name: str) -> str:
    """Summary, events, scenario and provenance of a run."""
    summary, provenance, notes = words["summary"], words["provenance"], words["notes"]
    assert isinstance(summary, dict)
    assert isinstance(provenance, dict)
    assert isinstance(notes, list)
    events = "".join(
        f'<li><button type="button" data-at="{at}"><b>{at}</b>{html.escape(text)}</button></li>' for at, text in notes
    )
    return (
        f"<h2>{name}Summary</h2>{_pairs(summary)}"
        + (f'<h2>{name}Events</h2><ul class="events">{events}</ul>' if events else "")
        + f"<h2>{name}Scenario</h2><details><summary>with every default written out</summary>"
        f"<pre>{html.escape(str(words['scenario']))}</pre></details><h2>{name}Provenance</h2>{_pairs(provenance)}"
    )


def _pairs(pairs: dict[str, object]) -> str:
    return (
        "<dl>" + "".join(f"<dt>{html.escape(k)}</dt><dd>{html.escape(str(v))}</dd>" for k, v in pairs.items()) + "</dl>"
    )
