"""Which code makes a run, by content: this package's, that of plug-ins, and the user's own."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final

import msgspec

from swarmsim.core import distributions, snapshot
from swarmsim.core.errors import InputError
from swarmsim.core.snapshot import Files

OURS: Final = "swarmsim"
UNSEEN: Final = "unseen"  # in the place of a hash, for code without a file


@dataclass(frozen=True, slots=True)
class Code:
    """All code that makes a run."""

    #: A hash for `swarmsim`, for each distribution that a part is from, and for each file of the user's own.
    hashes: Mapping[str, str] = field(default_factory=dict)
    files: Files = field(default_factory=Files)  # the user's own


def code_of(scenario: msgspec.Struct) -> Code:
    """The code that makes the runs of a scenario, whose own code is loaded."""
    named = set(uses(msgspec.to_builtins(scenario)))
    places = sorted({use.rpartition(":")[0] for use in named if ":" in use})
    hashes = {OURS: distributions.ours()}
    for entries in distributions.parts().values():
        used = [entries[use] for use in named & entries.keys()]
        hashes |= dict(distributions.plugin(entry) for entry in used if not _is_ours(entry.module))
    if not places:
        return Code(hashes)
    now = snapshot.present()
    texts = now.texts(places)
    for place in places:
        if now.name_of(place) is None and not _is_ours(place):
            hashes[place.partition(".")[0]] = distributions.module(place) or UNSEEN
    for file, text in sorted(texts.items()):
        name, number = now.short(file), 2
        while name in hashes:
            name, number = f"{now.short(file)} ({number})", number + 1
        hashes[name] = hashlib.blake2b(text, digest_size=8).hexdigest()
    return Code(hashes, Files(str(now.base), tuple((str(file), text) for file, text in sorted(texts.items()))))


def known(code: Code, place: str) -> Code:
    """The same code. Raises InputError, which starts with `place`, if other processes cannot have it for sure."""
    for name, found in code.hashes.items():
        if found == UNSEEN:
            raise InputError(f"{place}: the code of {name!r} stands in no file; expected a file, which workers can run")
        if found.endswith(distributions.CHANGED):
            raise InputError(
                f"{place}: the files of {name} have changed since this process began to use them; start it again"
            )
    return code


def differences(was: Mapping[str, str], now: Mapping[str, str], here: str = "now") -> str:
    """In what code differs, in words: `mind.py (1a2b3c4d, now 5e6f7a8b)`; nothing if it is the same."""
    names = [name for name in {**was, **now} if was.get(name) != now.get(name)]
    return ", ".join(f"{name} ({_short(was.get(name))}, {here} {_short(now.get(name))})" for name in names)


def _short(found: str | None) -> str:
    if found is None:
        return "none"
    return f"{found[:8]}, changed since" if found.endswith(distributions.CHANGED) else found[:8]


def _is_ours(module: str) -> bool:
    return module.partition(".")[0] == OURS


def uses(value: object) -> Iterator[str]:
    """What parts are called, at any depth of a scenario's tables."""
    if isinstance(value, dict):
        if isinstance(use := value.get("use"), str):
            yield use
        value = value.values()
    elif not isinstance(value, list | tuple):
        return
    for inner in value:
        yield from uses(inner)
