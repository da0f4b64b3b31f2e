"""The verbs of single runs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from swarmsim.cli.progress import RunBar, progress_bar

if TYPE_CHECKING:
    from rich.progress import Progress
    from rich.table import Table

    from swarmsim.build import Run
    from swarmsim.recording import Recording

FINISHED, NOT_FINISHED = 0, 1  # exit codes
EVENT_LINES = 12  # shown of a summary's events


def run(
    scenario: Annotated[Path, typer.Argument(help="Scenario file (TOML).")],
    seed: Annotated[int | None, typer.Option(help="Seed, instead of the scenario's.")] = None,
    set_: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Override a key; the value is TOML.")
    ] = None,
    faults: Annotated[
        list[str] | None, typer.Option("--fault", metavar="'KIND KEY=VALUE ...'", help="One more fault, in words.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for the recording; it must not exist yet.")] = None,
    video: Annotated[Path | None, typer.Option(help="Film to write: .mp4 or .gif.")] = None,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print nothing but errors.")] = False,
) -> None:
    """Simulate a scenario until its map is complete or the limit is reached.

    Exit code 0: finished; 1: not finished at the limit; 2: bad input.

    Example: swarmsim run scenarios/basilica.toml --seed 7 --set robots.count=20 --out runs/twenty

    A table replaces the whole table: --set 'network.topology={use="ring"}'

    Faults come on top of the scenario's: --fault "remove at=50 count=5" --fault "motor off at=20 share=0.2 lasts=100"
    """
    from swarmsim.recording import Recording

    overrides = [*(set_ or []), *([f"seed={seed}"] if seed is not None else [])]
    if video is not None:
        from swarmsim.view.video import check_film

        check_film(video)
    with progress_bar(quiet) as progress:
        progress.console.print(f"{scenario}: opening (a first run compiles, which takes about half a minute)")
        made = _made(scenario, overrides, faults or [])
        folder = _new_folder(out, scenario.stem)
        finished = _simulate(made, folder / "recording.h5", progress)
        recording = Recording(folder)
        summary = recording.summary()
        (folder / "summary.json").write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")
        if video is not None:
            _film(recording, video, progress)
    progress.console.print(_table(summary, folder))
    raise typer.Exit(FINISHED if finished else NOT_FINISHED)


def video(
    recording: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run, or its recording.")],
    out: Annotated[Path, typer.Argument(metavar="OUT.mp4", help="Film to write: .mp4 or .gif.")],
    fps: Annotated[int, typer.Option(help="Frames per second of film.")] = 30,
    speed: Annotated[float, typer.Option(help="Simulated seconds per second of film.")] = 20.0,
    size: Annotated[str, typer.Option(help="Width x height in pixels.")] = "1280x720",
    quiet: Annotated[bool, typer.Option("--quiet", help="Print nothing but errors.")] = False,
) -> None:
    """Make a film from a recording.

    Example: swarmsim video runs/basilica-1 basilica.mp4 --speed 40
    """
    from swarmsim.recording import Recording
    from swarmsim.view.video import check_film

    width_height = _size(size)
    check_film(out, fps, speed, width_height)
    with progress_bar(quiet) as progress:
        _film(Recording(recording), out, progress, fps, speed, width_height)


def show(
    recording: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run, or its recording.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")] = False,
) -> None:
    """Print the summary of a recording.

    Example: swarmsim show runs/basilica-1
    """
    from rich.console import Console

    from swarmsim.recording import Recording

    summary = Recording(recording).summary()
    if as_json:
        print(json.dumps(summary, indent=2))
    else:
        Console().print(_table(summary, recording))


def verify(
    recording: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run, or its recording.")],
    quiet: Annotated[bool, typer.Option("--quiet", help="Print nothing but errors.")] = False,
) -> None:
    """Simulate a recording again and compare every field of every iteration.

    Exit code 0: equal; 1: different, naming the first iteration and field; 2: bad input.

    Example: swarmsim verify runs/basilica-1
    """
    from swarmsim.build import build
    from swarmsim.recording import Digests, Recording, versions

    recorded = Recording(recording)
    with progress_bar(quiet) as progress:
        simulation = build(recorded.scenario, str(recording), recorded.world).simulation
        digests = Digests()
        task = progress.add_task("verifying", total=recorded.iterations, text="")
        difference = None
        while difference is None and simulation.state.iteration < recorded.iterations and not simulation.over:
            simulation.tick([digests])
            difference = recorded.difference(simulation.state.iteration - 1, digests.rows[-1])
            progress.update(task, completed=simulation.state.iteration)
    if difference is None and simulation.state.iteration < recorded.iterations:
        difference = f"the run is over after {simulation.state.iteration} iterations, not {recorded.iterations}"
    if difference is None:
        if not quiet:
            print(f"{recording}: equal in all {recorded.iterations} iterations, digest {recorded.digest()}")
        raise typer.Exit(FINISHED)
    print(f"{recording}: different: {difference}")
    changed = {name: was for name, was in recorded.versions.items() if versions().get(name) != was}
    for name, was in changed.items():
        print(f"  recorded with {name} {was}, verified with {versions().get(name)}")
    raise typer.Exit(NOT_FINISHED)


def schema() -> None:
    """Print the JSON Schema of scenario files, for completion and checks in an editor.

    Example: swarmsim schema > scenario.schema.json
    """
    from swarmsim.core.scenario import schema as scenario_schema

    print(json.dumps(scenario_schema(), indent=2))


def _made(path: Path, overrides: list[str], faults: list[str]) -> Run:
    """The run of a scenario file with these faults besides. Raises InputError, which names the option at fault."""
    import msgspec

    from swarmsim.build import build
    from swarmsim.core.errors import InputError
    from swarmsim.core.scenario import load
    from swarmsim.faults.spelling import fault_in_words

    scenario = load(path, overrides)
    given = len(scenario.faults)
    for text in faults:
        try:
            more = fault_in_words(text)
        except InputError as problem:
            raise InputError(f"--fault {text!r}: {problem}") from problem
        scenario = msgspec.structs.replace(scenario, faults=(*scenario.faults, more))
    try:
        return build(scenario, str(path))
    except InputError as problem:
        for number, text in enumerate(faults, given):
            place = f"{path}: faults[{number}]."
            if str(problem).startswith(place):
                raise InputError(f"--fault {text!r}: {str(problem).removeprefix(place)}") from problem
        raise


def _new_folder(asked: Path | None, stem: str) -> Path:
    """Make the run's folder: the one asked for, or the first unused runs/STEM-N."""
    from swarmsim.core.errors import InputError

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
            raise InputError(
                f"--out {folder}: cannot be made ({problem.strerror}); expected a place that can be written"
            ) from problem
        return folder


def _simulate(made: Run, path: Path, progress: Progress) -> bool:
    """Run to the end with a recording and a progress bar; an interrupted run keeps what it has recorded."""
    task = progress.add_task("simulating", total=made.scenario.stop.coverage, text="")
    with made.recorder(path) as recorder:
        return made.simulation.run([recorder, RunBar(progress, task, made)])


def _film(
    recording: Recording,
    out: Path,
    progress: Progress,
    fps: int = 30,
    speed: float = 20.0,
    size: tuple[int, int] = (1280, 720),
) -> None:
    from swarmsim.view.video import write_film

    task = progress.add_task("filming", total=None, text="")

    def at(frame: int, frames: int) -> None:
        progress.update(task, completed=frame, total=frames, text=f"frame {frame} of {frames}")

    write_film(recording, out, fps, speed, size, at)
    progress.console.print(f"film: {out}")


def _table(summary: dict[str, Any], folder: Path) -> Table:
    from rich.markup import escape
    from rich.table import Table

    table = Table(title=summary["title"], show_header=False)
    lines = [_event_line(event) for event in summary["events"]]
    hidden = len(lines) - EVENT_LINES
    reached = ", ".join(f"{share} at {'-' if at is None else at}" for share, at in summary["reached"].items())
    for name, value in {
        **summary,
        "coverage": f"{summary['coverage']:.2%} of {summary['domain cells']} cells",
        "reached": reached,
        "events": "\n".join(lines[:EVENT_LINES] + ([f"and {hidden} more in summary.json"] if hidden > 0 else [])),
        "versions": ", ".join(f"{name} {version}" for name, version in summary["versions"].items()),
        "run": folder,
    }.items():
        if name not in ("title", "domain cells"):
            table.add_row(name, escape(str(value)))
    return table


def _event_line(event: dict[str, Any]) -> str:
    who = ", ".join(map(str, event["robots"]))
    return f"{event['iteration']}: {event['kind']} ({event['cause']})" + (f": robots {who}" if who else "")


def _size(text: str) -> tuple[int, int]:
    from swarmsim.core.errors import InputError

    width, _, height = text.partition("x")
    if not (width.isdecimal() and height.isdecimal()):
        raise InputError(f"--size {text}: expected width x height in pixels, as in 1280x720")
    return int(width), int(height)
