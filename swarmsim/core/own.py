"""The user's code: where it is, and where it does not fit its form."""

from __future__ import annotations

import ast
import difflib
import dis
import inspect
import math
import reprlib
import sysconfig
import textwrap
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final, SupportsFloat, SupportsIndex

import numpy as np
from numpy.typing import NDArray

from swarmsim.core import renamed
from swarmsim.core.errors import InputError

_PACKAGE: Final = Path(__file__).parents[1]
_PYTHON: Final = Path(sysconfig.get_path("stdlib"))
_RAISE: Final = dis.opmap["RAISE_VARARGS"]


class MisfitError(ValueError):
    """User code returns or declares something its form does not allow; with the line of that code."""

    def __init__(self, wrong: str, owner: object = None, name: str = "") -> None:
        """`wrong` in words, about a function or about the attribute `name` of the class `owner`.

        Without an owner it is about the caller of the function that raises this.
        """
        super().__init__(wrong)
        self.line = "" if owner is None else line_of(owner, name)


def is_failure(problem: BaseException) -> bool:
    """Whether code has failed, rather than an outside request to end the program.

    Exits are failures of the code that raises them. A keyboard interrupt has no `raise` in the code.
    """
    if isinstance(problem, Exception):
        return True
    last = problem.__traceback__
    while last is not None and last.tb_next is not None:
        last = last.tb_next
    if last is None or _PACKAGE in Path(last.tb_frame.f_code.co_filename).parents:
        return False
    if isinstance(problem, SystemExit):
        return True
    return isinstance(problem, KeyboardInterrupt) and last.tb_frame.f_code.co_code[last.tb_lasti] == _RAISE


@contextmanager
def not_ending() -> Iterator[None]:
    """Within this context user code may not end the program. Raises InputError if it tries."""
    try:
        yield
    except (SystemExit, KeyboardInterrupt) as problem:
        if not is_failure(problem):
            raise
        raise InputError(f"own code ends the program: {told(problem)}") from problem


def told(problem: BaseException, at: str = "") -> str:
    """An exception in words, with the lines outside of this package that led to it; without any, with `at`."""
    foreign = [
        frame
        for frame in traceback.extract_tb(problem.__traceback__)
        if _PACKAGE not in Path(frame.filename).parents
        and not frame.filename.startswith("<frozen")
        and (_PYTHON not in Path(frame.filename).parents or "site-packages" in frame.filename)
    ]
    own = [f for f in foreign if "site-packages" not in f.filename] or foreign
    lines = "".join(_worded(frame.filename, frame.lineno, frame.name, frame.line or "") for frame in own)
    whose = "".join(f", {note}" for note in getattr(problem, "__notes__", ()))
    if isinstance(problem, MisfitError):
        return "".join(f"{note}: " for note in getattr(problem, "__notes__", ())) + f"{problem}{lines or problem.line}"
    return f"{type(problem).__name__}: {problem}{_meant(problem)}{whose}{lines or at}"


def _meant(problem: BaseException) -> str:
    """After a semicolon, a name's new form or the attribute most like a missing one; or nothing."""
    if not isinstance(problem, AttributeError) or problem.obj is None:
        return renamed.hint_of(problem)
    if type(problem.obj).__name__ == "Me" and problem.name in renamed.OF_MINDS:
        return renamed.hint([problem.name], renamed.OF_MINDS)
    similar = difflib.get_close_matches(str(problem.name), [name for name in dir(problem.obj) if name[0] != "_"], n=1)
    return f"; did you mean {similar[0]!r}?" if similar else ""


def _worded(file: str, number: int | None, name: str, code: str) -> str:
    return f"\n  {file}, line {number}, in {name}: {code.strip()}"


def line_of(owner: object, name: str = "") -> str:
    """The line where a function begins, or where a class defines `name`, formatted as in `told`.

    Empty without code.
    """
    home = next((kind for kind in getattr(owner, "__mro__", ()) if name in vars(kind)), owner)
    member = vars(home).get(name) if isinstance(home, type) else None
    found = member if inspect.isfunction(member) else home
    if not callable(found):
        return ""
    try:
        lines, first = inspect.getsourcelines(found)
        at = _assigned(lines, name) if isinstance(found, type) else 0
        where = name if name and isinstance(found, type) else getattr(found, "__name__", "")
        return _worded(inspect.getfile(found), max(first, 1) + at, where, lines[at])
    except (OSError, TypeError, SyntaxError):
        return ""


def _assigned(lines: list[str], name: str) -> int:
    """The line of `name` within a class's code; 0 if it is defined elsewhere."""
    kind = ast.parse(textwrap.dedent("".join(lines))).body[0]
    for node in kind.body if isinstance(kind, ast.ClassDef) else ():
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        if any(isinstance(one, ast.Name) and one.id == name for one in targets):
            return node.lineno - 1
    return 0


def brief(value: object) -> str:
    """A value's repr, cut short; for an array its type and shape."""
    if not isinstance(value, np.ndarray) or value is np.ma.masked:
        return reprlib.repr(value)
    kind = "masked array" if isinstance(value, np.ma.MaskedArray) else "array"
    return f"a {kind} of {value.dtype} and shape {value.shape}".replace("a array", "an array")


def number_of(value: object) -> float:
    """A number as a float. Raises ValueError for anything else: text, arrays, tables, masked values."""
    several = isinstance(value, np.ndarray) and (type(value) is not np.ndarray or value.ndim > 0)
    try:
        if several or isinstance(value, np.complexfloating) or not isinstance(value, SupportsFloat | SupportsIndex):
            raise TypeError
        return float(value)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{brief(value)}, which is no number") from None


def finite(value: object) -> float:
    """A finite number as a float. Raises ValueError for anything else."""
    found = number_of(value)
    if not math.isfinite(found):
        raise ValueError(f"{found}, which is not finite")
    return found


def array_of(value: object, *shape: int | None) -> NDArray[np.generic]:
    """An array of numbers, of this shape (None: any length). Raises ValueError for all else, even masked arrays."""
    try:
        found = np.asarray(value)
    except ValueError:  # rows of different lengths
        found = np.empty(0, object)
    subclass = isinstance(value, np.ndarray) and type(value) is not np.ndarray
    if subclass or found.dtype.kind not in "fiub":
        raise ValueError(brief(value))
    if len(found.shape) != len(shape) or any(side not in (None, n) for side, n in zip(shape, found.shape, strict=True)):
        raise ValueError(brief(value) if found is value else f"{brief(value)}, of shape {found.shape}")
    return found


def kept_as(kind: np.dtype[np.generic], value: object, *shape: int | None) -> NDArray[np.generic]:
    """A copy of `array_of` in a number type. Also raises ValueError for numbers that the type cannot hold."""
    given = array_of(value, *shape)
    with np.errstate(all="ignore"):
        kept = given.astype(kind)
    if not np.array_equal(kept, given, equal_nan=True) and (kept.dtype.kind != "f" or not np.isfinite(kept).all()):
        raise ValueError(f"{brief(value)} does not fit {kind}")
    return kept
