"""Lists the parts and the meanings of their keys, read from the parts themselves."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import io
import re
import textwrap
import tokenize
import typing
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import msgspec
from msgspec import inspect as types

from swarmsim.core.errors import InputError, nearest
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.part import Part, seam_of
from swarmsim.core.seams import SEAMS
from swarmsim.core.tables import markdown


@dataclass(frozen=True, slots=True)
class Parameter:
    """One key of a part's table."""

    key: str
    kind: str  # accepted values, in words
    default: str | None  # as in TOML; None if the key is required
    meaning: str  # with its unit; from the comment in the code


@dataclass(frozen=True, slots=True)
class PartDescription:
    """One part of a seam."""

    seam: str
    name: str
    default: bool  # whether it is the scenario's default
    origin: str  # its distribution and version
    first: str  # first sentence of its docstring
    text: str  # the whole docstring
    parameters: tuple[Parameter, ...]


def parts(which: str | None = None) -> list[PartDescription]:
    """The parts that scenarios can name, ours and those of other distributions, with their keys: `swarmsim parts`.

    `which` is a seam, such as `topology`, or one of its parts, such as `topology.knn`; by default all, in the order
    of seams and names. Raises InputError for an unknown seam or part.
    """
    seam, _, name = (which or "").partition(".")
    if name:
        return [part(seam, name)]
    return [part(each, one) for each in ((_known(seam),) if seam else SEAMS) for one in registry.entries(each)]


def _known(seam: str) -> str:
    if seam not in SEAMS:
        raise InputError(f"{seam}: no such seam; {nearest(seam, SEAMS)}")
    return seam


def part(seam: str, name: str) -> PartDescription:
    """One installed part. Raises InputError for an unknown name."""
    kind, entry = registry.find(_known(seam), name), registry.entries(seam)[name]
    text = inspect.cleandoc(kind.__doc__ or "")
    return PartDescription(
        seam=seam,
        name=name,
        default=SEAMS[seam].default == name,
        origin=f"{entry.dist.name} {entry.dist.version}" if entry.dist is not None else "unknown",
        first=_first_sentence(text),
        text=text,
        parameters=tuple(_parameters(kind)),
    )


def _first_sentence(text: str) -> str:
    paragraph = " ".join(text.partition("\n\n")[0].split())
    end = paragraph.find(". ")
    return paragraph if end < 0 else paragraph[: end + 1]


def _parameters(kind: type[msgspec.Struct]) -> Iterator[Parameter]:
    info = types.type_info(kind)
    assert isinstance(info, types.StructType)
    meanings = comments(kind)
    for field in info.fields:
        default = None if field.required else _toml(field)
        yield Parameter(field.encode_name, words(field.type), default, meanings.get(field.name, ""))


def keys(kind: type[msgspec.Struct], place: str = "") -> Iterator[Parameter]:
    """Every key of a table and of the tables inside it, by its dotted path: `robots.wheel_base`, `expect[].that`."""
    info = types.type_info(kind)
    assert isinstance(info, types.StructType)
    for field, told in zip(info.fields, _parameters(kind), strict=True):
        path = f"{place}{told.key}"
        inner, many = _tables(field.type)
        yield dataclasses.replace(told, key=path, kind=_seam(kind, field.name) or told.kind)
        if inner is not None:
            yield from keys(inner, f"{path}[]." if many else f"{path}.")


def _tables(kind: types.Type) -> tuple[type[msgspec.Struct] | None, bool]:
    """The struct of the tables that a type takes, and whether it takes a list of them."""
    match kind:
        case types.UnionType():
            return next((found for one in kind.types if (found := _tables(one))[0]), (None, False))
        case types.Metadata():
            return _tables(kind.type)
        case types.VarTupleType() | types.ListType():
            return _tables(kind.item_type)[0], True
        case types.StructType():
            return kind.cls, False
    return None, False


def _seam(kind: type[msgspec.Struct], name: str) -> str:
    """Which parts a key takes, in words; empty if it takes none."""
    hint = typing.get_type_hints(kind, include_extras=True)[name]
    nested = [hint, *typing.get_args(hint), *(deep for one in typing.get_args(hint) for deep in typing.get_args(one))]
    part = next((one for one in nested if typing.get_origin(one) is Part), None)
    seam = None if part is None else seam_of(part)
    if seam is None:
        return ""
    return f"{'parts' if typing.get_origin(hint) is tuple else 'a part'} of the seam {seam}"


def _toml(field: types.Field) -> str:
    if field.default is msgspec.NODEFAULT and field.default_factory is msgspec.NODEFAULT:  # may be left out
        implied = [one.extra_json_schema or {} for one in _inside(field.type) if isinstance(one, types.Metadata)]
        return next((msgspec.json.encode(one["default"]).decode() for one in implied if "default" in one), "none")
    value = field.default if field.default is not msgspec.NODEFAULT else field.default_factory()
    if isinstance(value, Part):
        return f'"{value.use}"' if value else "none"
    plain = {} if isinstance(value, msgspec.Struct) else msgspec.to_builtins(value)
    return "none" if plain is None else msgspec.json.encode(plain).decode()


def _inside(kind: types.Type) -> Iterator[types.Type]:
    """A type and those that it is one of."""
    yield kind
    for one in kind.types if isinstance(kind, types.UnionType) else ():
        yield from _inside(one)


def comments(kind: type) -> dict[str, str]:
    """The comments behind the fields of a class and its bases, by name; empty without code."""
    found: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        try:
            source = textwrap.dedent(inspect.getsource(base))
            tree = ast.parse(source)
        except (OSError, TypeError, SyntaxError):
            continue
        behind = {
            token.start[0]: token.string.lstrip("#: ").strip()
            for token in tokenize.generate_tokens(io.StringIO(source).readline)
            if token.type == tokenize.COMMENT
        }
        for node in tree.body[0].body if isinstance(tree.body[0], ast.ClassDef) else ():
            if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
                last = node.lineno if node.end_lineno is None else node.end_lineno
                said = [behind[line] for line in range(node.lineno, last + 1) if line in behind]
                found |= {node.target.id: said[-1]} if said else {}
    return found


def axis_label(scenario: msgspec.Struct, key: str) -> str:
    """A dotted key of a scenario on an axis, in the words and the unit of its meaning: "others heard, k"."""
    holder: object = scenario
    *path, last = key.split(".")
    name = last.replace("_", " ")
    for step in path:
        holder = holder[int(step)] if step.isdecimal() and isinstance(holder, tuple) else getattr(holder, step, None)
        holder = holder.parameters if isinstance(holder, Part) and holder else holder
    meaning = comments(type(holder)).get(last, "").partition(";")[0].strip()
    first, _, rest = meaning.partition(",")
    if UNIT.fullmatch(first):
        return f"{rest.strip() or name}, {first}" if len(last) == 1 else f"{name}, {first}"
    if not meaning or len(meaning) > LONGEST or meaning.startswith("the "):
        return name
    return f"{meaning}, {name}" if len(last) == 1 else meaning


UNIT: Final = re.compile(r"(?:[mskgNWJVAK%]|mm|cm|min|rad|Hz|kg|dB|dBm|B)(?:[/ ^\d-]*(?:[msgNWJVAK]|rad|kg|B)?)*")
LONGEST: Final = 40  # letters along an axis
PLAIN: Final[dict[type, str]] = {
    types.BoolType: "true or false",
    types.StrType: "text",
    types.AnyType: "anything",
    types.NoneType: "nothing",
    types.DictType: "a table",
    types.CustomType: "a table",
}


def words(kind: types.Type) -> str:
    """What values a type takes, in words."""
    match kind:
        case types.IntType() | types.FloatType():
            return ("whole number" if isinstance(kind, types.IntType) else "number") + _bounds(kind)
        case types.LiteralType():
            return " or ".join(f'"{value}"' for value in kind.values)
        case types.UnionType():
            inner = [words(one) for one in kind.types if not isinstance(one, types.NoneType)]
            return " or ".join(dict.fromkeys(inner))
        case types.ListType() | types.VarTupleType() | types.SetType() | types.FrozenSetType():
            return f"list of: {words(kind.item_type)}"
        case types.TupleType():
            return f"[{', '.join(words(one) for one in kind.item_types)}]"
        case types.StructType():
            return f"table of {', '.join(field.encode_name for field in kind.fields)}"
        case types.Metadata():
            return words(kind.type)
    return PLAIN.get(type(kind), type(kind).__name__.removesuffix("Type").lower())


def _bounds(kind: types.IntType | types.FloatType) -> str:
    low = f" from {kind.ge:g}" if kind.ge is not None else f" above {kind.gt:g}" if kind.gt is not None else ""
    high = f" to {kind.le:g}" if kind.le is not None else f" below {kind.lt:g}" if kind.lt is not None else ""
    return low + high


def seams_in_markdown() -> str:
    """The table of all seams in docs/parts.md."""
    head, rows = ("seam", "in a scenario", "default", "what a part does", "what it has"), []
    for seam in SEAMS.values():
        place = f"`[[{seam.at}]]`" if seam.many else f"`[{seam.at}]`" if seam.place else seam.elsewhere
        default = "must be named" if seam.required else f"`{seam.default}`" if seam.default else "none"
        does = _first_sentence(inspect.cleandoc(seam.protocol.__doc__ or "")).rstrip(".")
        rows.append((seam.name, place, default, does, ", ".join(f"`{verb}`" for verb in seam.verbs)))
    return f"{markdown(head, rows)}\n"


def plain(description: PartDescription) -> dict[str, object]:
    """A description as JSON values."""
    found: dict[str, object] = msgspec.to_builtins(description)
    return found
