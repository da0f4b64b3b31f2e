from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT

from swarmsim.core.scenario import load
from swarmsim.engine.build import build
from swarmsim.recording.reader import Recording
from swarmsim.studies.plan import open_study
from swarmsim.view.video import Film, write_film

SCENARIOS = sorted(
    [
        *ROOT.glob("scenarios/*.toml"),
        *ROOT.glob("scenarios/faults/*"),
        *ROOT.glob("scenarios/operations/*"),
        *ROOT.glob("scenarios/worlds/*"),
    ]
)


def blocks(document: str, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", (ROOT / document).read_text(), flags=re.DOTALL)


@pytest.mark.parametrize("path", SCENARIOS, ids=lambda path: path.stem)
def test_every_scenario_runs_and_is_filmed(path: Path, tmp_path: Path) -> None:
    run = build(load(path, ["stop.iterations=40"]), str(path))
    with run.recorder(tmp_path / "recording.h5") as recorder:
        run.simulation.run([recorder])
    assert run.simulation.state.iteration == 40 or run.simulation.finished
    film = Film(fps=2, speed=20.0 * run.scenario.period, size=(480, 270))
    write_film(Recording(tmp_path), tmp_path / "film.mp4", film)
    assert (tmp_path / "film.mp4").stat().st_size > 5_000


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("copy")
    for name in ("scenarios", "worlds"):
        (folder / name).symlink_to(ROOT / name)
    return folder


def test_the_commands_of_the_readme_run_in_their_order(copy: Path) -> None:
    make, *use = blocks("README.md", "sh")
    assert [line.split()[:2] for line in make.splitlines()] == [["make", "demo"], ["make", "test"]]
    commands = [line for block in use for line in block.splitlines() if line.startswith("swarmsim")]
    assert len(commands) == 17
    for command in commands:
        done = subprocess.run(
            f"{sys.executable} -m {command}", shell=True, cwd=copy, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, f"{command}\n{done.stdout}{done.stderr}"
    assert (copy / "runs" / "room.mp4").exists()
    assert (copy / "runs" / "ring.gif").exists()
    page = (copy / "runs" / "kit2018" / "report.html").read_text()
    assert "20-15-10-5 units" in page
    sources = re.findall(r'src="([^"]+)"', page)
    assert len(sources) == 5
    assert all(source.startswith("data:image/png;base64,") for source in sources)


@pytest.mark.parametrize("path", sorted(ROOT.glob("scenarios/studies/**/*.toml")), ids=lambda path: path.stem)
def test_every_study_opens(path: Path) -> None:
    assert open_study(path, 1).conditions


def test_the_study_of_the_page_on_studies_opens(tmp_path: Path) -> None:
    (text,) = blocks("docs/studies.md", "toml")
    (tmp_path / "study.toml").write_text(text.replace("scenarios/", f"{ROOT}/scenarios/"))
    assert len(open_study(tmp_path / "study.toml").conditions) == 3 * 2 + 1


def test_the_scenario_of_the_readme_runs(copy: Path) -> None:
    (text,) = blocks("README.md", "toml")
    path = copy / "own.toml"
    path.write_text(text)
    simulation = build(load(path, ["stop.iterations=20"]), str(path)).simulation
    simulation.run()
    assert simulation.state.iteration == 20


def test_the_mind_and_the_task_of_the_page_run_record_film_and_study(copy: Path) -> None:
    listings = blocks("docs/minds.md", "python")
    for listing in listings:
        assert listing.count("\n") <= 25
        (copy / listing.splitlines()[0].removeprefix("# ")).write_text(listing)
    for name, text in zip(("spread", "study"), blocks("docs/minds.md", "toml"), strict=True):
        (copy / f"{name}.toml").write_text(text)
    for command in "".join(blocks("docs/minds.md", "sh")).splitlines():
        arguments = [sys.executable, "-m", *command.split()]
        done = subprocess.run(arguments, cwd=copy, capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{command}\n{done.stdout}{done.stderr}"
    recording = Recording(copy / "runs" / "spread")
    assert recording["smallest_gap"][-1] >= 0.35 > recording["smallest_gap"][0]
    assert (copy / "runs" / "spread.mp4").stat().st_size > 10_000


@pytest.mark.parametrize("page", ["docs/recordings.md", "docs/networks.md"])
def test_the_python_of_the_pages_runs(room: Path, page: str) -> None:
    (code,) = blocks(page, "python")
    code = code.replace("runs/demo", str(room))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("\n") >= 2


def test_the_tables_of_the_pages_list_every_scenario() -> None:
    pages = "".join(
        (ROOT / page).read_text() for page in ("README.md", "docs/faults.md", "docs/operations.md", "docs/worlds.md")
    )
    listed = set(re.findall(r"`(scenarios/[\w/-]+\.toml)`", pages))
    listed |= {f"scenarios/worlds/{name}.toml" for name in re.findall(r"figures/world-(\w+)\.png", pages)}
    assert {str(path.relative_to(ROOT)) for path in SCENARIOS} <= listed


def test_links_of_the_documents_lead_somewhere() -> None:
    for document in [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *ROOT.glob("docs/*.md")]:
        for target in re.findall(r"\]\(([^)#:]+)\)", document.read_text()):
            assert (document.parent / target).exists(), f"{document.name}: {target}"
