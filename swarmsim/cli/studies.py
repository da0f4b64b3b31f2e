"""The verbs of studies: many runs, what they say, and the paper beside them."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from swarmsim.cli.interruption import end_if_asked
from swarmsim.cli.options import AllowCode, KeepOld, Overrides, Quiet
from swarmsim.cli.progress import perform_all, progress_bar
from swarmsim.cli.tables import print_table
from swarmsim.core.errors import InputError, unwritten

if TYPE_CHECKING:
    from swarmsim.studies.engine import Job
    from swarmsim.studies.plan import Plan
    from swarmsim.studies.results import Result
    from swarmsim.studies.store import Row, Store

app = typer.Typer(
    help="Run a scenario many times, varied, and tell what the runs say.\n\n"
    "Example: swarmsim study run scenarios/studies/kit2018/network.toml --seeds 30",
    no_args_is_help=True,
    rich_markup_mode=None,
)

FAILED = 1  # exit code: some run failed, some claim does not hold, or nothing was found

StudyFile = Annotated[Path, typer.Argument(metavar="STUDY", help="Study file (TOML).")]
Seeds = Annotated[int | None, typer.Option(help="Seeds 1 to N, instead of the study's.", min=1)]
StoreFile = Annotated[Path | None, typer.Option(help="Results; default: runs/studies/STUDY.sqlite.")]
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
    """List the conditions of a study, its number of runs, and the time they will take.

    Example: swarmsim study plan scenarios/studies/kit2018/network.toml
    """
    from swarmsim.studies.plan import open_study
    from swarmsim.studies.results import gather

    opened = open_study(study, seeds, keep_old=keep_old)
    with opened_store(store, study) as results:
        found = gather(opened, results)
    _notice_other_code(opened, found)
    seconds = [row.seconds for result in found.values() for row in result.rows]
    changes = {c.name: ", ".join(f"{key} = {value}" for key, value in c.changes.items()) for c in opened.conditions}
    print_table(opened.study.title, ("condition", "changes"), list(changes.items()))
    each = sum(seconds) / len(seconds) if seconds else _trial(opened)
    missing = sum(result.missing for result in found.values())
    print(
        f"{len(opened.conditions)} conditions x {len(opened.seeds)} seeds = {len(opened.runs)} runs, {missing} still "
        f"to do; about {each:.2f} s of one core each, {each * missing / 60:.1f} core minutes"
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
    """Do the runs of a study that are still missing; each is kept as it ends.

    Runs that were made by other code are done again; the older ones stay in the store. With --keep-old they count.

    Exit code 0: all there; 1: some failed; 2: bad input.

    Example: swarmsim study run scenarios/studies/kit2018/network.toml --seeds 30 --workers 2
    """
    from swarmsim.studies.plan import open_study
    from swarmsim.studies.results import gather, missing

    opened = open_study(study, seeds, keep_old=keep_old)
    for notice in () if quiet else opened.notices:
        print(f"notice: {notice}")
    with opened_store(store, study) as results:
        if not quiet:
            _notice_other_code(opened, gather(opened, results))
        perform_all(missing(opened, results, retry), results, workers, scheduler, quiet)
        failed = [row for result in gather(opened, results).values() for row in result.failed]
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
    """Tell how far a study has come.

    Example: swarmsim study status scenarios/studies/kit2018/network.toml
    """
    from swarmsim.studies.plan import open_study
    from swarmsim.studies.results import gather

    opened = open_study(study, seeds, keep_old=keep_old)
    with opened_store(store, study) as results:
        found = gather(opened, results)
    _notice_other_code(opened, found)
    rows = [
        (name, str(int(r.finished.sum())), str(int((~r.finished).sum())), str(len(r.failed)), str(r.missing))
        for name, r in found.items()
    ]
    print_table(opened.study.title, ("condition", "finished", "not finished", "failed", "missing"), rows)


@app.command()
def table(
    study: StudyFile,
    seeds: Seeds = None,
    store: StoreFile = None,
    keep_old: KeepOld = False,
    measure: Annotated[str | None, typer.Option(help="A measure instead of the iterations, such as path_sum.")] = None,
    compare: Annotated[str | None, typer.Option(help="Test every condition against this one.")] = None,
    allow_code: AllowCode = False,
) -> None:
    """Print the results of a study, with intervals.

    Example: swarmsim study table scenarios/studies/kit2018/network.toml --compare k=1
    """
    from swarmsim.studies import results as res
    from swarmsim.studies.plan import open_study

    opened = open_study(study, seeds, keep_old=keep_old)
    with opened_store(store, study) as kept:
        found = res.gather(opened, kept)
    _notice_other_code(opened, found)
    if measure is None:
        print_table(f"{opened.study.title}: iterations", *res.filled(res.HEAD, res.lines(found)))
    else:
        print_table(f"{opened.study.title}: {measure}", res.MEASURED, res.measured(found, measure))
    if compare is not None:
        if compare not in found:
            raise InputError(f"--compare {compare}: no such condition; known: {', '.join(found)}")
        _notice_unlike(opened)
        print_table(f"against {compare}", res.COMPARED, res.compared(found, compare))
    print(f"digest of the runs: {res.digest(list(found.values()))}")


@app.command()
def plot(
    study: StudyFile,
    out: Annotated[Path, typer.Argument(metavar="DIR", help="Folder for the figures (PNG and SVG).")],
    measure: Annotated[list[str] | None, typer.Option(help="Draw a measure along the axis too; repeatable.")] = None,
    seeds: Seeds = None,
    store: StoreFile = None,
    keep_old: KeepOld = False,
    allow_code: AllowCode = False,
) -> None:
    """Draw curves, the distribution of iterations, the course along an axis and the table of a study.

    Example: swarmsim study plot scenarios/studies/kit2018/network.toml runs/figures
    """
    from swarmsim.studies.plan import open_study
    from swarmsim.studies.report import study_figures
    from swarmsim.studies.results import gather

    opened = open_study(study, seeds, keep_old=keep_old)
    with opened_store(store, study) as results:
        found = gather(opened, results)
    _notice_other_code(opened, found)
    for path in study_figures(opened.study, found, out, measure or ()):
        print(path)


@app.command()
def export(
    study: StudyFile,
    csv: Annotated[Path | None, typer.Option(help="CSV file to write, one line a run.")] = None,
    parquet: Annotated[Path | None, typer.Option(help="Parquet file to write.")] = None,
    seeds: Seeds = None,
    store: StoreFile = None,
    keep_old: KeepOld = False,
    allow_code: AllowCode = False,
) -> None:
    """Write every run of a study with all its measures.

    Example: swarmsim study export scenarios/studies/kit2018/network.toml --csv runs/network.csv
    """
    from swarmsim.studies.plan import open_study
    from swarmsim.studies.results import gather, records, write_csv, write_parquet

    if csv is None and parquet is None:
        raise InputError("study export: nothing to write; name a file with --csv or --parquet")
    opened = open_study(study, seeds, keep_old=keep_old)
    with opened_store(store, study) as kept:
        found = gather(opened, kept)
    _notice_other_code(opened, found)
    rows = records(opened, found)
    for path, write in ((csv, write_csv), (parquet, write_parquet)):
        if path is not None:
            try:
                write(path, rows)
            except OSError as problem:
                raise unwritten(path, problem) from problem
            print(f"{path}: {len(rows)} runs")


@app.command()
def rank(
    study: StudyFile,
    method: Annotated[str, typer.Option(help="What the axes of the methods have as 'together'.")] = "method",
    within: Annotated[str | None, typer.Option(help="Key of an axis whose values are kept apart.")] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for figures of ratios and profiles (PNG and SVG).")] = None,
    seeds: Seeds = None,
    store: StoreFile = None,
    keep_old: KeepOld = False,
    allow_code: AllowCode = False,
) -> None:
    """Compare methods over many worlds: ratios to the first method, probability of improvement, profiles.

    Example: swarmsim study rank scenarios/studies/strategies/unseen.toml --out runs/figures
    """
    from swarmsim.studies import methods
    from swarmsim.studies.plan import open_study
    from swarmsim.studies.report import method_figures
    from swarmsim.studies.results import digest, gather

    opened = open_study(study, seeds, keep_old=keep_old)
    with opened_store(store, study) as kept:
        results = gather(opened, kept)
    _notice_other_code(opened, results)
    found = methods.compare(opened, results, method, within)
    for group, standings in found.groups.items():
        title = f"{opened.study.title}{group and f', {group}'}: {found.tasks} tasks"
        print_table(title, methods.HEAD, methods.lines(standings))
    print(f"digest of the runs: {digest(list(results.values()))}")
    for path in () if out is None else method_figures(found, opened.study.title, out):
        print(path)


@app.command()
def best(
    study: StudyFile,
    confidence: Annotated[float, typer.Option(help="That no other value is better.", min=0.5, max=0.999)] = 0.95,
    budget: Annotated[int, typer.Option(help="Runs to spend at most.", min=2)] = 2000,
    tolerance: Annotated[float, typer.Option(help="A difference that does not matter, as a share.", min=0.0)] = 0.03,
    store: StoreFile = None,
    keep_old: KeepOld = False,
    workers: Workers = None,
    scheduler: Scheduler = None,
    allow_code: AllowCode = False,
    quiet: Quiet = False,
) -> None:
    """Find the condition of a study with the fewest iterations, with as few runs as the confidence allows.

    Example: swarmsim study best scenarios/studies/best-k/15.toml --budget 1000
    """
    from swarmsim.studies import selection
    from swarmsim.studies.plan import open_study
    from swarmsim.studies.results import gather

    opened = open_study(study, 1, keep_old=keep_old)
    if not quiet:
        _notice_unlike(opened)
    with opened_store(store, study) as results:
        if not quiet:
            _notice_other_code(opened, gather(opened, results))

        def more(tasks: Sequence[Job]) -> None:
            perform_all(tasks, results, workers, scheduler, quiet)

        answer = selection.best(opened, results, more, confidence, budget, tolerance)
    print_table(opened.study.title, selection.HEAD, selection.lines(answer))
    print(answer.sentence)


@app.command()
def worst(
    scenario: Annotated[Path, typer.Argument(help="Scenario file (TOML).")],
    out: Annotated[Path, typer.Option(help="Scenario file to write, with the smallest timeline of faults.")],
    set_: Overrides = None,
    budget: Annotated[int, typer.Option(help="Timelines to try; more where shrinking needs them.", min=1)] = 300,
    entries: Annotated[int, typer.Option(help="Faults of a timeline at most.", min=1, max=10)] = 3,
    factor: Annotated[float, typer.Option(help="Times the sound run's iterations that are a failure.", min=1.0)] = 2.0,
    seeds: Annotated[int, typer.Option(help="Seeds with each of which it has to fail.", min=1)] = 3,
    seed: Annotated[int, typer.Option(help="Of the search.", min=0)] = 1,
    workers: Workers = None,
    scheduler: Scheduler = None,
    allow_code: AllowCode = False,
    quiet: Quiet = False,
) -> None:
    """Look for the smallest timeline of faults that makes the swarm fail: not done in twice the time.

    Exit code 0: found and written; 1: none found; 2: bad input.

    Example: swarmsim study worst scenarios/basilica.toml --set network.topology.k=1 --out runs/worst.toml
    """
    from swarmsim.core.scenario.file import load
    from swarmsim.engine.build import build
    from swarmsim.studies import worst as search
    from swarmsim.studies.engine import worker_pool

    if out.exists():
        raise InputError(f"{out}: is there already; expected the name of a new file")
    opened = load(scenario, set_ or [])
    world = build(opened, str(scenario)).world
    with progress_bar(quiet) as progress, worker_pool(workers or os.cpu_count() or 1, scheduler) as run_jobs:
        bar = progress.add_task("searching", total=budget, text="")

        def tell(words: str) -> None:
            progress.console.print(words, markup=False, highlight=False)

        def performed(tasks: Sequence[Job]) -> Iterator[Row]:
            for row in run_jobs(tasks):
                end_if_asked()
                yield row
            progress.update(bar, completed=min(look.timelines, budget), text=f"{look.timelines} timelines")

        look = search.Search(opened, world, performed, seeds, factor, tell)
        answer = look.run(budget, entries, seed)
    title = (
        f"{scenario}: not done in {factor:g} times the {' / '.join(map(str, answer.sound))} iterations without faults"
    )
    print_table(title, search.HEAD, search.lines(answer))
    print(f"{answer.timelines} timelines tried in {answer.runs} runs")
    if answer.smallest is None:
        raise typer.Exit(FAILED)
    search.write(opened, answer.smallest.timeline, answer.limit[0], out)
    print(f"{out}: swarmsim run {out}")


def _trial(opened: Plan) -> float:
    """Seconds that one run of a study takes here, in the mean over its conditions' first 100 iterations."""
    from swarmsim.engine.build import build

    seconds = []
    for one in opened.conditions:
        simulation = build(one.scenario, one.name, opened.world_of(one)).simulation
        simulation.tick()
        begun = time.perf_counter()
        while not simulation.over and simulation.state.iteration < 100:
            simulation.tick()
        each = (time.perf_counter() - begun) / max(simulation.state.iteration - 1, 1)
        seconds.append(each * min(one.scenario.stop.iterations, 700))
    return sum(seconds) / len(seconds)


def _notice_unlike(opened: Plan) -> None:
    """Say in what the conditions of a study differ that makes their numbers tell little of each other."""
    from swarmsim.studies.likeness import Side, notices

    for notice in notices([Side(one.name, one.scenario, opened.world_of(one)) for one in opened.conditions]):
        print(f"notice: {notice}")


def _notice_other_code(opened: Plan, found: Mapping[str, Result]) -> None:
    """Say which runs other code has made than the present."""
    from swarmsim.studies.results import of_other_code

    for notice in of_other_code(opened, found):
        print(f"notice: {notice}")


def opened_store(asked: Path | None, study: Path) -> Store:
    """The store that was asked for, or the one of that study."""
    from swarmsim.studies.store import Store

    return Store(asked or Path("runs") / "studies" / f"{study.stem}.sqlite")
