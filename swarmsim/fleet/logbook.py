"""What each process of a fleet writes down of what it hears, says and decides: whole up to the moment it is killed."""

from __future__ import annotations

import os
import struct
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final, final

from msgspec import Struct

from swarmsim.core.errors import InputError, unwritten
from swarmsim.core.messages import FrameError
from swarmsim.fleet import wire
from swarmsim.fleet.terms import Terms
from swarmsim.fleet.wire import Telegram

_MARK: Final = b"swarmsim log 1\n"
_HEAD: Final = struct.Struct(">BqI")  # kind, when on the process's own clock (ns), bytes of what follows
_LARGEST: Final = 2**26  # bytes of an entry
#: Kinds besides those of telegrams: a frame heard on the air; the terms; a mind that goes on with what it knew; of a
#: world its scenario, what had come from robots by then, and what was seen of their processes.
HEARD, TERMS, RECALLED, SCENARIO, CAME, SEEN = range(wire.END + 1, wire.END + 7)
LAST: Final = SEEN


class WorldTold(Struct, frozen=True, forbid_unknown_fields=True):
    """What a world's log begins with: its scenario."""

    name: str  # of the scenario's file
    scenario: str  # TOML, complete
    world: str  # the floor plan's text
    terms: Terms
    local: bool  # whether the robots' processes were on the world's machine


class Came(Struct, frozen=True, array_like=True):
    """What had come from robots, since the last such entry, when a world went on."""

    iteration: int
    said: tuple[int, ...] = ()  # robots whose frames of this iteration had
    ready: tuple[int, ...] = ()  # robots that had joined
    deeds: tuple[tuple[int, int], ...] = ()  # robots and iterations, in order


class ProcessesSeen(Struct, frozen=True, array_like=True):
    """What a world saw of its robots' processes."""

    iteration: int
    gone: tuple[int, ...] = ()
    paused: tuple[int, ...] = ()
    ready: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class LogEntry:
    """One entry of a log."""

    kind: int
    when: int  # ns, on the clock of the process that wrote it
    data: bytes

    def telegram(self, path: Path) -> Telegram:
        """The telegram in it, by the log at `path`. Raises InputError."""
        try:
            return Telegram.read(self.data)
        except FrameError as problem:
            raise InputError(f"{path}: {problem}; expected a log as it was written") from problem


@final
class Logbook:
    """Appends entries to a file. What `flush` has been called for is kept if the process is killed."""

    def __init__(self, path: Path) -> None:
        """Go on with a file, or begin it. Raises InputError for one that is no log, StorageError for a full disk."""
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            begun = path.exists() and path.stat().st_size > 0
            length = sum(_HEAD.size + len(one.data) for one in entries(path)) if begun else 0
            self._file = os.open(path, os.O_WRONLY | os.O_CREAT, 0o644)
            os.ftruncate(self._file, len(_MARK) + length if begun else 0)  # an entry that was cut short ends here
            os.lseek(self._file, 0, os.SEEK_END)
        except OSError as problem:
            raise unwritten(f"--log {path}", problem) from problem
        self._path, self._waiting = path, bytearray(b"" if begun else _MARK)
        self.flush()

    def note(self, kind: int, data: bytes) -> None:
        """Add an entry."""
        self._waiting += _HEAD.pack(kind, time.monotonic_ns(), len(data)) + data

    def flush(self) -> None:
        """Hand over to the system all that was noted. Raises StorageError for a full disk."""
        try:
            while self._waiting:
                del self._waiting[: os.write(self._file, self._waiting)]
        except OSError as problem:
            raise unwritten(f"--log {self._path}", problem) from problem

    def close(self) -> None:
        """The end."""
        self.flush()
        os.close(self._file)


@final
class NoLogbook:
    """Keeps nothing."""

    def note(self, kind: int, data: bytes) -> None:
        """Nothing."""

    def flush(self) -> None:
        """Nothing."""

    def close(self) -> None:
        """Nothing."""


def entries(path: Path) -> Iterator[LogEntry]:
    """All whole entries of a log. Raises InputError for a file that is none."""
    try:
        with path.open("rb") as file:
            if file.read(len(_MARK)) != _MARK:
                raise InputError(f"{path}: is no log of a fleet's process; expected one that `fleet up` has written")
            while len(head := file.read(_HEAD.size)) == _HEAD.size:
                kind, when, length = _HEAD.unpack(head)
                if kind > LAST or length > _LARGEST:
                    raise InputError(f"{path}: an entry of kind {kind} and {length} bytes; expected a log as written")
                data = file.read(length)
                if len(data) < length:
                    return
                yield LogEntry(kind, when, data)
    except OSError as problem:
        raise InputError(f"{path}: cannot be read ({problem.strerror}); expected a log") from problem
