"""Papers done again on made-up runs: what is printed, decided and written."""

from __future__ import annotations

import re
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from conftest import ROOT

from swarmsim.core.errors import InputError
from swarmsim.studies import paper_report
from swarmsim.studies.engine import Job
from swarmsim.studies.paper import Paper, open_paper
from swarmsim.studies.reproduction import Reproduction, lines, listed, reproduce, scaling_lines, side_by_side
from swarmsim.studies.store import Row, Store

KIT = open_paper(ROOT / "papers" / "kit2018")
STUDY = {
    "title": "Sizes", "scenario": str(ROOT / "scenarios" / "room.toml"), "seeds": 12,
    "vary": [{"key": "robots.count", "values": [2, 3, 4]}],
}  # fmt: skip
CLAIM = {"text": "three are faster than two", "source": "Fig. 1"}
TEST = {"kind": "faster", "study": "size", "conditions": ["count=2", "count=3"]}


@pytest.fixture
def paper(tmp_path: Path) -> Callable[..., Paper]:
    """A small paper, with more in its `paper.toml` and these published numbers."""

    def made(numbers: str, **about: object) -> Paper:
        folder = tmp_path / "small"
        folder.mkdir()
        whole = {"cite": "Doe & Roe (2020)", "title": "Small", "studies": {"size": "size.toml"}, **about}
        for name, table in (("paper", whole), ("size", STUDY), ("claims", {"claim": [{**CLAIM, "test": [TEST]}]})):
            (folder / f"{name}.toml").write_text(tomli_w.dumps(table))
        (folder / "published.csv").write_text(numbers)
        return open_paper(folder)

    return made


def done(
    paper: Paper, store: Path, time_of: Callable[[str], float | None], readings: Sequence[str] = (), **keys: object
) -> list[Reproduction]:
    """The reproduction of runs that take the time of their condition and a tenth about it, drawn by their seed."""
    with Store(store) as kept:

        def run_jobs(jobs: Sequence[Job]) -> None:
            for job in jobs:
                time = time_of(job.condition)
                noise = 0.9 + 0.2 * (zlib.crc32(f"{job.condition} {job.seed}".encode()) % 1000) / 1000
                taken = 5000 if time is None else round(time * noise)
                pace = taken if not job.condition.startswith("20") else 300  # those of 20 begin alike
                curve = np.minimum(np.arange(1, taken + 1) / pace, 1.0)
                curve[50:] *= 0.5 if "15" in job.condition else 1.0
                status = "not finished" if time is None else "finished"
                row = Row(
                    job.identity, job.condition, job.seed, status, taken, {"error": 0.25}, curve, "", {}, 0.0, None
                )
                kept.add(row)

        return reproduce(paper, kept, run_jobs, readings=readings, **keys)


def verdicts(found: Reproduction) -> list[str]:
    return [claim.verdict for claim in found.claims]


def test_runs_as_published_hold_every_claim_of_the_reference_paper(tmp_path: Path) -> None:
    numbers = {number.condition: number.value for number in KIT.published} | {"ring": 585.0}
    (found,) = done(KIT, tmp_path / "runs.sqlite", numbers.__getitem__, ["letter"], seeds=20)
    assert verdicts(found) == ["holds"] * 8
    assert found.error < 0.05
    assert found.seed_count == "20"
    assert found.seeds == "1 to 20"
    assert [row[-1] for row in lines(found)] == ["calibrated"] * 15
    told = found.error_sentences(found.fit)
    assert told.startswith("Predicted numbers: none but those that --calibrate leaves out in turn; fitted numbers: 14,")
    assert told.count(". ") <= 2  # three sentences
    assert found.fit.averaged[0].farther[0] == 1.0  # no run is as near to the means as the published numbers
    assert "the margin was chosen after its bare sign was seen to be open" in found.claims[1].test


@pytest.mark.thorough
def test_the_report_of_the_reference_paper_has_five_figures_of_each_reading(tmp_path: Path) -> None:
    found = done(KIT, tmp_path / "runs.sqlite", lambda condition: 500.0, seeds=2)
    paper_report.write(found, tmp_path / "out")
    page = (tmp_path / "out" / paper_report.FILES[1]).read_text()
    assert "20-15-10-5 units" in page
    sources = re.findall(r'src="([^"]+)"', page)
    assert len(sources) == 10
    assert all(source.startswith("data:image/png;base64,") for source in sources)


def test_runs_that_take_the_same_whatever_is_done_hold_no_claim_of_an_effect(tmp_path: Path) -> None:
    (found,) = done(KIT, tmp_path / "runs.sqlite", lambda condition: 500.0, ["letter"], seeds=20)
    assert verdicts(found)[:4] == ["undecided", "does not hold", "does not hold", "undecided"]
    assert verdicts(found)[6:] == ["holds", "holds"]  # which are about equality


def test_a_small_paper_is_printed_decided_and_written(paper, tmp_path: Path) -> None:
    figures = [
        {"name": kind, "kind": kind, "study": "size", "title": kind, "caption": f"The {kind}"}
        for kind in ("curves", "distributions", "scaling", "sweep")
    ]
    table = [{"title": "speed", "study": "size", "measure": "speed"}]
    small = paper("study,condition,iterations,row\nsize,count=2,400,one\n", figure=figures, table=table)
    (found,) = done(small, tmp_path / "runs.sqlite", {"count=2": 400.0, "count=3": 200.0, "count=4": 100.0}.get)
    assert verdicts(found) == ["holds"]
    ((name, published, *_, kind),) = lines(found)
    assert (name, published, kind) == ("count=2", "400", "predicted")
    assert float(side_by_side([found])[0][3]) == pytest.approx(1.0, abs=0.05)
    assert [row[0] for row in listed(found, small.about.table[0])] == ["count=2", "count=3", "count=4"]
    assert float(listed(found, small.about.table[0])[2][1]) == pytest.approx(0.01, rel=0.1)
    assert float(scaling_lines(found.results["size"])[2][1]) == pytest.approx(4.0, rel=0.1)
    paper_report.write([found], tmp_path / "out")
    text, page = ((tmp_path / "out" / name).read_text() for name in paper_report.FILES)
    assert "# Doe & Roe (2020), reproduced" in text
    assert "12 seeds of each condition." in text
    assert "| three are faster than two | holds | Mann-Whitney" in text
    assert "<title>Doe &amp; Roe (2020), reproduced</title>" in page
    assert len(re.findall(r'src="data:image/png', page)) == 5
    assert "calibrated" not in text
    assert "Predicted numbers: 1, root-mean-square log-ratio 0.0" in text
    assert "| averaged runs | error of a perfect model |" in text


def test_an_unfinished_run_has_no_mean_in_any_table(paper, tmp_path: Path) -> None:
    small = paper("study,condition,iterations\nsize,count=2,400\n", table=[{"title": "times", "study": "size"}])
    (found,) = done(small, tmp_path / "runs.sqlite", {"count=3": 200.0, "count=4": 100.0}.get)
    assert lines(found)[0][2:7] == ("-", "-", "-", "0 of 12", "-")
    assert listed(found, small.about.table[0])[0] == ("count=2", "-", "-", "0 of 12")
    assert found.error == float("inf")
    assert found.fit is None
    assert (
        found.error_sentences(None)
        == "Predicted numbers: 1, root-mean-square log-ratio inf. Too few finished runs to say more."
    )


def test_numbers_of_another_measure_are_compared_with_that(paper, tmp_path: Path) -> None:
    small = paper("study,condition,error\nsize,count=2,0.5\n", published="error")
    (found,) = done(small, tmp_path / "runs.sqlite", lambda condition: 100.0)
    assert lines(found)[0][1:3] == ("0.5", "0.25")
    assert found.numbers[0].ratio == 0.5


def test_a_figure_of_curves_that_are_not_kept_is_refused(paper, tmp_path: Path) -> None:
    figure = {"name": "c", "kind": "curves", "study": "size", "title": "c", "caption": "c"}
    small = paper("study,condition,iterations\nsize,count=2,400\n", figure=[figure])
    study = small.folder / "size.toml"
    study.write_text(tomli_w.dumps({**STUDY, "keep": "summary"}))
    with Store(tmp_path / "runs.sqlite") as kept:

        def run_jobs(jobs: Sequence[Job]) -> None:
            for job in jobs:
                kept.add(Row(job.identity, job.condition, job.seed, "finished", 9, {}, None, "", {}, 0.0, None))

        found = reproduce(small, kept, run_jobs)
    with pytest.raises(InputError, match=r"size\.toml: keeps no curves, which the figure c shows"):
        paper_report.write(found, tmp_path / "out")


def test_runs_that_failed_are_no_reproduction(paper, tmp_path: Path) -> None:
    small = paper("study,condition,iterations\nsize,count=2,400\n")
    with Store(tmp_path / "runs.sqlite") as kept:

        def run_jobs(jobs: Sequence[Job]) -> None:
            for job in jobs:
                kept.add(Row(job.identity, job.condition, job.seed, "failed", None, {}, None, None, {}, 0.0, "broke"))

        with pytest.raises(InputError, match="size, count=2: broke"):
            reproduce(small, kept, run_jobs)
        with pytest.raises(InputError, match="size, count=2: 12 runs are missing"):
            reproduce(small, Store(tmp_path / "other.sqlite"), lambda jobs: None)
