"""On what terms a world and its robots go together: whether they wait for one another, and whom robots hear."""

from __future__ import annotations

from typing import Annotated, Final, Literal, Self

import msgspec
from msgspec import Meta, Struct

from swarmsim.core.errors import InputError

LATE: Final = 8  # iterations after which a frame that was heard on a real link counts no more
PATIENCE: Final = 3  # periods without a fresh decision, after which a body stands

AGAIN: Final = 1.0  # s between two knocks at the world's door

Links = Literal["simulated", "real"]


class Terms(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What a world tells each robot besides its charge."""

    period: Annotated[float, Meta(ge=0.0, le=1e5)] = 0.0  # s on the clock for an iteration; 0: all wait for all
    links: Links = "simulated"  # whether the world says who hears whom, or robots hear what arrives
    nearest: Annotated[int, Meta(ge=0)] = 0  # with real links: how many senders a robot listens to; 0: all

    @property
    def lockstep(self) -> bool:
        """Whether an iteration goes on once every robot has answered, and not before."""
        return self.period == 0.0

    def packed(self) -> bytes:
        """As bytes."""
        return msgspec.json.encode(self)

    @classmethod
    def read(cls, data: bytes) -> Self:
        """What `packed` made. Raises InputError."""
        try:
            return msgspec.json.decode(data, type=cls)
        except msgspec.DecodeError as problem:
            raise InputError(f"the world's terms: {problem}; expected a world of this version") from problem


def from_robot(robot: int) -> str:
    """The channel on which one robot tells the world."""
    return f"robots/{robot}"


def from_world(robot: int) -> str:
    """The channel on which the world tells one robot."""
    return f"world/{robot}"
