"""The verbs of the benchmark: entries, their verification, the page that compares them, and sets of one's own."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from swarmsim.cli.options import AllowCode, Quiet
from swarmsim.cli.progress import study_bar
from swarmsim.cli.studies import FAILED, Scheduler, Workers
from swarmsim.cli.tables import print_table

app = typer.Typer(
    help="Enter a method into a benchmark, verify entries, and compare them.\n\n"
    "Example: swarmsim benchmark explore my.toml --out runs/entries/my",
    no_args_is_help=True,
    rich_markup_mode=None,
)

Tasks = Annotated[Path | None, typer.Option(help="Folder of a set of tasks; default: the newest that is shipped.")]
Secret = Annotated[Path | None, typer.Option(help="File with the secret that opens the held-out tasks.")]


@app.command()
def explore(
    method: Annotated[Path, typer.Argument(metavar="METHOD", help="The method's file (TOML): name and mind.")],
    out: Annotated[Path, typer.Option(help="The entry: a folder, or a file that ends in .json.")],
    tasks: Tasks = None,
    secret: Secret = None,
    store: Annotated[
        Path | None, typer.Option(help="Where runs are kept; default: runs/benchmark/SET/NAME.sqlite.")
    ] = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    allow_code: AllowCode = False,
    quiet: Quiet = False,
) -> None:
    """Run a method on all tasks of a set and write its entry.

    Example: swarmsim benchmark explore scenarios/benchmarks/explore/methods/nearest.toml --out runs/entries/nearest
    """
    from swarmsim.api.benchmark import benchmark_explore
    from swarmsim.studies.benchmark.leaderboard import HEAD, lines

    begun = time.perf_counter()
    with study_bar(quiet) as bar:
        made = benchmark_explore(
            method, out=out, tasks=tasks, secret=secret, store=store, workers=workers, scheduler=scheduler,
            allow_code=allow_code, progress=bar,
        )  # fmt: skip
    if not quiet:
        print_table(
            f"{made.entry.method.name}, {made.entry.set}, in units of {made.scores.unit}", HEAD, lines(made.scores)
        )
        print(f"{len(made.entry.runs)} runs in {time.perf_counter() - begun:.0f} s, checksum {made.entry.checksum}")
        for path in made.files:
            print(path)


@app.command()
def verify(
    entry: Annotated[Path, typer.Argument(metavar="ENTRY", help="Folder of an entry, or its .json file.")],
    share: Annotated[float, typer.Option(help="Share of the tasks to repeat, above 0 and at most 1.")] = 0.05,
    tasks: Tasks = None,
    secret: Secret = None,
    seed: Annotated[int | None, typer.Option(help="Which tasks are drawn; default: others each time.", min=0)] = None,
    workers: Workers = None,
    allow_code: AllowCode = False,
    quiet: Quiet = False,
) -> None:
    """Repeat a share of an entry's runs in other processes, and compare every number.

    Exit code 0: all are equal; 1: some differ; 2: a damaged entry, or bad input.

    Example: swarmsim benchmark verify runs/entries/nearest --share 0.05
    """
    from swarmsim.api.benchmark import benchmark_verify

    with study_bar(quiet) as bar:
        found = benchmark_verify(
            entry, share=share, tasks=tasks, secret=secret, seed=seed, workers=workers, allow_code=allow_code,
            progress=bar,
        )  # fmt: skip
    for one in found.disagreements:
        print(f"differs: {one}")
    if found.unlike and not quiet:
        print(f"notice: made by other code or libraries: {found.unlike}")
    if not quiet:
        print(f"{found.repeated} of {found.of} runs repeated: {'equal' if found.equal else 'not those of the entry'}")
    raise typer.Exit(0 if found.equal else FAILED)


@app.command()
def board(
    out: Annotated[Path, typer.Option(help="The page to write, which ends in .html; figures go beside it.")],
    entries: Annotated[
        list[Path] | None, typer.Argument(metavar="[ENTRY...]", help="Folders or .json files of entries.")
    ] = None,
    tasks: Tasks = None,
    energy: Annotated[
        str | None, typer.Option(metavar="metre=A,second=B,kilobyte=C", help="What costs a robot how many joules.")
    ] = None,
    alone: Annotated[bool, typer.Option("--alone", help="Leave out the entries that come with the set.")] = False,
) -> None:
    """Compare entries on a page: scores with intervals, profiles, and which entries are shown to differ.

    Example: swarmsim benchmark board runs/entries/curious --out runs/board.html
    """
    from swarmsim.api.benchmark import benchmark_board
    from swarmsim.studies.benchmark.leaderboard import HEAD, PAIRED, held_out_line, lines, pair_lines

    found = benchmark_board(entries or (), out=out, tasks=tasks, energy=energy, alone=alone)
    for part, standings in found.standings.items():
        print_table(f"{part}: {standings.worlds} worlds, in units of {standings.unit}", HEAD, lines(standings))
    public = found.standings["public"]
    print_table("different or not, all pairs taken together", PAIRED, pair_lines(public))
    if "held-out" in found.standings:
        print(held_out_line(public, found.standings["held-out"]))
    for path in found.files:
        print(path)


@app.command()
def references(
    tasks: Annotated[Path, typer.Argument(metavar="SET", help="Folder of a set of tasks; references are kept there.")],
    secret: Secret = None,
    check: Annotated[float, typer.Option(help="Only replay this share of the kept tours, and compare.")] = 0.0,
    quiet: Quiet = False,
) -> None:
    """Find the proved lower bounds and the replayed tours that a set's tasks lack, with the map known.

    Exit code 0: done; 1: a replay did not confirm a reference; 2: bad input.

    Example: swarmsim benchmark references runs/maps
    """
    from swarmsim.api.benchmark import benchmark_references

    with study_bar(quiet) as bar:
        done = benchmark_references(tasks, secret=secret, check=check, progress=bar)
    for one in done.disagreements:
        print(f"differs: {one}")
    if not quiet:
        print(f"{done.of} tours replayed" if check else f"{done.found} references found, {done.of} in all")
    raise typer.Exit(FAILED if done.disagreements else 0)


@app.command(name="import")
def import_(
    source: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of maps: map_server's YAML files, PNG, PGM.")],
    out: Annotated[Path, typer.Option(help="Folder of the new set.")],
    width: Annotated[float | None, typer.Option(help="Width of every map in metres, instead of its own.")] = None,
    resolution: Annotated[float | None, typer.Option(help="Metres a pixel, of pictures without a YAML file.")] = None,
    floor: Annotated[
        int | None, typer.Option(help="Darkest grey that is floor, of pictures without a YAML file.", min=1, max=255)
    ] = None,
    robots: Annotated[
        list[int] | None, typer.Option(help="A number of robots; repeatable; default: 4, 10, 30.")
    ] = None,
    limit: Annotated[int | None, typer.Option(help="Iterations after which a run is not finished.", min=1)] = None,
    tasks: Tasks = None,
) -> None:
    """Make a set of tasks from others' maps; the other verbs take it with --tasks.

    Example: swarmsim benchmark import maps --out runs/maps --width 12
    """
    from swarmsim.api.benchmark import benchmark_import

    made = benchmark_import(
        source, out=out, width=width, resolution=resolution, floor=floor, robots=robots or (), limit=limit, tasks=tasks
    )
    for file, why in made.left_out.items():
        print(f"left out: {file}: {why}")
    print(
        f"{made.folder}: {len(made.worlds)} worlds; enter with: swarmsim benchmark explore METHOD --tasks {made.folder}"
    )
