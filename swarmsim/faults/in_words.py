"""Faults in words, as on the command line: `motor off at=20 fraction=0.2 duration=100`."""

from __future__ import annotations

import json
import re
import tomllib

import msgspec

from swarmsim.core.errors import InputError
from swarmsim.core.parts import Fault
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.files import Table
from swarmsim.core.scenario.part import Part

KIND = re.compile(r"[A-Za-z][\w-]*|[A-Za-z_][\w.]*:[A-Za-z_]\w*|[\w./-]+\.py:[A-Za-z_]\w*", re.ASCII)  # a name, or code
WORD = re.compile(r"[A-Za-z_][\w.:/-]*", re.ASCII)  # what may stand without quotes
WORDS_OF_TOML = ("true", "false", "inf", "nan")
EXAMPLE = "expected a kind, its failure if it has several, and key=value, as in 'motor off at=20 count=5'"


def fault_in_words(text: str) -> Part[Fault]:
    """A fault as a scenario has it: its kind, a second bare word as its `failure`, then key=value.

    A value is TOML, or a bare word. Raises InputError that starts with the key or the word at fault.
    """
    kind, *rest = _words(text) or [""]
    if not KIND.fullmatch(kind):
        raise InputError(f"{kind or 'nothing'!r} is not a kind of fault; {EXAMPLE}")
    table: Table = {"use": kind}
    try:
        struct = registry.find("fault", kind)
    except InputError as problem:
        raise InputError(str(problem).removeprefix("use: ")) from problem
    if rest and "=" not in rest[0]:
        if "failure" not in struct.__struct_fields__:
            raise InputError(f"{rest[0]!r}: {kind!r} fails in one way only; expected key=value next, as in at=20")
        table["failure"] = rest.pop(0)
    for word in rest:
        key, equals, value = word.partition("=")
        if not equals or not key:
            raise InputError(f"{word!r} is not key=value; {EXAMPLE}")
        if key in table:
            hint = "the first word says so already" if key == "use" else "expected each key once"
            raise InputError(f"{key}: given twice; {hint}")
        table[key] = _value(key, value)
    return Part[Fault]("fault", table).decoded()


def _words(text: str) -> list[str]:
    """The text cut at blanks outside quotes and brackets. Raises InputError if one stays open."""
    words, word, depth, quote, escaped = [], "", 0, "", False
    for letter in text:
        if quote:
            quote = "" if letter == quote and not escaped else quote
            escaped = letter == "\\" and not escaped and quote == '"'
        elif letter in "'\"":
            quote = letter
        else:
            depth += (letter in "[{") - (letter in "]}")
        if letter.isspace() and not quote and depth == 0:
            words.append(word)
            word = ""
        else:
            word += letter
    if quote or depth:
        raise InputError(f"{word!r}: {quote or 'a bracket'} is left open; expected its other half")
    return [one for one in [*words, word] if one]


def _value(key: str, text: str) -> object:
    try:
        found = tomllib.loads(f"value = [{text}]")  # in brackets a comment cannot hide
    except (tomllib.TOMLDecodeError, RecursionError) as problem:
        if WORD.fullmatch(text):
            return text
        raise InputError(f"{key}: {text!r} is not a TOML value; expected a number, a word or a list") from problem
    if list(found) != ["value"] or len(found["value"]) != 1:
        raise InputError(f"{key}: {text!r} is not one value; expected a number, a word or a list")
    return found["value"][0]


def described(fault: Part[Fault]) -> str:
    """A scenario's fault as on the command line: its name, its failure and all keys that differ from the defaults."""
    given = fault.table
    name = str(given.pop("use")).rpartition(":")[2]
    failure = given.pop("failure", None)
    try:
        fields = msgspec.structs.fields(type(fault.parameters))
        defaults = {field.encode_name: msgspec.to_builtins(field.default) for field in fields if not field.required}
    except InputError:  # third-party code that was not allowed to run
        defaults = {}
    keys = (f"{key}={_spelled(value)}" for key, value in given.items() if value != defaults.get(key))
    return " ".join([name, *([str(failure)] if failure else []), *keys])


def _spelled(value: object) -> str:
    """A value as TOML on one line without blanks; a string of one word needs no quotes."""
    if isinstance(value, str) and re.fullmatch(r"[A-Za-z][\w-]*", value) and value not in WORDS_OF_TOML:
        return value
    return _toml(value)


def _toml(value: object) -> str:
    if isinstance(value, dict):
        return "{" + ",".join(f"{key}={_toml(inner)}" for key, inner in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ",".join(map(_toml, value)) + "]"
    return json.dumps(value)
