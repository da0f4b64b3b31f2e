"""A part as a scenario names it: its seam, its name, and its keys as one typed value."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final, Generic, Protocol, Self, TypeVar, final, get_args, get_origin

import msgspec

from swarmsim.core.errors import InputError, nearest
from swarmsim.core.renamed import OF_PARTS, hint
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.decoding import Nested, Take, called, convert
from swarmsim.core.scenario.files import Table, with_files
from swarmsim.core.seams import SEAMS

P = TypeVar("P", covariant=True)  # the built part: a seam's Protocol
T = TypeVar("T")

_EMPTY: Final[Mapping[str, Any]] = {}


class Buildable(Protocol[P]):
    """A part's parameters."""

    def build(self, context: Any, /) -> P:  # noqa: ANN401 - of a run or of a world
        """The part, for a run or, of a building, for a site. Raises InputError, which starts with the key at fault."""
        ...


@final
class Part(Nested, Generic[P]):
    """One part by name, with its parameter struct, decoded from its table once.

    A part inside another one is a field of this type: `over: Part[Channel] = Part("channel")`. Parts are frozen,
    compared and hashed by their parameters. One that is not installed has no parameters but keeps its table, so that
    its recordings can still be viewed.
    """

    __slots__ = ("_completed", "_given", "_parameters", "_use", "seam")

    def __init__(self, seam: str, table: Mapping[str, Any] = _EMPTY) -> None:
        """`table` is `use` and the part's own keys; they are decoded later."""
        self.seam: Final = seam
        self._given = {key: value for key, value in table.items() if key != "use"}
        self._use: str | None = table.get("use", None)
        self._parameters: msgspec.Struct | None = None
        self._completed = not table  # whether its table comes from its parameters

    @classmethod
    def of_table(cls, kind: object, given: Nested | dict[str, Any], take: Take | None) -> Nested:
        """The part in the table of a field of this type, decoded unless `take` says otherwise, or NONE if it is empty.

        Raises InputError, which starts with the key at fault.
        """
        if isinstance(given, Part) and not given.seam:
            return given
        if isinstance(given, dict) and not isinstance(given.get("use", ""), str):
            raise InputError(f"use: expected `str`, got `{called(given['use'])}`")
        table = given if isinstance(given, dict) else {}
        part: Part[Any] = given if isinstance(given, Part) else Part(seam_of(kind), table)
        seam = SEAMS[part.seam]
        if not (part or seam.required or seam.many):
            return NONE
        return part.decoded() if take is None else take(part)

    def decoded(self) -> Self:
        """The same with its keys checked and complete. Raises InputError, which starts with the key at fault."""
        self._parameters = self.parameters
        self._completed = True
        return self

    def beside(self, folder: Path) -> Part[P]:
        """The same with paths in it resolved from `folder`, and files of numbers read.

        Raises InputError, which starts with the key.
        """
        named = {} if self._use is None else {"use": self._use}
        return Part(self.seam, with_files({**named, **self._given}, folder))

    def __bool__(self) -> bool:
        """Whether there is a part, be it named or the default."""
        return bool(self._use is not None or self._given or self.use)

    @property
    def use(self) -> str:
        """Its name; empty without a part."""
        return self._name or ""

    @property
    def _name(self) -> str | None:
        return SEAMS[self.seam].default if self._use is None and self.seam else self._use

    @property
    def parameters(self) -> msgspec.Struct:
        """Its parameter struct. Raises InputError, which starts with the key at fault."""
        if self._parameters is None:
            self._parameters = parameters_of(self.seam, self._name, self._given)
        return self._parameters

    @property
    def table(self) -> Table:
        """`use`, then its keys as in a scenario; once decoded, all that have a value."""
        if not self:
            return {}
        keys: Table = self._given
        if self._completed:
            keys = msgspec.json.decode(msgspec.json.encode(self.parameters, enc_hook=plain))
        return {"use": self.use, **{key: value for key, value in keys.items() if value is not None}}

    def declares(self, name: str, default: T) -> T:
        """A property that the part declares to others: an attribute of its parameters, or the default without it.

        A part that is not installed has the default.
        """
        try:
            found: T = getattr(self.parameters, name, default) if self else default
        except InputError:
            return default
        return found

    def inside(self) -> Iterator[Part[Any]]:
        """The part itself, and the parts in its keys at any depth."""
        yield self
        for name in self.parameters.__struct_fields__:
            value = getattr(self.parameters, name)
            for one in value if isinstance(value, tuple | list) else (value,):
                if isinstance(one, Part) and one:
                    yield from one.inside()

    def build(self, context: object, key: str = "") -> P:
        """The part itself, built for a run or a site; inside another part, `key` is its place there.

        Raises InputError, which starts with the key.
        """
        try:
            parameters: Any = self.parameters
            built: P = parameters.build(context) if hasattr(parameters, "build") else parameters
        except InputError as problem:
            raise (problem.inside(key) if key else problem) from problem
        missing = [] if registry.is_ours(parameters) else SEAMS[self.seam].missing(built)
        if missing:
            kind, at = (
                f"{type(built).__module__.rpartition('.')[2]}.{type(built).__qualname__}",
                f"{key}." if key else "",
            )
            old = hint((name for name in dir(built) if OF_PARTS.get(name) in missing), OF_PARTS)
            raise InputError(
                f"{at}use: what {self.use!r} builds, {kind}, lacks {', '.join(missing)}; expected a {self.seam}{old}"
            )
        return built

    def _identity(self) -> object:
        if not self:
            return None
        try:
            parameters = self.parameters
            hash(parameters)
        except InputError:
            return msgspec.json.encode(self.table, order="deterministic")
        except TypeError:  # third-party, with lists or tables
            return type(parameters), msgspec.json.encode(parameters, enc_hook=plain, order="deterministic")
        return parameters

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Part):
            return NotImplemented
        return (self.seam, self.use) == (other.seam, other.use) and self._identity() == other._identity()

    def __hash__(self) -> int:
        return hash((self.seam, self.use, self._identity()))

    def __copy__(self) -> Self:
        return self

    def __deepcopy__(self, memo: object) -> Self:
        return self

    def __reduce__(self) -> str | tuple[object, ...]:
        """Pickles its table: another process cannot find a custom part's class by name."""
        return (Part, (self.seam, self.table)) if self else "NONE"

    def __repr__(self) -> str:
        return f"Part({self.seam!r}, {self.table!r})"


#: No part at all.
NONE: Final[Part[Any]] = Part("")


def parameters_of(seam: str, use: str | None, keys: Mapping[str, Any]) -> msgspec.Struct:
    """The parameter struct that the keys of a part describe, checked and complete.

    Raises InputError, which starts with the key.
    """
    if use is None:
        raise InputError(f"use: required key is missing; {nearest('', registry.entries(seam) if seam else {})}")
    return convert(keys, registry.find(seam, use))


def seam_of(kind: object) -> str:
    """The seam of a field of this type, as in Part[Sensor]; empty if unknown."""
    protocols = [base for one in get_args(kind) for base in getattr(get_origin(one) or one, "__mro__", ())]
    return next((seam.name for seam in SEAMS.values() if seam.protocol in protocols), "")


def plain(value: object) -> Table:
    """A part's form in a text, for msgspec, which knows all other types. Raises TypeError."""
    if isinstance(value, Part):
        return value.table
    raise NotImplementedError(type(value).__name__)  # which msgspec takes for "not mine", and raises TypeError
