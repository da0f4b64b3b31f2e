"""The program `swarmsim-robot`: one robot of a fleet, where no more than a robot's half of the package is installed."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import swarmsim
from swarmsim.core.charge import Charge
from swarmsim.core.errors import InputError, lacks
from swarmsim.core.robot import warm
from swarmsim.core.scenario import registry
from swarmsim.fleet.diaries import replayed
from swarmsim.fleet.robot_process import BAD_INPUT, RobotAsked, run

DIFFERENT: Final = 1  # exit code


def main(words: Sequence[str] | None = None) -> int:
    """Do what the command line asks for; the exit code."""
    asked = _parser().parse_args(words)
    try:
        done: int = asked.do(asked)
    except InputError as problem:
        found = problem
    except ModuleNotFoundError as problem:
        found = lacks("this robot's mind", problem)
    else:
        return done
    sys.stderr.write(f"swarmsim-robot: {found}\n")
    return BAD_INPUT


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="swarmsim-robot", description="One robot of a swarm.")
    parser.add_argument("--version", action="version", version=f"swarmsim-robot {swarmsim.__version__}")
    verbs = parser.add_subparsers(required=True, metavar="VERB")
    one = verbs.add_parser(
        "run", help="join a world, and go on until it ends",
        description="Be one robot: join a world, be told a charge, and go on until the world ends. Exit code 0: the "
        "world has ended; 2: bad input; 3: the world was lost.",
        epilog="Example: swarmsim-robot run --id 3 --join 192.168.1.20:7447",
    )  # fmt: skip
    one.add_argument("--join", required=True, metavar="HOST:PORT", help="the world's address")
    number = one.add_mutually_exclusive_group(required=True)
    number.add_argument("--id", type=int, help="the robot's number, from 0")
    number.add_argument(
        "--charge", type=Path, metavar="FILE",
        help="a charge that `swarmsim robot charge` wrote: it has the number, and its mind is tried before joining",
    )  # fmt: skip
    one.add_argument("--transport", default="zenoh", help="what carries frames: zenoh, udp, or an installed part")
    one.add_argument("--allow-code", action="store_true", help="run code that the scenario names")
    one.set_defaults(do=_run)
    one = verbs.add_parser(
        "replay", help="live through a log, and compare",
        description="Let a robot sense and hear what it did in a run, and compare what it says and does, to the last "
        "bit. Exit code 0: equal; 1: different; 2: bad input.",
        epilog="Example: swarmsim-robot replay 3.log",
    )  # fmt: skip
    one.add_argument("log", type=Path, help="a robot's log, or what `swarmsim robot replay --out` wrote")
    one.add_argument("--allow-code", action="store_true", help="run code that the scenario names")
    one.set_defaults(do=_replay)
    return parser


def _run(asked: argparse.Namespace) -> int:
    number: int = asked.id if asked.charge is None else _tried(asked.charge, asked.allow_code)
    return run(RobotAsked(transport=asked.transport, join=asked.join, id=number, allow_code=asked.allow_code))


def _replay(asked: argparse.Namespace) -> int:
    with registry.own_code(asked.allow_code):
        found = replayed(asked.log)
    sys.stdout.write(f"{asked.log}: {found}\n")
    return 0 if found.equal else DIFFERENT


def _tried(file: Path, allow_code: bool) -> int:
    """The number of the robot of a charge, once its mind has worked here. Raises InputError."""
    charge = Charge.open(file)
    with registry.own_code(allow_code):
        warm(charge)
    return charge.robot


if __name__ == "__main__":
    raise SystemExit(main())
