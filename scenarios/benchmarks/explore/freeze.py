"""Make a set's worlds.csv from its set.toml and a secret: python freeze.py FOLDER SECRET.

Ten worlds of each kind. World i has the kind i mod 6 and is number a = i div 6 of it; its regime is number
(a + 2 kind) mod 4, something goes wrong where a mod 5 = 0, and it is held out where (a + kind) mod 3 = 0. So each part
has each regime equally often, and each regime has equally many worlds in which something goes wrong.
"""

from __future__ import annotations

import hashlib
import sys
from pathlib import Path

from swarmsim.core.scenario.decoding import read_struct
from swarmsim.studies.benchmark import sets
from swarmsim.studies.benchmark.listed import lines_of

EACH = 10


def main(folder: Path, secret: str) -> None:
    about = read_struct(folder / sets.SET, "a set", sets.SetFile)
    kinds, regimes = list(about.kinds), list(about.regimes)
    name, worlds = f"{about.name}-{about.edition}", list[sets.SetWorld]()
    held = hashlib.blake2b(digest_size=16, key=secret.encode()[:64])
    for i in range(EACH * len(kinds)):
        kind, a = i % len(kinds), i // len(kinds)
        world, out = f"{kinds[kind]}-{a}", (a + kind) % 3 == 0
        public = int.from_bytes(hashlib.blake2b(f"{name}: {world}".encode(), digest_size=4).digest(), "big")
        seed = sets.held_out_seed(secret, world) if out else public
        digest = sets.digest_of(folder, about, {"generate": about.kinds[kinds[kind]], "seed": seed}, world)
        if out:
            held.update(digest.encode())
        worlds.append(
            sets.SetWorld(
                world=world, kind=kinds[kind], part="held-out" if out else "public",
                regime=regimes[(a + 2 * kind) % len(regimes)], struck=a % 5 == 0,
                seed=None if out else seed, file="", digest=None if out else digest,
            )
        )  # fmt: skip
    (folder / sets.WORLDS).write_text(lines_of(worlds, sets.SetWorld))
    sys.stdout.write(f'commitment = "{sets.commitment(secret, name)}"\nsealed = "{held.hexdigest()}"\n')  # for set.toml


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]).read_text().strip())
