"""The verbs of single runs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from swarmsim.cli.films import film
from swarmsim.cli.interruption import told_if_interrupted
from swarmsim.cli.options import AllowCode, Faults, Overrides, Quiet, Seed
from swarmsim.cli.progress import Counted, RunBar, compiling, progress_bar

if TYPE_CHECKING:
    from rich.table import Table

    from swarmsim.api.recorded import Run
    from swarmsim.recording.reader import Recording

FINISHED, NOT_FINISHED = 0, 1  # exit codes
EVENT_LINES = 12  # events shown of a summary


def run(
    scenario: Annotated[Path, typer.Argument(help="Scenario file (TOML).")],
    seed: Seed = None,
    set_: Overrides = None,
    faults: Faults = None,
    out: Annotated[Path | None, typer.Option(help="Folder for the recording; it must not exist yet.")] = None,
    video: Annotated[Path | None, typer.Option(help="Film to write: .mp4 or .gif.")] = None,
    allow_code: AllowCode = False,
    quiet: Quiet = False,
) -> None:
    """Simulate a scenario until its task is done or the limit is reached.

    Exit code 0: finished; 1: not finished at the limit; 2: bad input; 3: a third-party part failed
    during the run.

    Example: swarmsim run basilica --seed 7 --set robots.count=20 --out runs/twenty

    Setting a table replaces it entirely: --set 'network.topology={use="ring"}'

    --fault adds to the scenario's faults: --fault "remove at=50 count=5" --fault "motor off at=20 fraction=0.2"
    """
    from swarmsim.api.runs import built, new_folder, record, scenario_of
    from swarmsim.core.scenario.file import files_outside

    if video is not None:
        from swarmsim.view.video import check_film

        check_film(video)
    asked = scenario_of(scenario, seed, set_, faults or ())
    with progress_bar(quiet) as progress, compiling(progress):
        progress.console.print(f"{scenario}: opening")
        made = built(asked, scenario, faults or ())
        from swarmsim.engine.contacts import Contacts  # not before: it needs the compiler

        for notice in (*files_outside(scenario, set_ or ()), *made.notices):
            progress.console.print(f"notice: {notice}", markup=False, highlight=False)
        folder = new_folder(out, scenario.stem)
        with told_if_interrupted(lambda: f"{made.simulation.state.iteration} iterations are kept in {folder}"):
            task = progress.add_task("simulating", total=1.0, text="")
            done = record(made, folder, [RunBar(progress, task, made), contacts := Contacts(made)])
        if contacts.notice:
            progress.console.print(f"notice: {contacts.notice}", markup=False, highlight=False)
        if video is not None:
            with told_if_interrupted(lambda: f"no film was written; the run is in {folder}"):
                film(done, video, progress)
    progress.console.print(table(done))
    raise typer.Exit(FINISHED if done.finished else NOT_FINISHED)


def show(
    recording: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run, or its recording.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")] = False,
) -> None:
    """Print the summary of a recording.

    Example: swarmsim show runs/basilica-1
    """
    from swarmsim.api.runs import open as open_run
    from swarmsim.cli.console import VisibleConsole

    opened = open_run(recording)
    if as_json:
        print(json.dumps(opened.summary, indent=2))
    else:
        VisibleConsole().print(table(opened))


def verify(
    recording: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run, or its recording.")],
    allow_code: AllowCode = False,
    quiet: Quiet = False,
) -> None:
    """Simulate a recording again and compare every field of every iteration.

    Exit code 0: equal; 1: different, naming the first iteration and field; 2: bad input; 3: a third-party part
    failed.

    Example: swarmsim verify runs/basilica-1
    """
    from swarmsim.api.runs import open as open_run

    opened = open_run(recording)
    with progress_bar(quiet) as progress:
        told = Counted(progress, "verifying")
        with told_if_interrupted(lambda: f"{told.done} iterations were equal"):
            found = opened.verify(allow_code=allow_code, progress=told)
    if found.equal:
        if not quiet:
            print(f"{recording}: equal in all {found.iterations} iterations, digest {found.digest}")
            if found.code:
                print(f"  though the code differs: {found.code}")
        raise typer.Exit(FINISHED)
    print(f"{recording}: different: {found.difference}")
    for name, (was, now) in found.libraries.items():
        print(f"  recorded with {name} {was}, verified with {now}")
    if found.code:
        print(f"  the code differs: {found.code}")
    raise typer.Exit(NOT_FINISHED)


def schema() -> None:
    """Print the JSON Schema of scenario files, for completion and checks in an editor.

    Example: swarmsim schema > scenario.schema.json
    """
    from swarmsim.core.scenario.schema import schema as scenario_schema

    print(json.dumps(scenario_schema(), indent=2))


def table(run: Run) -> Table:
    """A run's summary, for a terminal."""
    from rich.markup import escape
    from rich.table import Table

    from swarmsim.core.durations import told
    from swarmsim.view.timeline import noted

    summary, recording = run.summary, run.recording
    found = Table(title=summary["title"], show_header=False)
    lines = [noted(event, recording.scenario).text for event in recording.events()]
    hidden = len(lines) - EVENT_LINES
    shown: dict[str, object] = {}
    for name, value in summary.items():
        shown |= _measures(summary["measures"], recording) if name == "measures" else {name: value}
    period, times = recording.scenario.period, summary["reached"].items()
    shown["iterations"] = f"{summary['iterations']}, {told(summary['iterations'] * period)} simulated"
    reached = [f"{share} at {at} ({told(at * period)})" for share, at in times if at is not None]
    shown["reached"] = ", ".join(reached) or "none"
    shown["lost"] = ", ".join(f"{reason} {count}" for reason, count in summary["lost"].items()) or "none"
    shown["progress"] = f"{100.0 * summary['progress']:.2f} %"
    shown["events"] = "\n".join(lines[:EVENT_LINES] + ([f"and {hidden} more in summary.json"] if hidden > 0 else []))
    shown["versions"] = ", ".join(f"{name} {version}" for name, version in summary["versions"].items())
    if "absent" in shown:
        shown["absent"] = ", ".join(recording.absent)
    for name, value in {**shown, "run": run.path}.items():
        if name not in ("title", "domain cells"):
            found.add_row(name, escape(str(value)))
    return found


def _measures(values: dict[str, float], recording: Recording) -> dict[str, str]:
    """The last measures in words; the task's measure has its unit."""
    curve = recording.curve
    worded = {name: f"{value:.4g}" for name, value in values.items()}
    if curve.name in values:
        unit = curve.label.partition(", ")[2]
        scaled = curve.scale * values[curve.name]
        worded[curve.name] = f"{scaled:.2f} %" if unit == "%" else f"{scaled:{curve.format}} {unit}".rstrip()
    if "changes" in recording and curve.name == "coverage" and values:
        worded[curve.name] += f" of {int(recording['domain'].sum())} cells"
    return worded
