"""The verb `test`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from swarmsim.cli.interruption import end_if_asked, told_if_interrupted
from swarmsim.cli.options import AllowCode, Quiet
from swarmsim.cli.progress import progress_bar
from swarmsim.cli.studies import Scheduler, Workers
from swarmsim.cli.tables import print_table
from swarmsim.core.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.progress import Progress

    from swarmsim.api.expectations import Expectations, Tested
    from swarmsim.studies.expectations.mutation import Tried
    from swarmsim.studies.expectations.verdicts import Verdict

CODES: Final = {"holds": 0, "fails": 1, "undecided": 5}
COLOURS: Final = {"holds": "green", "fails": "red", "undecided": "yellow"}
TODAY: Final = "today"

Files = Annotated[list[Path], typer.Argument(metavar="PATHS", help="Scenarios, studies, or folders of them.")]
Only = Annotated[str, typer.Option("-k", metavar="TEXT", help="Only expectations whose name contains this text.")]
Planned = Annotated[bool, typer.Option("--plan", help="Print how many runs it takes, and run nothing.")]
Mutate = Annotated[bool, typer.Option("--mutate", help="Break the swarm, and list expectations that do not notice.")]
Mutants = Annotated[list[str] | None, typer.Option(help="With --mutate, one more way: a fault in words, or KEY=VALUE.")]
Fresh = Annotated[
    str,
    typer.Option("--fresh", metavar="NIGHT", help="New seeds, drawn from a date or text, or 'today'."),
]
JUnit = Annotated[Path | None, typer.Option(help="JUnit XML file to write.")]
Films = Annotated[Path | None, typer.Option(help="Folder for films of the worst runs of what fails.")]
Budget = Annotated[int | None, typer.Option(help="Most runs of an expectation with a chance.", min=1)]
Alpha = Annotated[float, typer.Option(help="Largest probability that any 'fails' is wrong.", min=1e-9, max=0.5)]
Allowed = Annotated[bool, typer.Option("--allow-undecided", help="Count undecided as passed.")]
StoreFile = Annotated[Path | None, typer.Option(help="Where runs are kept; default: runs/expectations.sqlite.")]


def test(
    paths: Files,
    only: Only = "",
    plan: Planned = False,
    mutate: Mutate = False,
    mutant: Mutants = None,
    night: Fresh = "",
    junit: JUnit = None,
    films: Films = None,
    budget: Budget = None,
    alpha: Alpha = 0.01,
    allow_undecided: Allowed = False,
    store: StoreFile = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    allow_code: AllowCode = False,
    quiet: Quiet = False,
) -> None:
    """Say whether runs meet what scenarios and studies expect of them with [[expect]].

    Exit code 0: all hold; 1: some fail; 2: bad input; 5: none fails, but some are undecided. With --mutate, 1
    means that some expectation fails with no mutant, or with nothing broken.

    Example: swarmsim test room --junit runs/expectations.xml
    """
    from swarmsim.api.expectations import open_expectations

    if mutant and not mutate:
        raise InputError("--mutant: it breaks the swarm for --mutate only; expected --mutate as well")

    when = date.today().isoformat() if night == TODAY else night
    opened = open_expectations(
        paths, only=only, night=when, budget=budget, alpha=alpha, store=store, allow_code=allow_code
    )
    if plan:
        _print_cost(opened)
        return
    if mutate:
        with _bar(quiet, len(opened.found)) as bar:
            found = opened.mutants(mutant or (), workers=workers, scheduler=scheduler, tell=bar.tried, progress=bar)
        raise typer.Exit(_print_broken(found))
    with _bar(quiet, len(opened.found)) as bar:
        tested = opened.test(films=films, workers=workers, scheduler=scheduler, tell=bar.judged, progress=bar)
    _print(tested, quiet)
    if junit is not None:
        tested.junit(junit, allow_undecided=allow_undecided)
    raise typer.Exit(0 if allow_undecided and tested.answer == "undecided" else CODES[tested.answer])


@contextmanager
def _bar(quiet: bool, of: int) -> Iterator[_Bar]:
    """A bar for these expectations; on interruption, print what is kept."""
    with progress_bar(quiet) as progress:
        bar = _Bar(progress, of)
        with told_if_interrupted(bar.kept):
            yield bar


class _Bar:
    """A bar that counts runs, over lines of verdicts."""

    def __init__(self, progress: Progress, of: int) -> None:
        self._progress, self._of, self._told, self._runs = progress, of, 0, 0
        self._task = progress.add_task("testing", total=of, text="")

    def __call__(self, runs: int) -> None:
        """Show the number of runs done."""
        end_if_asked()
        self._runs = runs
        self._progress.update(self._task, text=f"{runs} runs")

    def kept(self) -> str:
        """What is kept after an interruption."""
        return f"{self._runs} runs are kept; the same command goes on from there"

    def judged(self, verdict: Verdict) -> None:
        """Print a verdict."""
        self._say(verdict.expectation.name, verdict.words, COLOURS[verdict.answer], f"{verdict.seconds:.1f} s")

    def tried(self, one: Tried) -> None:
        """Print what mutants do to an expectation."""
        killed = f"fails with {len(one.killers)} of {len(one.fates) - len(one.equivalent)} mutants"
        if one.sound == "fails":
            killed = "fails with nothing broken"
        self._say(one.expectation.name, killed, "green" if one.killers else "red", "")

    def _say(self, name: str, words: str, colour: str, after: str) -> None:
        from rich.text import Text

        self._told += 1
        share = f"{100 * self._told // self._of:3d} %"
        self._progress.console.print(
            Text.assemble(f"{name} ", (words, colour), f"  [{share}] {after}".rstrip()), soft_wrap=True
        )
        self._progress.update(self._task, completed=self._told)
        if self._told == self._of:
            self._progress.remove_task(self._task)


def _print(tested: Tested, quiet: bool) -> None:
    """Print what fails and is undecided with how to repeat it, then the counts."""
    bad = [one for one in tested.verdicts if one.answer != "holds"]
    for verdict in bad:
        print(f"{verdict.expectation.name}\n    {verdict.words}")
        for line in (verdict.command, verdict.film):
            if line:
                print(f"    {line}")
    if not quiet:
        counts = {answer: sum(one.answer == answer for one in tested.verdicts) for answer in CODES}
        thin = sum(one.thin for one in tested.verdicts)
        words = {"holds": "hold", "fails": "fail", "undecided": "undecided"}
        said = [f"{count} {words[answer]}" for answer, count in counts.items() if count] + (
            [f"{thin} thin"] if thin else []
        )
        print(f"{', '.join(said)}; {tested.runs} runs done in {tested.seconds:.1f} s")


def _print_cost(opened: Expectations) -> None:
    found = opened.cost()
    rows = [(one.expectation.name, str(one.least), str(one.most), str(one.lacking)) for one in found.costs]
    print_table("what it will cost", ("expectation", "runs, if all are good", "at most", "still to do"), rows)
    print(f"{found.runs} runs to do if all are good; about {found.seconds / 60.0:.1f} core minutes")


def _print_broken(found: Sequence[Tried]) -> int:
    """Print which expectations no mutant fails, and give the exit code."""
    told = [one for one in found if one.sound != "fails"]
    for one in (one for one in told if one.met_standing):
        more = f"; fails with: {', '.join(one.killers)}" if one.killers else ""
        print(f"met even by robots that stand still: {one.expectation.name}{more}")
    blind = [one for one in told if not one.killers]
    for one in blind:
        print(f"no mutant is shown to fail it: {one.expectation.name}")
    for one in (one for one in found if one.sound == "fails"):
        print(f"not tried, as it fails with nothing broken: {one.expectation.name}")
    rows = []
    for mutant in dict.fromkeys(name for one in told for name in (*one.fates, *one.left_out)):
        fates = [one.fates.get(mutant) for one in told]
        rows.append((mutant, *(str(fates.count(fate)) for fate in ("fails", "holds", "undecided", "same", None))))
    print_table("expectations by mutant", ("all robots", "fail", "hold", "undecided", "no change", "cannot be"), rows)
    same = dict.fromkeys(
        (one.expectation.plan.path, one.expectation.condition.name, name) for one in told for name in one.equivalent
    )
    for path, condition, name in same:
        print(f"equivalent: {path}{f', {condition}' if condition else ''}: {name} changes no digest")
    print(f"{len(told) - len(blind)} of {len(found)} expectations fail with some mutant")
    return 0 if len(told) == len(found) and not blind else 1
