"""The seam of adapters: what a robot's body senses, and how it is driven, in the words of its maker."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, Protocol

from swarmsim.core.seams import Seam

Pose = tuple[float, float, float]  # x and y in m, yaw in rad


@dataclass(frozen=True, slots=True)
class Felt:
    """What a body knows at one moment."""

    pose: Pose | None = None  # in the frame of what measures it; None: unknown
    velocity: tuple[float, float] | None = None  # m/s ahead, rad/s; None: unknown
    values: Mapping[str, tuple[float, ...]] = field(default_factory=dict)  # what else it senses, by its maker's names


class RobotBody(Protocol):
    """One robot's body, real or simulated. No verb waits for it."""

    def sense(self) -> Felt:
        """What it has told last. Raises LinkError once it cannot be reached."""
        ...

    def drive(self, ahead: float, turn: float) -> None:
        """Go on at a velocity (m/s, rad/s), as fast as it can if that is too fast. Raises LinkError."""
        ...

    def stop(self) -> None:
        """Stand. Raises LinkError."""
        ...

    def close(self) -> None:
        """Let go of it; it stands."""
        ...


class Adapter(Protocol):
    """Speaks to the body of a real robot."""

    def open(self, robot: int) -> RobotBody:
        """Reach the body of the robot of this number. Raises InputError, in a sentence, if it does not answer."""
        ...


SEAM: Final = Seam("adapter", (), Adapter, elsewhere="`swarmsim.fleet.guard`")
