"""The verb of networks: a run's graphs, in tables and figures."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from swarmsim.cli.printing import for_print
from swarmsim.cli.tables import print_table

if TYPE_CHECKING:
    from swarmsim.network.report import GraphNumbers, NetworkNumbers, Spread


@for_print
def network(
    recording: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run, or its recording.")],
    from_: Annotated[int, typer.Option("--from", metavar="N", help="First iteration of the window.")] = 0,
    to: Annotated[int | None, typer.Option(metavar="M", help="First iteration after it; default: the end.")] = None,
    plots: Annotated[Path | None, typer.Option(metavar="FOLDER", help="Draw figures there.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")] = False,
) -> None:
    """Measure the network of a recorded run: links, heard messages, changes and losses.

    Example: swarmsim network runs/basilica-1 --from 50 --to 250 --plots runs/basilica-1/network
    """
    from swarmsim.api.runs import open as open_run

    found = open_run(recording).network(from_=from_, to=to, plots=plots)
    if as_json:
        print(json.dumps(found.numbers, indent=2))
        return
    _print_tables(found.numbers)
    for path in found.figures:
        print(path)


def _print_tables(found: NetworkNumbers) -> None:
    from swarmsim.network.report import MEASURES, SPELLED

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

    def shares(graph: GraphNumbers) -> str:
        there = [share for share in graph["share of others heard"] if share is not None]
        return f"{sum(there) / len(there):.1%} ({min(there):.1%} to {max(there):.1%})" if there else "-"

    window = [
        pick("union of the graphs strongly connected", "union strongly connected"),
        pick("every two robots have met, at iteration", "every pair has met"),
        pick("every robot has heard every other, at iteration", "every robot has heard every other"),
        ["share of the others each has heard at the end: mean (range)", *map(shares, graphs.values())],
    ]
    for key in SPELLED:
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
    print_table("messages", ("outcome", "messages", "share", "bytes"), fates)
    busiest = [list(map(str, link.values())) for link in found["busiest links"]]
    print_table("busiest links", ("receiver", "sender", "heard", "bytes"), busiest)


def _spread(measure: Spread | None) -> tuple[str, str]:
    if measure is None:
        return "-", "-"
    return f"{measure['mean']:.3g}", f"{measure['least']:.3g} to {measure['most']:.3g}"


def _said(value: float | bool | None, nothing: str = "never") -> str:
    if value is None:
        return nothing
    return ("yes" if value else "no") if isinstance(value, bool) else f"{value:g}"
