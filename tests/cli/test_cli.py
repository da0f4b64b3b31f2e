from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from conftest import ROOT, called

from swarmsim.cli import main
from swarmsim.cli.progress import RunBar
from swarmsim.core.state import Moment
from swarmsim.recording.reader import Recording

SMALL_PLAN = """<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 3 3">
<g id="walls"><path fill-rule="evenodd" d="M0 0H3V3H0Z M.3 .3V2.7H2.7V.3Z"/>{walls}</g>
<g id="spawn">{spawn}</g></svg>"""
SPAWN = '<rect id="room" x="0.6" y="0.6" width="0.6" height="0.6"/>'
SMALL = """title = "t"
world = "w.svg"
[robots]
count = 2
spawn = "room"
[network.topology]
use = "knn"
k = 1
[stop]
iterations = 200
"""


def plan(folder: Path, walls: str = "", spawn: str = SPAWN, text: str | None = None) -> Path:
    (folder / "w.svg").write_text(SMALL_PLAN.format(walls=walls, spawn=spawn) if text is None else text)
    scenario = folder / "s.toml"
    scenario.write_text(SMALL)
    return scenario


def test_a_run_leaves_recording_summary_and_film_and_verifies(tmp_path: Path) -> None:
    scenario, out, film = plan(tmp_path), tmp_path / "run", tmp_path / "film.mp4"
    done = called("run", scenario, "--seed", 3, "--out", out, "--video", film)
    assert done.returncode == 0, done.stderr
    assert "finished" in done.stdout
    assert sorted(path.name for path in out.iterdir()) == ["recording.h5", "summary.json"]
    assert film.stat().st_size > 10_000
    summary = json.loads((out / "summary.json").read_text())
    assert (summary["status"], summary["seed"], summary["measures"]["coverage"]) == ("finished", 3, 1.0)

    shown = called("show", out)
    assert shown.returncode == 0
    assert summary["digest"] in shown.stdout
    assert json.loads(called("show", out, "--json").stdout) == summary

    verified = called("verify", out)
    assert verified.returncode == 0, verified.stderr
    assert f"equal in all {summary['iterations']} iterations" in verified.stdout

    again = called("run", scenario, "--seed", 3, "--out", tmp_path / "again", "--quiet")
    assert (again.returncode, again.stdout, again.stderr) == (0, "", "")
    assert json.loads((tmp_path / "again" / "summary.json").read_text())["digest"] == summary["digest"]
    gif = called("video", out, tmp_path / "film.gif", "--size", "640x360", "--fps", 5, "--speed", 40, "--quiet")
    assert gif.returncode == 0, gif.stderr
    assert (tmp_path / "film.gif").read_bytes()[:6] == b"GIF89a"


def test_verify_names_the_first_iteration_and_field_that_differ(tmp_path: Path) -> None:
    import h5py

    scenario = plan(tmp_path)
    assert called("run", scenario, "--out", tmp_path / "run", "--quiet").returncode == 0
    with h5py.File(tmp_path / "run" / "recording.h5", "r+") as file:
        changed = file["digests"][:]
        changed[2, 4, 0] ^= 1
        file["digests"][...] = changed
    done = called("verify", tmp_path / "run")
    assert done.returncode == 1
    assert "different: iteration 2, field 'readings'" in done.stdout


def test_a_run_that_does_not_finish_says_so_with_exit_code_1(tmp_path: Path) -> None:
    done = called("run", plan(tmp_path), "--set", "stop.iterations=3", "--out", tmp_path / "run")
    assert done.returncode == 1
    assert "not finished" in done.stdout
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["reached"]["100 %"] is None


def test_runs_without_a_folder_of_their_own_are_numbered(tmp_path: Path) -> None:
    scenario = plan(tmp_path)
    for _ in range(2):
        called("run", scenario, "--set", "stop.iterations=2", "--quiet", cwd=tmp_path)
    assert sorted(path.name for path in (tmp_path / "runs").iterdir()) == ["s-1", "s-2"]


def test_the_schema_version_and_help_are_printed() -> None:
    assert json.loads(called("schema").stdout)["title"] == "swarmsim scenario"
    assert called("--version").stdout.startswith("swarmsim ")
    for command in ("run", "video", "show", "verify", "schema"):
        done = called(command, "--help")
        assert done.returncode == 0
        assert f"Example: swarmsim {command}" in done.stdout


def test_help_imports_nothing_heavy() -> None:
    heavy = ("numpy", "numba", "pymunk", "pygame", "h5py", "shapely", "msgspec", "imageio", "matplotlib")
    code = f"import sys, swarmsim.cli; sys.exit(' '.join(m for m in {heavy} if m in sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stderr.strip() == ""


@pytest.mark.parametrize(
    ("arguments", "heavy"),
    [
        (["run", "scenarios/room.toml", "--set", "robots.cout=3"], ("numba", "scipy", "shapely", "pymunk", "rich")),
        (["run", "scenarios/none.toml"], ("numba", "scipy", "shapely", "pymunk", "rich")),
        (["world", "check", "worlds/room.svg", "--set", "world.scale=0.5"], ("matplotlib", "ezdxf", "pygame")),
    ],
)
def test_a_mistake_is_told_without_waiting_for_what_it_does_not_need(
    arguments: list[str], heavy: tuple[str, ...]
) -> None:
    code = (
        f"import sys; from swarmsim.cli import main; sys.argv[1:] = {arguments}\n"
        f"try: main()\nfinally: print('imported:', *(m for m in {heavy} if m in sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd=ROOT)
    assert done.stdout.splitlines()[-1].strip() == "imported:", done.stdout + done.stderr


PILLAR = '<rect x="1.35" y="0" width="0.15" height="{}"/>'
BAD_PLANS = [
    ({"text": "no svg"}, "w.svg", "XML"),
    ({"text": "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 9 9'/>"}, "w.svg", "walls"),
    ({"spawn": ""}, "w.svg", "spawn"),
    ({"spawn": SPAWN.replace('"room"', '"hall"')}, "'room'", "hall"),
    ({"spawn": '<rect id="room" x="0" y="0" width="0.25" height="0.25"/>'}, "'room'", "w.svg"),
    ({"walls": '<path id="flap" d="M1 1 L2 1 L2"/>'}, "flap", "too few"),
]


@pytest.mark.parametrize(("parts", "first", "second"), BAD_PLANS)
def test_a_bad_floor_plan_is_refused_before_anything_is_written(
    tmp_path: Path, parts: dict[str, str], first: str, second: str
) -> None:
    refused(tmp_path, [first, second], "run", plan(tmp_path, **parts))


def test_an_open_building_is_refused(tmp_path: Path) -> None:
    text = SMALL_PLAN.replace('d="M0 0H3V3H0Z M.3 .3V2.7H2.7V.3Z"', 'd="M0 0H3V3H0V2H.3V2.7H2.7V.3H.3V1H0Z"')
    open_ = plan(tmp_path, text=text.format(walls="", spawn=SPAWN))
    refused(tmp_path, ["w.svg", "open", "world.border = true"], "run", open_, "--set", "world.border=false")
    done = called("run", open_, "--out", tmp_path / "closed")
    assert "a border closes it there" in " ".join(done.stdout.split())
    assert done.returncode == 0


def test_a_room_without_a_door_does_not_count_or_is_refused(tmp_path: Path) -> None:
    split = plan(tmp_path, walls=PILLAR.format(3))
    words = ["w.svg", "has no way to spawn area"]
    refused(tmp_path, words, "run", split, "--set", "world.pockets=refuse")
    done = called("run", split, "--out", tmp_path / "half")
    assert "cannot be entered and does not count" in " ".join(done.stdout.split())
    assert done.returncode == 0


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (["network.topology.k=2"], ["s.toml: network.topology.k", "at most 1"]),
        (["robots.count=999"], ["s.toml: robots.count", "'room'", "holds"]),
        (["robots.radius=1.3"], ["w.svg", "robot"]),
        (["sensor.beams=4"], ["s.toml: sensor.beams", "at least"]),
        (["mind.computation.hit=0.3"], ["s.toml: mind.computation.hit", "lowest < miss < 0.5 < hit < highest"]),
        (["robots.cuont=3"], ["robots.cuont", "'count'"]),
        (["grid.cell=0.0001"], ["cells"]),
    ],
)
def test_what_cannot_work_is_refused_before_anything_is_written(
    tmp_path: Path, settings: list[str], words: list[str]
) -> None:
    arguments = [part for context in settings for part in ("--set", context)]
    refused(tmp_path, words, "run", plan(tmp_path), *arguments)


def test_a_robot_wider_than_every_door_is_refused(tmp_path: Path) -> None:
    scenario = plan(tmp_path, walls=PILLAR.format(1.2) + '<rect x="1.35" y="1.5" width="0.15" height="1.5"/>')
    wide = ("--set", "robots.radius=0.2")
    done = refused(tmp_path, ["w.svg", "door"], "run", scenario, *wide, "--set", "world.pockets=refuse")
    assert "0.4" in done
    assert called("run", scenario, "--out", tmp_path / "slim", "--quiet").returncode == 0


def test_bad_places_are_refused(tmp_path: Path) -> None:
    scenario = plan(tmp_path)
    refused(tmp_path, ["nowhere.toml", "cannot be read"], "run", tmp_path / "nowhere.toml")
    (tmp_path / "there").mkdir()
    refused(tmp_path, ["there", "exists"], "run", scenario, "--out", tmp_path / "there")
    refused(tmp_path, ["s.toml", "cannot be made"], "run", scenario, "--out", scenario / "run")
    refused(tmp_path, ["film.avi", ".mp4"], "run", scenario, "--video", tmp_path / "film.avi")
    refused(tmp_path, ["s.toml", "folder"], "run", scenario, "--video", scenario / "film.mp4")
    for command in (["show"], ["verify"], ["video"]):
        more = [tmp_path / "film.mp4"] if command == ["video"] else []
        refused(tmp_path, ["none", "recording"], *command, tmp_path / "none", *more)
        refused(tmp_path, ["s.toml", "recording"], *command, scenario, *more)
    refused(tmp_path, ["--size", "1280x720"], "video", tmp_path, tmp_path / "film.mp4", "--size", "wide")


def refused(folder: Path, words: list[str], *arguments: object) -> str:
    before = sorted(folder.rglob("*"))
    done = called(*arguments, cwd=folder)
    assert done.returncode == 2, done.stdout + done.stderr
    assert "Traceback" not in done.stderr
    assert done.stderr.count("\n") == 1, done.stderr
    for word in words:
        assert word in done.stderr, done.stderr
    assert sorted(folder.rglob("*")) == before
    return done.stderr


@pytest.mark.parametrize(
    ("ended", "code", "word", "quiet"),
    [
        (signal.SIGINT, 130, "interrupted", []), (signal.SIGINT, 130, "interrupted", ["--quiet"]),
        (signal.SIGTERM, 143, "terminated", []),
    ],
)  # fmt: skip
def test_a_run_that_is_stopped_says_what_is_kept_even_if_quiet(
    tmp_path: Path, ended: signal.Signals, code: int, word: str, quiet: list[str]
) -> None:
    out = tmp_path / "run"
    forever = ["--set", "stop.when_done='continue'", "--set", "stop.iterations=100000"]
    command = [sys.executable, "-m", "swarmsim", "run", str(ROOT / "scenarios/room.toml"), "--out", str(out)]
    process = subprocess.Popen([*command, *forever, *quiet], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    recording = out / "recording.h5"
    while not recording.exists() or recording.stat().st_size < 60_000:  # 40 kB are the first 64 iterations
        assert process.poll() is None
        time.sleep(0.05)
    process.send_signal(ended)
    printed, said = process.communicate()
    assert process.returncode == code
    assert re.fullmatch(rf"swarmsim: {word}; \d+ iterations are kept in {re.escape(str(out))}\n", said)
    assert not quiet or printed == ""
    assert Recording(out).iterations > 0
    assert json.loads((out / "summary.json").read_text())["status"] == "interrupted"


def test_an_interruption_while_the_command_is_imported_is_told() -> None:
    script = """
import sys
class Interrupted:
    def find_spec(self, name, path, target=None):
        if name == "swarmsim.cli.doctor":
            raise KeyboardInterrupt
sys.meta_path.insert(0, Interrupted())
from swarmsim.__main__ import main
main()
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "swarmsim: interrupted\n")


def test_an_interruption_that_gets_lost_in_a_callback_is_raised_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    raised = []

    class Forgetful(set):
        def __del__(self) -> None:  # what is raised here is printed and forgotten
            raised.append(True)
            signal.raise_signal(signal.SIGINT)

    sample = RunBar.sample

    def sampling(self: RunBar, moment: Moment) -> None:
        if moment.state.iteration == 5:
            Forgetful()
        sample(self, moment)

    monkeypatch.setattr(RunBar, "sample", sampling)
    monkeypatch.setattr(
        "sys.argv", ["swarmsim", "run", str(ROOT / "scenarios" / "room.toml"), "--out", str(tmp_path / "r")]
    )
    monkeypatch.setattr("sys.unraisablehook", lambda told: None)
    before = [signal.getsignal(one) for one in (signal.SIGINT, signal.SIGTERM)]
    try:
        with pytest.raises(SystemExit) as ended:
            main()
    finally:
        for one, handler in zip((signal.SIGINT, signal.SIGTERM), before, strict=True):
            signal.signal(one, handler)
    assert raised
    assert ended.value.code == 130
    assert Recording(tmp_path / "r").iterations == 6


STARTING = """
import os, signal, sys, threading
if __name__ == "__main__":
    from swarmsim.cli import main
    from swarmsim.studies import engine
    start = engine._start
    def starting(workers):
        threading.Timer(0.5, {end}).start()
        return start(workers)
    engine._start = starting
    main()
"""


@pytest.mark.thorough
@pytest.mark.skipif(sys.platform == "win32", reason="signals to a group of processes")
@pytest.mark.parametrize(
    ("end", "code", "word"),
    [
        ("lambda: os.kill(os.getpid(), signal.SIGTERM)", 143, "terminated"),
        ("lambda: os.killpg(os.getpgid(0), signal.SIGINT)", 130, "interrupted"),  # as a terminal sends Ctrl-C
    ],
)
def test_a_study_that_is_ended_while_its_workers_start_says_so(tmp_path: Path, end: str, code: int, word: str) -> None:
    (tmp_path / "s.toml").write_text(f'title = "s"\nscenario = "{ROOT}/scenarios/room.toml"\nseeds = 3\n')
    (tmp_path / "start.py").write_text(STARTING.format(end=end))
    command = [sys.executable, "start.py", "study", "run", "s.toml", "--workers", "2", "--quiet"]
    done = subprocess.run(
        command, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=150, start_new_session=True
    )
    told = f"swarmsim: {word}; 0 of 3 runs are kept; the same command goes on from there\n"
    assert (done.stderr, done.returncode) == (told, code)
