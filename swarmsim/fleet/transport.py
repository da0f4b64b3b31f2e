"""The seam of transports: what carries frames between robots that are processes, or machines, of their own."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, Protocol

from swarmsim.core.errors import InputError
from swarmsim.core.seams import Seam

#: The number of the process that is no robot: it moves the simulated bodies, or gives commands.
WORLD: Final = -1
Heard = tuple[bytes, float | None]  # a frame, and how strong its signal was (dBm), where that is measured


class LinkError(Exception):
    """A link that stood has ended, so its process cannot go on; the message says which and why."""


class RobotLink(Protocol):
    """One robot's end of a transport. It never hears itself, and no verb but `wait` waits for anybody.

    Frames are taken and given as they are: bytes that a codec packed, with nothing before or after them.
    """

    @property
    def mtu(self) -> int:
        """The bytes of the longest frame."""
        ...

    @property
    def counts(self) -> Mapping[str, int]:
        """What was not delivered, by reason, such as `full`: frames that nobody took in time."""
        ...

    def say(self, frame: bytes) -> None:
        """Send a frame to all who listen. What does not get through is lost, on a channel nothing is.

        Raises InputError for a frame longer than the mtu, LinkError on a closed link.
        """
        ...

    def heard(self) -> list[Heard]:
        """The frames that have arrived since it was last asked, in their order of arrival.

        Raises LinkError where a channel has broken off.
        """
        ...

    def wait(self, seconds: float) -> bool:
        """Wait until there is something to hear, at most so long; whether there is."""
        ...

    def airtime(self, length: int) -> float:
        """How long a frame of so many bytes occupies the medium, in s."""
        ...

    def present(self) -> set[int]:
        """The numbers of the others that are there, WORLD among them: what is said from now on reaches them."""
        ...

    def channel(self, name: str) -> RobotLink:
        """A link to all who open a channel of this name, on which frames arrive whole, once and in order.

        It is for commands and what a simulated world tells; robots talk on the link itself. A channel ends with its
        link. Raises InputError where a transport has no channels, or if the host does not answer.
        """
        ...

    def close(self) -> None:
        """Leave. A closed link hears nothing; closing it again does nothing."""
        ...


class Transport(Protocol):
    """Carries frames between robots that are processes of their own."""

    def open(self, address: str, robot: int) -> RobotLink:
        """Join at an address as the robot of this number, or as WORLD.

        Raises InputError, in a sentence, for an address that is none, is taken or does not answer.
        """
        ...


SEAM: Final = Seam("transport", (), Transport, "zenoh", elsewhere="`swarmsim fleet up --transport`")


def check_length(frame: bytes, mtu: int, kind: str) -> None:
    """Raise InputError for a frame that a transport of this kind cannot take."""
    if len(frame) > mtu:
        raise InputError(f"transport {kind}: a frame of {len(frame)} bytes; it takes at most {mtu}")
