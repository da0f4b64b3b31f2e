"""The verbs of studies: many runs and their results."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from swarmsim.cli.interruption import end_if_asked
from swarmsim.cli.options import AllowCode, KeepOld, Overrides, Quiet
from swarmsim.cli.printing import Form, for_print
from swarmsim.cli.progress import Counted, progress_bar, study_bar
from swarmsim.cli.tables import print_table
from swarmsim.core.errors import InputError

if TYPE_CHECKING:
    from swarmsim.api.studies import StudyRun
    from swarmsim.studies.store import Store

app = typer.Typer(
    help="Run many variations of a scenario and evaluate the runs.\n\n"
    "Example: swarmsim study run kit2018/network --seeds 30",
    no_args_is_help=True,
    rich_markup_mode=None,
)

FAILED = 1  # exit code: some run failed, some claim does not hold, or nothing was found

StudyFile = Annotated[Path, typer.Argument(metavar="STUDY", help="Study file (TOML).")]
Seeds = Annotated[int | None, typer.Option(help="Seeds 1 to N, instead of the study's.", min=1)]
StoreFile = Annotated[Path | None, typer.Option(help="Results; default: runs/studies/STUDY.sqlite.")]
Ends = Literal["highest", "lowest"]
Workers = Annotated[int | None, typer.Option(help="Processes; default: one for each core.", min=1)]
Scheduler = Annotated[str | None, typer.Option(help="Address of a running Dask scheduler, tcp://host:port.")]


@app.command()
def plan(
    study: StudyFile,
    seeds: Seeds = None,
    store: StoreFile = None,
    keep_old: KeepOld = False,
    allow_code: AllowCode = False,
) -> None:
    """List a study's conditions, its number of runs, and the time they will take.

    Example: swarmsim study plan kit2018/network
    """
    opened = _opened(study, seeds, store, keep_old, allow_code)
    conditions = opened.plan.conditions
    changes = {c.name: ", ".join(f"{key} = {value}" for key, value in c.changes.items()) for c in conditions}
    print_table(opened.plan.study.title, ("condition", "changes"), list(changes.items()))
    found = opened.estimate()
    print(
        f"{len(conditions)} conditions x {len(opened.plan.seeds)} seeds = {found.runs} runs, {found.missing} still "
        f"to do; about {found.seconds:.2f} s of one core each, {found.seconds * found.missing / 60:.1f} core minutes"
    )


@app.command()
def run(
    study: StudyFile,
    seeds: Seeds = None,
    store: StoreFile = None,
    keep_old: KeepOld = False,
    workers: Workers = None,
    scheduler: Scheduler = None,
    retry: Annotated[bool, typer.Option("--retry", help="Do failed runs again.")] = False,
    allow_code: AllowCode = False,
    quiet: Quiet = False,
) -> None:
    """Do a study's missing runs; each is stored as it ends.

    Runs of other code are done again; the old ones stay in the store, and count with --keep-old.

    Exit code 0: all done; 1: some failed; 2: bad input.

    Example: swarmsim study run kit2018/network --seeds 30 --workers 2
    """
    from swarmsim.api.studies import open_study

    opened = open_study(study, seeds=seeds, store=store, keep_old=keep_old, allow_code=allow_code)
    if not quiet:
        _notice([*opened.plan.notices, *opened.of_other_code()])
    with study_bar(quiet) as bar:
        opened.run(workers=workers, scheduler=scheduler, retry=retry, progress=bar)
    failed = [row for result in opened.results.values() for row in result.failed]
    for row in failed:
        print(f"failed: {row.condition}, seed {row.seed}: {row.message}")
    raise typer.Exit(FAILED if failed else 0)


@app.command()
def status(
    study: StudyFile,
    seeds: Seeds = None,
    store: StoreFile = None,
    keep_old: KeepOld = False,
    allow_code: AllowCode = False,
) -> None:
    """Print the progress of a study.

    Example: swarmsim study status kit2018/network
    """
    opened = _opened(study, seeds, store, keep_old, allow_code)
    rows = [tuple(map(str, astuple(one))) for one in opened.status()]
    print_table(opened.plan.study.title, ("condition", "finished", "not finished", "failed", "missing"), rows)


@app.command()
def table(
    study: StudyFile,
    seeds: Seeds = None,
    store: StoreFile = None,
    keep_old: KeepOld = False,
    measure: Annotated[str | None, typer.Option(help="A measure instead of the iterations, such as path_sum.")] = None,
    by: Annotated[list[str] | None, typer.Option(help="Chance of being done by this time: 8min; repeatable.")] = None,
    quantile: Annotated[
        list[float] | None, typer.Option(help="Time by which this share is done: 0.95; repeatable.")
    ] = None,
    compare: Annotated[str | None, typer.Option(help="Test every condition against this one.")] = None,
    peak: Annotated[Ends | None, typer.Option(help="The best value on the axis by --measure.")] = None,
    form: Form = None,
    allow_code: AllowCode = False,
) -> None:
    """Print the results of a study, with intervals.

    Example: swarmsim study table kit2018/network --compare k=1

    How sure, and by when: --by 8min --by 10min --quantile 0.95
    """
    opened = _opened(study, seeds, store, keep_old, allow_code, aside=form is not None)
    tables = [opened.table(measure)]
    tables += [opened.chances(*by)] if by else []
    tables += [opened.quantiles(*quantile)] if quantile else []
    if compare is not None:
        tables.append(opened.compare(compare))
        _notice(opened.unlike(), aside=form is not None)
    for one in tables:
        print_table(one.title, one.head, one.rows, form)
    if peak is not None:
        _print_peaks(opened, measure, peak)
    if form is None:
        print(f"digest of the runs: {opened.digest()}")


def _print_peaks(opened: StudyRun, measure: str | None, which: Ends) -> None:
    from swarmsim.studies.peak import sentences

    if measure is None:
        raise InputError(f"--peak {which}: no measure is named; expected --measure as well, such as --measure path_sum")
    first = opened.plan.study.vary[0].key.rpartition(".")[2] if opened.plan.study.vary else "x"
    for sentence in sentences(opened.peaks(measure, which), measure, first, which):
        print(sentence)


@app.command()
@for_print
def plot(
    study: StudyFile,
    out: Annotated[Path, typer.Argument(metavar="DIR", help="Folder for the figures and tables.")],
    measure: Annotated[list[str] | None, typer.Option(help="Draw a measure along the axis too; repeatable.")] = None,
    seeds: Seeds = None,
    store: StoreFile = None,
    keep_old: KeepOld = False,
    allow_code: AllowCode = False,
) -> None:
    """Draw a study's curves, its distribution of iterations, its trend along an axis, and write its table.

    Figures are PNG and SVG, the table is Markdown, LaTeX and CSV.

    Example: swarmsim study plot kit2018/network runs/figures

    For a column of a paper: --pdf --width 252pt --no-title
    """
    for path in _opened(study, seeds, store, keep_old, allow_code).plot(out, *(measure or ())):
        print(path)


@app.command()
def export(
    study: StudyFile,
    csv: Annotated[Path | None, typer.Option(help="CSV file to write, one line per run.")] = None,
    parquet: Annotated[Path | None, typer.Option(help="Parquet file to write.")] = None,
    seeds: Seeds = None,
    store: StoreFile = None,
    keep_old: KeepOld = False,
    allow_code: AllowCode = False,
) -> None:
    """Write every run of a study with all its measures.

    Example: swarmsim study export kit2018/network --csv runs/network.csv
    """
    if csv is None and parquet is None:
        raise InputError("study export: nothing to write; name a file with --csv or --parquet")
    opened = _opened(study, seeds, store, keep_old, allow_code)
    for path in opened.export(csv=csv, parquet=parquet):
        print(f"{path}: {len(opened.records())} runs")


@app.command()
@for_print
def rank(
    study: StudyFile,
    method: Annotated[str, typer.Option(help="The 'together' of the methods' axes.")] = "method",
    within: Annotated[str | None, typer.Option(help="Key of an axis whose values are compared separately.")] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for figures of ratios and profiles.")] = None,
    seeds: Seeds = None,
    store: StoreFile = None,
    keep_old: KeepOld = False,
    allow_code: AllowCode = False,
) -> None:
    """Compare methods over many worlds: ratios to the first method, probability of improvement, profiles.

    Example: swarmsim study rank strategies/unseen --out runs/figures
    """
    from swarmsim.studies.methods import HEAD, lines, notes

    opened = _opened(study, seeds, store, keep_old, allow_code)
    found = opened.rank(method=method, within=within, out=out)
    for group, standings in found.groups.items():
        print_table(f"{opened.plan.study.title}{group and f', {group}'}: {found.tasks} tasks", HEAD, lines(standings))
        for note in notes(standings):
            print(note)
    print(f"digest of the runs: {opened.digest()}")
    for path in found.figures:
        print(path)


@app.command()
def best(
    study: StudyFile,
    confidence: Annotated[float, typer.Option(help="Confidence in the answer.", min=0.5, max=0.999)] = 0.95,
    budget: Annotated[int, typer.Option(help="Runs to spend at most.", min=2)] = 2000,
    tolerance: Annotated[float, typer.Option(help="Negligible difference, as a share.", min=0.0)] = 0.03,
    within: Annotated[str | None, typer.Option(help="Compare chances of being done by this time: 8min, 90s.")] = None,
    store: StoreFile = None,
    keep_old: KeepOld = False,
    workers: Workers = None,
    scheduler: Scheduler = None,
    allow_code: AllowCode = False,
    quiet: Quiet = False,
) -> None:
    """Find the condition of a study with the fewest iterations, with as few runs as the confidence allows.

    Unfinished runs are compared up to the shortest limit of the conditions; if too few finish, no condition is named.

    Example: swarmsim study best best-k/15 --budget 1000

    The one with the highest chance of being done by a time: --within 8min --tolerance 0.05
    """
    from swarmsim.api.studies import open_study
    from swarmsim.studies.selection import head, lines

    opened = open_study(study, seeds=1, store=store, keep_old=keep_old, allow_code=allow_code)
    if not quiet:
        _notice([*opened.unlike(), *opened.of_other_code()])
    with study_bar(quiet) as bar:
        answer = opened.best(
            confidence=confidence,
            budget=budget,
            tolerance=tolerance,
            within=within,
            workers=workers,
            scheduler=scheduler,
            progress=bar,
        )
    print_table(opened.plan.study.title, head(answer), lines(answer))
    print(answer.sentence)


@app.command()
def worst(
    scenario: Annotated[Path, typer.Argument(help="Scenario file (TOML).")],
    out: Annotated[Path, typer.Option(help="Scenario file to write, with the smallest timeline of faults.")],
    set_: Overrides = None,
    budget: Annotated[int, typer.Option(help="Timelines to try; shrinking may take more.", min=1)] = 300,
    entries: Annotated[int, typer.Option(help="Most faults in a timeline.", min=1, max=10)] = 3,
    factor: Annotated[float, typer.Option(help="Limit, as a multiple of the fault-free iterations.", min=1.0)] = 2.0,
    seeds: Annotated[int, typer.Option(help="Number of seeds that must all fail.", min=1)] = 3,
    seed: Annotated[int, typer.Option(help="Seed of the search.", min=0)] = 1,
    workers: Workers = None,
    scheduler: Scheduler = None,
    allow_code: AllowCode = False,
    quiet: Quiet = False,
) -> None:
    """Search for the smallest timeline of faults that makes the swarm fail: not done in twice the time.

    Exit code 0: found and written; 1: none found; 2: bad input.

    Example: swarmsim study worst basilica --set network.topology.k=1 --out runs/worst.toml
    """
    from swarmsim.api.worst import study_worst
    from swarmsim.core.durations import told
    from swarmsim.studies.worst import HEAD, lines

    with progress_bar(quiet) as progress:
        counted = Counted(progress, "searching", "{} timelines")

        def tell(words: str) -> None:
            progress.console.print(words, markup=False, highlight=False)

        def move(timelines: int) -> None:
            end_if_asked()
            counted(timelines, budget)

        answer = study_worst(
            scenario,
            out,
            overrides=set_,
            budget=budget,
            entries=entries,
            factor=factor,
            seeds=seeds,
            seed=seed,
            workers=workers,
            scheduler=scheduler,
            allow_code=allow_code,
            progress=move,
            tell=tell,
        )
    sound = " / ".join(map(str, answer.sound))
    span = " / ".join(told(took * answer.period) for took in answer.sound)
    title = f"{scenario}: not done in {factor:g} times the {sound} iterations ({span}) without faults"
    print_table(title, HEAD, lines(answer))
    print(f"{answer.timelines} timelines tried in {answer.runs} runs")
    if answer.smallest is None:
        raise typer.Exit(FAILED)
    print(f"{out}: swarmsim run {out}")


def _opened(
    study: Path, seeds: int | None, store: Path | None, keep_old: bool, allow_code: bool, *, aside: bool = False
) -> StudyRun:
    """Open a study, and print which of its runs were made by other code."""
    from swarmsim.api.studies import open_study

    opened = open_study(study, seeds=seeds, store=store, keep_old=keep_old, allow_code=allow_code)
    _notice(opened.of_other_code(), aside=aside)
    return opened


def _notice(sentences: Sequence[str], *, aside: bool = False) -> None:
    for sentence in sentences:
        typer.echo(f"notice: {sentence}", err=aside)


def opened_store(asked: Path | None, study: Path) -> Store:
    """The requested store, or the study's default one."""
    from swarmsim.studies.store import Store

    return Store(asked or Path("runs") / "studies" / f"{study.stem}.sqlite")
