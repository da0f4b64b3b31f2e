"""A robot's process: a robot at its end of a link, until its world ends."""

from __future__ import annotations

import argparse
import ctypes
import os
import signal
import sys
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, Literal

from swarmsim.core.charge import Charge
from swarmsim.core.errors import InputError, StorageError
from swarmsim.core.scenario import registry
from swarmsim.fleet.opening import opened
from swarmsim.fleet.robot_end import RobotEnd
from swarmsim.fleet.terms import AGAIN
from swarmsim.fleet.transport import LinkError

BAD_INPUT, LOST = 2, 3  # exit codes
_PR_SET_PDEATHSIG: Final = 1  # of Linux's prctl: which signal tells of the parent's end


def _end_with_parent() -> None:
    """End this process once the process at the other end of its input has ended, for whatever reason."""

    def watch() -> None:
        while os.read(0, 1):  # not sys.stdin, whose lock would outlive this process's end
            pass
        os._exit(LOST)

    with suppress(OSError, AttributeError):  # on Linux alone: a stopped process watches nothing
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    threading.Thread(target=watch, daemon=True).start()


def run(asked: RobotAsked) -> int:
    """Be the robot of this number; the exit code."""
    try:
        while not _lived(asked):
            asked = replace(asked, patient=True)
    except (InputError, LinkError, StorageError) as problem:
        sys.stderr.write(f"swarmsim: robot {asked.id}: {problem}\n")
        return LOST if isinstance(problem, LinkError) else BAD_INPUT
    return 0


def _lived(asked: RobotAsked) -> bool:
    """Join a world and live until it ends; whether that was all, or another world is awaited."""
    try:
        link = opened(asked.transport, asked.join, asked.id, asked.link)
    except InputError:
        if not asked.patient:
            raise
        time.sleep(AGAIN)
        return False
    try:
        with registry.own_code(asked.allow_code):
            RobotEnd(link, asked.id, asked.log, asked.recall, asked.charge).run()
    except LinkError as problem:
        if asked.after_world == "end":
            raise
        sys.stderr.write(f"swarmsim: robot {asked.id}: {problem}; waits for another world\n")
        return False
    finally:
        link.close()
    return True


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotAsked:
    """What a robot's process is started for."""

    transport: str
    join: str  # the world's address
    id: int  # its number
    charge: Charge | None = None  # that it expects to be told
    link: Sequence[str] = ()  # keys of the transport, as KEY=VALUE
    allow_code: bool = False
    log: Path | None = None
    recall: bool = False  # whether it begins with what its log says that it knew
    after_world: Literal["end", "wait"] = "end"  # whether it ends with its world, or waits for another one
    patient: bool = False  # whether it waits for a world that does not answer


def main(words: Sequence[str] | None = None) -> int:
    """One robot of a fleet on this machine, which ends with the process that started it."""
    parser = argparse.ArgumentParser(prog="swarmsim.fleet.robot_process")
    parser.add_argument("--transport", required=True)
    parser.add_argument("--join", required=True)
    parser.add_argument("--id", type=int, required=True)
    parser.add_argument("--link", action="append", default=[])
    parser.add_argument("--allow-code", action="store_true")
    parser.add_argument("--log", type=Path)
    parser.add_argument("--recall", action="store_true")
    asked = parser.parse_args(words)
    _end_with_parent()
    return run(RobotAsked(**vars(asked)))


if __name__ == "__main__":
    raise SystemExit(main())
