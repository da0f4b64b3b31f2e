"""The verbs of one robot of a fleet."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import Annotated, Literal

import typer

from swarmsim.cli.fleets import Link, Scenario, Transport
from swarmsim.cli.options import AllowCode, Overrides, Quiet, Seed
from swarmsim.cli.progress import Counted, progress_bar
from swarmsim.cli.runs import FINISHED, NOT_FINISHED

robot = typer.Typer(
    help="One robot of a fleet.\n\nExample: swarmsim robot charge basilica --id 3 --out build/3.charge",
    no_args_is_help=True,
    rich_markup_mode=None,
)

Body = Annotated[
    list[str] | None, typer.Option(metavar="KEY=VALUE", help="A key of the adapter, as in port=/dev/ttyACM0.")
]
Guard = Annotated[
    list[str] | None, typer.Option(metavar="KEY=VALUE", help="A limit of the body, as in fence=[0,0,2,1.5].")
]


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
    join: Annotated[str, typer.Option(help="Where to meet, HOST:PORT: the world's address.")],
    id_: Annotated[int | None, typer.Option("--id", help="The robot's number, from 0.")] = None,
    charge: Annotated[Path | None, typer.Option(help="Its charge; a world has to simulate that scenario.")] = None,
    transport: Transport = "zenoh",
    link: Link = None,
    log: Annotated[Path | None, typer.Option(help="File to log into; an earlier one goes on.")] = None,
    recall: Annotated[bool, typer.Option("--recall", help="Begin with what the log says that it knew.")] = False,
    after_world: Annotated[
        Literal["end", "wait"], typer.Option(help="When the world is lost: end, or wait for another one.")
    ] = "end",
    adapter: Annotated[str, typer.Option(help="Live without a world, in the body that this adapter reaches.")] = "",
    body: Body = None,
    guard: Guard = None,
    nearest: Annotated[int, typer.Option(min=0, help="With an adapter: listen to so many; 0: to all.")] = 0,
    iterations: Annotated[int | None, typer.Option(min=1, help="With an adapter: end after so many.")] = None,
    allow_code: AllowCode = False,
) -> None:
    """Be one robot: of a world that tells it its charge, or with a body of its own.

    Without --adapter it joins a world and goes on until that ends. With one it needs a --charge and no world: it
    senses and drives its body, hears the robots that it meets, and goes on until it is told to end. The body stands if
    its mind falls silent, if it leaves the guard's fence, and after `swarmsim robot halt`.

    Exit code 0: it has ended as it should; 2: bad input; 3: the world or the body was lost.

    Example: swarmsim robot run --id 3 --join 127.0.0.1:7447
    """
    from swarmsim.fleet.starting import OneRobot, started

    asked = OneRobot(
        join=join, id_=id_, charge=charge, transport=transport, link=link or (), log=log, recall=recall,
        after_world=after_world, adapter=adapter, body=body or (), guard=guard or (), nearest=nearest,
        iterations=iterations, allow_code=allow_code,
    )  # fmt: skip
    raise typer.Exit(started(asked))


@robot.command("halt")
def halt(
    join: Annotated[str, typer.Option(help="Where the robots meet, HOST:PORT.")],
    id_: Annotated[int | None, typer.Option("--id", help="One robot's number; default: all robots.")] = None,
    release: Annotated[bool, typer.Option("--release", help="End the emergency stop.")] = False,
    transport: Transport = "zenoh",
    link: Link = None,
) -> None:
    """Let robots with bodies of their own stand at once, whatever their minds tell them, until they are released.

    The order is a frame on the air, said for a second. It reaches robots that hear it and whose minds live: have a
    switch at hand, too.

    Example: swarmsim robot halt --join 192.168.1.20:7447 --transport udp --link interface=eth0
    """
    from swarmsim.fleet.emergency import EVERYBODY, say
    from swarmsim.fleet.opening import opened
    from swarmsim.fleet.transport import WORLD

    with closing(opened(transport, join, WORLD, link or ())) as there:
        say(there, EVERYBODY if id_ is None else id_, not release)
    print(f"{'all robots' if id_ is None else f'robot {id_}'} at {join}: {'released' if release else 'halted'}")


@robot.command("replay")
def replay(
    recording: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run, or its recording.")],
    id_: Annotated[int, typer.Option("--id", help="The robot's number, from 0.")] = 0,
    out: Annotated[Path | None, typer.Option(help="File to keep what it was told in, for another computer.")] = None,
    allow_code: AllowCode = False,
    quiet: Quiet = False,
) -> None:
    """Try one robot's mind: let it sense and hear what it did in a run, and compare what it says and does.

    With --out, `swarmsim-robot replay FILE` does the same on the computer of a robot, and tells how long that takes.
    Exit code 0: equal, to the last bit; 1: different; 2: bad input.

    Example: swarmsim robot replay runs/basilica-1 --id 3 --out build/3.log
    """
    from swarmsim.api.runs import open as open_run

    opened = open_run(recording)
    with progress_bar(quiet) as progress:
        told = Counted(progress, "simulating")
        found = opened.replay(id_=id_, out=out, allow_code=allow_code, progress=told)
    print(f"{recording}: {found}")
    raise typer.Exit(FINISHED if found.equal else NOT_FINISHED)
