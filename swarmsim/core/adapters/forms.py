"""Simpler forms of parts: plain functions of arrays, and classes of one robot's mind."""

from __future__ import annotations

import inspect
from abc import ABC
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, cast, get_type_hints

import msgspec
import numpy as np
from numpy.typing import NDArray

from swarmsim.core import own
from swarmsim.core.context import BuildContext
from swarmsim.core.drawing import Mark, Shown
from swarmsim.core.messages import Broadcast, Inbox, MessageBatch, PlainCodec
from swarmsim.core.own import MisfitError
from swarmsim.core.parts import Curve, Links, Summary
from swarmsim.core.readings import Readings
from swarmsim.core.state import Done, Estimates, Intents, Knowledge, Measured, Moment, Senses, State

OfFunction = Callable[[Callable[..., object], dict[str, Any], BuildContext], object]  # from the function and its keys
OfMind = Callable[[type, Callable[[], Any], BuildContext], object]  # from the class and what makes one robot's mind


def adapted(found: object, function: OfFunction | None, mind: OfMind | None) -> type[msgspec.Struct] | None:
    """The parameter struct of a part in a simpler form, or None if its seam takes no such form.

    Its keys are a function's keyword-only parameters, or those of a class's constructor.
    """
    if isinstance(found, type):
        if mind is None or not callable(getattr(found, "step", None)):
            return None
        parameters = [p for p in inspect.signature(found).parameters.values() if p.kind is not p.VAR_KEYWORD]
        make = vars(found).get("__init__", found)  # where its parameters have their types
        return _struct(found, make, parameters, lambda keys, context: mind(found, lambda: found(**keys), context))
    if function is None or not inspect.isfunction(found):
        return None
    parameters = [p for p in inspect.signature(found).parameters.values() if p.kind is p.KEYWORD_ONLY]
    return _struct(found, found, parameters, lambda keys, context: function(found, keys, context))


def _struct(
    found: Callable[..., object],
    typed: Callable[..., object],
    parameters: Sequence[inspect.Parameter],
    make: Callable[[dict[str, Any], BuildContext], object],
) -> type[msgspec.Struct]:
    hints = get_type_hints(typed, include_extras=True)
    fields: list[Any] = []
    for one in parameters:
        kind = hints.get(one.name, Any)
        fields.append((one.name, kind) if one.default is one.empty else (one.name, kind, one.default))

    def build(self: msgspec.Struct, context: BuildContext) -> object:
        return make(msgspec.structs.asdict(self), context)

    return msgspec.defstruct(
        found.__name__, fields, namespace={"build": build, "__doc__": found.__doc__}, module=found.__module__,
        frozen=True, forbid_unknown_fields=True, kw_only=True,
    )  # fmt: skip


class FunctionForm(ABC):
    """A function and the values of its keys."""

    def __init__(self, function: Callable[..., object], keys: dict[str, Any], context: BuildContext) -> None:
        #: The class or function named in messages about broken contracts.
        self.written_by = function
        self._function, self._keys, self._context = function, keys, context

    def _ask(self, *given: object) -> object:
        return self._function(*given, **self._keys)

    def _array(self, found: object, *shape: int | None) -> NDArray[np.generic]:
        """The function's result as an array of numbers of this shape. Raises MisfitError for anything else."""
        try:
            return own.array_of(found, *shape)
        except ValueError as problem:
            sides = ", ".join("any" if side is None else str(side) for side in shape)
            raise self._misfit(f"{problem}; expected an array of numbers, of shape ({sides})") from None

    def _misfit(self, wrong: str) -> MisfitError:
        return MisfitError(f"{self._function.__name__} gave {wrong}", self._function)


@dataclass(frozen=True, slots=True, eq=False)
class Observations:
    """All that a function may know in one iteration; robot i may use row i and its inbox alone.

    A computation is called twice: for what robots say, before anything is heard (`inbox` is None), and for what they
    know afterwards. A strategy sees all of it.
    """

    iteration: int
    pose: NDArray[np.float64]  # (n, 3): each robot's estimate of its own pose: x, y in m, yaw in rad
    velocity: NDArray[np.float64]  # (n, 3): m/s, m/s, rad/s, in the world frame
    alive: NDArray[np.bool_]  # (n,)
    readings: Readings
    decided: Intents | None  # what each robot decided in the previous iteration; None in the first
    inbox: Inbox[Any] | None = None
    knowledge: Knowledge | None = None  # of the kind that the computation gives

    @classmethod
    def of(cls, senses: Senses, inbox: Inbox[Any] | None = None, knowledge: Knowledge | None = None) -> Observations:
        """What is sensed, heard and known, in one value."""
        return cls(
            senses.iteration, senses.pose, senses.velocity, senses.alive, senses.readings, senses.decided,
            inbox, knowledge,
        )  # fmt: skip


class FunctionStrategy(FunctionForm):
    """`def strategy(observations, *, key=default)`: Intents, or velocities (n, 2) in m/s ahead and rad/s.

    A table of what actuators are to do may follow the velocities: `velocities, {"led": colours}`, each array (n, ...).
    """

    requires_knowledge: type[Knowledge] = Knowledge  # type: ignore[type-abstract]  # any kind will do

    def step(self, senses: Senses, inbox: Inbox[MessageBatch], knowledge: Knowledge) -> Intents:
        found = self._ask(Observations.of(senses, inbox, knowledge))
        if isinstance(found, Intents):
            return found
        count = len(senses.alive)
        twists, commands = found, dict[str, object]()
        if isinstance(found, tuple) and len(found) == 2 and isinstance(found[1], dict):
            twists, commands = found
        intents = Intents.twisting(self._array(twists, count, 2).astype(np.float64))
        try:
            told = {name: self._context.actuators.command(name, value, count) for name, value in commands.items()}
        except ValueError as problem:
            raise self._misfit(str(problem)) from None
        return replace(intents, commands=told)


class FunctionTopology(FunctionForm):
    """`def topology(state, *, key=default)`: links (m, 2) of receiver and sender, sorted."""

    def links(self, state: State) -> Links:
        return cast("Links", self._ask(state))  # checked as those of all topologies


class FunctionLayer(FunctionForm):
    """`def layer(shown, *, key=default)`: the shapes that show one moment."""

    @property
    def name(self) -> str:
        """The function's name."""
        return self._function.__name__

    def draw(self, shown: Shown) -> Sequence[Mark]:
        """The function's shapes."""
        return cast(Sequence[Mark], self._ask(shown))  # it is checked where it is drawn


@dataclass(frozen=True, slots=True, eq=False)
class Saying(MessageBatch):
    """Messages of a computation that is a function: each robot's row of its value."""

    value: NDArray[np.float64]  # (t, ...)


@dataclass(frozen=True, slots=True, eq=False)
class Value(Estimates):
    """Knowledge of a computation that is a function."""

    value: NDArray[np.float64]  # (n, ...)


class FunctionComputation(FunctionForm):
    """`def computation(observations, value, *, key=default)`: the new value (n, ...) of every robot.

    At first `value` is None and nothing has been heard. Every robot says its row; the function finds the rows heard in
    `observations.inbox`: `receivers`, `senders` and `content.value`, sorted by receiver.
    """

    knowledge_type: type[Knowledge] = Value

    def __init__(self, function: Callable[..., object], keys: dict[str, Any], context: BuildContext) -> None:
        super().__init__(function, keys, context)
        self._value: NDArray[np.float64] | None = None
        self._new = np.ones(len(context.ids), np.bool_)
        #: For one number each until the first `say` shows how long rows are; nothing can be heard before that.
        self.codec = PlainCodec(Saying(np.zeros(0)))

    def say(self, senses: Senses) -> Broadcast[Saying]:
        value = self._begun(senses)
        return Broadcast.each(Saying(value.copy()), self.codec.size)

    def _begun(self, senses: Senses) -> NDArray[np.float64]:
        """Every robot's row, new robots included."""
        value = self._value
        if value is not None and not self._new.any():
            return value
        first = self._values(self._ask(Observations.of(senses), None), len(senses.alive))
        value = first.copy() if value is None else value
        value[self._new] = first[self._new]
        self._value, self._new = value, np.zeros_like(self._new)
        self.codec = PlainCodec(Saying(value[:0]))
        return value

    def hear(self, senses: Senses, inbox: Inbox[Saying]) -> Value:
        """The function's new value."""
        before, heard = self._begun(senses), Observations.of(senses, inbox)
        found = self._values(self._ask(heard, _read_only(before)), *before.shape)
        alive = senses.alive.reshape(-1, *[1] * (before.ndim - 1))
        self._value = np.where(alive, found, before)
        return Value(_read_only(self._value))

    def _values(self, found: object, *shape: int) -> NDArray[np.float64]:
        """One row for each robot; of any length until one is known."""
        row = found.shape[1:] if self._value is None and isinstance(found, np.ndarray) else shape[1:]
        return self._array(found, shape[0], *row).astype(np.float64)

    def reset(self, robots: NDArray[np.int64]) -> None:
        """Reset robots (r,)."""
        self._new[robots] = True

    def copy_from(self, robots: NDArray[np.int64], source: int) -> None:
        """Copy another robot's row to robots (r,)."""
        if self._value is not None:
            self._value[robots] = self._value[source]


def _read_only(array: NDArray[np.float64]) -> NDArray[np.float64]:
    view = array.view()
    view.flags.writeable = False
    return view


class FunctionTask(FunctionForm):
    """`def task(moment, *, key=default)`: a number, a number and whether the task is done, or Measured.

    The measure has the function's name; an axis shows it in words, and its docstring's first line explains it.
    """

    requires_knowledge: type[Knowledge] = Knowledge  # type: ignore[type-abstract]  # any kind will do

    def __init__(self, function: Callable[..., object], keys: dict[str, Any], context: BuildContext) -> None:
        super().__init__(function, keys, context)
        self.curve = Curve(function.__name__, function.__name__.replace("_", " "), low=None)

    def measure(self, done: Done[Knowledge]) -> Measured:
        found = self._ask(done)
        if isinstance(found, Measured):
            return found
        value, *rest = found if isinstance(found, tuple) else (found,)
        finished = rest[0] if rest else False
        if len(rest) > 1 or not isinstance(finished, bool | np.bool_):
            wanted = "a number, or a number and whether the task is done: True or False"
            raise self._misfit(f"{own.brief(found)}; expected {wanted}")
        try:
            return Measured({self.curve.name: own.number_of(value)}, {}, float(finished), bool(finished))
        except ValueError:
            wanted = "a number, a number and whether the task is done, or swarmsim.core.state.Measured"
            raise self._misfit(f"{own.brief(found)}; expected {wanted}") from None

    def summaries(self) -> Sequence[Summary[Knowledge]]:
        return (Last(),)


class Last:
    """Keeps the last measurement."""

    def __init__(self) -> None:
        self._values: dict[str, float] = {}

    def sample(self, moment: Moment[Knowledge]) -> None:
        """Note one iteration."""
        self._values = dict(moment.measured.values)

    def summary(self) -> dict[str, float | int | None]:
        """Each measure's last value, as NAME_end."""
        return {f"{name}_end": float(value) for name, value in self._values.items()}
