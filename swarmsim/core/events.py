"""Events of a run as typed values; they become words where people read them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, TypeVar

import msgspec
from msgspec import Meta, Struct

Box = tuple[float, float, float, float]  # left, lower, right, upper edge in m


class Happened(Struct, frozen=True, tag_field="event", tag=True):
    """An event worth a mark in the film and a line in the summary."""

    iteration: int  # the first one that it affects


class Begins(Happened, frozen=True, tag="begins"):
    """A fault begins."""

    fault: int  # its place among the scenario's faults
    robots: tuple[int, ...] = ()  # affected; empty if it strikes no particular robot


class Ends(Happened, frozen=True, tag="ends"):
    """A fault is over."""

    fault: int
    robots: tuple[int, ...] = ()


class BoxStands(Happened, frozen=True, tag="box-stands"):
    """A box has been added to the building."""

    fault: int
    box: Box


class BoxGone(Happened, frozen=True, tag="box-gone"):
    """A box has left the building."""

    fault: int
    box: Box


class BoxWaits(Happened, frozen=True, tag="box-waits"):
    """A box is due, but its place is occupied."""

    fault: int
    box: Box


class PieceTaken(Happened, frozen=True, tag="piece-taken"):
    """A robot goes on with a piece of a job that another one has computed."""

    job: Annotated[str, Meta(max_length=200)]
    piece: Annotated[int, Meta(ge=0)]
    robots: tuple[int, ...]  # who has taken it over, and who had it


class PieceLost(Happened, frozen=True, tag="piece-lost"):
    """No living robot has a state of a piece of a job any more."""

    job: Annotated[str, Meta(max_length=200)]
    piece: Annotated[int, Meta(ge=0)]


class Lost(Happened, frozen=True, tag="lost"):
    """The processes of robots have ended, or cannot be heard any more, through no fault of the scenario's."""

    robots: tuple[int, ...]


class Regained(Happened, frozen=True, tag="regained"):
    """They are back, with an empty memory."""

    robots: tuple[int, ...]


class Ended(Happened, frozen=True, tag="ended"):
    """The run is over; `iteration` is its last one."""

    finished: bool  # whether the task was done


Event = Begins | Ends | BoxStands | BoxGone | BoxWaits | PieceTaken | PieceLost | Lost | Regained | Ended
E = TypeVar("E", bound=Happened)


def encoded(event: Event) -> bytes:
    """The event as JSON, as recordings keep it."""
    return msgspec.json.encode(event)


def decoded(text: bytes | str) -> Event:
    """The event that `encoded` wrote."""
    event: Event = msgspec.json.decode(text, type=Event)
    return event


def boxes_at(events: Iterable[Event], iteration: int) -> list[Box]:
    """The boxes added to the plan and present in an iteration, oldest first."""
    boxes: list[Box] = []
    for event in events:
        if event.iteration <= iteration and isinstance(event, BoxStands):
            boxes.append(event.box)
        elif event.iteration <= iteration and isinstance(event, BoxGone):
            boxes.remove(event.box)
    return boxes
