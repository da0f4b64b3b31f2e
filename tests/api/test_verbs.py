"""Every verb of the command line has its function, and every function of the package its page."""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
import typer
from conftest import ROOT
from typer.core import TyperCommand, TyperGroup

import swarmsim as sw
from swarmsim.cli import app
from swarmsim.core.errors import InputError

#: The function of each verb. What is about a recorded run or a study is a function of `Run` or `StudyRun`.
FUNCTIONS = {
    "run": "run",
    "video": "Run.film",
    "report": "Run.report StudyRun.report",
    "show": "Run.summary",
    "verify": "Run.verify",
    "export": "Run.export",
    "compare": "compare",
    "size": "size",
    "reproduce": "reproduce",
    "network": "Run.network",
    "test": "test open_expectations",
    "parts": "parts",
    "new": "new",
    "schema": "schema",
    "doctor": "doctor",
    "study plan": "StudyRun.estimate",
    "study run": "StudyRun.run",
    "study status": "StudyRun.status",
    "study table": "StudyRun.table StudyRun.chances StudyRun.quantiles StudyRun.compare StudyRun.peaks",
    "study plot": "StudyRun.plot",
    "study export": "StudyRun.export",
    "study rank": "StudyRun.rank",
    "study best": "StudyRun.best",
    "study worst": "study_worst",
    "benchmark explore": "benchmark_explore",
    "benchmark verify": "benchmark_verify",
    "benchmark board": "benchmark_board",
    "benchmark references": "benchmark_references",
    "benchmark import": "benchmark_import",
    "radio airtime": "radio_airtime",
    "radio keys": "radio_keys",
    "plot": "Run.figure Run.plot",
    "figure local-maps": "Run.figure_local_maps",
    "figure network": "Run.figure_network",
    "figure provenance": "Run.figure_provenance",
    "world check": "world_check",
    "world preview": "world_preview",
    "world convert": "world_convert",
    "world generate": "world_generate",
    "world import": "world_import",
    "examples": "examples",
    "examples run": "example",
    "examples copy": "examples_copy",
    "import-log": "import_log",
    "fleet up": "fleet_up",
    "fleet merge": "fleet_merge",
    "fleet status": "fleet_status",
    "world serve": "world_serve",
    "robot charge": "robot_charge",
    "robot replay": "Run.replay",
}
#: Verbs without a function, and why.
WITHOUT = {
    "view": "opens a window and takes keys until it is closed",
    "robot run": "is a process of its own until the world ends",
    "robot halt": "is a hand at a switch",
}
#: Options that belong to a command alone, whatever its verb; for print there are `printing` and `StudyTable.written`.
OF_COMMANDS = {"quiet", "as_json", "help", "pdf", "svg", "width", "font", "no_title", "style", "form"}
#: What an option is called in Python, where it is not the same word.
CALLED = {
    "set_": "overrides",
    "recording": "",  # the Run
    "study": "",  # the StudyRun
    "reading": "readings",
    "show": "look",
    "hide": "look",
    "theme": "look",
    "focus": "look",
    "robots of video": "look",
    "out of video": "path",
    "out of study plot": "folder",
    "measure of study plot": "measures",
    "compare of study table": "against",
    "peak of study table": "which",
    "yes": "answers",
    "what": "",
    "plan of test": "",  # open_expectations(...).cost()
    "mutate of test": "",  # open_expectations(...).mutants()
    "mutant of test": "",
    "junit of test": "",  # test(...).junit()
    "allow_undecided of test": "",
    "video": "",  # run(...).film(...)
    "calibrate": "",  # of those who made the readings
    "name of run": "",
}


def verbs(
    command: TyperCommand | TyperGroup, words: tuple[str, ...] = ()
) -> Iterator[tuple[str, TyperCommand | TyperGroup]]:
    """All verbs of a command by their words; a group that does something alone is one too."""
    if isinstance(command, TyperGroup):
        if words and command.invoke_without_command:
            yield " ".join(words), command
        for name, inner in command.commands.items():
            yield from verbs(inner, (*words, name))
    else:
        yield " ".join(words), command


VERBS = dict(verbs(typer.main.get_command(app)))


def function(name: str) -> object:
    """What stands under a dotted name in the package."""
    found: object = sw
    for part in name.split("."):
        found = getattr(found, part)
    return found


def public() -> dict[str, object]:
    """Every public function of the package, and of the two classes that have verbs."""
    found = {name: getattr(sw, name) for name in sw.__all__}
    for owner in (sw.Run, sw.StudyRun):
        for name, member in vars(owner).items():
            if not name.startswith("_"):
                found[f"{owner.__name__}.{name}"] = getattr(member, "fget", getattr(member, "func", member))
    return found


def test_every_verb_has_its_function_or_a_reason() -> None:
    assert set(VERBS) == {*FUNCTIONS, *WITHOUT}
    for names in FUNCTIONS.values():
        for name in names.split():
            assert name in public(), name


@pytest.mark.parametrize("verb", FUNCTIONS)
def test_a_function_says_which_verb_it_is(verb: str) -> None:
    for name in FUNCTIONS[verb].split():
        assert f"`swarmsim {verb}" in (inspect.getdoc(public()[name]) or ""), f"{name}: swarmsim {verb}"


@pytest.mark.parametrize("verb", FUNCTIONS)
def test_a_function_takes_what_its_verb_takes(verb: str) -> None:
    given = set[str]()
    for name in FUNCTIONS[verb].split():
        found = public()[name]
        given |= set(inspect.signature(found).parameters)
        if name.startswith("StudyRun."):
            given |= set(inspect.signature(sw.open_study).parameters)
    if verb == "examples run":
        given |= {name for one in (sw.run, sw.study, sw.reproduce) for name in inspect.signature(one).parameters}
    for option in VERBS[verb].params:
        if option.name and option.name not in OF_COMMANDS:
            called = CALLED.get(f"{option.name} of {verb}", CALLED.get(option.name, option.name))
            assert not called or called in given, f"swarmsim {verb}: {option.name}"


#: Functions that nothing can make fail but a damaged recording or installation.
SAFE = {"doctor", "schema", "examples"}


@pytest.mark.parametrize("name", sorted(public()))
def test_a_function_has_types_and_tells_of_its_parameters_and_errors(name: str) -> None:
    found, told = public()[name], inspect.getdoc(public()[name]) or ""
    assert told
    if inspect.isclass(found):
        return
    signature = inspect.signature(found)
    assert signature.return_annotation is not inspect.Signature.empty
    others = "are those of" in told or "are as" in told
    for parameter in list(signature.parameters.values())["." in name :]:
        assert parameter.annotation is not inspect.Parameter.empty, parameter.name
        assert others or re.search(rf"\b{parameter.name.strip('_')}", told), parameter.name
    if "." not in name and name not in SAFE:
        assert others or "Raises" in told


def test_every_function_stands_on_the_page_of_the_reference() -> None:
    page = (ROOT / "docs/reference.md").read_text()
    listed = dict(re.findall(r"^::: (\S+)(?:\n    options:\n      members: \[(.*)\])?", page, flags=re.MULTILINE))
    for name in sw.__all__:
        found = getattr(sw, name)
        assert found.__module__ in listed, name
        members = listed[found.__module__].split(", ")
        assert members == [""] or found.__name__ in members, name


def test_the_table_of_the_page_is_that_of_the_verbs() -> None:
    page = (ROOT / "docs/python.md").read_text()
    rows = re.findall(r"^\| `swarmsim ([\w -]+?)(?: [A-Z].*?)?` \| (.*?) \|", page, flags=re.MULTILINE)
    table = {verb: re.findall(r"`(?:sw\.|run\.|study\.)(\w+)", call) for verb, call in rows}
    assert table == {verb: [one.rpartition(".")[2] for one in names.split()] for verb, names in FUNCTIONS.items()}
    for name in sw.__all__:
        assert re.search(rf"`(sw\.)?{name}\b", page), name


def test_nothing_below_the_command_line_prints_or_exits() -> None:
    for path in sorted((ROOT / "swarmsim").rglob("*.py")):
        if path.relative_to(ROOT / "swarmsim").parts[0] in ("cli", "__main__.py"):
            continue
        called = [node.func for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Call)]
        words = {ast.unparse(one) for one in called}
        assert not words & {"print", "sys.exit", "exit", "typer.echo"}, path


pytestmark = pytest.mark.usefixtures("no_workers")
PLAN = """<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 4 4" width="4m" height="4m">
<g id="walls"><path fill-rule="evenodd" d="M0 0H4V4H0Z M.2 .2V3.8H3.8V.2Z"/></g>
<g id="spawn"><rect id="floor" x=".5" y=".5" width="3" height="3"/></g></svg>"""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> sw.Run:
    out = tmp_path_factory.mktemp("verbs") / "run"
    return sw.run(ROOT / "scenarios/room.toml", faults=["crash at=20 count=1"], out=out)


def test_a_run_in_a_folder_keeps_its_summary_and_its_faults(run: sw.Run) -> None:
    assert (run.path / "summary.json").is_file()
    assert next(event["iteration"] for event in run.summary["events"]) == 20
    with pytest.raises(InputError, match=r"--fault 'crash at=-3': .*at"):
        sw.run(ROOT / "scenarios/room.toml", faults=["crash at=-3"])


def test_overrides_in_words_are_those_of_the_command_line() -> None:
    values = sw.run(ROOT / "scenarios/room.toml", overrides={"stop.iterations": 4, "robots.count": 2})
    words = sw.run(ROOT / "scenarios/room.toml", overrides=["stop.iterations=4", "robots.count=2"])
    assert values.recording.digest() == words.recording.digest()


def test_a_run_verifies_and_tells_of_progress(run: sw.Run) -> None:
    told = list[tuple[int, int]]()
    found = run.verify(progress=lambda done, of: told.append((done, of)))
    assert (found.equal, found.iterations, found.digest) == (True, run.iterations, run.recording.digest())
    assert told == [(done, run.iterations) for done in range(run.iterations + 1)]
    assert not found.libraries
    assert not found.code


@pytest.mark.thorough
def test_networks_compare_figures_pages_and_exports_give_values_and_files(run: sw.Run, tmp_path: Path) -> None:
    found = run.network(from_=5, to=25, plots=tmp_path / "network")
    assert (found.numbers["from"], found.numbers["to"]) == (5, 25)
    assert len(found.graphs["heard"].snapshots) == 20
    other = sw.run(ROOT / "scenarios/room.toml", out=tmp_path / "other")
    compared = sw.compare([run.path, other.path], plot=tmp_path / "cost")
    assert [cost.name for cost in compared.costs] == ["run", "other"]
    files = [
        *found.figures,
        *compared.figures,
        *run.figure_local_maps([0, 1], at=9, out=tmp_path / "maps"),
        *run.figure_network(3, 9, tmp_path / "rewired"),
        *run.figure_provenance(0, at=9, out=tmp_path / "provenance"),
        *run.export(map_=tmp_path / "map.yaml", robot=1),
        run.report(tmp_path / "page.html", beside=other),
    ]
    assert len(files) == 8 + 2 + 3 * 2 + 2 + 1
    assert all(path.stat().st_size > 50 for path in files)
    with pytest.raises(InputError, match="--from 999: no such iteration"):
        run.network(from_=999)
    with pytest.raises(InputError, match="--robots 0,77: no robot 77 in the run"):
        run.figure_local_maps([0, 77], at=9)


def test_buildings_are_checked_drawn_converted_made_and_imported(tmp_path: Path) -> None:
    plan = tmp_path / "plan.svg"
    plan.write_text(PLAN)
    found = sw.world_check(plan, overrides={"robots.radius": 0.1})
    assert found.problem is None
    assert found.scenario.robots.radius == 0.1
    assert sw.world_preview(plan, tmp_path / "plan.png").stat().st_size > 1000
    converted = sw.world_convert(plan, tmp_path / "map.yaml", cell=0.1)
    assert [path.suffix for path in converted.files] == [".pgm", ".yaml"]
    made = sw.world_generate("maze", tmp_path / "maze.geojson", seed=3, overrides={"width": 12.0})
    assert sw.world_check(made).problem is None
    imported = sw.world_import(plan, tmp_path / "mine.toml", width=4.0)
    assert imported.problem is None
    assert sw.run(imported.scenario, overrides=["stop.iterations=3"]).iterations == 3
    with pytest.raises(InputError, match=r"plan\.txt: expected a name that ends in"):
        sw.world_convert(plan, tmp_path / "plan.txt")


def test_a_study_can_be_opened_done_and_asked(tmp_path: Path) -> None:
    (tmp_path / "s.toml").write_text(
        f'title = "Two"\nscenario = "{ROOT}/scenarios/room.toml"\nseeds = 2\n[set]\n"stop.iterations" = 300\n'
        '[[vary]]\nkey = "network.topology.k"\nvalues = [0, 2]\ntogether = "method"\n'
    )
    study = sw.open_study(tmp_path / "s.toml", store=tmp_path / "s.sqlite")
    before = study.estimate()
    assert (before.runs, before.missing, before.seconds > 0.0) == (4, 4, True)
    told = list[tuple[int, int, int]]()
    assert study.run(workers=1, progress=lambda *counts: told.append(counts)) is study
    assert told == [(done, 4, 0) for done in range(5)]
    assert [(one.condition, one.finished, one.missing) for one in study.status()] == [("k=0", 2, 0), ("k=2", 2, 0)]
    assert [row[0] for row in study.table().rows] == ["k=0", "k=2"]
    assert "<td>k=2</td>" in study.table("path_sum")._repr_html_()
    assert [row[0] for row in study.compare("k=0").rows] == ["k=2"]
    ranked = study.rank(out=tmp_path / "figures")
    assert [one.method for one in ranked.groups[""]] == ["0", "2"]
    assert len(ranked.figures) == 4
    assert study.export(csv=tmp_path / "s.csv") == [tmp_path / "s.csv"]
    assert study.report(tmp_path / "s.html", replays=False) == [tmp_path / "s.html"]
    answer = study.best(budget=40, workers=1)
    assert answer.best in ("k=0", "k=2")
    assert answer.runs <= 40
    with pytest.raises(InputError, match="--compare k=9: no such condition"):
        study.compare("k=9")


def test_parts_examples_and_skeletons_are_told_of(tmp_path: Path) -> None:
    (knn,) = sw.parts("topology.knn")
    assert "k" in {parameter.key for parameter in knn.parameters}
    assert {part.seam for part in sw.parts("channel")} == {"channel"}
    assert sw.examples()["room"]
    assert sw.examples_copy("room", tmp_path)[0].name == sw.example("room").name
    assert [path.name for path in sw.new("mind", "my_rule", tmp_path)] == ["my_rule.py", "test_my_rule.py"]
    assert sw.schema()["title"] == "swarmsim scenario"
    found = {one.what: one for one in sw.doctor()}
    assert found["simulation"].works
    assert not found["display"].needed
