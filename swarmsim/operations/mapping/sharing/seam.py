"""The seam of sharing policies."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, Protocol, TypeVar

from swarmsim.core.messages import Broadcast, Codec, Inbox
from swarmsim.core.seams import Seam
from swarmsim.core.state import Senses

if TYPE_CHECKING:  # who asks for seams needs no kernels
    from swarmsim.operations.mapping.maps import Maps, TileItems

I = TypeVar("I", bound="TileItems")  # noqa: E741 (of items)


class Sharing(Protocol[I]):
    """What robots that map say of what they know, and what they take in of what they hear.

    The items that they take in have the columns of TileItems at least.
    """

    @property
    def codec(self) -> Codec[I]:
        """What it looks like on the air."""
        ...

    def say(self, senses: Senses, known: Maps, /) -> Broadcast[I]:
        """The message of every robot, from what it senses now and what it knew before this iteration."""
        ...

    def accepted(self, senses: Senses, inbox: Inbox[I]) -> Inbox[TileItems]:
        """The items of the inbox that are taken in."""
        ...


SEAM: Final = Seam("sharing", (), Sharing, "current-tile")
