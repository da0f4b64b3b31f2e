"""Replay pages: one file, small, and in a real browser what they show is what was recorded."""

from __future__ import annotations

import base64
import hashlib
import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ROOT, called, made

from swarmsim.operations.mapping.replay import MapReplay
from swarmsim.recording.reader import Recording
from swarmsim.view.layers.known import SEEN
from swarmsim.view.page.document import replay_page, study_page
from swarmsim.view.page.tracks import _differing
from swarmsim.view.scene import Scene

FAULTS = """faults=[{use="people", count=1}, {use="join", at=8}, {use="motor", failure="off", at=5, count=1},
    {use="remove", at=12, count=1}, {use="furniture", at=15, duration=9, box=[3.9, 0.9, 4.3, 1.3]}]""".replace("\n", "")


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    path = tmp_path_factory.mktemp("page") / "recording.h5"
    run = made("robots.count=5", "stop.iterations=60", FAULTS, 'network.channel={use="bernoulli", loss=0.3}',
               "title='Five </script> robots & a \"door\"'")  # fmt: skip
    with run.recorder(path) as recorder:
        run.simulation.run([recorder])
    return Recording(path)


def test_a_page_names_no_address_and_is_small(recording: Recording) -> None:
    page = replay_page(recording)
    assert len(page) < 400_000
    assert not re.findall(r"""(?:src|href)=["'](?!data:)""", page)
    assert "http" not in page.replace("http-equiv", "")
    assert "Five </script>" not in page
    assert page == replay_page(Recording(recording.path))


def policy_of(page: str) -> dict[str, list[str]]:
    """What a page may do, by directive."""
    (text,) = re.findall(r'<meta http-equiv="Content-Security-Policy" content="([^"]+)">', page)
    return {words[0]: words[1:] for words in map(str.split, text.split(";"))}


def test_a_page_may_run_its_own_script_alone(recording: Recording) -> None:
    for page in (replay_page(recording), study_page("A study", {"Results": (("a",), [("1",)])}, {}, {})):
        policy = policy_of(page)
        assert policy.pop("img-src") == ["data:"]
        for directive, tag in (("script-src", "script"), ("style-src", "style")):
            (text,) = re.findall(rf"<{tag}>(.*?)</{tag}>", page, re.DOTALL)
            digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
            assert policy.pop(directive) == [f"'sha256-{digest}'"]
        assert policy == {key: ["'none'"] for key in ("default-src", "base-uri", "form-action")}
        assert not re.search(r'<[^>]*\s(?:style|on\w+)="', page)  # which such a policy stops
        assert page.index("Content-Security-Policy") < page.index("<title>")


@pytest.mark.thorough
def test_the_page_of_the_basilica_is_below_five_megabytes(tmp_path: Path) -> None:
    run = made(scenario="basilica")
    with run.recorder(tmp_path / "recording.h5") as recorder:
        assert run.simulation.run([recorder])
    page = replay_page(Recording(tmp_path))
    assert 100_000 < len(page.encode()) < 5_000_000


@pytest.mark.parametrize("size", [1, 7, 8, 61])
def test_cells_that_differ_are_found_word_by_word(size: int) -> None:
    random = np.random.default_rng(size)
    for _ in range(50):
        before = random.integers(0, 3, size, np.uint8)
        new = np.where(random.random(size) < 0.1, random.integers(0, 3, size, np.uint8), before)
        assert np.array_equal(_differing(new, before), np.flatnonzero(new != before))


def test_the_verb_writes_pages_and_refuses_what_it_cannot_show(recording: Recording, tmp_path: Path) -> None:
    def report(*arguments: object) -> subprocess.CompletedProcess[str]:
        return called("report", *arguments, cwd=tmp_path)

    done = report(recording.path, "-o", "page.html", "--beside", recording.path)
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "page.html").read_text() == replay_page(recording, recording)
    for arguments, words in (
        ((recording.path, "-o", "page.pdf"), "pages end in .html"),
        (("nowhere", "-o", "page.html"), "no such recording"),
        ((ROOT / "scenarios/studies/topology.toml", "-o", "s.html"), "no runs yet"),
    ):
        done = report(*arguments)
        assert done.returncode == 2
        assert words in done.stderr
    assert sorted(path.name for path in tmp_path.iterdir() if path.suffix == ".html") == ["page.html"]


@pytest.mark.usefixtures("no_workers")
def test_a_study_has_a_page_with_tables_pictures_and_links(tmp_path: Path) -> None:
    study = tmp_path / "study.toml"
    study.write_text(
        f'title = "Two networks"\nscenario = "{ROOT}/scenarios/room.toml"\nseeds = 3\n'
        '[[vary]]\nkey = "network.topology.k"\nvalues = [1, 2]\n'
    )
    for verb in (["study", "run", "study.toml", "--quiet"], ["report", "study.toml", "-o", "study.html"]):
        done = called(*verb, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
    page = (tmp_path / "study.html").read_text()
    links = re.findall(r'href="([^"]+)"', page)
    runs = [link for link in links if link.startswith("study-runs/")]
    assert len(set(runs)) == 2
    assert all((tmp_path / link).stat().st_size > 20_000 for link in runs)
    assert page.count('src="data:image/png;base64,') >= 2


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    playwright = pytest.importorskip("playwright.sync_api")
    chromium = shutil.which("chromium")
    assert chromium is not None
    with playwright.sync_playwright() as driver:
        opened = driver.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        yield opened
        opened.close()


def wait_until(view: Any, expression: str) -> None:
    """Until an expression is true; the page's policy forbids the driver's own way, which evaluates text in the page."""
    for _ in range(500):
        if view.evaluate(expression):
            return
        view.wait_for_timeout(20)
    raise AssertionError(f"never true: {expression}")


def opened(browser: Any, page: str, folder: Path, complaints: list[str], **how: Any) -> Any:
    path = folder / "page.html"
    path.write_text(page)
    view = browser.new_page(**how)
    view.on("console", lambda message: complaints.append(message.text) if message.type == "error" else None)
    view.on("pageerror", lambda problem: complaints.append(str(problem)))
    view.goto(path.as_uri())
    wait_until(view, "window.swarmsim && window.swarmsim.ready")
    return view


@pytest.mark.browser
def test_what_the_page_shows_is_what_was_recorded(browser: Any, recording: Recording, tmp_path: Path) -> None:
    complaints: list[str] = []
    view = opened(browser, replay_page(recording), tmp_path, complaints, viewport={"width": 1280, "height": 900})
    scene, replay = Scene(recording), MapReplay(recording)
    for row in (0, 7, 20, 59):
        replay.advance(row)
        view.evaluate(f"swarmsim.seek({row})")
        poses = np.array(view.evaluate(f"Array.from({{length: 5}}, (_, i) => swarmsim.runs[0].poseAt({row}, i))"))
        assert poses[:, :2] == pytest.approx(recording["pose"][row][:, :2], abs=6e-4)
        for robot in (0, 3):
            own = np.array(view.evaluate(f"Array.from(swarmsim.runs[0].mapOf({robot}))"), np.uint8)
            assert np.array_equal(own.reshape(recording.lattice.shape), replay.maps[robot])
        known = np.array(view.evaluate("Array.from(swarmsim.runs[0].raster('known').values)"))
        expected = np.where(replay.held_occupied > 0, SEEN, replay.known)
        assert np.array_equal(known.reshape(recording.lattice.shape), expected)
        heard = [
            (robot, other)
            for robot in range(5)
            for other in view.evaluate(f"swarmsim.runs[0].pairs({row}, {robot}).hears")
        ]
        letters = recording.letters(row)
        assert sorted(heard) == sorted(set(map(tuple, letters[letters[:, 4] == 0, :2].tolist())))
        marks = view.evaluate(f"Array.from({{length: 5}}, (_, i) => swarmsim.runs[0].mark({row}, i))")
        assert marks == scene.marks_at(row)
    worded = [view.evaluate(f"swarmsim.runs[0].worded(100 * Math.fround({share}))") for share in (0.279, 0.9996, 1.0)]
    assert worded == ["27.9 %", "99.9 %", "100.0 %"]  # as in films: 100 % is all of it
    view.evaluate("swarmsim.seek(20)")  # back: maps are undone as exactly as they are made
    again = MapReplay(recording)
    again.advance(20)
    own = np.array(view.evaluate("Array.from(swarmsim.runs[0].mapOf(2))"), np.uint8)
    assert np.array_equal(own.reshape(recording.lattice.shape), again.maps[2])
    assert complaints == []


@pytest.mark.browser
def test_a_script_that_got_into_a_page_is_not_run(browser: Any, recording: Recording, tmp_path: Path) -> None:
    complaints: list[str] = []
    page = replay_page(recording).replace(
        "<body>", "<body><script>window.evil = 1</script><b class='evil' onclick='evil = 1'>x</b>"
    )
    view = opened(browser, page, tmp_path, complaints)
    view.locator(".evil").click()
    assert view.evaluate("window.evil") is None
    assert len(complaints) == 2
    assert all("Content Security Policy" in complaint for complaint in complaints)


@pytest.mark.browser
def test_the_scrubber_moves_the_robots_and_a_picked_robot_shows_its_map(
    browser: Any, recording: Recording, tmp_path: Path
) -> None:
    complaints: list[str] = []
    view = opened(browser, replay_page(recording), tmp_path, complaints, viewport={"width": 1280, "height": 900})
    canvas = view.locator("#view-0 canvas")
    start = canvas.screenshot()
    box = view.locator("#scrubber").bounding_box()
    view.mouse.click(box["x"] + 0.5 * box["width"], box["y"] + 20)
    middle = view.evaluate("swarmsim.state.time")
    assert abs(middle - 30) <= 2
    assert canvas.screenshot() != start
    assert view.locator("#numbers").inner_text().split("\n")[1] == f"{middle} of 60"
    view.keyboard.press("ArrowRight")
    assert view.evaluate("swarmsim.state.time") == middle + 1
    assert view.get_attribute("#scrubber", "aria-valuetext").startswith(f"iteration {middle + 1}, coverage ")
    # A click on a robot picks it; its map, its state and who hears it are told.
    row = int(middle) + 1
    robot = int(np.flatnonzero(recording["alive"][row])[0])
    x, y = view.evaluate(f"swarmsim.views[0].at(...swarmsim.runs[0].poseAt({row}, {robot}).slice(0, 2))")
    place = canvas.bounding_box()
    view.mouse.click(place["x"] + x, place["y"] + y)
    assert view.evaluate("swarmsim.state.robot") == robot
    told = view.locator("#about").inner_text().split("\n")
    letters = recording.letters(row)
    heard_by = sorted(set(letters[(letters[:, 1] == robot) & (letters[:, 4] == 0), 0].tolist()))
    assert told[told.index("is heard by") + 1] == (", ".join(map(str, heard_by)) or "nobody")
    replay = MapReplay(recording)
    replay.advance(row)
    theme = view.evaluate("swarmsim.runs[0].themes.light.all")
    cells = np.argwhere((replay.maps[robot] == 1) & ~recording["truth"])[::7]
    points = recording.lattice.centres(cells).tolist()
    script = """points => { const view = swarmsim.views[0], c = view.canvas.getContext("2d");
        const colour = (x, y) => Array.from(c.getImageData(Math.round(x), Math.round(y), 1, 1).data.slice(0, 3));
        return points.map(([x, y]) => colour(...view.at(x, y))) }"""
    for name in ("links", "ways", "tiles"):
        view.locator(f'#layers input[name="{name}"]').uncheck()
    colours = np.array(view.evaluate(script, points))
    assert (np.abs(colours - theme).max(axis=1) <= 2).mean() > 0.85
    view.mouse.move(place["x"] + x, place["y"] + y)
    assert f"robot {robot}: alive" in view.locator(".tip").inner_text()
    view.keyboard.press("Escape")
    assert view.evaluate("swarmsim.state.robot") == -1
    view.locator("#play").click()
    wait_until(view, f"swarmsim.state.time > {row + 1} || !swarmsim.state.playing")
    assert complaints == []


@pytest.mark.browser
@pytest.mark.parametrize("width", [400, 1280])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_pages_fit_phones_and_screens_by_day_and_night(
    browser: Any, recording: Recording, tmp_path: Path, width: int, scheme: str
) -> None:
    complaints: list[str] = []
    how = {"viewport": {"width": width, "height": 800}, "color_scheme": scheme}
    view = opened(browser, replay_page(recording, recording), tmp_path, complaints, **how)
    assert view.evaluate("document.documentElement.scrollWidth") <= width
    assert view.evaluate("swarmsim.state.theme") == scheme
    assert view.evaluate("swarmsim.runs.length") == 2
    named = "e => e.ariaLabel || e.textContent || e.labels?.length"
    unnamed = f"[...document.querySelectorAll('button, select, input')].filter(e => !({named})(e)).length"
    assert view.evaluate(unnamed) == 0
    view.locator("#theme").click()
    assert view.evaluate("swarmsim.state.theme") != scheme
    assert complaints == []


@pytest.mark.browser
def test_the_page_of_a_study_opens(browser: Any, tmp_path: Path) -> None:
    complaints: list[str] = []
    rows = [(f"k={k}, seed 1", "finished") for k in range(60)]
    text = study_page("A study", {"Results": (("run", "status"), rows)}, {}, {"k=1, seed 1": "runs/1.html"})
    (tmp_path / "page.html").write_text(text)
    view = browser.new_page()
    view.on("console", lambda message: complaints.append(message.text) if message.type == "error" else None)
    view.goto((tmp_path / "page.html").as_uri())
    assert view.locator("a").count() == 1
    assert complaints == []
