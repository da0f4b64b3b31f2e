"""The seam of sharing policies."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, Protocol, TypeVar

from swarmsim.core.messages import Broadcast, Codec, Inbox
from swarmsim.core.seams import Seam
from swarmsim.core.state import Senses

if TYPE_CHECKING:  # the seams' users need no kernels
    from swarmsim.operations.mapping.maps import Maps, TileItems

I = TypeVar("I", bound="TileItems")  # noqa: E741 (of items)


class Sharing(Protocol[I]):
    """What mapping robots tell of their knowledge, and which messages they take in.

    The items taken in have at least the columns of TileItems.
    """

    @property
    def codec(self) -> Codec[I]:
        """The form on the air."""
        ...

    def say(self, senses: Senses, known: Maps, /) -> Broadcast[I]:
        """The message of every robot, from its present readings and its knowledge before this iteration."""
        ...

    def accepted(self, senses: Senses, inbox: Inbox[I]) -> Inbox[TileItems]:
        """The items of the inbox that are taken in."""
        ...


SEAM: Final = Seam("sharing", (), Sharing, "current-tile")
