"""Digests of iterations: two runs are equal if and only if their digests are."""

from __future__ import annotations

import hashlib
import platform
from functools import cache
from importlib import metadata
from typing import Final

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.state import Knowledge, Moment

DIGESTED: Final = (
    "pose", "velocity", "wheels", "alive", "readings", "links", "heard", "knowledge", "goals", "ways", "measured",
)  # fmt: skip


#: Further fields, hashed in runs with actuators.
ACTUATED: Final = "actuators"


class Digests:
    """An observer that hashes each field of every iteration, eight bytes each (BLAKE2b, RFC 7693)."""

    def __init__(self) -> None:
        self.rows: list[bytes] = []

    def sample(self, moment: Moment[Knowledge]) -> None:
        """Append one row: the hashes of DIGESTED, in that order, and of ACTUATED if there is any."""
        self.rows.append(b"".join(hashed(*arrays) for arrays in _digested(moment)))

    def total(self) -> str:
        """The digest of the whole run so far, in hexadecimal."""
        return hashlib.blake2b(b"".join(self.rows), digest_size=16).hexdigest()


def _digested(moment: Moment[Knowledge]) -> tuple[tuple[NDArray[np.generic], ...], ...]:
    state, intents = moment.state, moment.intents
    acted = state.actuators.arrays()
    return (
        (state.pose,),
        (state.velocity,),
        (state.wheels,),
        (state.alive,),
        moment.readings.arrays(),
        (moment.links,),
        moment.inbox.arrays(),
        (*moment.knowledge.arrays(), *(array for one in moment.jobs for array in one.knowledge.arrays())),
        (moment.building.lattice.cells_within(intents.goals),),  # as cells, the original form of goals
        (intents.counts, intents.waypoints, *(() if intents.twists is None else (intents.twists,))),
        moment.measured.arrays(),
        *([(*acted, *intents.commands.values())] if acted else []),
    )


def hashed(*arrays: NDArray[np.generic]) -> bytes:
    """Eight bytes for the bytes of all arrays."""
    made = hashlib.blake2b(digest_size=8)
    for array in arrays:
        made.update(array.data if array.flags.c_contiguous else array.tobytes())
    return made.digest()


@cache  # reading it takes a millisecond
def version(distribution: str) -> str:
    """The version of an installed distribution."""
    return metadata.version(distribution)


def versions() -> dict[str, str]:
    """The versions that a run's bytes depend on besides its scenario and seed."""
    packages = {name: version(name) for name in ("numpy", "numba", "pymunk", "shapely", "svgelements")}
    return {
        "swarmsim": version("swarmsim-lab"),
        "python": platform.python_version(),
        **packages,
        "platform": f"{platform.system()} {platform.machine()}",
    }
