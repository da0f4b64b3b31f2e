"""Expectations: whether a swarm behaves as its scenarios and studies say."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import msgspec

from swarmsim.api.overrides import keys_of
from swarmsim.api.runs import record
from swarmsim.core.errors import InputError
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.files import write_whole
from swarmsim.engine.build import build
from swarmsim.faults.in_words import fault_in_words
from swarmsim.studies.engine import Job, pool_when_needed, run_job
from swarmsim.studies.expectations.junit import junit_of
from swarmsim.studies.expectations.mutation import Broken, Tried, tried
from swarmsim.studies.expectations.nights import Nights
from swarmsim.studies.expectations.reading import Expectation, expectations_of, files_of
from swarmsim.studies.expectations.session import ExpectationSession, Forecast, forecast
from swarmsim.studies.expectations.verdicts import Answer, Levels, Verdict
from swarmsim.studies.runner import Runner
from swarmsim.studies.store import Row, Store

ALPHA: Final = 0.01
STORE: Final = Path("runs") / "expectations.sqlite"
Paths = str | Path | Sequence[str | Path]


@dataclass(frozen=True, slots=True)
class Tested:
    """The verdicts of a session."""

    verdicts: tuple[Verdict, ...]
    runs: int  # done now; all others were stored
    begun: datetime
    seconds: float  # of wall clock

    @property
    def answer(self) -> Answer:
        """The worst of all: one that fails, else one that is undecided, else all hold."""
        answers = {one.answer for one in self.verdicts}
        return "fails" if "fails" in answers else "undecided" if "undecided" in answers else "holds"

    def text(self) -> str:
        """Every verdict in a line: the same for the same code, wherever and whenever it was tested."""
        return "".join(f"{one.expectation.name} {one.words}\n" for one in self.verdicts)

    def junit(self, path: str | Path, *, allow_undecided: bool = False) -> Path:
        """Write the file `path` as JUnit XML, and return it: `swarmsim test --junit`.

        Undecided counts as a failure unless you `allow_undecided`. Raises InputError, StorageError for a full disk.
        """
        write_whole(Path(path), junit_of(self.verdicts, self.begun, self.seconds, allow_undecided))
        return Path(path)


def test(
    paths: Paths,
    *,
    only: str = "",
    night: str = "",
    budget: int | None = None,
    alpha: float = ALPHA,
    films: str | Path | None = None,
    store: str | Path | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    allow_code: bool = False,
) -> Tested:
    """Say whether runs meet what files expect of them with `[[expect]]`: `swarmsim test`.

    It is `open_expectations`, then `Expectations.test`; parameters and errors are those of both.
    """
    opened = open_expectations(
        paths, only=only, night=night, budget=budget, alpha=alpha, store=store, allow_code=allow_code
    )
    return opened.test(films=films, workers=workers, scheduler=scheduler)


test.__dict__["__test__"] = False  # no test of pytest's, wherever it is imported


def open_expectations(
    paths: Paths,
    *,
    only: str = "",
    night: str = "",
    budget: int | None = None,
    alpha: float = ALPHA,
    store: str | Path | None = None,
    allow_code: bool = False,
) -> Expectations:
    """Read what files expect, and check that their runs can tell, without doing any: for `swarmsim test`.

    `paths` are scenarios, studies, and folders of them; `only` keeps expectations whose name has this text. With a
    `night`, a date or a number, those with a chance get new seeds, and evidence goes on from other nights of the same
    behaviour. `budget` replaces the most runs of each of these; `alpha` is the session's probability of a wrong
    *fails* among them. Runs are kept in `store`, by default runs/expectations.sqlite. `allow_code` lets scenarios run
    their own code. Raises InputError that names the file and the key.
    """
    if not 0.0 < alpha < 1.0:
        raise InputError(f"--alpha {alpha:g}: expected a probability between 0 and 1")
    named = [Path(paths)] if isinstance(paths, str | Path) else [Path(one) for one in paths]
    with registry.own_code(allow_code):
        found = [one for file in files_of(named) for one in expectations_of(file)]
    chosen = [one for one in found if only.lower() in one.name.lower()]
    if not chosen:
        names = ", ".join(one.name for one in found)
        raise InputError(f"-k {only}: no expectation has this in its name; known: {names}")
    return Expectations(tuple(chosen), Path(store) if store else STORE, night, budget, alpha, allow_code)


@dataclass(frozen=True, slots=True)
class Expectations:
    """What files expect, ready to be tested; the fields are the parameters of `open_expectations`."""

    found: tuple[Expectation, ...]
    store: Path
    night: str
    budget: int | None
    alpha: float
    allow_code: bool

    def test(
        self,
        *,
        films: str | Path | None = None,
        workers: int | None = None,
        scheduler: str | None = None,
        tell: Callable[[Verdict], None] = lambda verdict: None,
        progress: Callable[[int], None] = lambda runs: None,
    ) -> Tested:
        """Do the runs that are needed, and give all verdicts: `swarmsim test`.

        `films` is a folder for films of the worst runs of what fails. One of `workers` runs here, more in processes of
        their own, or those of a Dask `scheduler`. `tell` is called with each verdict, `progress` with the number of
        runs done. Raises InputError for a scheduler that does not answer, StorageError for a full disk.
        """
        begun, start, verdicts = datetime.now(UTC), time.perf_counter(), list[Verdict]()
        with self._session(workers, scheduler, progress) as session:
            for verdict in session.verdicts(self.found):
                verdicts.append(_filmed(verdict, films))
                tell(verdicts[-1])
        return Tested(tuple(verdicts), session.runner.done, begun, time.perf_counter() - start)

    def cost(self) -> Forecast:
        """The runs that expectations will take, and about how long, without doing any: `swarmsim test --plan`."""
        with self._session(1, None, lambda runs: None) as session:
            return forecast(session, self.found)

    def mutants(
        self,
        own: Sequence[str] = (),
        *,
        workers: int | None = None,
        scheduler: str | None = None,
        tell: Callable[[Tried], None] = lambda tried: None,
        progress: Callable[[int], None] = lambda runs: None,
    ) -> list[Tried]:
        """Break every robot in one way after another, and say which expectations notice: `swarmsim test --mutate`.

        `own` are more ways to break the swarm: faults in words, "motor slow at=0 fraction=1 factor=0.5", or keys as for
        --set, "mind.strategy.use=stand". `tell` is called with each expectation's results; other parameters and errors
        are those of `test`.
        """
        broken = {text: _broken(text) for text in own}
        found = list[Tried]()
        with self._session(workers, scheduler, progress) as session:
            for one in tried(self.found, session.runner, self.alpha, self.budget, broken):
                found.append(one)
                tell(one)
        return found

    @contextmanager
    def _session(
        self, workers: int | None, scheduler: str | None, progress: Callable[[int], None]
    ) -> Iterator[ExpectationSession]:
        with registry.own_code(self.allow_code), ExitStack() as stack:
            kept = stack.enter_context(Store(self.store))
            here = workers == 1 and scheduler is None
            perform = run_here if here else stack.enter_context(pool_when_needed(workers, scheduler))
            runner = Runner(kept, perform, progress)
            nights = None
            if self.night:
                nights = stack.enter_context(Nights(kept.path.with_suffix(".nights.sqlite"), self.night))
            levels = Levels.of(self.alpha, sum(one.expect.chance is not None for one in self.found))
            yield ExpectationSession(runner, levels, self.budget, nights)


def run_here(jobs: Sequence[Job]) -> Iterator[Row]:
    """Do runs in this process, one after the other."""
    return map(run_job, jobs)


def _filmed(verdict: Verdict, films: str | Path | None) -> Verdict:
    """The verdict, with the film of its worst run if it fails."""
    if films is None or verdict.answer != "fails" or verdict.worst is None or not verdict.worst.ended:
        return verdict
    one, seed = verdict.expectation, verdict.worst.seed
    out = Path(films) / f"{one.plan.path.stem}-{one.plan.identity(one.condition, seed)[:8]}.mp4"
    if not out.exists():
        scenario = msgspec.structs.replace(one.condition.scenario, seed=seed)
        with tempfile.TemporaryDirectory(prefix="swarmsim-") as folder:
            made = build(scenario, str(one.plan.path), one.plan.world_of(one.condition))
            record(made, Path(folder)).film(out)
    return replace(verdict, film=out)


def _broken(text: str) -> Broken:
    """A mutant in words. Raises InputError."""
    try:
        if "=" in (text.split() or [""])[0]:
            return Broken(changes=keys_of([text]), own=True)
        return Broken(fault_in_words(text).table, own=True)
    except InputError as problem:
        raise InputError(f"--mutant {text!r}: {str(problem).removeprefix(f'--set {text}: ')}") from problem
