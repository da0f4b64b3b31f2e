"""A set of three tiny worlds, one of them held out, for tests of the benchmark."""

from __future__ import annotations

import hashlib
import re
import shutil
from pathlib import Path

from swarmsim.core.scenario.decoding import read_struct
from swarmsim.studies.benchmark import sets
from swarmsim.studies.benchmark.listed import lines_of
from swarmsim.studies.benchmark.referenced import TOURS

SECRET = "long enough to be a secret"
TINY = 'rooms = {use = "rooms", width = 3.0, height = 2.4, room = 1.2}'
#: Each world's part, regime, and whether something goes wrong in it.
WORLDS = {"a": ("public", "nearest", False), "b": ("public", "thin", True), "c": ("held-out", "sight", False)}


def tiny_set(folder: Path) -> Path:
    """Write the set, with the shipped one's regimes, and its secret beside it; gives the folder."""
    shutil.copytree(sets.shipped_set(), folder)
    for name in (sets.REFERENCES, TOURS):
        (folder / name).unlink()
    text = (folder / sets.SET).read_text().replace("counts = [4, 10, 30]", "counts = [2, 3]")
    text = re.sub(r"k = \d", "k = 1", re.sub(r"rooms = .*", TINY, text))
    text = re.sub(r"(halls|office|maze|cave|obstacles) = .*\n", "", text)
    text = re.sub(r"commitment = .*", f'commitment = "{sets.commitment(SECRET, "explore-1")}"', text)
    (folder / sets.SET).write_text(text)
    about = read_struct(folder / sets.SET, "a set", sets.SetFile)
    lines, held = [], hashlib.blake2b(digest_size=16, key=SECRET.encode())
    for number, (name, (part, regime, struck)) in enumerate(WORLDS.items()):
        out = part == "held-out"
        seed = sets.held_out_seed(SECRET, name) if out else number
        digest = sets.digest_of(folder, about, {"generate": about.kinds["rooms"], "seed": seed}, name)
        if out:
            held.update(digest.encode())
        lines.append(
            sets.SetWorld(
                world=name, kind="rooms", part=part, regime=regime, struck=struck, seed=None if out else seed, file="",
                digest=None if out else digest,
            )
        )  # fmt: skip
    (folder / sets.WORLDS).write_text(lines_of(lines, sets.SetWorld))
    (folder / sets.SET).write_text(re.sub(r"sealed = .*", f'sealed = "{held.hexdigest()}"', text))
    (folder / "secret.txt").write_text(SECRET + "\n")
    return folder
