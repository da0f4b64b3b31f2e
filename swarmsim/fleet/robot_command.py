"""The program `swarmsim-robot`: one robot of a fleet, where no more than a robot's half of the package is installed."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import swarmsim
from swarmsim.core.errors import InputError, lacks
from swarmsim.core.scenario import registry
from swarmsim.fleet.diaries import replayed
from swarmsim.fleet.robot_process import BAD_INPUT
from swarmsim.fleet.starting import OneRobot, started

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
        "run", help="join a world or, with --adapter, live in a body",
        description="Be one robot: of a world that tells it its charge, until that ends, or with a body of its own. "
        "Exit code 0: it has ended as it should; 2: bad input; 3: the world or the body was lost.",
        epilog="Example: swarmsim-robot run --id 3 --join 192.168.1.20:7447",
    )  # fmt: skip
    one.add_argument("--join", required=True, metavar="HOST:PORT", help="the world's address")
    one.add_argument("--id", type=int, dest="id_", help="the robot's number, from 0")
    one.add_argument(
        "--charge", type=Path, metavar="FILE",
        help="a charge that `swarmsim robot charge` wrote: it has the number, and a world has to simulate its scenario",
    )  # fmt: skip
    one.add_argument("--transport", default="zenoh", help="what carries frames: zenoh, udp, or an installed part")
    one.add_argument("--log", type=Path, metavar="FILE", help="file to log into; an earlier one goes on")
    one.add_argument("--recall", action="store_true", help="begin with what the log says that it knew")
    one.add_argument("--after-world", choices=("end", "wait"), default="end", help="when the world is lost")
    one.add_argument("--adapter", default="", help="live without a world, in the body that this adapter reaches")
    for option, told in (("link", "transport"), ("body", "adapter"), ("guard", "guard, as in fence=[0,0,2,1.5]")):
        one.add_argument(f"--{option}", action="append", default=[], metavar="KEY=VALUE", help=f"a key of the {told}")
    one.add_argument("--nearest", type=int, default=0, help="with an adapter: listen to so many; 0: to all")
    one.add_argument("--iterations", type=int, help="with an adapter: end after so many")
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
    return started(OneRobot(**{name: value for name, value in vars(asked).items() if name != "do"}))


def _replay(asked: argparse.Namespace) -> int:
    with registry.own_code(asked.allow_code):
        found = replayed(asked.log)
    sys.stdout.write(f"{asked.log}: {found}\n")
    return 0 if found.equal else DIFFERENT


if __name__ == "__main__":
    raise SystemExit(main())
