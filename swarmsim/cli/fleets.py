"""The verbs of robots that are processes of their own."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from swarmsim.cli.interruption import told_if_interrupted
from swarmsim.cli.options import AllowCode, Faults, Overrides, Quiet, Seed
from swarmsim.cli.progress import RunBar, compiling, progress_bar
from swarmsim.cli.runs import FINISHED, NOT_FINISHED, table

if TYPE_CHECKING:
    from swarmsim.fleet.running import Fleet

fleet = typer.Typer(
    help="Run a swarm as processes: a world, and each robot by itself.\n\n"
    "Example: swarmsim fleet up room --out runs/fleet --transport udp",
    no_args_is_help=True,
    rich_markup_mode=None,
)
Scenario = Annotated[Path, typer.Argument(help="Scenario file (TOML).")]
Pace = Annotated[
    str, typer.Option(help="lockstep: all wait for all. A number: so many times real time, and nobody waits.")
]
Links = Annotated[
    Literal["simulated", "real"],
    typer.Option(help="simulated: topology and channel say who hears whom. real: robots hear what arrives."),
]
Strikes = Annotated[
    list[str] | None,
    typer.Option(metavar="ROBOTS@ITERATION[:ITERATIONS]", help="Robots, when, and for how long; see above."),
]
Transport = Annotated[str, typer.Option(help="What carries frames: udp, zenoh, or an installed part.")]
Control = Annotated[
    str | None,
    typer.Option(metavar="HOST:PORT", help="Begin paused, and answer services of simulation_interfaces there."),
]
Link = Annotated[
    list[str] | None, typer.Option(metavar="KEY=VALUE", help="A key of the transport, as in interface=eth0.")
]


@fleet.command("up")
def up(
    scenario: Scenario,
    out: Annotated[Path | None, typer.Option(help="Folder for the recording; it must not exist yet.")] = None,
    pace: Pace = "lockstep",
    links: Links = "simulated",
    transport: Transport = "zenoh",
    link: Link = None,
    kill: Strikes = None,
    pause: Strikes = None,
    late: Strikes = None,
    faults: Faults = None,
    seed: Seed = None,
    set_: Overrides = None,
    control: Control = None,
    allow_code: AllowCode = False,
    quiet: Quiet = False,
) -> None:
    """Simulate a scenario whose robots are processes of their own, on this machine.

    Each has its own mind, senses only what the world tells it, and hears frames over the transport. In lockstep the
    recording is that of `swarmsim run`, to the last bit: `swarmsim verify` says so. At a pace, what is late is late,
    and faults strike the processes: --kill 1,3@200 kills, --kill 1@200:100 starts it again 100 iterations later, with
    an empty map, --pause 2@400:80 stops one for 80 iterations, and --late 3,4@300 starts two at 300. Exit codes are
    those of `run`.

    Example: swarmsim fleet up basilica --out runs/fleet --pace lockstep
    """
    from swarmsim.api.fleets import assembled, pace_of, strikes

    struck = strikes(kill or (), pause or (), late or ())
    made = assembled(scenario, seed, set_, [*struck, *(faults or ())], pace_of(pace), links)
    count = made.run.context.swarm
    head = f"{scenario}: a world and {count} robots, {count + 1} processes, over {transport}"
    _fly(made, head, out, scenario.stem, transport, link or (), quiet, control)


def serve(
    scenario: Scenario,
    at: Annotated[str, typer.Option(help="Address to listen at, HOST:PORT.")] = "127.0.0.1:7447",
    out: Annotated[Path | None, typer.Option(help="Folder for the recording; it must not exist yet.")] = None,
    pace: Pace = "lockstep",
    links: Links = "simulated",
    transport: Transport = "zenoh",
    link: Link = None,
    faults: Faults = None,
    seed: Seed = None,
    set_: Overrides = None,
    control: Control = None,
    allow_code: AllowCode = False,
    quiet: Quiet = False,
) -> None:
    """Simulate a world whose robots come by themselves, from any machine, each with `swarmsim robot run`.

    It waits until all have come. To listen beyond this machine name an interface. Exit codes are those of `run`.

    Example: swarmsim world serve scenarios/room.toml --at 192.168.1.20:7447 --link interface=eth0
    """
    from swarmsim.api.fleets import assembled, pace_of

    made = assembled(scenario, seed, set_, faults or (), pace_of(pace), links, local=False)
    head = f"{scenario}: waits at {at} for {made.run.context.swarm} robots, over {transport}"
    _fly(made, head, out, scenario.stem, transport, link or (), quiet, control, at)


def _fly(
    made: Fleet, head: str, out: Path | None, stem: str, transport: str, link: list[str] | tuple[()], quiet: bool,
    control: str | None, at: str | None = None,
) -> None:  # fmt: skip
    """Run a fleet to its end, and tell of it."""
    from swarmsim.api.fleets import flown
    from swarmsim.api.runs import new_folder

    with progress_bar(quiet) as progress, compiling(progress):
        folder = new_folder(out, stem)
        progress.console.print(head)
        with told_if_interrupted(lambda: f"{made.run.simulation.state.iteration} iterations are kept in {folder}"):
            task = progress.add_task("simulating", total=1.0, text="")
            done = flown(made, folder, transport, link, [RunBar(progress, task, made.run)], at, control)
    progress.console.print(table(done))
    raise typer.Exit(FINISHED if done.finished else NOT_FINISHED)


@fleet.command("merge")
def merge(
    logs: Annotated[Path, typer.Argument(help="Folder of logs: RUN/logs of `fleet up`.")],
    out: Annotated[Path, typer.Option(help="Folder for the recording; it must not exist yet.")],
    scenario: Annotated[
        Path | None, typer.Option(help="Use the robots' logs alone, of this scenario; true poses are then absent.")
    ] = None,
    seed: Seed = None,
    set_: Overrides = None,
    allow_code: AllowCode = False,
    quiet: Quiet = False,
) -> None:
    """Make one recording of the logs of a fleet's processes.

    With the world's log it is that of the run, to the last bit. Exit code 0: the logs hold the whole run; 1: something
    is missing, which is told; 2: bad input.

    Example: swarmsim fleet merge runs/fleet/logs --out runs/merged
    """
    from swarmsim.api.fleets import fleet_merge
    from swarmsim.cli.console import VisibleConsole

    found = fleet_merge(logs, out, scenario=scenario, seed=seed, overrides=set_, allow_code=allow_code)
    if not quiet:
        VisibleConsole().print(table(found.run))
        clocks = ", ".join(f"robot {robot} {1000.0 * ahead:+.1f}" for robot, ahead in found.offsets.items())
        print(f"clocks, in ms, ahead of the first: {clocks}")
    if found.lacks:
        print(f"missing: {found.lacks}")
    raise typer.Exit(NOT_FINISHED if found.lacks else FINISHED)


@fleet.command("status")
def status(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run by `fleet up`.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Tell how a fleet goes: its processes, its iteration, late ones, and what was dropped, by reason.

    Example: swarmsim fleet status runs/fleet
    """
    import msgspec

    from swarmsim.api.fleets import fleet_status

    told = msgspec.to_builtins(fleet_status(run), str_keys=True)
    if as_json:
        print(json.dumps(told, indent=2))
        return
    for name, value in {**told, **told.pop("free", {})}.items():
        words = ", ".join(f"{key} {one}" for key, one in value.items()) if isinstance(value, dict) else value
        print(f"{name}: {words}")
