from __future__ import annotations

import re
import shlex
import subprocess
import sys
import tomllib
from collections.abc import Callable
from copy import deepcopy
from pathlib import Path

import numpy as np
import pytest
import tomli_w
import typer
from _pytest.mark import ParameterSet
from conftest import ROOT, called, jobs_here
from offspring import Offspring
from typer.core import TyperGroup

import swarmsim
from swarmsim.cli import app
from swarmsim.core.events import Begins, PieceTaken
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.file import decode, load
from swarmsim.core.seams import SEAMS
from swarmsim.engine.build import build
from swarmsim.learning.environment import SwarmEnv
from swarmsim.recording.reader import Recording
from swarmsim.studies.plan import open_study
from swarmsim.view.video import Film, write_film

SCENARIOS = sorted(
    [
        *ROOT.glob("scenarios/*.toml"),
        *ROOT.glob("scenarios/faults/*"),
        *ROOT.glob("scenarios/operations/*"),
        *ROOT.glob("scenarios/computing/*"),
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


def commands_of(document: str) -> list[str]:
    """The lines of a page's shell blocks, without comments."""
    lines = "\n".join(blocks(document, "sh")).replace("\\\n", " ").splitlines()
    return [line.partition(" #")[0].strip() for line in lines if line.strip() and not line.startswith("#")]


def done(command: str, folder: Path, offspring: Offspring) -> subprocess.CompletedProcess[str]:
    """What becomes of a page's command; a shell starts those that start processes of their own."""
    words = shlex.split(command)[1:]
    if words[0] not in ("study", "reproduce", "fleet"):
        return offspring.ended(words, folder)
    typed = f"{sys.executable} -m {command}"
    return subprocess.run(typed, shell=True, cwd=folder, capture_output=True, text=True, check=False)


def run_in_order(document: str, folder: Path, offspring: Offspring, shortened: Callable[[str], str]) -> None:
    """In an empty folder, as with an installed wheel."""
    for text in blocks(document, "toml") if document == "docs/tutorial.md" else ():
        (folder / "tutorial").mkdir(exist_ok=True)
        (folder / "tutorial" / "deaths.toml").write_text(shortened(text))
    for command in commands_of(document):
        if command.startswith("swarmsim") and (asked := shortened(command)):
            ended = done(asked, folder, offspring)
            assert ended.returncode == 0 or (ended.returncode == 1 and EARLY in asked), (
                f"{command}\n{ended.stdout}{ended.stderr}"
            )


IN_ORDER = ["README.md", "docs/tutorial.md", "docs/looking.md", "docs/on-robots.md"]
EARLY = " --set stop.iterations=40"


@pytest.mark.thorough
@pytest.mark.parametrize("document", IN_ORDER)
def test_the_commands_of_a_page_run_in_their_order(tmp_path: Path, offspring: Offspring, document: str) -> None:
    """Runs end early, a study has fewer seeds, and the paper is left to the next test."""

    def shortened(text: str) -> str:
        if text.startswith("swarmsim"):
            runs = text.startswith(("swarmsim run ", "swarmsim fleet up "))
            return "" if " reproduce " in text else text + (EARLY if runs else "")
        assert "seeds = 10" in text
        return text.replace("seeds = 10", "seeds = 3")

    run_in_order(document, tmp_path, offspring, shortened)


@pytest.mark.slow
@pytest.mark.parametrize("document", IN_ORDER)
def test_the_commands_of_a_page_run_to_the_letter(tmp_path: Path, offspring: Offspring, document: str) -> None:
    run_in_order(document, tmp_path, offspring, lambda text: text)
    if document == "README.md":
        assert (tmp_path / "runs" / "room.mp4").exists()
        page = (tmp_path / "runs" / "kit2018" / "report.html").read_text()
        assert "20-15-10-5 units" in page
        sources = re.findall(r'src="([^"]+)"', page)
        assert len(sources) == 10  # five figures of each reading
        assert all(source.startswith("data:image/png;base64,") for source in sources)


PAGES = ["README.md", "CONTRIBUTING.md", *(f"docs/{path.name}" for path in sorted(ROOT.glob("docs/*.md")))]
COMMANDS = [(page, line) for page in PAGES for line in commands_of(page)]


#: Whether a package index has swarmsim. The one place to change when it does, with `docs/install.md`.
PUBLISHED = False
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def installable(what: str) -> bool:
    """Whether pip can install this: a checkout, a wheel of this version, an extra of what is installed."""
    name, _, extra = what.rstrip("]").partition("[")
    wheel = f"swarmsim_lab-{swarmsim.__version__}-py3-none-any.whl"
    if what == "." or what.rpartition("/")[2] == wheel:
        return True
    return name == PROJECT["name"] and (extra in PROJECT["optional-dependencies"] or (PUBLISHED and not extra))


def promised(text: str) -> list[str]:
    """What of swarmsim a text says that installers install."""
    said = re.findall(r"\b(?:(?:pip|pipx|uv|conda|poetry|tool) (?:install|add|run)|uvx) ([^`\n]*)", text)
    words = [word.strip("\"',;.:()") for line in said for word in line.split()]
    return [word for word in words if re.search(r"\bswarmsim(?![\w/]|\.[a-z])|swarmsim_lab", word)]


def test_no_page_or_message_promises_an_installation_that_fails() -> None:
    texts = {page: (ROOT / page).read_text() for page in (*PAGES, "template/README.md", "CHANGELOG.md")}
    texts |= {str(path.relative_to(ROOT)): path.read_text() for path in sorted(ROOT.glob("swarmsim/**/*.py"))}
    found = [(page, what) for page, text in texts.items() for what in promised(text)]
    assert len(found) > 20
    assert [pair for pair in found if not installable(pair[1])] == []
    install = (ROOT / "docs/install.md").read_text()
    assert ("is on no package index yet" in install) == (not PUBLISHED)
    assert all(f"[{extra}]" in install for extra in PROJECT["optional-dependencies"] if extra not in FOR_DEVELOPERS)


@pytest.mark.parametrize(
    "false", ["pip install swarmsim-lab", "pip install swarmsim", "uvx swarmsim-lab run", "pipx install 'swarmsim-lab'",
              "pip install 'swarmsim-lab[nothing]'", "pip install dist/swarmsim_lab-9.9-py3-none-any.whl"],
)  # fmt: skip
def test_a_false_promise_would_be_found(false: str) -> None:
    assert not all(map(installable, promised(f"Say `{false}` once."))), false


FOR_DEVELOPERS = {"test", "browser", "docs", "bench", "dist"}


#: Pages whose commands take files of the repository; those of all others run in an empty folder.
IN_A_CHECKOUT = {
    "CONTRIBUTING.md",
    "docs/benchmark.md",
}


@pytest.mark.parametrize(("page", "line"), COMMANDS, ids=[f"{page}: {line}" for page, line in COMMANDS])
def test_every_command_of_every_page_is_one_that_there_is(page: str, line: str) -> None:
    words = shlex.split(line.removesuffix("|| true"))
    for word in words:
        if word.startswith(("scenarios/", "worlds/", "papers/")):
            named = page in IN_A_CHECKOUT or words[0] == "python"  # which runs a file of the repository
            assert named, f"{page}: {word} is in no empty folder; expected the name of what ships"
            assert (ROOT / word).exists(), f"{page}: {word}"
    if words[0] in ("make", ".", "cd"):
        if words[0] == "make":
            assert f"\n{words[1]}:" in (ROOT / "Makefile").read_text()
        return
    if page == "CONTRIBUTING.md" and ".venv/bin/" in line:
        return  # another test runs those
    if words[0] == "pip":
        assert words[1] == "uninstall" or installable(words[2]), f"{page}: {line}"
        return
    if words[0] == "python":
        assert (ROOT / words[1]).exists(), f"{page}: {line}"
        return
    assert words[0] == "swarmsim", f"{page}: {line}"
    command, rest, context = typer.main.get_command(app), words[1:], None
    while isinstance(command, TyperGroup) and rest:
        command, context, rest = command.commands[rest[0]], None, rest[1:]
    with command.make_context("swarmsim", [*rest], parent=context, resilient_parsing=False):
        pass


@pytest.mark.thorough
def test_the_commands_for_contributors_run(tmp_path: Path) -> None:
    """In a copy of the needed files; for make, only its targets are checked.

    Tests that run here anyway are only collected.
    """
    for name in ("docs", "scenarios", "swarmsim", "template", "tests", "worlds", "pyproject.toml"):
        (tmp_path / name).symlink_to(ROOT / name)
    (tmp_path / ".venv").symlink_to(sys.prefix)
    for line in commands_of("CONTRIBUTING.md"):
        if line.startswith("make"):
            continue
        command = f"{sys.executable} -m {line}" if line.startswith("swarmsim") else line
        if line.startswith(".venv/bin/pytest tests/"):
            command += " --collect-only"
        done = subprocess.run(command, shell=True, cwd=tmp_path, capture_output=True, text=True, check=False)
        unfinished = " run " in line  # a run that ends at its limit
        assert done.returncode == int(unfinished), f"{line}\n{done.stdout}{done.stderr}"


#: Pages whose listings are files that belong together, with their own tests.
TOLD = ("docs/benchmark.md", "docs/computing.md", "docs/minds.md", "docs/own.md", "docs/papers.md")
ROOM = {**tomllib.loads((ROOT / "scenarios" / "basilica.toml").read_text()), "world": "worlds/basilica.svg"}
FRAGMENTS = [(page, text) for page in PAGES if page not in TOLD for text in blocks(page, "toml")]


@pytest.mark.parametrize(("page", "text"), FRAGMENTS, ids=[page for page, _ in FRAGMENTS])
def test_every_listing_of_a_scenario_or_study_can_be_read(page: str, text: str, tmp_path: Path) -> None:
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError:  # one key per line, to choose from
        for line in text.splitlines():
            decode({**ROOM, **tomllib.loads(line)}, page, ROOT)
        return
    if "project" in table:
        assert all(group.removeprefix("swarmsim.") in {"seam", *SEAMS} for group in table["project"]["entry-points"])
        return
    if "scenario" in table or "vary" in table:
        given = {"title": "t", "scenario": str(ROOT / "scenarios/room.toml"), "seeds": 1, **table}
        given["scenario"] = str(ROOT / given["scenario"])
        (tmp_path / "study.toml").write_text(tomli_w.dumps(given))
        assert open_study(tmp_path / "study.toml", 1).conditions
        return
    whole = deepcopy(ROOM)

    def merge(into: dict, other: dict) -> None:
        for key, value in other.items():
            if isinstance(value, dict) and isinstance(into.get(key), dict) and "use" not in value:
                merge(into[key], value)
            else:
                into[key] = value

    merge(whole, table)
    scenario = decode(whole, page, ROOT / "scenarios" if "../worlds" in text else ROOT)
    if Path(scenario.world.file).exists():
        build(scenario, page)
    else:
        assert Path(scenario.world.file).name == "plan.svg"


def modules_of(code: str) -> set[str]:
    """The modules of swarmsim from which code imports."""
    found = re.findall(r"^\s*from (swarmsim(?:\.\w+)*) import (\([^)]*\)|[^\n]*)", code, re.MULTILINE)
    whole = {f"{module}.{name}" for module, names in found for name in re.findall(r"(\w+)(?: as \w+)?", names)}
    return {one if is_module(one) else one.rpartition(".")[0] for one in whole}


def is_module(name: str) -> bool:
    place = ROOT / name.replace(".", "/")
    return place.is_dir() or place.with_suffix(".py").exists()


def test_nothing_is_shown_that_the_page_of_promises_does_not_place() -> None:
    """What listings, skeletons and the template import, and what the reference lists, is public or said not to be."""
    promises = (ROOT / "docs/stability.md").read_text()
    placed = set(re.findall(r"`(swarmsim(?:\.\w+)+)`", promises))
    assert all(is_module(one) for one in placed - {"swarmsim.__all__"})
    texts = ["\n".join(blocks(page, "python")) for page in PAGES]
    texts += [
        path.read_text() for path in [*ROOT.glob("template/src/**/*.py"), *ROOT.glob("swarmsim/api/skeletons/*.txt")]
    ]
    shown = set().union(*map(modules_of, texts)) - {"swarmsim"}
    assert len(shown) > 40
    assert shown - placed == set()
    listed = set(re.findall(r"^::: (swarmsim[\w.]*)", (ROOT / "docs/reference.md").read_text(), re.MULTILINE))
    homes = {f"swarmsim.{place.partition(':')[0]}" for place in swarmsim._PLACES.values()}
    inside = {one for one in listed - placed - homes if not one.startswith(("swarmsim.testing.", "swarmsim.learning."))}
    assert inside == RETURNED


#: Modules on the page of the reference whose values functions of `swarmsim` return.
RETURNED = {
    "swarmsim.api.verification", "swarmsim.network.radios", "swarmsim.network.report", "swarmsim.studies.comparison",
    "swarmsim.studies.expectations.verdicts", "swarmsim.studies.sizing_report", "swarmsim.core.scenario.expect",
}  # fmt: skip


#: What takes tens of seconds: the listings of a page, and studies of many conditions.
DEAR = {"docs/benchmark-bounds.md", "calibration", "choice", "letter", "worlds"}


def marked(*values: object, name: str) -> ParameterSet:
    return pytest.param(*values, id=name, marks=[pytest.mark.thorough] if name in DEAR else [])


CODE = [marked(page, text, name=page) for page in PAGES if page not in TOLD for text in blocks(page, "python")]


@pytest.mark.parametrize(("page", "text"), CODE)
def test_every_listing_of_python_runs(
    page: str, text: str, copy: Path, room: Path, offspring: Offspring, tmp_path: Path
) -> None:
    code = text.replace("runs/demo", str(room))
    if "SLURMCluster" in code:  # there is no Slurm here
        compile(code, page, "exec")
        return
    (tmp_path / "listing.py").write_text(code)
    ended = offspring.ended([tmp_path / "listing.py"], tmp_path)
    assert ended.returncode == 0, ended.stderr


def test_no_page_has_a_listing_of_another_kind() -> None:
    for page in PAGES:
        text = (ROOT / page).read_text()
        kinds = re.findall(r"^```(\w*)\n", text, flags=re.MULTILINE)
        assert len(kinds) == len(re.findall(r"^```$", text, flags=re.MULTILINE)) or "" in kinds
        assert set(kinds) <= {"sh", "toml", "python", ""}, page


def test_what_a_page_says_that_a_command_prints_is_what_it_prints(room: Path) -> None:
    (shown,) = re.findall(
        r"^```\n(each iteration.*?)^```", (ROOT / "docs/networks.md").read_text(), re.DOTALL | re.MULTILINE
    )
    printed = called("network", room).stdout
    for line in shown.splitlines()[1:]:
        assert re.split(r"  +", line)[0] in printed


STUDIES = [marked(path, name=path.stem) for path in sorted(ROOT.glob("scenarios/studies/**/*.toml"))]


@pytest.mark.parametrize("path", STUDIES)
def test_every_study_opens(path: Path) -> None:
    assert open_study(path, 1).conditions


@pytest.mark.thorough
def test_the_mind_and_the_task_of_the_page_run_record_film_and_study(copy: Path, offspring: Offspring) -> None:
    listings = blocks("docs/minds.md", "python")
    for listing in listings:
        assert listing.count("\n") <= 25
        (copy / listing.splitlines()[0].removeprefix("# ")).write_text(listing)
    for name, text in zip(("spread", "study", "herding"), blocks("docs/minds.md", "toml"), strict=True):
        (copy / f"{name}.toml").write_text(text)
    for command in commands_of("docs/minds.md"):
        ended = done(command, copy, offspring)
        assert ended.returncode == 0, f"{command}\n{ended.stdout}{ended.stderr}"
    recording = Recording(copy / "runs" / "spread")
    assert recording["smallest_gap"][-1] >= 0.35 > recording["smallest_gap"][0]
    assert (copy / "runs" / "spread.mp4").stat().st_size > 10_000


def test_the_paper_of_the_page_is_done_again(copy: Path) -> None:
    listings = re.findall(r"```(?:toml)?\n(# mine/.*?)```", (ROOT / "docs/papers.md").read_text(), re.DOTALL)
    assert sum(listing.count("\n") for listing in listings) <= 30
    (copy / "mine").mkdir()
    for listing in listings:
        name, text = listing.split("\n", 1)
        (copy / name.removeprefix("# ")).write_text(text)
    with jobs_here():
        reproduced = called("reproduce", "mine", "--workers", 1, cwd=copy)
    assert reproduced.returncode == 0, reproduced.stdout + reproduced.stderr
    assert "eight robots need less time than two │ holds" in reproduced.stdout
    assert "| count=8 | 60 |" in (copy / "runs" / "mine" / "report.md").read_text()


@pytest.mark.thorough
def test_the_parts_of_the_page_are_recorded_struck_seen_and_learned_from(tmp_path: Path, offspring: Offspring) -> None:
    for listing in blocks("docs/own.md", "python"):
        assert listing.count("\n") <= 30
        (tmp_path / listing.splitlines()[0].removeprefix("# ")).write_text(listing)
    (scenario,) = blocks("docs/own.md", "toml")
    (tmp_path / "hall.toml").write_text(scenario)
    for words in [*(shlex.split(line)[1:] for line in commands_of("docs/own.md")), ["look.py"]]:
        ended = offspring.ended(words, tmp_path)
        assert ended.returncode == 0, f"{words}\n{ended.stdout}{ended.stderr}"
    tried = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "test_hall.py"]
    subprocess.run(tried, cwd=tmp_path, check=True)
    assert (tmp_path / "runs" / "hall.mp4").stat().st_size > 10_000
    recording = Recording(tmp_path / "runs" / "hall")
    seen = recording["nearby_count"]
    assert seen[:60, 0].any()
    assert not seen[60:, 0].any()  # its sensor is off from then on
    assert seen[60:, 1:].any()
    assert recording["crowding.others"].shape == (10, 5)
    lamp, near = recording["lamp"], recording["neighbours_lamp"]
    assert 0.3 < lamp.max() < 1.0
    assert np.isin(near[near > 0.0], lamp).all()
    assert (near > 0.0).any()
    begun = [event for event in recording.events() if isinstance(event, Begins)]
    assert [(event.iteration, event.fault) for event in begun] == [(20, 0), (60, 1)]
    with registry.own_code(True):
        env = SwarmEnv(tmp_path / "hall.toml", observe=["nearby"])
        observed, _ = env.reset(seed=3)
        still = {agent: np.zeros(2, np.float32) for agent in env.agents}
        after = [env.step(still)[0] for _ in range(3)][-1]
    assert observed["robot_0"]["nearby"].shape == (4, 2)
    assert all(env.observation_space(agent).contains(one) for agent, one in after.items())
    assert any(one["nearby_known"].any() for one in after.values())


@pytest.mark.thorough
def test_the_job_of_the_page_is_done_taken_over_and_filmed(copy: Path, offspring: Offspring, tmp_path: Path) -> None:
    listings = blocks("docs/computing.md", "python")
    for listing in listings:
        assert listing.count("\n") <= 40
        (tmp_path / listing.splitlines()[0].removeprefix("# ")).write_text(listing)
    fragment, scenario = blocks("docs/computing.md", "toml")
    test_every_listing_of_a_scenario_or_study_can_be_read("docs/computing.md", fragment, tmp_path)
    (tmp_path / "warm.toml").write_text(scenario)
    (tmp_path / "worlds").symlink_to(copy / "worlds")
    (command,) = [line for line in commands_of("docs/computing.md") if " warm.toml" in line]
    ended = done(command, tmp_path, offspring)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert (tmp_path / "runs" / "warm.mp4").stat().st_size > 10_000
    recording = Recording(tmp_path / "runs" / "warm")
    assert recording["error_sequential"][-1] == 0.0
    assert {one.robots[1] for one in recording.events() if isinstance(one, PieceTaken)} == {1}
    field = next(one for one in recording.probes[0].tables if one.drawn == "field")
    assert (field.unit, recording["heat.field"].shape[1:]) == ("K", recording.lattice.shape)
    tried = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "test_heat.py"]
    subprocess.run(tried, cwd=tmp_path, check=True)


def test_the_tables_of_the_pages_list_every_scenario() -> None:
    others = sorted(f"docs/{path.name}" for path in ROOT.glob("docs/computing*.md"))
    pages = "".join(
        (ROOT / page).read_text()
        for page in ("README.md", "docs/faults.md", "docs/operations.md", "docs/worlds.md", *others)
    )
    listed = set(re.findall(r"`(scenarios/[\w/-]+\.toml)`", pages))
    listed |= {f"scenarios/worlds/{name}.toml" for name in re.findall(r"figures/world-(\w+)\.png", pages)}
    assert {str(path.relative_to(ROOT)) for path in SCENARIOS} <= listed


def test_links_of_the_documents_lead_somewhere() -> None:
    for document in [*(ROOT / f"{name}.md" for name in ("README", "CONTRIBUTING", "AGENTS")), *ROOT.glob("docs/*.md")]:
        for target in re.findall(r"\]\(([^)#:]+)\)", document.read_text()):
            assert (document.parent / target).exists(), f"{document.name}: {target}"


def test_what_the_page_for_assistants_names_is_there() -> None:
    page = (ROOT / "AGENTS.md").read_text()
    named = re.findall(r"(?<![\w/])((?:docs|tests|swarmsim|template|locks)/[\w./-]*|\w+\.md)", page)
    assert len(named) > 10
    for path in named:
        assert (ROOT / path.rstrip(".")).exists(), path
    for line in re.findall(r"^\.venv/bin/(\S+)", page, flags=re.MULTILINE):
        assert re.search(rf"\b{line}\b", (ROOT / "Makefile").read_text()), line
    assert len(page.splitlines()) < 60
