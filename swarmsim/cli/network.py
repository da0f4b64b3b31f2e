"""The verb of networks: what the graph of a run did, in tables and figures."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, Literal, TypedDict

import typer

from swarmsim.cli.tables import print_table

if TYPE_CHECKING:
    import numpy as np
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from swarmsim.network.analysis import LinkGraph, Reach, Spells
    from swarmsim.recording.reader import Recording

BUSIEST = 5  # links shown
MEASURES = {
    "mean_degree": "others heard by a live robot (in-degree): mean",
    "least_degree": "... least",
    "most_degree": "... most",
    "least_listeners": "others that hear a live robot (out-degree): least",
    "most_listeners": "... most",
    "reciprocity": "reciprocity",
    "clustering": "clustering",
    "weak_components": "weak components",
    "strong_components": "strong components",
    "weak_share": "share of robots in the largest weak component",
    "strong_share": "share of robots in the largest strong component",
    "turnover": "neighbour turnover",
}


_Spelled = Literal["contacts", "times between contacts", "contacts, one way", "times between contacts, one way"]
_SPELLED: Final[tuple[_Spelled, ...]] = (
    "contacts",
    "times between contacts",
    "contacts, one way",
    "times between contacts, one way",
)


class _Spread(TypedDict):
    mean: float
    least: float
    most: float


#: How many spells there are of each length: seen from beginning to end, or not.
_Spells = TypedDict(
    "_Spells",
    {
        "number": int,
        "median": float | None,
        "whole": dict[int, int],
        "censored": dict[int, int],
        "begun before": dict[int, int],
    },
)

_Described = TypedDict(
    "_Described",
    {
        "measures": dict[str, _Spread | None],
        "in-degrees": list[int],
        "out-degrees": list[int],
        "union strongly connected": bool,
        "every pair has met": int | None,
        "every robot has heard every other": int | None,
        "share of others heard": list[float | None],
        "contacts": _Spells,
        "times between contacts": _Spells,
        "contacts, one way": _Spells,
        "times between contacts, one way": _Spells,
    },
)


class _Fate(TypedDict):
    messages: int
    bytes: int


class _Link(TypedDict):
    receiver: int
    sender: int
    heard: int
    bytes: int


_Found = TypedDict(
    "_Found",
    {
        "title": str,
        "seed": int,
        "robots": int,
        "from": int,
        "to": int,
        "graphs": dict[str, _Described],
        "messages": dict[str, _Fate],
        "busiest links": list[_Link],
    },
)


@dataclass(frozen=True, slots=True)
class Graph:
    """One graph of a run, linked or heard, in a window of iterations."""

    snapshots: list[LinkGraph]
    reach: Reach
    ordered: tuple[Spells, Spells]  # contacts and times between them, receiver and sender
    unordered: tuple[Spells, Spells]  # of two robots, whichever hears


def network(
    recording: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run, or its recording.")],
    from_: Annotated[int, typer.Option("--from", metavar="N", help="First iteration of the window.")] = 0,
    to: Annotated[int | None, typer.Option(metavar="M", help="First iteration after it; default: the end.")] = None,
    plots: Annotated[Path | None, typer.Option(metavar="FOLDER", help="Draw figures (PNG and SVG) there.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")] = False,
) -> None:
    """Measure the network of a recorded run: who is linked, who was heard, how that changes, what was lost.

    Example: swarmsim network runs/basilica-1 --from 50 --to 250 --plots runs/basilica-1/network
    """
    from swarmsim.recording.reader import Recording

    opened = Recording(recording)
    window = _window(opened, from_, to)
    linked = [opened.links(t) for t in window]
    heard = [rows[rows[:, 4] == 0, :2] for rows in map(opened.letters, window)]
    graphs = {"linked": _graph(linked, opened, window), "heard": _graph(heard, opened, window)}
    messages, busiest = _messages(opened, window)
    found: _Found = {
        "title": opened.scenario.title,
        "seed": opened.scenario.seed,
        "robots": opened.scenario.robots.count,
        "from": window.start,
        "to": window.stop,
        "graphs": {name: _described(graph) for name, graph in graphs.items()},
        "messages": messages,
        "busiest links": busiest,
    }
    if as_json:
        print(json.dumps(found, indent=2))
    else:
        _print_tables(found)
    if plots is not None:
        caption = f"{found['title']}\nseed {found['seed']}, n = {found['robots']} robots, iterations {window.start} to "
        drawn = _figures(graphs, window.start, f"{caption}{window.stop - 1}")
        for path in save_all({plots / name: figure for name, figure in drawn.items()}, "--plots"):
            if not as_json:
                print(path)


def save_all(figures: Mapping[Path, Figure], option: str, dpi: int = 150) -> list[Path]:
    """Save figures under their stems as PNG and SVG; gives the files. Raises InputError, naming the option."""
    from swarmsim.core.errors import unwritten
    from swarmsim.view.plots import save

    try:
        return [path for stem, figure in figures.items() for path in save(figure, stem, dpi)]
    except OSError as problem:
        raise unwritten(f"{option} {problem.filename}", problem, "a place for figures") from problem


def _window(recording: Recording, first: int, end: int | None) -> range:
    from swarmsim.core.errors import InputError

    last = recording.iterations
    if not last:
        raise InputError(f"{recording.path}: no whole iteration was recorded; expected at least one")
    end = last if end is None else end
    if not 0 <= first < last:
        raise InputError(f"--from {first}: no such iteration; expected 0 to {last - 1}")
    if not first < end <= last:
        raise InputError(f"--to {end}: not after --from within the run; expected {first + 1} to {last}")
    return range(first, end)


def _graph(links: Sequence[NDArray[np.int32]], recording: Recording, window: range) -> Graph:
    from swarmsim.network import analysis

    alive, first = recording["alive"][window.start : window.stop], window.start
    return Graph(
        analysis.snapshots(links, alive),
        analysis.reach(links, alive, first),
        analysis.contacts(links, alive, first),
        analysis.contacts([analysis.meetings(pairs) for pairs in links], alive, first),
    )


def _described(graph: Graph) -> _Described:
    """All measures of one graph, ready for JSON; None where nothing is defined."""
    import numpy as np

    def counted(lengths: NDArray[np.int64]) -> dict[int, int]:
        return dict(zip(*(part.tolist() for part in np.unique(lengths, return_counts=True)), strict=True))

    def spells(found: Spells) -> _Spells:
        return {
            "number": len(found.length),
            "median": found.median(),
            "whole": counted(found.length[found.begun & found.ended]),
            "censored": counted(found.length[found.begun & ~found.ended]),
            "begun before": counted(found.length[~found.begun]),
        }

    series = {name: np.array([getattr(s, name) for s in graph.snapshots], float) for name in MEASURES}
    defined = {name: values[np.isfinite(values)] for name, values in series.items()}
    heard, listened = (
        np.bincount(np.concatenate([getattr(snapshot, name) for snapshot in graph.snapshots]))
        for name in ("degrees", "listeners")
    )
    last = graph.reach.share[-1]
    return {
        "measures": {
            name: {"mean": float(values.mean()), "least": float(values.min()), "most": float(values.max())}
            if len(values)
            else None
            for name, values in defined.items()
        },
        "in-degrees": heard.tolist(),
        "out-degrees": listened.tolist(),
        "union strongly connected": graph.reach.strongly_connected,
        "every pair has met": graph.reach.all_met,
        "every robot has heard every other": graph.reach.all_heard,
        "share of others heard": [None if np.isnan(share) else float(share) for share in last],
        "contacts": spells(graph.unordered[0]),
        "times between contacts": spells(graph.unordered[1]),
        "contacts, one way": spells(graph.ordered[0]),
        "times between contacts, one way": spells(graph.ordered[1]),
    }


def _messages(recording: Recording, window: range) -> tuple[dict[str, _Fate], list[_Link]]:
    """Messages and bytes by fate, and the links over which most was heard."""
    import numpy as np

    letters = np.concatenate([recording.letters(t) for t in window])
    fates: dict[str, _Fate] = {
        name: {"messages": int((letters[:, 4] == fate).sum()), "bytes": int(letters[letters[:, 4] == fate, 3].sum())}
        for fate, name in enumerate(recording.fates)
    }
    heard = letters[letters[:, 4] == 0].astype(np.int64)
    pairs, where, counts = np.unique(heard[:, :2], axis=0, return_inverse=True, return_counts=True)
    sizes = np.bincount(where.ravel(), weights=heard[:, 3], minlength=len(pairs))
    busiest = np.argsort(-counts, kind="stable")[:BUSIEST]
    return fates, [
        {
            "receiver": int(pairs[at, 0]),
            "sender": int(pairs[at, 1]),
            "heard": int(counts[at]),
            "bytes": int(sizes[at]),
        }
        for at in busiest
    ]


def _print_tables(found: _Found) -> None:
    graphs = found["graphs"]
    title = f"{found['title']}\nseed {found['seed']}, {found['robots']} robots, iterations {found['from']} to"
    rows = [
        [label, *(text for graph in graphs.values() for text in _spread(graph["measures"][name]))]
        for name, label in MEASURES.items()
    ]
    print_table(f"{title} {found['to'] - 1}", ("each iteration", "linked: mean", "range", "heard: mean", "range"), rows)

    def pick(
        label: str,
        key: Literal["union strongly connected", "every pair has met", "every robot has heard every other"],
    ) -> list[str]:
        return [label, *(_said(graph[key]) for graph in graphs.values())]

    def shares(graph: _Described) -> str:
        there = [share for share in graph["share of others heard"] if share is not None]
        return f"{sum(there) / len(there):.1%} ({min(there):.1%} to {max(there):.1%})" if there else "-"

    window = [
        pick("union of the graphs strongly connected", "union strongly connected"),
        pick("every two robots have met, at iteration", "every pair has met"),
        pick("every robot has heard every other, at iteration", "every robot has heard every other"),
        ["share of the others each has heard at the end: mean (range)", *map(shares, graphs.values())],
    ]
    for key in _SPELLED:
        spells = [graph[key] for graph in graphs.values()]
        censored = [sum(one["censored"].values()) for one in spells]
        numbers = [f"{one['number']} ({cut})" for one, cut in zip(spells, censored, strict=True)]
        window.append([f"{key}: number (censored)", *numbers])
        window.append([f"{key}: median, iterations", *(_said(one["median"], "none") for one in spells)])
    print_table("the window", ("measure", *graphs), window)
    total = max(1, sum(fate["messages"] for fate in found["messages"].values()))
    fates = [
        [name, f"{fate['messages']}", f"{fate['messages'] / total:.1%}", f"{fate['bytes']}"]
        for name, fate in found["messages"].items()
    ]
    print_table("messages", ("what became of them", "messages", "share", "bytes"), fates)
    busiest = [list(map(str, link.values())) for link in found["busiest links"]]
    print_table("busiest links", ("receiver", "sender", "heard", "bytes"), busiest)


def _spread(measure: _Spread | None) -> tuple[str, str]:
    if measure is None:
        return "-", "-"
    return f"{measure['mean']:.3g}", f"{measure['least']:.3g} to {measure['most']:.3g}"


def _said(value: float | bool | None, nothing: str = "never") -> str:
    if value is None:
        return nothing
    return ("yes" if value else "no") if isinstance(value, bool) else f"{value:g}"


def _figures(graphs: dict[str, Graph], first: int, caption: str) -> dict[str, Figure]:
    """The four figures by name; one curve where what was heard is just what was linked."""
    import numpy as np

    from swarmsim.view import plots

    same = np.array_equal(graphs["linked"].reach.first_heard, graphs["heard"].reach.first_heard) and all(
        np.array_equal(one.degrees, other.degrees)
        for one, other in zip(graphs["linked"].snapshots, graphs["heard"].snapshots, strict=True)
    )
    shown = {"linked and heard": graphs["heard"]} if same else graphs
    snapshots = {name: graph.snapshots for name, graph in shown.items()}
    heard = graphs["heard"]
    return {
        "course": plots.network_course(snapshots, first, f"The network over time: {caption}"),
        "degrees": plots.degrees(snapshots, f"How many each robot hears, and is heard by: {caption}"),
        "who-heard-whom": plots.who_heard_whom(heard.reach, f"Who heard whom: {caption}"),
        "contact-times": plots.contact_times(
            {"two robots": heard.unordered, "one way": heard.ordered}, f"How long robots hear each other: {caption}"
        ),
    }
