"""The verbs of single runs."""

from __future__ import annotations

import json
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from swarmsim.cli.films import film
from swarmsim.cli.interruption import told_if_interrupted
from swarmsim.cli.options import AllowCode, Faults, Overrides, Quiet, Seed
from swarmsim.cli.progress import RunBar, compiling, progress_bar

if TYPE_CHECKING:
    from rich.progress import Progress
    from rich.table import Table

    from swarmsim.core.scenario.file import Scenario
    from swarmsim.engine.build import Run
    from swarmsim.recording.reader import Recording

FINISHED, NOT_FINISHED = 0, 1  # exit codes
EVENT_LINES = 12  # shown of a summary's events


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

    Exit code 0: finished; 1: not finished at the limit; 2: bad input; 3: a part of somebody else's
    failed while the run went on.

    Example: swarmsim run scenarios/basilica.toml --seed 7 --set robots.count=20 --out runs/twenty

    A table replaces the whole table: --set 'network.topology={use="ring"}'

    Faults come on top of the scenario's: --fault "remove at=50 count=5" --fault "motor off at=20 fraction=0.2"
    """
    from swarmsim.core.errors import InputError, StorageError
    from swarmsim.core.scenario.file import files_outside
    from swarmsim.recording.reader import Recording

    overrides = [*(set_ or []), *([f"seed={seed}"] if seed is not None else [])]
    if video is not None:
        from swarmsim.view.video import check_film

        check_film(video)
    with progress_bar(quiet) as progress, compiling(progress):
        progress.console.print(f"{scenario}: opening")
        made = _made(scenario, overrides, faults or [])
        for notice in (*files_outside(scenario, overrides), *made.notices):
            progress.console.print(f"notice: {notice}", markup=False, highlight=False)
        folder = new_folder(out, scenario.stem)
        finished = False
        with told_if_interrupted(lambda: f"{made.simulation.state.iteration} iterations are kept in {folder}"):
            try:
                finished = _simulate(made, folder / "recording.h5", progress)
            except BaseException:
                with suppress(InputError, StorageError):  # what ended the run is told, and not what follows from it
                    summarise(Recording(folder), folder)
                raise
            recording = Recording(folder)
            summarise(recording, folder)
        if video is not None:
            with told_if_interrupted(lambda: f"no film was written; the run is in {folder}"):
                film(recording, video, progress)
    progress.console.print(_table(recording, folder))
    raise typer.Exit(FINISHED if finished else NOT_FINISHED)


def show(
    recording: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run, or its recording.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")] = False,
) -> None:
    """Print the summary of a recording.

    Example: swarmsim show runs/basilica-1
    """
    from swarmsim.cli.console import VisibleConsole
    from swarmsim.recording.reader import Recording

    opened = Recording(recording)
    if as_json:
        print(json.dumps(opened.summary(), indent=2))
    else:
        VisibleConsole().print(_table(opened, recording))


def verify(
    recording: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run, or its recording.")],
    allow_code: AllowCode = False,
    quiet: Quiet = False,
) -> None:
    """Simulate a recording again and compare every field of every iteration.

    Exit code 0: equal; 1: different, naming the first iteration and field; 2: bad input; 3: a part of somebody
    else's failed.

    Example: swarmsim verify runs/basilica-1
    """
    from swarmsim.core.scenario.identity import differences
    from swarmsim.engine.build import build
    from swarmsim.recording.digests import Digests, versions
    from swarmsim.recording.reader import Recording

    recorded = Recording(recording)
    with progress_bar(quiet) as progress:
        made = build(recorded.scenario, str(recording), recorded.world)
        simulation, digests = made.simulation, Digests()
        task = progress.add_task("verifying", total=recorded.iterations, text="")
        difference = None
        with told_if_interrupted(lambda: f"{simulation.state.iteration} iterations were equal"):
            while difference is None and simulation.state.iteration < recorded.iterations and not simulation.over:
                moment = simulation.tick([digests])
                difference = recorded.difference(moment.state.iteration, digests.rows[-1], made.sampled(moment))
                progress.update(task, completed=simulation.state.iteration)
    other = differences(recorded.code, made.code.hashes) if recorded.code else ""
    if difference is None and simulation.state.iteration < recorded.iterations:
        difference = f"the run is over after {simulation.state.iteration} iterations, not {recorded.iterations}"
    if difference is None:
        if not quiet:
            print(f"{recording}: equal in all {recorded.iterations} iterations, digest {recorded.digest()}")
            if other:
                print(f"  though the code is other: {other}")
        raise typer.Exit(FINISHED)
    print(f"{recording}: different: {difference}")
    changed = {name: was for name, was in recorded.versions.items() if versions().get(name) != was}
    for name, was in changed.items():
        print(f"  recorded with {name} {was}, verified with {versions().get(name)}")
    if other:
        print(f"  the code is other: {other}")
    raise typer.Exit(NOT_FINISHED)


def schema() -> None:
    """Print the JSON Schema of scenario files, for completion and checks in an editor.

    Example: swarmsim schema > scenario.schema.json
    """
    from swarmsim.core.scenario.schema import schema as scenario_schema

    print(json.dumps(scenario_schema(), indent=2))


def _made(path: Path, overrides: list[str], faults: list[str]) -> Run:
    """The run of a scenario file with these faults besides. Raises InputError, which names the option at fault."""
    from swarmsim.core.errors import InputError
    from swarmsim.engine.build import build

    scenario = scenario_of(path, overrides, faults)
    try:
        return build(scenario, str(path))
    except InputError as problem:
        for number, text in enumerate(faults, len(scenario.faults) - len(faults)):
            place = f"{path}: faults[{number}]."
            if str(problem).startswith(place):
                raise InputError(f"--fault {text!r}: {str(problem).removeprefix(place)}") from problem
        raise


def scenario_of(path: Path, overrides: list[str], faults: list[str]) -> Scenario:
    """A scenario file with faults in words besides its own. Raises InputError, which names the option at fault."""
    import msgspec

    from swarmsim.core.errors import InputError
    from swarmsim.core.scenario.file import load
    from swarmsim.faults.in_words import fault_in_words

    scenario = load(path, overrides)
    for text in faults:
        try:
            more = fault_in_words(text)
        except InputError as problem:
            raise InputError(f"--fault {text!r}: {problem}") from problem
        scenario = msgspec.structs.replace(scenario, faults=(*scenario.faults, more))
    return scenario


def new_folder(asked: Path | None, stem: str) -> Path:
    """Make the run's folder: the one asked for, or the first unused runs/STEM-N."""
    from swarmsim.core.errors import InputError, is_of_the_machine

    numbers = iter(range(1, 1_000_000))
    while True:
        folder = asked or Path("runs") / f"{stem}-{next(numbers)}"
        try:
            folder.mkdir(parents=True)
        except FileExistsError as problem:
            if asked is None:
                continue
            raise InputError(
                f"--out {folder}: exists already; expected a new folder, no run is overwritten"
            ) from problem
        except OSError as problem:
            if is_of_the_machine(problem):
                raise
            raise InputError(
                f"--out {folder}: cannot be made ({problem.strerror}); expected a place that can be written"
            ) from problem
        return folder


def summarise(recording: Recording, folder: Path) -> None:
    """Write the summary of a run, also of one that was interrupted."""
    from swarmsim.core.scenario.files import write_whole

    write_whole(folder / "summary.json", json.dumps(recording.summary(), indent=2) + "\n")


def _simulate(made: Run, path: Path, progress: Progress) -> bool:
    """Run to the end with a recording and a progress bar; an interrupted run keeps what it has recorded."""
    task = progress.add_task("simulating", total=1.0, text="")
    with made.recorder(path) as recorder:
        return made.simulate([recorder, RunBar(progress, task, made)])


def _table(recording: Recording, folder: Path) -> Table:
    from rich.markup import escape
    from rich.table import Table

    from swarmsim.view.timeline import noted

    summary = recording.summary()
    table = Table(title=summary["title"], show_header=False)
    lines = [noted(event, recording.scenario).text for event in recording.events()]
    hidden = len(lines) - EVENT_LINES
    shown: dict[str, object] = {}
    for name, value in summary.items():
        shown |= _measures(summary["measures"], recording) if name == "measures" else {name: value}
    times = summary["reached"].items()
    shown["reached"] = ", ".join(f"{share} at {'-' if at is None else at}" for share, at in times) or "-"
    shown["lost"] = ", ".join(f"{reason} {count}" for reason, count in summary["lost"].items()) or "none"
    shown["progress"] = f"{100.0 * summary['progress']:.2f} %"
    shown["events"] = "\n".join(lines[:EVENT_LINES] + ([f"and {hidden} more in summary.json"] if hidden > 0 else []))
    shown["versions"] = ", ".join(f"{name} {version}" for name, version in summary["versions"].items())
    for name, value in {**shown, "run": folder}.items():
        if name not in ("title", "domain cells"):
            table.add_row(name, escape(str(value)))
    return table


def _measures(values: dict[str, float], recording: Recording) -> dict[str, str]:
    """What was measured last, in words; what the task is about has its unit."""
    curve = recording.curve
    worded = {name: f"{value:.4g}" for name, value in values.items()}
    if curve.name in values:
        unit = curve.label.partition(", ")[2]
        scaled = curve.scale * values[curve.name]
        worded[curve.name] = f"{scaled:.2f} %" if unit == "%" else f"{scaled:{curve.format}} {unit}".rstrip()
    if "changes" in recording and curve.name == "coverage" and values:
        worded[curve.name] += f" of {int(recording['domain'].sum())} cells"
    return worded
