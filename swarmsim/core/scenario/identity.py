"""The code behind a run, by content: this package's, plug-ins', and the user's."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from swarmsim.core.code import distributions, snapshot
from swarmsim.core.code.snapshot import Files
from swarmsim.core.errors import InputError
from swarmsim.core.scenario.file import Scenario, every_part

OURS: Final = "swarmsim"
UNSEEN: Final = "unseen"  # instead of a hash, for code without a file


@dataclass(frozen=True, slots=True)
class Code:
    """All code behind a run."""

    #: A hash for `swarmsim`, for each part's distribution, and for each file of the user's.
    hashes: Mapping[str, str] = field(default_factory=dict)
    files: Files = field(default_factory=Files)  # the user's


def code_of(scenario: Scenario) -> Code:
    """The code behind a scenario's runs, as its parts loaded it. Raises InputError if files changed meanwhile."""
    hashes, base = {OURS: distributions.ours()}, ""
    texts, names = dict[Path, bytes](), dict[Path, str]()
    for part in every_part(scenario):
        place = part.use.rpartition(":")[0]
        entry = distributions.parts().get(part.seam, {}).get(part.use)
        if entry is not None and not _is_ours(entry.module):
            hashes |= [distributions.plugin(entry)]
        if not place or _is_ours(place):
            continue
        own = snapshot.home_of_class(type(part.parameters))
        if own.name_of(place) is None:
            hashes[place.partition(".")[0]] = distributions.module(place) or UNSEEN
        found, base = own.texts([place]), str(own.base)
        if changed := [str(file) for file in found.keys() & texts.keys() if found[file] != texts[file]]:
            raise InputError(f"{', '.join(sorted(changed))}: was edited while the scenario was read; read it again")
        texts |= found
        names |= {file: own.short(file) for file in found}
    for file in sorted(texts):
        name, number = names[file], 2
        while name in hashes:
            name, number = f"{names[file]} ({number})", number + 1
        hashes[name] = hashlib.blake2b(texts[file], digest_size=8).hexdigest()
    return Code(hashes, Files(base, tuple((str(file), texts[file]) for file in sorted(texts))))


def known(code: Code, place: str) -> Code:
    """The same code. Raises InputError, which starts with `place`, if other processes might not get the same."""
    for name, found in code.hashes.items():
        if found == UNSEEN:
            raise InputError(f"{place}: the code of {name!r} stands in no file; expected a file, which workers can run")
        if found.endswith(distributions.CHANGED):
            raise InputError(
                f"{place}: the files of {name} have changed since this process began to use them; start it again"
            )
    return code


def differences(was: Mapping[str, str], now: Mapping[str, str], here: str = "now") -> str:
    """Differences of code in words: `mind.py (1a2b3c4d, now 5e6f7a8b)`; empty if there are none."""
    names = [name for name in {**was, **now} if was.get(name) != now.get(name)]
    return ", ".join(f"{name} ({_short(was.get(name))}, {here} {_short(now.get(name))})" for name in names)


def _short(found: str | None) -> str:
    if found is None:
        return "none"
    return f"{found[:8]}, changed since" if found.endswith(distributions.CHANGED) else found[:8]


def _is_ours(module: str) -> bool:
    return module.partition(".")[0] == OURS
