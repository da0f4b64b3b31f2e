"""How many robots a task needs."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, Literal

import numpy as np

from swarmsim.api.overrides import Overrides, fault_of, keys_of, seconds_in
from swarmsim.core.errors import InputError
from swarmsim.core.scenario import registry, shipped
from swarmsim.core.scenario.files import Table
from swarmsim.core.scenario.toml import parsed, read_toml
from swarmsim.studies import sequential
from swarmsim.studies.engine import pool_when_needed
from swarmsim.studies.labels import label
from swarmsim.studies.plan import changed
from swarmsim.studies.prices import Prices, prices_of
from swarmsim.studies.runner import Runner
from swarmsim.studies.sizing import Asked, LadderSearch, Question
from swarmsim.studies.sizing_figures import figures
from swarmsim.studies.sizing_report import Sizing
from swarmsim.studies.sizing_runs import Trials
from swarmsim.studies.sizing_words import COUNT, SizedLadder
from swarmsim.studies.store import Store

STEPS: Final = 17  # values of a key between two numbers that are not whole
MOST_VALUES: Final = 10_000
DOUBLED: Final = (2, 4, 8)  # times the scenario's count: what is asked first without --high
Varied = Mapping[str, Sequence[object]] | Sequence[str]  # {"robots.use": ["e-puck"]}, or ["robots.use=e-puck"]


def size(
    scenario: str | Path,
    within: str | float,
    *,
    sure: float = 0.95,
    slack: float = 0.02,
    confidence: float = 0.95,
    over: str = COUNT,
    low: float | None = None,
    high: float | None = None,
    values: Sequence[object] | str | None = None,
    better: Literal["more", "less"] | None = None,
    faults: Sequence[str] = (),
    overrides: Overrides | None = None,
    price: Mapping[str, float] | str | None = None,
    vary: Varied = (),
    budget: int = 4000,
    store: str | Path | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    plot: str | Path | None = None,
    allow_code: bool = False,
    progress: Callable[[int], None] = lambda runs: None,
    tell: Callable[[str], None] = lambda words: None,
) -> Sizing:
    """Find the smallest swarm that does its task in time with a given probability: `swarmsim size`.

    `within` is the time, "8min" or seconds; a run that takes longer is not done. A count suffices once a chance of more
    than `sure` - `slack` is shown; all statements together are right with `confidence`. Counts from `low` (default: the
    first that the scenario accepts) to `high` (default: twice its own or, if that is too few, up to 8 times) are asked
    by bisection, or values of another key `over`: from `low` to `high`, or `values`. `better` says whether "more" or
    "less" of it makes the task easier; for counts it is "more", else it is found out. `faults` and `overrides` are
    those of `run`. `price`, such as {"robot": 120, "minute": 0.5}, looks for the cheapest too. `vary` repeats all for
    each combination of values of other keys, with at most `budget` runs in all. Runs are kept in `store`, by default
    runs/sizes/SCENARIO.sqlite, and done once. `workers`, `scheduler` and `allow_code` are those of a study. `plot` is
    the path, without suffix, of a figure: PNG and SVG. `progress` is called with the number of runs simulated, `tell`
    with each finding. Raises InputError for what cannot work, and for a run that fails.
    """
    path = shipped.found(scenario)
    with registry.own_code(allow_code), ExitStack() as stack:
        question = _question(within, sure, slack, confidence, budget)
        table, changes = _base(path, overrides, faults)
        choices = _choices(vary, over)
        decoded = changed(str(path), table, {**changes, **choices[0]}, path.parent)
        prices = None if price is None else prices_of(price, [one for choice in choices for one in choice.values()])
        kept = stack.enter_context(Store(Path(store or Path("runs") / "sizes" / f"{path.stem}.sqlite")))
        runner = Runner(kept, stack.enter_context(pool_when_needed(workers, scheduler)), progress)

        def trials(choice: Mapping[str, object], ladder: Sequence[object]) -> Trials:
            return Trials(path, table, {**changes, **choice}, over, ladder, question.within, runner)

        first: Sequence[int] = ()
        if over == COUNT and values is None:
            count = decoded.robots.count
            ladder, first = _counts(low, high, count, trials(choices[0], range(DOUBLED[-1] * count + 1)).accepts)
        else:
            ladder = _ladder(over, low, high, values)
        alpha, each = (1.0 - confidence) / len(choices), max(2, budget // len(choices))
        shared = replace(question, confidence=1.0 - alpha, budget=each)
        look = _Look(
            question=shared,
            trials=lambda choice: trials(choice, ladder),
            prices=prices,
            more_is_better={None: True if over == COUNT else None, "more": True, "less": False}[better],
            first=() if better == "less" else first,
            tell=tell,
        )  # fmt: skip
        answers = tuple(look.at(choice) for choice in choices)
    found = Sizing(path, confidence, answers, prices, runner.done)
    if plot is None:
        return found
    return replace(found, figures=tuple(figures(found, Path(plot), path.stem)))


@dataclass(frozen=True, slots=True)
class _Look:
    """One search after the other."""

    question: Question
    trials: Callable[[Mapping[str, object]], Trials]
    prices: Prices | None
    more_is_better: bool | None
    first: Sequence[int]  # places to ask first
    tell: Callable[[str], None]

    def at(self, choice: Mapping[str, object]) -> SizedLadder:
        """The answer with these values of the varied keys."""
        trials = self.trials(choice)
        extra = 0.0 if self.prices is None else self.prices.extra(list(choice.values()))
        named = f"{label(dict(choice))}: " if choice else ""

        def robots(place: int) -> int:
            value = trials.values[place] if trials.key == COUNT else None
            return value if isinstance(value, int) else trials.condition(place).scenario.robots.count

        def tell(asked: Asked) -> None:
            value = label({trials.key: trials.values[asked.place]})
            self.tell(f"{named}{value}: done in {asked.judged.successes} of {asked.judged.runs} runs: {asked.verdict}")

        search = LadderSearch(self.question, len(trials.values), trials, tell, priced=self.prices is not None)
        search.smallest(self.more_is_better, self.first)
        if self.prices is not None and search.best is not None:
            price = self.prices
            search.cheaper(
                lambda asked: price.of(asked, robots(asked.place), extra)[0],
                lambda place: price.least(robots(place), extra),
            )
        for notice in trials.notices:
            self.tell(f"notice: {notice}")
        answer = search.answer()
        counts = {one.place: robots(one.place) for one in answer.asked}
        return SizedLadder(choice, trials.key, tuple(trials.values), answer, counts, extra)


def _question(within: str | float, sure: float, slack: float, confidence: float, budget: int) -> Question:
    seconds = seconds_in("--within", within)
    if not 0.5 <= confidence < 1.0:
        raise InputError(f"--confidence {confidence:g}: expected 0.5 or more, and below 1")
    if budget < 2:
        raise InputError(f"--budget {budget}: expected 2 runs or more")
    try:
        sequential.bounds(sure, slack)
    except ValueError as problem:
        raise InputError(f"--sure {sure:g} --slack {slack:g}: {problem}") from problem
    return Question(seconds, sure, slack, confidence, budget)


def _base(path: Path, overrides: Overrides | None, faults: Sequence[str]) -> tuple[Table, dict[str, object]]:
    """The scenario's table, and the changes for all runs; faults in words join the scenario's own."""
    table = {"title": path.stem, **read_toml(path, "a scenario file")}
    changes = keys_of(overrides)
    if faults:
        own = changes.get("faults", table.get("faults", []))
        changes["faults"] = [*(own if isinstance(own, list) else []), *(fault_of(text).table for text in faults)]
    return table, changes


def _counts(
    low: float | None, high: float | None, count: int, accepts: Callable[[int], bool]
) -> tuple[Sequence[object], Sequence[int]]:
    """Counts of robots from low to high, and the places of those to ask first.

    Without `low`, the first is the smallest that the scenario accepts: two robots cannot have two neighbours. Without
    `high`, multiples of the scenario's own count are asked first. Raises InputError.
    """
    first = next((n for n in range(1, count + 1) if accepts(n)), count) if low is None else low
    tops = [n for n in (times * count for times in DOUBLED) if accepts(n)] or [count] if high is None else [high]
    if not (float(first).is_integer() and float(tops[-1]).is_integer() and 1 <= first <= tops[-1]):
        raise InputError(f"--low {first:g} --high {tops[-1]:g}: expected whole numbers from 1, low not above high")
    ladder = _few(COUNT, range(int(first), int(tops[-1]) + 1))
    return ladder, [int(top - first) for top in tops if top >= first]


def _ladder(
    over: str, low: float | None, high: float | None, values: Sequence[object] | str | None
) -> Sequence[object]:
    """The values of a key, from low to high. Raises InputError."""
    if values is not None:
        if low is not None or high is not None:
            raise InputError("--values: expected either values, or --low and --high")
        return _few(over, _listed("--values", values) if isinstance(values, str) else values)
    if low is None or high is None:
        raise InputError(f"--over {over}: expected --low and --high, or --values")
    if not -1e9 < low < high < 1e9:
        raise InputError(f"--low {low:g} --high {high:g}: expected numbers, low below high")
    if float(low).is_integer() and float(high).is_integer() and high - low >= 2.0:
        return _few(over, range(int(low), int(high) + 1))
    return [float(f"{value:.6g}") for value in np.linspace(low, high, STEPS)]


def _few(over: str, values: Sequence[object]) -> Sequence[object]:
    if not 1 <= len(values) <= MOST_VALUES or len({str(value) for value in values}) < len(values):
        raise InputError(f"--over {over}: {len(values)} values; expected 1 to {MOST_VALUES}, each once")
    return values


def _choices(vary: Varied, over: str) -> list[dict[str, object]]:
    """Every combination of the varied keys' values, `over` not among them; one without changes if none is varied."""
    if isinstance(vary, Mapping):
        axes = {key: list(values) for key, values in vary.items()}
    else:
        axes = {}
        for text in [vary] if isinstance(vary, str) else vary:
            key, equals, values = text.partition("=")
            if not equals or not key.strip():
                raise InputError(f"--vary {text}: expected key=value,value, as in robots.use=e-puck,thymio")
            axes[key.strip()] = _listed(f"--vary {key}", values)
    if over in axes:
        raise InputError(f"--vary {over}: it is the key whose value is looked for; expected another one")
    if ends := [key for key in (over, *axes) if key.partition(".")[0] == "stop"]:
        raise InputError(f"{ends[0]}: runs end after --within, whatever the scenario's limit; expected another key")
    return [dict(zip(axes, chosen, strict=True)) for chosen in itertools.product(*axes.values())]


def _listed(option: str, text: str) -> list[object]:
    """Values between commas: TOML, or else bare words."""
    try:
        found = parsed(f"value = [{text}]")["value"]
    except ValueError:
        found = [_word(one.strip()) for one in text.split(",")]
    if not isinstance(found, list) or not found or "" in found:
        raise InputError(f"{option} {text}: expected values with commas between them")
    return found


def _word(text: str) -> object:
    try:
        return parsed(f"value = {text}")["value"]
    except ValueError:
        return text
