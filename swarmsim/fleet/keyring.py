"""Secrets of a swarm: one for each robot and one for its world, in one file."""

from __future__ import annotations

import hashlib
import os
import re
import secrets
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from swarmsim.core.errors import InputError, unwritten
from swarmsim.fleet.transport import WORLD

TAG: Final = 8  #: bytes of a tag: a forger succeeds once in 2^64 tries
_LINE: Final = re.compile(r"(world|robot(\d{1,5})):((?:[0-9a-f]{2}){16,32})")
_LARGEST: Final = 2**23  # bytes of a file: a line for each of 65536 robots takes less


def user(robot: int) -> str:
    """What a robot, or WORLD, is called in the file, and in a network that asks for passwords."""
    return "world" if robot == WORLD else f"robot{robot}"


def read_keys(path: str | Path, kind: str) -> Mapping[int, bytes]:
    """The secrets by number, of a file whose lines are `robot3:` and 16 to 32 bytes in hexadecimal.

    zenoh reads the same file as a list of passwords. Raises InputError, which names file and line.
    """
    file, found = Path(path), dict[int, bytes]()
    try:
        if not file.is_file() or file.stat().st_size > _LARGEST:
            raise InputError(
                f"transport {kind}: keys: {file} is no file of keys; expected one by `swarmsim radio keys`"
            )
        lines = file.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeError) as problem:
        raise InputError(
            f"transport {kind}: keys: {file} cannot be read ({problem}); expected a file of keys"
        ) from problem
    for number, line in enumerate(lines, 1):
        matched = _LINE.fullmatch(line)
        robot = -2 if matched is None else WORLD if matched[2] is None else int(matched[2])
        if matched is None or robot > 65_535 or robot in found:
            raise InputError(
                f"transport {kind}: keys: {file}: line {number} is no key, or a second one; expected robot3: or world: "
                "and 32 to 64 hexadecimal digits"
            )
        found[robot] = bytes.fromhex(matched[3])
    return found


def key_of(robot: int, keys: Mapping[int, bytes], path: str | Path, kind: str) -> bytes:
    """One's own secret. Raises InputError if the file has none."""
    if robot not in keys:
        raise InputError(
            f"transport {kind}: keys: {path} has none for {user(robot)}; expected a line {user(robot)}:KEY"
        )
    return keys[robot]


def tag(data: bytes, key: bytes, purpose: bytes) -> bytes:
    """The tag that only who has the key can make: keyed BLAKE2b (RFC 7693). None of another `purpose` is equal."""
    return hashlib.blake2b(data, digest_size=TAG, key=key, person=purpose).digest()


def write_keys(robots: int, out: str | Path) -> Path:
    """Write to `out` new secrets for a world and so many `robots`, readable by you alone: `swarmsim radio keys`.

    Give each robot a copy: with the file one can pass for any of them. Raises InputError for a file that exists, or
    that cannot be written.
    """
    path = Path(out)
    text = "".join(f"{user(robot)}:{secrets.token_hex(32)}\n" for robot in range(WORLD, robots))
    try:
        with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError as problem:
        raise InputError(f"{path}: exists already; expected a new name, nothing is overwritten") from problem
    except OSError as problem:
        raise unwritten(path, problem) from problem
    return path
