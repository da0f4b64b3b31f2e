"""The verb that makes pages."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from swarmsim.cli.options import AllowCode, KeepOld

if TYPE_CHECKING:
    from swarmsim.studies.plan import Plan
    from swarmsim.studies.results import Result


def report(
    what: Annotated[Path, typer.Argument(metavar="RUN|STUDY.toml", help="A run's folder, or a study's file.")],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="PAGE.html", help="The page to write.")],
    beside: Annotated[Path | None, typer.Option(metavar="RUN_B", help="A second run to replay in step.")] = None,
    store: Annotated[Path | None, typer.Option(help="A study's results; default: runs/studies/STUDY.sqlite.")] = None,
    replays: Annotated[
        bool, typer.Option(help="Of a study: simulate the median run of each condition again, as a page of its own.")
    ] = True,
    keep_old: KeepOld = False,
    allow_code: AllowCode = False,
) -> None:
    """Write a page that replays a run in any browser, or one that shows a study; it needs no server and no network.

    Example: swarmsim report runs/basilica-1 -o basilica.html

    Two runs in step: swarmsim report runs/sound -o both.html --beside runs/faulty
    """
    from swarmsim.core.errors import InputError
    from swarmsim.core.scenario.files import write_whole
    from swarmsim.recording.reader import Recording
    from swarmsim.view.layers.own import left_out
    from swarmsim.view.page.document import replay_page

    if out.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"--out {out}: pages end in .html, not in {out.suffix or 'nothing'!r}")
    if what.suffix == ".toml":
        if beside is not None:
            raise InputError(f"--beside {beside}: a study is no run; expected --beside with a run's folder")
        _study(what, out, store, replays, keep_old)
        return
    for path in (what, *([] if beside is None else [beside])):
        opened = Recording(path)
        if not opened.iterations:
            raise InputError(f"{path}: no whole iteration was recorded; there is nothing to show")
        if told := left_out(opened.scenario):
            print(told)
    write_whole(out, replay_page(Recording(what), None if beside is None else Recording(beside)))
    print(f"{out}: {out.stat().st_size / 1e6:.1f} MB; open it in any browser")


def _study(path: Path, out: Path, store: Path | None, replays: bool, keep_old: bool) -> None:
    from swarmsim.core.code import distributions
    from swarmsim.core.errors import InputError
    from swarmsim.core.scenario.files import write_whole
    from swarmsim.recording.digests import versions
    from swarmsim.studies import results as res
    from swarmsim.studies.plan import open_study
    from swarmsim.studies.report import study_pictures
    from swarmsim.studies.store import Store
    from swarmsim.view.page.document import study_page

    opened = open_study(path, keep_old=keep_old)
    with Store(store or Path("runs") / "studies" / f"{path.stem}.sqlite") as kept:
        found = res.gather(opened, kept)
    other = res.of_other_code(opened, found)
    for notice in other:
        print(f"notice: {notice}")
    if not any(result.rows for result in found.values()):
        raise InputError(f"{path}: no runs yet; do them with: swarmsim study run {path}")
    links = _replays(opened, found, out) if replays else {}
    runs = [
        (f"{name}, seed {row.seed}", row.status, str(row.iterations), row.digest or "-")
        for name, result in found.items()
        for row in result.rows
    ]
    first = [line for line in runs if line[0] in links]
    tables: dict[str, tuple[Sequence[str], Sequence[Sequence[str]]]] = {
        "Results": res.filled(res.HEAD, res.lines(found)),
        **({"The median run of each condition": (("run", "status", "iterations", "digest"), first)} if first else {}),
        "All runs": (("run", "status", "iterations", "digest"), runs),
        "Provenance": (("what", "value"), [("study", str(path)), ("digest", res.digest(list(found.values()))),
                                           *versions().items(), ("swarmsim's code", distributions.ours()),
                                           *(("notice", notice) for notice in other)]),
    }  # fmt: skip
    write_whole(out, study_page(opened.study.title, tables, study_pictures(opened.study, found), links))
    for page in (out, *(out.parent / link for link in links.values())):
        print(page)


def _replays(opened: Plan, found: dict[str, Result], out: Path) -> dict[str, str]:
    """Write the page of the median run of each condition into a folder beside the study's; gives links by run."""
    import tempfile

    import msgspec

    from swarmsim.core.scenario.files import write_whole
    from swarmsim.engine.build import build
    from swarmsim.recording.reader import Recording
    from swarmsim.view.page.document import replay_page

    links: dict[str, str] = {}
    for number, condition in enumerate(opened.conditions, 1):
        rows = sorted(found[condition.name].rows, key=lambda row: (row.iterations, row.seed))
        if not rows:
            continue
        seed = rows[(len(rows) - 1) // 2].seed
        scenario = msgspec.structs.replace(condition.scenario, seed=seed)
        with tempfile.TemporaryDirectory() as folder:
            made = build(scenario, condition.name, opened.world_of(condition))
            with made.recorder(Path(folder) / "recording.h5") as recorder:
                made.simulate([recorder])
            place = Path(f"{out.stem}-runs") / f"{number:02d}-seed-{seed}.html"
            write_whole(out.parent / place, replay_page(Recording(Path(folder))))
        links[f"{condition.name}, seed {seed}"] = place.as_posix()
    return links
