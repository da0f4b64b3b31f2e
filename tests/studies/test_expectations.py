from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from conftest import ROOT, called

import swarmsim as sw
from swarmsim.core.errors import InputError
from swarmsim.core.scenario.expect import Expect
from swarmsim.core.state import Intents
from swarmsim.core.streams import Streams
from swarmsim.studies.expectations.verdicts import Levels, clear, decided
from swarmsim.studies.watching import Watch, Watcher

#: One robot that finishes after ten iterations unless it has died by then: it lives with the chance exp(-9 / mean).
SCENARIO = """
world = {{generate = {{use = "rooms"}}}}
[robots]
count = 1
[sensor]
use = "none"
[physics]
use = "particles"
[network.topology]
use = "none"
[mind.computation]
use = "reactive"
[mind.strategy]
use = "stand"
[task]
use = "./ends.py:lived"
[[faults]]
use = "crash"
life = {{mean = {mean}}}
min_alive = 0
[stop]
iterations = 12
{expect}
"""
ENDS = """def lived(moment):
    time = moment.state.iteration
    return float(time), bool(time >= 9 and moment.state.alive.all())
"""
LIVES = "[[expect]]\nthat = 'finished within 11s'\nchance = {}\nzone = {}\n"


def mean_of(chance: float) -> float:
    """The mean lifetime of a robot that lives through ten iterations with this chance."""
    return -9.0 / np.log(chance)


@pytest.fixture
def chance(tmp_path: Path) -> Callable[..., Path]:
    """Writes the scenario with a true chance, and what is expected of it."""

    def write(true: float, expect: str) -> Path:
        (tmp_path / "ends.py").write_text(ENDS)
        path = tmp_path / "chance.toml"
        path.write_text(SCENARIO.format(mean=mean_of(true), expect=expect))
        return path

    return write


def judged(path: Path | Sequence[Path], store: str = "kept", **more) -> sw.api.expectations.Tested:
    folder = path.parent if isinstance(path, Path) else path[0].parent
    return sw.test(path, store=folder / f"{store}.sqlite", workers=1, allow_code=True, **more)


ONE = Levels.of(0.01, 1)
CHANCE = Expect(that="finished", chance=0.95)


def answers(true: float, of: int = 200, levels: Levels = ONE) -> list[tuple[str, int]]:
    """The verdicts of nights of at most 2000 runs, each with new seeds, with this true chance."""
    rng = np.random.default_rng(26)
    return [decided(list(rng.random(2000) < true), CHANCE, levels) for _ in range(of)]


def test_nights_are_red_with_a_wrong_chance_only() -> None:
    """Where 95 % is asked: true 97 %, red in at most alpha of 200 nights; true 90 %, in all."""
    good, bad = answers(0.97), answers(0.90)
    for true, found in ((0.97, good), (0.90, bad)):
        counts = {answer: sum(one == answer for one, _ in found) for answer in ("holds", "fails", "undecided")}
        print(f"true {true}: {counts}, median runs {np.median([runs for _, runs in found]):.0f}")
    assert sum(answer == "fails" for answer, _ in good) <= 0.01 * len(good)
    assert sum(answer == "holds" for answer, _ in good) >= 0.98 * len(good)
    assert [answer for answer, _ in bad] == ["fails"] * len(bad)
    assert np.median([runs for _, runs in good]) < 400
    assert np.median([runs for _, runs in bad]) < 400


def test_a_session_of_thirty_is_seldom_red() -> None:
    """With a plain share of 20 runs each, 98 % of such nights would be."""
    assert pytest.approx(0.98, abs=0.005) == 1.0 - (0.97**20 + 20 * 0.97**19 * 0.03) ** 30
    thirty = Levels.of(0.01, 30)
    assert not any(answer == "fails" for answer, _ in answers(0.97, 150, thirty))


def test_a_verdict_stays_whatever_is_run_beyond_it() -> None:
    rng = np.random.default_rng(5)
    for true in (0.8, 0.9, 0.97, 1.0):
        outcomes = list(rng.random(1500) < true)
        answer, taken = decided(outcomes, CHANCE, ONE)
        assert answer != "undecided"
        assert decided(outcomes[:taken], CHANCE, ONE) == (answer, taken)
        assert decided(outcomes[: taken - 1], CHANCE, ONE) == ("undecided", taken - 1)


def test_a_clear_chance_takes_about_a_hundred_runs() -> None:
    assert clear(CHANCE, ONE) == 89
    assert decided([True] * 200, CHANCE, ONE) == ("holds", 89)


def test_a_chance_holds_fails_or_is_undecided_by_its_runs(chance: Callable[..., Path]) -> None:
    path = chance(0.95, LIVES.format(0.8, 0.1))
    done = judged(path)
    (verdict,) = done.verdicts
    assert (done.answer, verdict.answer, verdict.thin) == ("holds", "holds", False)
    assert "holds: " in verdict.words
    assert "shown: above 70 %" in verdict.words

    done = judged(chance(0.3, LIVES.format(0.8, 0.1)))
    (verdict,) = done.verdicts
    assert (done.answer, verdict.answer) == ("fails", "fails")
    assert "shown: below 80 %" in verdict.words
    assert verdict.worst is not None
    assert verdict.worst.seed == verdict.failing[0]
    assert f"worst: seed {verdict.worst.seed} (not finished)" in verdict.words
    assert verdict.command.startswith(f"swarmsim run {path} --seed {verdict.worst.seed} --allow-code")

    done = judged(chance(0.95, LIVES.format(0.8, 0.1)), budget=6)
    assert done.answer == "undecided"
    assert "undecided: 6 of 6 runs, 100 %; between " in done.text()


def test_a_chance_within_the_zone_is_thin(chance: Callable[..., Path]) -> None:
    done = judged(chance(0.6, LIVES.format(0.6, 0.3)), budget=60)
    (verdict,) = done.verdicts
    assert verdict.answer in ("holds", "undecided")
    assert verdict.thin
    assert f"thin: {100 * verdict.met / verdict.runs:.1f}".removesuffix(".0") in verdict.words
    assert "where 60 % is asked" in verdict.words


def test_one_commit_has_one_verdict(chance: Callable[..., Path], monkeypatch: pytest.MonkeyPatch) -> None:
    """To the byte, also when only the text of the code changes; not so with other random numbers."""
    path = chance(0.85, LIVES.format(0.7, 0.1) + "[[expect]]\nthat = 'nobody dead'\nseeds = 9\n")
    first = judged(path, "first")
    assert first.runs > 9
    assert judged(path, "second").text() == first.text()
    again = judged(path, "first")
    assert (again.runs, again.text()) == (0, first.text())
    (path.parent / "ends.py").write_text("\n\n# another comment\n" + ENDS.replace("    return", "\n    return"))
    edited = judged(path, "first")
    assert (edited.runs, edited.text()) == (first.runs, first.text())

    opened = Streams.open
    monkeypatch.setattr(Streams, "open", lambda self, purpose, robot=-1: opened(self, f"{purpose} renamed", robot))
    assert judged(path, "third").text() != first.text()


def test_nights_go_on_while_the_swarm_behaves_the_same(
    chance: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = chance(0.95, LIVES.format(0.8, 0.1))
    first = judged(path, night="1")
    assert judged(path, night="1").text() == first.text()
    (path.parent / "ends.py").write_text(ENDS + "# unchanged\n")
    second = judged(path, night="2")
    (one,), (two,) = first.verdicts, second.verdicts
    assert two.runs >= one.runs + 20
    assert judged(path, "fresh", night="1").verdicts[0].runs == one.runs

    opened = Streams.open
    monkeypatch.setattr(Streams, "open", lambda self, purpose, robot=-1: opened(self, f"{purpose} renamed", robot))
    (path.parent / "ends.py").write_text(ENDS + "# changed\n")
    (three,) = judged(path, night="3").verdicts
    assert three.runs < two.runs  # evidence starts anew


def test_a_regression_after_good_nights_is_seen_at_once(chance: Callable[..., Path]) -> None:
    path = chance(0.99, LIVES.format(0.8, 0.1))
    for night in range(3):
        assert judged(path, night=str(night)).answer == "holds"
    path.write_text(path.read_text().replace(f"mean = {mean_of(0.99)}", f"mean = {mean_of(0.2)}"))
    done = judged(path, night="4")
    assert done.answer == "fails"
    assert done.verdicts[0].runs <= 20


ROOM = f"""
world = "{ROOT}/worlds/room.svg"
[robots]
count = 3
spawn = "room"
[network.topology]
use = "knn"
k = 1
[stop]
iterations = 200
"""


def room(folder: Path, *expect: str) -> Path:
    path = folder / "room.toml"
    path.write_text(ROOM + "".join(f"[[expect]]\n{one}\n" for one in expect))
    return path


def words_of(path: Path, **more) -> list[str]:
    return [one.words for one in judged(path, **more).verdicts]


def test_every_listed_seed_has_to_meet_an_expectation_without_a_chance(tmp_path: Path) -> None:
    path = room(
        tmp_path,
        "that = 'finished'\nseeds = 2",
        "that = 'finished within 20s'\nseeds = [3, 1]",
        "that = 'coverage >= 50 % within 60s'\nseeds = 2",
        "that = 'coverage >= 0.999 at 150s'\nseeds = 2",
        "that = 'coverage <= 0.5 always'\nseeds = 2",
        "that = 'path_sum <= 100'\nseeds = 2",
        "that = 'nobody stuck'\nseeds = 2",
        "that = 'nobody dead'\nseeds = 2\nfaults = ['crash at=10 count=1']",
        "that = 'nobody stuck for 20s'\nseeds = 1\nfaults = ['motor off at=5 count=1']",
        "that = 'union_f1 >= 0.5'\nseeds = 1\nset = {'robots.count' = 2}",
    )
    done = judged(path)
    assert [one.answer for one in done.verdicts] == [
        "holds", "fails", "holds", "holds", "fails", "holds", "holds", "fails", "fails", "holds",
    ]  # fmt: skip
    told = [one.words for one in done.verdicts]
    assert told[0] == "holds: with each of the seeds 1 to 2"
    assert told[1].startswith("fails: seed ")
    assert "(finished after " in told[1]
    assert "and 1 more of 2 seeds" in told[1]
    assert "(coverage " in told[4]
    assert "1 robot dead" in told[7]
    assert "1 robot stuck" in told[8]
    assert done.verdicts[7].expectation.name == f"{path}::crash at=10 count=1: nobody dead"
    assert "faults=" in done.verdicts[7].command
    assert done.runs == 3 + 2 + 1 + 1  # those on one condition share runs


def test_a_run_that_finished_before_a_time_counts_with_its_last_value(tmp_path: Path) -> None:
    (early,) = judged(room(tmp_path, "that = 'coverage >= 1 at 199s'\nseeds = 1")).verdicts
    assert early.answer == "holds"


@pytest.mark.parametrize(
    ("expect", "words"),
    [
        ("that = 'finished within 10min'", r"room\.toml: expect\[0\]\.that: 10 min are 600 iterations, but runs end "
         r"after 200 \(\[stop\]\); expected a time up to 3 min 20 s"),
        ("that = 'coverage >= 0.9 at 201s'", r"3 min 21 s are 201 iterations"),
        ("that = 'coverage >= 0.9 at 0.5s'", r"0\.5 s is before the end of the first iteration"),
        ("that = 'nobody stuck for 1h'", r"1 h are 3600 iterations"),
        ("that = 'cover >= 0.9'", r"cover: no such measure; did you mean 'coverage'"),
        ("that = 'path_sum <= 9 at 10s'", r"path_sum is known at a run's end only; known: coverage"),
        ("that = 'finished'\nfaults = ['crush at=1']", r"expect\[0\]\.faults: 'crush at=1': .*did you mean 'crash'"),
        ("that = 'finished'\nset = {'robots.cuont' = 1}", r"robots\.cuont: unknown key"),
        ("that = 'finished'\n[[expect]]\nthat = 'finished'", r"expect\[1\]: 'finished' is listed twice"),
    ],
)  # fmt: skip
def test_what_runs_cannot_tell_is_refused_before_any(tmp_path: Path, expect: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        sw.open_expectations(room(tmp_path, expect))


def test_files_and_folders_without_expectations_are_told(tmp_path: Path) -> None:
    path = room(tmp_path)
    for wrong in (path, tmp_path):
        with pytest.raises(InputError, match=r"expects nothing|no file in it has \[\[expect\]\]"):
            sw.open_expectations(wrong)
    with pytest.raises(InputError, match=r"-k other: no expectation .*finished"):
        sw.open_expectations(room(tmp_path, "that = 'finished'"), only="other")


def test_a_study_expects_of_all_conditions_or_of_one(tmp_path: Path) -> None:
    room(tmp_path)
    study = tmp_path / "study.toml"
    study.write_text(
        "title = 'Sizes'\nscenario = 'room.toml'\nset = {'stop.iterations' = 500}\n"
        "[[vary]]\nkey = 'robots.count'\nvalues = [2, 3]\n"
        "[[expect]]\nthat = 'finished'\nseeds = 1\n"
        "[[expect]]\nthat = 'nobody stuck'\nseeds = 1\ncondition = 'count=3'\n"
        "[[expect]]\nthat = 'finished'\nseeds = 1\nfaults = ['crash at=5']\ncondition = 'count=2'\n"
    )
    done = judged(study)
    assert [one.expectation.name.partition("::")[2] for one in done.verdicts] == [
        "count=2: finished", "count=2; crash at=5: finished", "count=3: finished", "count=3: nobody stuck",
    ]  # fmt: skip
    assert done.answer == "holds"
    study.write_text(study.read_text().replace("condition = 'count=3'", "condition = 'count=4'"))
    with pytest.raises(InputError, match=r"expect\[1\]\.condition: did you mean 'count="):
        sw.open_expectations(study)


def test_a_run_that_raises_fails_with_its_message(chance: Callable[..., Path]) -> None:
    path = chance(0.99, "[[expect]]\nthat = 'finished'\nseeds = 2\n")
    (path.parent / "ends.py").write_text(ENDS.replace("    return", "    assert time < 5, 'too late'\n    return"))
    done = judged(path)
    assert done.answer == "fails"
    assert "too late" in done.text()


def plain_of(path: Path) -> list[tuple[str, set[str]]]:
    """The elements of a JUnit file, with the names of their attributes, as any reader finds them."""
    root = ET.parse(path).getroot()
    return [(one.tag, set(one.attrib)) for one in root.iter()]


def test_junit_is_read_by_a_parser_and_is_of_the_form_that_pytest_writes(tmp_path: Path) -> None:
    path = room(
        tmp_path,
        "that = 'finished'\nseeds = 1",
        "that = 'path_sum <= 1'\nseeds = 1",
        "that = 'nobody dead'\nchance = 0.9\nbudget = 3",
    )
    done = judged(path)
    root = ET.parse(done.junit(tmp_path / "ours.xml")).getroot()
    (suite,) = root
    assert (suite.get("tests"), suite.get("failures"), suite.get("errors"), suite.get("skipped")) == (
        "3", "2", "0", "0",
    )  # fmt: skip
    cases = {case.get("name"): case for case in suite}
    assert list(cases) == ["finished", "path_sum <= 1", "nobody dead (90 %)"]
    assert [one.tag for one in cases["finished"]] == ["system-out"]
    assert cases["path_sum <= 1"].find("failure").get("type") == "fails"  # type: ignore[union-attr]
    undecided = cases["nobody dead (90 %)"].find("failure")
    assert undecided is not None
    assert undecided.get("type") == "undecided"
    assert "3 of 3 runs" in undecided.get("message", "")
    allowed = ET.parse(done.junit(tmp_path / "allowed.xml", allow_undecided=True)).getroot()
    assert allowed[0].get("failures") == "1"

    (tmp_path / "test_two.py").write_text("def test_good():\n    print(1)\ndef test_bad():\n    assert 0\n")
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-p",
        "no:cacheprovider",
        "--junitxml",
        "theirs.xml",
        "test_two.py",
    ]
    subprocess.run(command, cwd=tmp_path, check=False, capture_output=True)
    theirs, ours = plain_of(tmp_path / "theirs.xml"), plain_of(tmp_path / "ours.xml")
    for tag in ("testsuites", "testsuite", "testcase", "failure"):
        needed = next(names for found, names in theirs if found == tag)
        assert all(names >= needed for found, names in ours if found == tag), tag
    assert [tag for tag, _ in ours][:3] == [tag for tag, _ in theirs][:3]


def printed(*words: str) -> tuple[int, str]:
    """The exit code and the output of a command."""
    done = called(*words)
    return done.returncode, done.stdout


def test_the_verb_prints_writes_and_exits(tmp_path: Path) -> None:
    path = room(tmp_path, "that = 'finished'\nseeds = 2", "that = 'nobody dead'\nchance = 0.9\nbudget = 4")
    options = ["--store", str(tmp_path / "kept.sqlite"), "--workers", "1"]
    code, out = printed("test", str(path), "--plan", *options)
    assert code == 0
    assert "51" in out or "4" in out
    assert "4 runs to do if all are good" in out
    code, out = printed("test", str(path), "--junit", str(tmp_path / "found.xml"), *options)
    assert code == 5, out
    assert f"{path}::finished holds: with each of the seeds 1 to 2  [ 50 %]" in out
    assert "1 hold, 1 undecided; 4 runs done in" in out
    assert ET.parse(tmp_path / "found.xml").getroot()[0].get("tests") == "2"
    code, out = printed("test", str(path), "--allow-undecided", *options)
    assert code == 0
    assert "0 runs done" in out
    code, out = printed("test", str(path), "-k", "FINISHED", "--quiet", *options)
    assert (code, out) == (0, "")
    room(tmp_path, "that = 'path_sum <= 1'\nseeds = 2")
    code, out = printed("test", str(path), "--films", str(tmp_path / "films"), *options)
    assert code == 1
    (film,) = (tmp_path / "films").iterdir()
    assert str(film) in out
    assert film.stat().st_size > 5000
    assert "swarmsim run" in out
    code, out = printed("test", str(tmp_path / "none.toml"), *options)
    assert code == 2


BUGGY = """import numpy as np

class Homing:
    def __init__(self, bug: bool = False) -> None:
        self.bug, self.time = bug, 0

    def step(self, me):
        self.time += 1
        if self.bug and self.time > 1:
            return me.drive(0.0, 0.5)  # turns on the spot for ever
        return me.drive(0.1, 0.0)
"""


def test_the_mutation_check_finds_a_planted_bug_and_expectations_that_never_fail(tmp_path: Path) -> None:
    (tmp_path / "mind.py").write_text(BUGGY)
    (tmp_path / "ends.py").write_text(
        "import numpy as np\n"
        "def moved(moment):\n"
        "    return float(np.hypot(*moment.state.pose[0, :2])), bool(moment.state.iteration >= 15)\n"
    )
    path = tmp_path / "own.toml"
    path.write_text(
        f'world = "{ROOT}/worlds/room.svg"\n[robots]\ncount = 1\nspawn = "room"\n[sensor]\nuse = "none"\n'
        '[network.topology]\nuse = "none"\n[mind]\nuse = "./mind.py:Homing"\n[task]\nuse = "./ends.py:moved"\n'
        "[stop]\niterations = 20\n"
        "[[expect]]\nthat = 'finished'\nseeds = 2\n"
        "[[expect]]\nthat = 'path_sum >= 0.2'\nseeds = 2\n"
        "[[expect]]\nthat = 'path_sum <= 0.1'\nseeds = 2\n"
    )
    opened = sw.open_expectations(path, store=tmp_path / "kept.sqlite", allow_code=True)
    toothless, sharp, wrong = opened.mutants(["mind.bug=true", "crash at=3 count=1 min_alive=0"], workers=1)
    assert toothless.killers == []
    assert toothless.met_standing
    assert {"mind.bug=true", "robots stand still", "crash"} <= set(sharp.killers)
    assert not sharp.met_standing
    assert "radio off" in sharp.equivalent  # nobody hears it anyway
    assert "byzantine occupied" in sharp.left_out
    assert (wrong.sound, wrong.fates) == ("fails", {})

    options = ["--store", str(tmp_path / "kept.sqlite"), "--workers", "1", "--allow-code"]
    code, out = printed("test", str(path), "--mutate", "--mutant", "mind.bug=true", *options)
    assert code == 1
    lines = out.splitlines()
    assert any(line.startswith(f"met even by robots that stand still: {path}::finished") for line in lines)
    assert f"no mutant is shown to fail it: {path}::finished" in lines
    assert printed("test", str(path), "--mutant", "mind.bug=true", *options)[0] == 2  # without --mutate
    assert f"equivalent: {path}: radio off changes no digest" in lines
    assert f"not tried, as it fails with nothing broken: {path}::path_sum <= 0.1" in lines
    with pytest.raises(InputError, match=r"--mutant 'mind\.bgu=true': .*bgu: unknown key"):
        opened.mutants(["mind.bgu=true"], workers=1)


STILL = np.zeros((1, 2))


class Room:
    """Moments of one robot that wants to get to a place at 1 m, and is where it is told."""

    def at(self, x: float, alive: bool = True, twists: np.ndarray | None = None, way: int = 1) -> SimpleNamespace:
        intents = Intents(STILL, np.array([[[1.0, 0.0]]]), np.array([way]), np.array([False]), twists)
        state = SimpleNamespace(pose=np.array([[x, 0.0, 0.0]]), alive=np.array([alive]))
        measured = SimpleNamespace(values={"x": x})
        return SimpleNamespace(state=state, intents=intents, believed=None, measured=measured)


@pytest.mark.parametrize(
    ("moments", "stuck"),
    [
        ([Room().at(0.0)] * 5, 1),  # from the first, in which it may have come
        ([Room().at(0.0)] * 3, 0),
        ([Room().at(0.01 * step) for step in range(20)], 1),  # creeps within its radius
        ([Room().at(0.2 * step) for step in range(6)], 0),
        ([Room().at(0.97)] * 9, 0),  # is there
        ([Room().at(0.0, way=0)] * 9, 0),  # wants nothing
        ([Room().at(0.0, alive=False)] * 9, 0),
        ([Room().at(0.0, twists=np.array([[0.1, 0.0]]))] * 9, 1),
        ([Room().at(0.0, twists=np.array([[0.0, 0.5]]))] * 9, 0),  # turns, as it wants
        ([Room().at(0.0, twists=np.array([[np.nan, np.nan]]))] * 9, 1),  # follows its way
        ([*[Room().at(0.0)] * 3, Room().at(0.5), *[Room().at(0.5)] * 2], 0),
    ],
)
def test_a_robot_is_stuck_if_it_wants_to_be_elsewhere_and_stays(moments: list, stuck: int) -> None:
    watcher = Watcher((Watch("stuck", iterations=4),), 0.06)
    for moment in moments:
        watcher.sample(moment)
    assert watcher.summary() == {"stuck 4": stuck}


def test_values_are_kept_at_times_and_at_their_extremes() -> None:
    until = (Watch("at", "x", 2), Watch("most", "x", 3), Watch("least", "x"), Watch("at", "x", 9), Watch("dead"))
    watcher = Watcher(until, 0.06)
    for x in (np.nan, 3.0, 2.0, 7.0):
        watcher.sample(Room().at(x))
    assert watcher.summary() == {
        "x at 2": 3.0, "x most 3": 3.0, "x least the end": 2.0, "x at 9": 7.0, "dead the end": 0,
    }  # fmt: skip


@pytest.mark.thorough
def test_workers_of_their_own_come_to_the_same_verdict(tmp_path: Path) -> None:
    path = room(tmp_path, "that = 'nobody dead'\nchance = 0.5", "that = 'finished'\nseeds = [4, 2]")
    here = judged(path, "here")
    assert sw.test(path, store=tmp_path / "two.sqlite", workers=2).text() == here.text()


@pytest.mark.slow
def test_a_true_chance_of_97_holds_where_95_is_asked_and_90_fails(chance: Callable[..., Path]) -> None:
    """Minutes of real runs, whose chance is set by construction."""
    for true, answer in ((0.97, "holds"), (0.90, "fails")):
        done = judged(chance(true, LIVES.format(0.95, 0.02)))
        assert done.answer == answer, done.text()
