"""The verbs of robots that are processes of their own."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from swarmsim.cli.interruption import told_if_interrupted
from swarmsim.cli.options import AllowCode, Overrides, Quiet, Seed
from swarmsim.cli.progress import RunBar, compiling, progress_bar
from swarmsim.cli.runs import FINISHED, NOT_FINISHED, table

fleet = typer.Typer(
    help="Run a swarm as processes: a world, and each robot by itself.\n\n"
    "Example: swarmsim fleet up room --out runs/fleet --transport udp",
    no_args_is_help=True,
    rich_markup_mode=None,
)
robot = typer.Typer(
    help="One robot of a fleet.\n\nExample: swarmsim robot charge basilica --id 3 --out build/3.charge",
    no_args_is_help=True,
    rich_markup_mode=None,
)

Scenario = Annotated[Path, typer.Argument(help="Scenario file (TOML).")]
Transport = Annotated[str, typer.Option(help="What carries frames: udp, zenoh, or an installed part.")]


@fleet.command("up")
def up(
    scenario: Scenario,
    out: Annotated[Path | None, typer.Option(help="Folder for the recording; it must not exist yet.")] = None,
    pace: Annotated[Literal["lockstep"], typer.Option(help="lockstep: all wait for all.")] = "lockstep",
    transport: Transport = "zenoh",
    seed: Seed = None,
    set_: Overrides = None,
    allow_code: AllowCode = False,
    quiet: Quiet = False,
) -> None:
    """Simulate a scenario whose robots are processes of their own, on this machine.

    Each has its own mind, senses only what the world tells it, and hears frames over the transport. In lockstep the
    recording is that of `swarmsim run`, to the last bit: `swarmsim verify` says so. Exit codes are those of `run`.

    Example: swarmsim fleet up basilica --out runs/fleet --pace lockstep
    """
    from swarmsim.api.fleets import assembled, flown
    from swarmsim.api.runs import new_folder

    with progress_bar(quiet) as progress, compiling(progress):
        made = assembled(scenario, seed, set_)
        folder = new_folder(out, scenario.stem)
        count = made.run.context.swarm
        progress.console.print(f"{scenario}: a world and {count} robots, {count + 1} processes, over {transport}")
        with told_if_interrupted(lambda: f"{made.run.simulation.state.iteration} iterations are kept in {folder}"):
            task = progress.add_task("simulating", total=1.0, text="")
            done = flown(made, folder, transport, observers=[RunBar(progress, task, made.run)])
    progress.console.print(table(done))
    raise typer.Exit(FINISHED if done.finished else NOT_FINISHED)


@robot.command("charge")
def charge(
    scenario: Scenario,
    out: Annotated[Path, typer.Option(help="File to write.")],
    id_: Annotated[int, typer.Option("--id", help="The robot's number, from 0.")] = 0,
    seed: Seed = None,
    set_: Overrides = None,
    allow_code: AllowCode = False,
) -> None:
    """Write all that a robot of a scenario is told: its number, body, lattice, period, seed and mind; no world.

    Example: swarmsim robot charge basilica --id 3 --out build/3.charge
    """
    from swarmsim.api.fleets import robot_charge

    written = robot_charge(scenario, out, id_=id_, seed=seed, overrides=set_, allow_code=allow_code)
    print(f"{written}: {written.stat().st_size} bytes, for robot {id_}")


@robot.command("run")
def run(
    join: Annotated[str, typer.Option(help="The world's address, HOST:PORT.")],
    id_: Annotated[int, typer.Option("--id", help="The robot's number, from 0.")],
    transport: Transport = "zenoh",
    allow_code: AllowCode = False,
) -> None:
    """Be one robot: join a world, be told a charge, and go on until the world ends.

    Exit code 0: the world has ended; 2: bad input; 3: the world was lost.

    Example: swarmsim robot run --id 3 --join 127.0.0.1:7447
    """
    from swarmsim.fleet.robot_process import run as robot_run

    raise typer.Exit(robot_run(transport, join, id_, allow_code))
