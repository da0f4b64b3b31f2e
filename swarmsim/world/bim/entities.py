"""The contents of an IFC file, as types that its library lacks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, overload


class Entity(Protocol):
    """One entity in the file. It has only the attributes of its class in the standard."""

    Name: str | None
    LongName: str | None
    Elevation: float | None
    ObjectPlacement: Entity | None
    Representation: Entity | None
    IsDecomposedBy: Sequence[Entity]
    HasFillings: Sequence[Entity]
    FillsVoids: Sequence[Entity]
    RelatingBuildingElement: Entity | None
    RelatedOpeningElement: Entity
    RelatedBuildingElement: Entity

    def id(self) -> int:
        """Its number in the file."""

    @overload
    def is_a(self) -> str: ...

    @overload
    def is_a(self, kind: str) -> bool: ...


class Model(Protocol):
    """The whole file."""

    def by_type(self, kind: str) -> Sequence[Entity]:
        """All entities of a class. Raises RuntimeError if this version of IFC lacks it."""

    def by_id(self, number: int) -> Entity:
        """The entity with this number."""
