"""Browser pages: replays of runs, and studies."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

import msgspec

from swarmsim.core.code import distributions
from swarmsim.core.durations import told
from swarmsim.core.errors import InputError
from swarmsim.core.scenario.files import write_whole
from swarmsim.engine.build import build
from swarmsim.recording.digests import versions
from swarmsim.recording.reader import Recording
from swarmsim.studies import results as res
from swarmsim.studies.plan import Plan
from swarmsim.studies.report import study_pictures
from swarmsim.studies.results import Result
from swarmsim.view.page import document


def replay_page(named: Sequence[tuple[str, Recording]], out: Path) -> Path:
    """Write the page that replays a run, or two in step; messages use their names. Raises InputError."""
    check_page(out)
    for name, recording in named:
        if not recording.iterations:
            raise InputError(f"{name}: no whole iteration was recorded; there is nothing to show")
    write_whole(out, document.replay_page(*(recording for _, recording in named)))
    return out


def study_page(plan: Plan, found: dict[str, Result], out: Path, replays: bool) -> list[Path]:
    """Write the page of a study and, with `replays`, one of each condition's median run. Raises InputError."""
    check_page(out)
    if not any(result.rows for result in found.values()):
        raise InputError(f"{plan.path}: no runs yet; do them with: swarmsim study run {plan.path}")
    links = _replays(plan, found, out) if replays else {}
    runs = [
        (f"{name}, seed {row.seed}", row.status, str(row.iterations), told(seconds), row.digest or "-")
        for name, result in found.items()
        for row, seconds in zip(result.rows, result.seconds.times.tolist(), strict=True)
    ]
    head = ("run", "status", "iterations", "simulated time", "digest")
    first = [line for line in runs if line[0] in links]
    tables: dict[str, tuple[Sequence[str], Sequence[Sequence[str]]]] = {
        "Results": res.filled(res.HEAD, res.lines(found)),
        **({"The median run of each condition": (head, first)} if first else {}),
        "All runs": (head, runs),
        "Provenance": (("what", "value"), [("study", str(plan.path)), ("digest", res.digest(list(found.values()))),
                                           *versions().items(), ("swarmsim's code", distributions.ours()),
                                           *(("notice", notice) for notice in res.of_other_code(plan, found))]),
    }  # fmt: skip
    write_whole(out, document.study_page(plan.study.title, tables, study_pictures(plan.study, found), links))
    return [out, *(out.parent / link for link in links.values())]


def check_page(out: Path) -> None:
    """Raise InputError unless this is the name of a page."""
    if out.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"--out {out}: pages end in .html, not in {out.suffix or 'nothing'!r}")


def _replays(plan: Plan, found: dict[str, Result], out: Path) -> dict[str, str]:
    """Write each condition's median run as a page into a folder beside the study's; return links by run."""
    links: dict[str, str] = {}
    for number, condition in enumerate(plan.conditions, 1):
        rows = sorted(found[condition.name].rows, key=lambda row: (row.iterations, row.seed))
        if not rows:
            continue
        seed = rows[(len(rows) - 1) // 2].seed
        scenario = msgspec.structs.replace(condition.scenario, seed=seed)
        with tempfile.TemporaryDirectory() as folder:
            made = build(scenario, condition.name, plan.world_of(condition))
            with made.recorder(Path(folder) / "recording.h5") as recorder:
                made.simulate([recorder])
            place = Path(f"{out.stem}-runs") / f"{number:02d}-seed-{seed}.html"
            write_whole(out.parent / place, document.replay_page(Recording(Path(folder))))
        links[f"{condition.name}, seed {seed}"] = place.as_posix()
    return links
