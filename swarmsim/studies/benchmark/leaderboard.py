"""The page that compares entries: scores with intervals, profiles, and which entries are shown to differ."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

import msgspec
import tomli_w
from markdown_it import MarkdownIt

from swarmsim.core.scenario.files import write_whole
from swarmsim.core.tables import markdown
from swarmsim.studies.benchmark.entries import MethodEntry
from swarmsim.studies.benchmark.scores import (
    SHARES,
    TAUS,
    EntryScore,
    Estimate,
    Joules,
    Standings,
    kept_order,
    standings,
)
from swarmsim.studies.benchmark.sets import TaskSet
from swarmsim.studies.report import page
from swarmsim.view import plots

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HEAD: Final = (
    "entry", "T99", "T50", "T90", "T100", "reached 99 %", "finished", "overlap", "m a robot", "kB a robot", "J a robot",
)  # fmt: skip
PAIRED: Final = ("faster", "slower", "ratio of T99", "p after Holm", "different")
Table = list[tuple[str, ...]]


def lines(found: Standings) -> Table:
    """One line an entry under HEAD, after those of the tour and the proved bound."""
    known: Table = []
    if found.bound is not None and found.tour is not None:
        blank = ("",) * (len(HEAD) - 2)
        known = [
            ("(proved lower bound)", f"{found.bound:.2f}", *blank),
            ("(best tour found, as planned)", f"{found.tour:.2f}", *blank),
            ("(the same, replayed: the unit)", "1", *blank),
        ]
    return [*known, *(_line(one) for one in found.scores)]


def _line(one: EntryScore) -> tuple[str, ...]:
    return (
        f"{one.name} (oracle)" if one.oracle else one.name,
        shown(one.times["t99"]),
        *(shown(one.times[share]) for share in SHARES if share != "t99"),
        f"{one.reached['t99']} of {one.runs}",
        f"{one.reached['t100']} of {one.runs}",
        shown(one.overlap),
        shown(one.way, ".1f"),
        shown(one.kilobytes, ".1f"),
        "-" if one.energy is None else shown(one.energy, ".1f"),
    )


def shown(found: Estimate, how: str = ".2f") -> str:
    """An estimate with its interval."""
    value, (low, high) = found
    return f"{value:{how}}" if math.isnan(low) else f"{value:{how}} ({low:{how}} to {high:{how}})"


def split_lines(found: Standings, title: Mapping[str, str]) -> tuple[tuple[str, ...], Table]:
    """T99 apart by robots, regime and whether something went wrong: the columns, and a line an entry."""
    first = found.scores[0]
    words = {False: "nothing goes wrong", True: "robots die, messages are lost"}
    head = (
        "entry", *(f"{count} robots" for count in first.of_robots), *(title[name] for name in first.of_regime),
        *(words[struck] for struck in first.of_struck),
    )  # fmt: skip
    table = [
        (one.name, *(shown(each) for of in (one.of_robots, one.of_regime, one.of_struck) for each in of.values()))
        for one in found.scores
    ]
    return head, table


def pair_lines(found: Standings) -> Table:
    """One line for every two entries, under PAIRED."""
    return [
        (pair.first, pair.second, shown(pair.ratio), f"{pair.adjusted:.2g}", "yes" if pair.different else "not shown")
        for pair in found.pairs
    ]  # fmt: skip


def held_out_line(public: Standings, held_out: Standings) -> str:
    """Whether the held-out part keeps the order of the entries that the public one calls different, as a sentence."""
    called, turned = kept_order(public, held_out)
    told = "; ".join(f"{pair.first} and {pair.second}" for pair in turned)
    return (
        f"{called} of {len(public.pairs)} pairs are called different on the public tasks; {called - len(turned)} of "
        f"these have the same order on the held-out ones{f'. Turned round: {told}' if turned else ''}."
    )


def figures(found: Standings, title: str) -> dict[str, Figure]:
    """The scores by number of robots, and the profiles."""
    counts = list(found.scores[0].of_robots)
    groups = {
        f"{count} robots": [_ratios(one, one.of_robots[count], count) for one in found.scores] for count in counts
    }
    everything = {"all tasks": [_ratios(one, one.times["t99"], 0) for one in found.scores]}
    short = "the tour's T99" if found.bound is not None else "the best entry's T99"
    return {
        "scores": plots.ratios(groups, f"{title}: T99 by number of robots", short),
        "profiles": plots.profiles(
            {**everything, **groups}, f"{title}: performance profiles", short, "runs that saw 99 %"
        ),
    }


def _ratios(one: EntryScore, found: Estimate, robots: int) -> plots.Ratios:
    return plots.Ratios(one.name, *found, TAUS, one.profiles[robots])


def write_board(
    tasks: TaskSet, entries: Sequence[MethodEntry], out: Path, joules: Joules | None = None
) -> tuple[dict[str, Standings], list[Path]]:
    """Write the page `out`, and the figures beside it; gives the standings of each part, and the files."""
    parts = ["public"]
    if all("held-out" in entry.parts for entry in entries):
        parts.append("held-out")
    found = {part: standings(tasks, entries, part, joules) for part in parts}
    files, pictures = [out], dict[str, str]()
    for name, figure in figures(found["public"], tasks.name).items():
        files += plots.save(figure, out.with_name(f"{out.stem}-{name}"))
        pictures[name] = plots.address(figure)
    body = MarkdownIt("commonmark", {"html": False}).enable("table").render(_text(tasks, entries, found, joules))
    for name, address in pictures.items():
        body = body.replace(f"<p>FIGURE {name}</p>", f'<p><img alt="{name}" src="{address}"></p>')
    write_whole(out, page(tasks.about.title, body))
    return found, files


def _text(tasks: TaskSet, entries: Sequence[MethodEntry], found: Mapping[str, Standings], joules: Joules | None) -> str:
    public, about = found["public"], tasks.about
    title = {name: regime.title for name, regime in about.regimes.items()}
    head, split = split_lines(public, title)
    parts = [
        f"# {_plain(about.title)}",
        f"Set {tasks.name}, digest {tasks.digest}. {len(entries)} entries on {public.worlds} public worlds, "
        f"{len(tasks.of_part('public'))} tasks. {_unit(public)} {_spent(joules)}",
        markdown(HEAD, lines(public)),
        "FIGURE scores",
        "FIGURE profiles",
        f"Share of runs with T99 within a ratio. A run that never saw 99 % counts at no ratio. Limit: {tasks.limit} "
        "iterations.",
        "## Different or not",
        "Two entries on the same worlds: one number a world, signs drawn anew, Holm's correction over all "
        f"{len(public.pairs)} pairs; *different* at 5 % for all of them together. Intervals are of each pair alone.",
        markdown(PAIRED, pair_lines(public)),
        "## T99 apart",
        markdown(head, split),
    ]
    if "held-out" in found:
        held = found["held-out"]
        parts += [
            "## Held-out worlds",
            f"{held.worlds} worlds that nobody had seen. {held_out_line(public, held)}",
            markdown(HEAD, lines(held)),
        ]
    parts += ["## Entries", *(_described(entry) for entry in entries)]
    return "\n\n".join(parts) + "\n"


def _unit(found: Standings) -> str:
    return (
        f"Times are in units of {found.unit}, task by task; the tables have geometric means over worlds with 95 % "
        "intervals of worlds drawn anew. A run that did not reach a share counts as *not finished*: beyond "
        f"{found.cap:g} units all ratios count alike, so its unknown time is not needed. Overlap is how often a cell "
        "was sensed by another robot too; way and bytes are until the run's end."
    )


def _spent(joules: Joules | None) -> str:
    if joules is None:
        return "Energy was not asked for (--energy)."
    return (
        f"A robot spends {joules.metre:g} J a metre, {joules.second:g} J a second until the run's end, and "
        f"{joules.kilobyte:g} J a kilobyte that it hears; one that dies is taken to go on waiting."
    )


def _described(entry: MethodEntry) -> str:
    method = entry.method
    code = ", ".join(f"{name} {found}" for name, found in entry.code.items())
    told = "\n".join(
        f"- {what}: {_plain(text)}"
        for what, text in (("tuning", method.tuning), ("code", code), ("checksum", entry.checksum))
        if text
    )
    mind = tomli_w.dumps({"mind": msgspec.to_builtins(method.mind)}).replace("```", "")
    return f"### {method.name}\n\n{_plain(method.title)}\n\n{told}\n\n```\n{mind}```"


def _plain(text: str) -> str:
    """A text from an entry, without marks of Markdown and line breaks."""
    return " ".join("".join(f"\\{one}" if one in "\\`*_[]<>#!|&~" else one for one in text).split())
