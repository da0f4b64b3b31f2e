"""Tables of chances and quantiles: how many runs are done by a time, and by when a share of them is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from swarmsim.core.durations import told
from swarmsim.studies.plan import one_period
from swarmsim.studies.results import Result
from swarmsim.studies.survival import Chance, Quantile

Table = tuple[list[str], list[list[str]]]  # head, and lines


def chances(results: Mapping[str, Result], times: Sequence[float]) -> Table:
    """The chance of being done by each of these times in s, with 95 % intervals; one line per condition."""
    head = ["condition", "n", "finished", *(cell for time in times for cell in (f"by {told(time)}", "95 % interval"))]
    return head, [
        [name, str(len(result.rows)), str(int(result.finished.sum()))]
        + [cell for time in times for cell in (_chance(result.seconds.by(time)) if result.rows else ("-", "-"))]
        for name, result in results.items()
    ]


def quantiles(results: Mapping[str, Result], shares: Sequence[float]) -> Table:
    """The time by which each of these shares of the runs is done, with 95 % intervals; one line per condition.

    It is given in iterations too if all conditions have one period.
    """
    period = one_period(result.condition for result in results.values())
    head = ["condition", "n", "finished"]
    for share in shares:
        head += [f"{100 * share:g} % done", "95 % interval", *(["in time"] if period else [])]
    rows = []
    for name, result in results.items():
        row = [name, str(len(result.rows)), str(int(result.finished.sum()))]
        for share in shares:
            if result.rows:
                row += _quantile((result.endings if period else result.seconds).quantile(share), period)
            else:
                row += ["-"] * (3 if period else 2)
        rows.append(row)
    return head, rows


def _chance(found: Chance) -> tuple[str, str]:
    low, high = (100.0 * end for end in found.interval)
    if found.value is None:
        return "beyond the limit", f"over {low:.0f} %"
    return f"{100.0 * found.value:.0f} %", f"{low:.0f} to {high:.0f} %"


def _quantile(found: Quantile, period: float | None) -> list[str]:
    def shown(time: float) -> str:
        return f"{time:.0f}" if period else told(time)

    between = f"over {shown(found.low)}" if found.high is None else f"{shown(found.low)} to {shown(found.high)}"
    value = "not reached" if found.value is None else shown(found.value)
    in_time = "-" if found.value is None or period is None else told(found.value * period)
    return [value, between, *([in_time] if period else [])]
