"""Scalar fields to measure: sources, formulas and pictures."""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping
from typing import Annotated, Final

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray
from scipy import ndimage

from swarmsim.core.context import BuildContext, Field
from swarmsim.core.errors import InputError

Noise = Annotated[float, Meta(ge=0.0)]


class FiniteField:
    """A field that ends the run if a value is not finite: its measurements would mean nothing.

    A formula may have a pole in time, and moving sources may leave the range of numbers.
    """

    def __init__(self, field: Field, what: str, context: BuildContext) -> None:
        """`what` names the field, its key first. Raises InputError unless it is finite on the floor at first."""
        self._field, self._what, self._period = field, what, context.period
        floor = context.lattice.centres(np.argwhere(context.building.explorable))
        with np.errstate(all="ignore"):
            first = field.value(0.0, floor)
        self._check(first, 0.0, floor, "")

    def value(self, time: float, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """The values (k,) at points (k, 2). Raises InputError, which names the iteration, if one is not finite."""
        with np.errstate(all="ignore"):  # the result is checked below
            found = self._field.value(time, points)
        self._check(found, time, points, "field.")
        return found

    def _check(self, found: NDArray[np.float64], time: float, points: NDArray[np.float64], place: str) -> None:
        if np.isfinite(found).all():
            return
        first = int(np.flatnonzero(~np.isfinite(found))[0])
        x, y = points[first].tolist()
        raise InputError(
            f"{place}{self._what} is {found[first]} in iteration {round(time / self._period)} (t = {time:g} s) at "
            f"x = {x:.3g} m, y = {y:.3g} m; expected finite values everywhere on the floor, at all times"
        )


class Source(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One source: a bell of a height and a width around a place, which may move."""

    x: float  # m, at the start
    y: float  # m
    height: float = 1.0  # in the field's unit
    width: Annotated[float, Meta(gt=0.0)] = 1.0  # m, standard deviation
    velocity: tuple[float, float] = (0.0, 0.0)  # m/s; it turns back at the edges of the page


class Sources(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The sum of bells around places that stand or move: f = base + sum_s h_s exp(-|p - p_s|^2 / (2 w_s^2))."""

    sources: Annotated[tuple[Source, ...], Meta(min_length=1)]
    base: float = 0.0  # in the field's unit
    noise: Noise = 0.0  # standard deviation of a sample, in the field's unit

    def build(self, context: BuildContext) -> FiniteField:
        """The field. Raises InputError for sources whose sum is not finite."""
        return FiniteField(SourceField(self, context.building.bounds), "sources: their sum", context)


class SourceField:
    """Bells with places that depend on time alone."""

    def __init__(self, parameters: Sources, page: tuple[float, float, float, float]) -> None:
        each = parameters.sources
        self._base = parameters.base
        self._start = np.array([(source.x, source.y) for source in each])
        self._velocity = np.array([source.velocity for source in each])
        self._height = np.array([source.height for source in each])
        self._width = np.array([source.width for source in each])
        self._low, self._size = np.array(page[:2]), np.array(page[2:]) - np.array(page[:2])

    def places(self, time: float) -> NDArray[np.float64]:
        """Where the sources (s, 2) are at a time (s)."""
        if not self._velocity.any():
            return self._start
        way = (self._start + time * self._velocity - self._low) % (2.0 * self._size)
        return np.asarray(self._low + np.minimum(way, 2.0 * self._size - way))

    def value(self, time: float, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """The values (k,) at points (k, 2)."""
        gap = points[:, None] - self.places(time)
        square = (gap**2).sum(axis=2)
        return np.asarray(self._base + (self._height * np.exp(-0.5 * square / self._width**2)).sum(axis=1))


class Formula(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A formula of x, y (m) and t (s), as in `2 + sin(x) * exp(-y / 3)`.

    It may hold numbers, pi, + - * / **, and the functions sin, cos, tan, exp, log, sqrt, abs, tanh, hypot, minimum and
    maximum; nothing else is evaluated.
    """

    formula: str
    noise: Noise = 0.0  # standard deviation of a sample, in the field's unit

    def build(self, context: BuildContext) -> FiniteField:
        """The field. Raises InputError for anything but a formula, and for values that are not finite."""
        return FiniteField(FormulaField(self.formula), f"formula: {self.formula!r}", context)


_Value = float | NDArray[np.float64]
_OPERATORS: Final[dict[type, np.ufunc]] = {
    ast.Add: np.add, ast.Sub: np.subtract, ast.Mult: np.multiply, ast.Div: np.divide, ast.Pow: np.power,
    ast.USub: np.negative, ast.UAdd: np.positive,
}  # fmt: skip
_FUNCTIONS: Final[dict[str, tuple[np.ufunc, int]]] = {
    **{name: (getattr(np, name), 1) for name in ("sin", "cos", "tan", "exp", "log", "sqrt", "abs", "tanh")},
    **{name: (getattr(np, name), 2) for name in ("hypot", "minimum", "maximum")},
}
_LONGEST: Final = 500  # characters: the nesting in a longer one could exhaust the stack


class FormulaField:
    """A formula, parsed once; only known operations are computed, so that a third-party formula runs no code."""

    def __init__(self, text: str) -> None:
        try:
            tree = ast.parse(text.strip()[: _LONGEST + 1], mode="eval")
        except (SyntaxError, ValueError) as problem:
            raise InputError(
                f"formula: {text[:60]!r} is not a formula; expected one as in 'sin(x) + y / 2'"
            ) from problem
        if len(text) > _LONGEST:
            raise InputError(f"formula: {len(text)} characters; expected at most {_LONGEST}")
        self._evaluate = _compiled(tree.body)

    def value(self, time: float, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """The values (k,) at points (k, 2)."""
        known: dict[str, _Value] = {"x": points[:, 0], "y": points[:, 1], "t": time, "pi": np.pi}
        with np.errstate(all="ignore"):
            return np.broadcast_to(np.asarray(self._evaluate(known), np.float64), len(points)).copy()


def _compiled(node: ast.AST) -> Callable[[Mapping[str, _Value]], _Value]:
    """What a node of a formula evaluates to. Raises InputError for nodes that formulas do not have."""
    match node:
        case ast.Constant(value=int() | float()) if not isinstance(node.value, bool):
            number = float(node.value)  # type: ignore[arg-type]
            return lambda known: number
        case ast.Name(id="x" | "y" | "t" | "pi" as name):
            return lambda known: known[name]
        case ast.BinOp() | ast.UnaryOp() if type(node.op) in _OPERATORS:
            operator = _OPERATORS[type(node.op)]
            sides = [node.left, node.right] if isinstance(node, ast.BinOp) else [node.operand]
            parts = [_compiled(side) for side in sides]
            return lambda known: operator(*(part(known) for part in parts))
        case ast.Call(func=ast.Name(id=name), keywords=[]) if name in _FUNCTIONS:
            function, arguments = _FUNCTIONS[name]
            if len(node.args) != arguments:
                raise InputError(
                    f"formula: {name} takes {arguments} value{'s' * (arguments > 1)}, not {len(node.args)}"
                )
            given = [_compiled(argument) for argument in node.args]
            return lambda known: function(*(one(known) for one in given))
    raise InputError(
        f"formula: {ast.unparse(node)[:60]!r} cannot stand in a formula; expected numbers, x, y, t, pi, + - * / ** and "
        f"{', '.join(_FUNCTIONS)}"
    )


class Picture(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Values on a grid that covers the page, its first row at the top; between them they are interpolated linearly.

    They may come from a file: `values = {file = "field.csv"}` or, as grey levels from 0 (black) to 1, a PNG.
    """

    values: Annotated[tuple[tuple[float, ...], ...], Meta(min_length=2)]  # rows from the top
    low: float = 0.0  # value of 0, in the field's unit
    high: float = 1.0  # value of 1
    noise: Noise = 0.0  # standard deviation of a sample, in the field's unit

    def build(self, context: BuildContext) -> FiniteField:
        """The field. Raises InputError for rows of different lengths, and for values that are not finite."""
        lengths = {len(row) for row in self.values}
        if len(lengths) > 1 or min(lengths) < 2:
            raise InputError(f"values: rows of {' and '.join(map(str, sorted(lengths)))} values; expected a rectangle")
        with np.errstate(all="ignore"):
            scaled = self.low + (self.high - self.low) * np.array(self.values, np.float64)
        return FiniteField(PictureField(scaled, context.building.bounds), "values: the picture", context)


class PictureField:
    """Values on a grid; the centres of its corner cells lie half a cell within the page."""

    def __init__(self, values: NDArray[np.float64], page: tuple[float, float, float, float]) -> None:
        self._values = values[::-1]
        self._low, self._size = np.array(page[:2]), np.array(page[2:]) - np.array(page[:2])

    def value(self, time: float, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """The values (k,) at points (k, 2)."""
        part = (points - self._low) / self._size
        place = part[:, ::-1] * np.array(self._values.shape) - 0.5
        return np.asarray(ndimage.map_coordinates(self._values, place.T, order=1, mode="nearest"))
