"""The verb that writes pages."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from swarmsim.cli.options import AllowCode, KeepOld


def report(
    what: Annotated[Path, typer.Argument(metavar="RUN|STUDY.toml", help="A run's folder, or a study's file.")],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="PAGE.html", help="The page to write.")],
    beside: Annotated[Path | None, typer.Option(metavar="RUN_B", help="A second run to replay in step.")] = None,
    store: Annotated[Path | None, typer.Option(help="A study's results; default: runs/studies/STUDY.sqlite.")] = None,
    replays: Annotated[
        bool, typer.Option(help="For a study: simulate each condition's median run again, as a separate page.")
    ] = True,
    keep_old: KeepOld = False,
    allow_code: AllowCode = False,
) -> None:
    """Write a page that replays a run or shows a study in any browser, without a server or network.

    Example: swarmsim report runs/basilica-1 -o basilica.html

    Two runs in step: swarmsim report runs/sound -o both.html --beside runs/faulty
    """
    from swarmsim.api.pages import check_page
    from swarmsim.api.runs import open as open_run
    from swarmsim.api.studies import open_study
    from swarmsim.core.errors import InputError
    from swarmsim.core.scenario import shipped
    from swarmsim.view.layers.own import left_out

    check_page(out)
    what = what if what.is_dir() else shipped.found(what, "studies")
    if what.suffix != ".toml":
        run = open_run(what)
        if notice := left_out(run.recording.scenario):
            print(notice)
        page = run.report(out, beside=None if beside is None else open_run(beside), allow_code=allow_code)
        print(f"{page}: {page.stat().st_size / 1e6:.1f} MB; open it in any browser")
        return
    if beside is not None:
        raise InputError(f"--beside {beside}: a study is not a run; expected --beside with a run's folder")
    study = open_study(what, store=store, keep_old=keep_old, allow_code=allow_code)
    for notice in study.of_other_code():
        print(f"notice: {notice}")
    for path in study.report(out, replays=replays):
        print(path)
