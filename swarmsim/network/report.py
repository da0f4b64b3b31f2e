"""The network of a recorded run in numbers: robots linked, robots heard, changes, losses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal, TypedDict

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.errors import InputError
from swarmsim.network import analysis
from swarmsim.network.analysis import LinkGraph, Reach, Spells

if TYPE_CHECKING:
    from pathlib import Path

    from swarmsim.recording.reader import Recording

BUSIEST: Final = 5  # links listed
#: The measures of each graph in each iteration, with their names in tables.
MEASURES: Final = {
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

Spelled = Literal["contacts", "times between contacts", "contacts, one way", "times between contacts, one way"]
SPELLED: Final[tuple[Spelled, ...]] = (
    "contacts",
    "times between contacts",
    "contacts, one way",
    "times between contacts, one way",
)


class Spread(TypedDict):
    """A measure over the iterations of the window."""

    mean: float
    least: float
    most: float


#: The number of spells of each length: seen from beginning to end, or not.
SpellCounts = TypedDict(
    "SpellCounts",
    {
        "number": int,
        "median": float | None,
        "whole": dict[int, int],
        "censored": dict[int, int],
        "begun before": dict[int, int],
    },
)

#: All measures of one graph; None where undefined.
GraphNumbers = TypedDict(
    "GraphNumbers",
    {
        "measures": dict[str, Spread | None],
        "in-degrees": list[int],
        "out-degrees": list[int],
        "union strongly connected": bool,
        "every pair has met": int | None,
        "every robot has heard every other": int | None,
        "share of others heard": list[float | None],
        "contacts": SpellCounts,
        "times between contacts": SpellCounts,
        "contacts, one way": SpellCounts,
        "times between contacts, one way": SpellCounts,
    },
)


class Fate(TypedDict):
    """The messages that ended in one way."""

    messages: int
    bytes: int


class BusyLink(TypedDict):
    """A busy link."""

    receiver: int
    sender: int
    heard: int
    bytes: int


#: What `swarmsim network --json` prints.
NetworkNumbers = TypedDict(
    "NetworkNumbers",
    {
        "title": str,
        "seed": int,
        "robots": int,
        "from": int,
        "to": int,
        "graphs": dict[str, GraphNumbers],
        "messages": dict[str, Fate],
        "busiest links": list[BusyLink],
    },
)


@dataclass(frozen=True, slots=True)
class Graph:
    """One graph of a run, linked or heard, in a window of iterations."""

    snapshots: list[LinkGraph]
    reach: Reach
    ordered: tuple[Spells, Spells]  # contacts and times between them, receiver and sender
    unordered: tuple[Spells, Spells]  # of two robots, in either direction


@dataclass(frozen=True, slots=True)
class NetworkReport:
    """The network of a run in a window of its iterations."""

    numbers: NetworkNumbers  # as `swarmsim network --json` prints them
    graphs: dict[str, Graph]  # linked and heard
    figures: tuple[Path, ...] = ()  # the files drawn, if any were asked for


def network_report(recording: Recording, from_: int = 0, to: int | None = None) -> NetworkReport:
    """Measure the network in iterations `from_` up to, but not including, `to`, by default the end.

    Raises InputError for a window outside of the run.
    """
    window = _window(recording, from_, to)
    linked = [recording.links(t) for t in window]
    heard = [rows[rows[:, 4] == 0, :2] for rows in map(recording.letters, window)]
    graphs = {"linked": _graph(linked, recording, window), "heard": _graph(heard, recording, window)}
    messages, busiest = _messages(recording, window)
    numbers: NetworkNumbers = {
        "title": recording.scenario.title,
        "seed": recording.scenario.seed,
        "robots": recording.scenario.robots.count,
        "from": window.start,
        "to": window.stop,
        "graphs": {name: _described(graph) for name, graph in graphs.items()},
        "messages": messages,
        "busiest links": busiest,
    }
    return NetworkReport(numbers, graphs)


def _window(recording: Recording, first: int, end: int | None) -> range:
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
    alive, first = recording["alive"][window.start : window.stop], window.start
    return Graph(
        analysis.snapshots(links, alive),
        analysis.reach(links, alive, first),
        analysis.contacts(links, alive, first),
        analysis.contacts([analysis.meetings(pairs) for pairs in links], alive, first),
    )


def _described(graph: Graph) -> GraphNumbers:
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
        "contacts": _spells(graph.unordered[0]),
        "times between contacts": _spells(graph.unordered[1]),
        "contacts, one way": _spells(graph.ordered[0]),
        "times between contacts, one way": _spells(graph.ordered[1]),
    }


def _spells(found: Spells) -> SpellCounts:
    return {
        "number": len(found.length),
        "median": found.median(),
        "whole": _counted(found.length[found.begun & found.ended]),
        "censored": _counted(found.length[found.begun & ~found.ended]),
        "begun before": _counted(found.length[~found.begun]),
    }


def _counted(lengths: NDArray[np.int64]) -> dict[int, int]:
    return dict(zip(*(part.tolist() for part in np.unique(lengths, return_counts=True)), strict=True))


def _messages(recording: Recording, window: range) -> tuple[dict[str, Fate], list[BusyLink]]:
    """Messages and bytes by fate, and the busiest links."""
    letters = np.concatenate([recording.letters(t) for t in window])
    fates: dict[str, Fate] = {
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
