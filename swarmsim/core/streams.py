"""Random numbers by purpose and robot, so that an extra draw in one place shifts none elsewhere."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class Streams:
    """All the randomness of one run, derived from its seed by name.

    A stream depends on the seed, its purpose and its robot only: neither on the order in which
    streams are opened nor on how many others there are.
    """

    seed: int

    def open(self, purpose: str, robot: int = -1) -> np.random.Generator:
        """The stream for `purpose`, one per robot if `robot` is given; opening it again restarts it."""
        name = int.from_bytes(hashlib.blake2b(purpose.encode(), digest_size=8).digest())
        sequence = np.random.SeedSequence(self.seed, spawn_key=(name, robot + 1))
        return np.random.Generator(np.random.Philox(sequence))
