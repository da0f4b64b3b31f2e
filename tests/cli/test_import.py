"""From the file of a stranger to a scenario that runs: questions, answers, what is written, and what never is."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner, Result

from swarmsim.cli import app
from swarmsim.core.errors import InputError

ROOMS = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 60 40"><g stroke="#000"><rect x="1" y="1" width="58" '
    'height="38" fill="#f6d5d5"/><rect x="2" y="2" width="18" height="16" fill="#d33"/><rect x="40" y="2" width="18" '
    'height="16" fill="#d33"/></g></svg>'
)
LAYERS = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 6 4"><g id="Base"><path d="M.1 .1H5.9V3.9H.1Z M3 .1V1.5 M3 '
    '2.5V3.9" fill="none" stroke="#000" stroke-width=".2"/></g><g id="furniture"><rect x="4" y="1" width=".6" '
    'height=".6"/></g></svg>'
)
SYMBOLS = (  # two rooms, and two doors of 9 units over walls that run on
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 120 80"><g fill="none" stroke="#000"><path stroke-width="2" '
    'd="M1 1H119V79H1ZM60 1V79"/><path d="M60 30H69A9 9 0 0 1 60 39M60 60H69A9 9 0 0 1 60 69"/></g></svg>'
)


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def imported(*words: str, typed: str = "") -> Result:
    found = CliRunner().invoke(app, ["world", "import", *words], input=typed)
    if isinstance(found.exception, InputError):
        raise found.exception
    return found


def world_in(path: Path) -> dict:
    return tomllib.loads(path.read_text(encoding="utf-8"))["world"]


def test_each_answer_is_a_key_and_the_scenario_runs(here: Path) -> None:
    (here / "plan.svg").write_text(ROOMS)
    found = imported("plan.svg", typed="6 m\n\n\n")
    assert found.exit_code == 0, found.output
    assert "It is 60 wide in its own units. How wide is the page, in metres?" in found.output
    assert "Take strokes for walls and fills for floor?" in found.output
    assert "Make doors of 0.9 m for 2 closed rooms?" in found.output
    assert world_in(here / "plan.toml") == {"file": "plan.svg", "width": 6.0, "solid": "strokes", "doors": 0.9}
    with Image.open(here / "plan-import.png") as picture:
        assert min(picture.size) > 400
        reddish = np.asarray(picture.convert("RGB")).astype(int)
    assert ((reddish[..., 0] > 180) & (reddish[..., 1] < 120) & (reddish[..., 2] < 60)).sum() > 200  # doors made
    assert CliRunner().invoke(app, ["run", "plan.toml", "--quiet", "--out", "run"]).exit_code == 0


def test_no_answer_is_kept_for_defaults_that_a_user_turns_down(here: Path) -> None:
    (here / "plan.svg").write_text(ROOMS)
    found = imported("plan.svg", "--width", "6", typed="y\nn\n")
    assert found.exit_code == 0, found.output
    assert world_in(here / "plan.toml")["doors"] == 0.0


def test_a_width_is_never_guessed(here: Path) -> None:
    (here / "plan.svg").write_text(ROOMS)
    with pytest.raises(InputError, match=r"How wide is the page.*--width METRES"):
        imported("plan.svg", "--yes")
    assert list(here.iterdir()) == [here / "plan.svg"]


def test_yes_takes_the_defaults_and_walls_that_would_be_decoration(here: Path) -> None:
    (here / "plan.svg").write_text(LAYERS)
    found = imported("plan.svg", "--width", "6", "--yes")
    assert found.exit_code == 0, found.output
    assert "`Base` (1 shape, 92 % of what is drawn) is not one of our layers" in found.output
    assert "Is it a wall? yes" in found.output
    assert world_in(here / "plan.toml")["layers"] == {"walls": ["Base"]}


def test_door_symbols_propose_a_width(here: Path) -> None:
    (here / "plan.svg").write_text(SYMBOLS)
    found = imported("plan.svg", typed="11.5\n")
    assert "If its 2 doors are 0.7 to 1 m wide, it is 9.33 to 13.3 m; 11.3 is likely." in found.output
    assert found.exit_code == 0, found.output
    assert "2 rooms" in found.output


def test_a_text_that_states_the_scale_is_asked_about(here: Path) -> None:
    paper = SYMBOLS.replace("viewBox", 'width="120mm" height="80mm" viewBox').replace(
        "</svg>", "<text>1:100</text></svg>"
    )
    (here / "plan.svg").write_text(paper)
    found = imported("plan.svg", "--yes")
    assert "The page is 0.12 m of paper, and says 1:100. Take that? yes" in found.output
    assert world_in(here / "plan.toml")["scale"] == 100.0


def test_a_map_knows_its_size_and_a_picture_is_asked_for_it(here: Path) -> None:
    levels = np.full((40, 60), 254, np.uint8)
    levels[10:30, 20:22] = 0
    Image.fromarray(levels).save(here / "m.png")
    found = imported("m.png", typed="6\n\n")
    assert found.exit_code == 0, found.output
    assert "How wide is it, in metres?" in found.output
    assert world_in(here / "m.toml") == {"file": "m.png", "width": 6.0, "border": True}


def test_nothing_is_overwritten_or_half_written(here: Path) -> None:
    (here / "plan.svg").write_text(ROOMS)
    with pytest.raises(InputError, match="not all questions were answered; nothing was written"):
        imported("plan.svg", typed="6\n")
    assert list(here.iterdir()) == [here / "plan.svg"]
    (here / "plan.toml").write_text("mine")
    with pytest.raises(InputError, match="exists already"):
        imported("plan.svg", "--width", "6", "--yes")
    assert (here / "plan.toml").read_text() == "mine"
