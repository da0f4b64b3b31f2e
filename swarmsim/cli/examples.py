"""The verbs of what ships: list, run, copy scenarios, studies, papers and worlds."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from swarmsim.cli.completion import example_names

app = typer.Typer(
    help="List, run and copy what comes with swarmsim: scenarios, studies, papers and worlds.\n\n"
    "Names also work wherever a command takes a path; where two share one, say papers/kit2018.\n\n"
    "Example: swarmsim examples run room",
    invoke_without_command=True,
    rich_markup_mode=None,
)

Name = Annotated[str, typer.Argument(metavar="NAME", autocompletion=example_names, help="As in the list.")]
USES = {
    "scenarios": "swarmsim run room --video room.mp4",
    "studies": "swarmsim study run kit2018/network --seeds 3",
    "papers": "swarmsim reproduce kit2018 --seeds 2",
    "worlds": "swarmsim world check house",
}


@app.callback()
def _listed(context: typer.Context) -> None:
    if context.invoked_subcommand is not None:
        return
    from swarmsim.cli.tables import print_table
    from swarmsim.core.scenario import shipped

    for kind in shipped.KINDS:
        print_table(kind, ("name", "what it is"), list(shipped.examples(kind).items()))
        print(f"for instance: {USES[kind]}")
    print("copy one to change it: swarmsim examples copy room my-folder")


@app.command()
def run(
    name: Name,
    seed: Annotated[int | None, typer.Option(help="Seed, instead of a scenario's.")] = None,
    seeds: Annotated[int | None, typer.Option(help="Seeds 1 to N, instead of a study's or paper's.", min=1)] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for a recording, or a paper's report.")] = None,
    video: Annotated[Path | None, typer.Option(help="Film of a scenario to write: .mp4 or .gif.")] = None,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print nothing but errors.")] = False,
) -> None:
    """Run a scenario, a study or a paper that comes with swarmsim: as `run`, `study run` and `reproduce` do.

    Example: swarmsim examples run faults/blind --video blind.mp4

    A study: swarmsim examples run studies/operations/rendezvous --seeds 2
    """
    from swarmsim.core.errors import InputError
    from swarmsim.core.scenario import shipped

    path = shipped.example(name)
    kind = shipped.kind_of(path)
    takes = {"scenarios": ("seed", "out", "video"), "studies": ("seeds",), "papers": ("seeds", "out"), "worlds": ()}
    for option, value in {"seed": seed, "seeds": seeds, "out": out, "video": video}.items():
        if value is not None and option not in takes[kind]:
            allowed = "".join(f" --{one}" for one in takes[kind]) or " none"
            raise InputError(f"--{option}: {name} is one of the {kind}, with other options; expected{allowed}")
    if kind == "scenarios":
        from swarmsim.cli.runs import run as run_scenario

        run_scenario(path, seed=seed, out=out, video=video, quiet=quiet)
    elif kind == "studies":
        from swarmsim.cli.studies import run as run_study

        run_study(path, seeds=seeds, quiet=quiet)
    elif kind == "papers":
        from swarmsim.cli.reproductions import reproduce

        reproduce(str(path.parent), seeds=seeds, out=out, quiet=quiet)
    else:
        raise InputError(f"{name}: is a building, and does not run; expected: swarmsim world check {name}")


@app.command()
def copy(
    name: Name,
    folder: Annotated[Path, typer.Argument(help="Folder for the copy; created if missing.")],
) -> None:
    """Copy a scenario, a study, a paper or a world with all files that it names, to change it.

    Example: swarmsim examples copy basilica my-folder
    """
    from swarmsim.core.scenario import shipped

    copies = shipped.copy(name, folder)
    for path in copies:
        print(path)
    kind = shipped.kind_of(shipped.example(name))
    first = copies[0].parent if kind == "papers" else copies[0]
    verbs = {"scenarios": "run", "studies": "study run", "papers": "reproduce", "worlds": "world check"}
    print(f"use it: swarmsim {verbs[kind]} {first}")
