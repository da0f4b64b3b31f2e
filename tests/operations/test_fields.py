"""Fields, and their reconstruction against regression and truths written out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import made, moments_of, setting_of
from hypothesis import given
from hypothesis import strategies as some
from numpy.testing import assert_allclose
from PIL import Image
from scipy import stats

from swarmsim.core.errors import InputError
from swarmsim.core.scenario.files import read_rows
from swarmsim.operations.fields.estimate import Basis
from swarmsim.operations.fields.replay import FieldReplay
from swarmsim.operations.fields.truth import Formula, FormulaField, Picture, PictureField, Source, SourceField, Sources
from swarmsim.recording.reader import Recording
from swarmsim.view.canvas import Canvas
from swarmsim.view.scene import Scene
from swarmsim.view.theme import DARK

FIELD, MOVING = "operations/field", "operations/moving-field"
PAGE = (0.0, 0.0, 8.0, 4.0)
POINTS = np.random.default_rng(2).uniform((0.0, 0.0), (8.0, 4.0), (50, 2))


def test_sources_are_bells_that_turn_back_at_the_edges() -> None:
    field = SourceField(Sources(sources=[Source(x=7.0, y=1.0, height=2.0, width=0.5, velocity=(0.5, -0.25))]), PAGE)
    assert_allclose(field.places(0.0), [[7.0, 1.0]])
    assert_allclose(field.places(2.0), [[8.0, 0.5]])
    assert_allclose(field.places(6.0), [[6.0, 0.5]])
    assert_allclose(field.places(40.0), [[5.0, 1.0]])  # 27 m from the left edge, there and back
    expected = 2.0 * np.exp(-((POINTS - (6.0, 0.5)) ** 2).sum(axis=1) / (2 * 0.5**2))
    assert_allclose(field.value(6.0, POINTS), expected, atol=1e-12)


def test_formulas_are_what_they_say() -> None:
    x, y = POINTS.T
    for text, expected in (
        ("2 + sin(x) * exp(-y / 3)", 2 + np.sin(x) * np.exp(-y / 3)),
        ("-x ** 2 + hypot(x, y) + pi * t", -(x**2) + np.hypot(x, y) + np.pi * 5.0),
        ("maximum(x - y, 1)", np.maximum(x - y, 1)),
        ("3", np.full(50, 3.0)),
    ):
        assert_allclose(FormulaField(text).value(5.0, POINTS), expected)


NO_FORMULAS = [
    *("", "x +", "z", "__import__('os')", "x.real", "(lambda: 1)()", "[x]", "sin(x, y)", "sin(x=1)", "'a'", "True"),
    *("x if y else 1", "x < y", "9" * 600, "(" * 300 + "x" + ")" * 300),
]


@pytest.mark.parametrize("text", NO_FORMULAS)
def test_what_is_no_formula_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="formula: "):
        FormulaField(text)


@given(some.text(max_size=80))
def test_no_text_whatever_does_more_than_be_refused(text: str) -> None:
    try:
        field = FormulaField(text)
    except InputError:
        return
    assert field.value(1.0, POINTS).shape == (50,)


def test_a_formula_that_is_not_finite_on_the_floor_is_refused() -> None:
    with pytest.raises(
        InputError, match=r"field\.formula: 'log\(x - 4\)' is nan in iteration 0 .*everywhere on the floor"
    ):
        made('field={use="formula", formula="log(x - 4)"}', scenario=FIELD)


@pytest.mark.parametrize(
    ("field", "words"),
    [
        ('{use="formula", formula="x + 1 / (t - 3)"}', r"field\.formula: 'x \+ 1 / \(t - 3\)' is inf in iteration 6 "),
        (
            '{use="formula", formula="sqrt(2.4 - t)"}',
            r"field\.formula: 'sqrt\(2\.4 - t\)' is nan in iteration 5 \(t = 2\.5 s\)",
        ),
        (
            '{use="sources", sources=[{x=1.0, y=1.0, velocity=[1.5e308, 0.0]}]}',
            r"field\.sources: .* is nan in iteration 3 ",
        ),
    ],
)
def test_a_field_that_becomes_infinite_is_named_with_the_iteration(field: str, words: str) -> None:
    """Each iteration is half a second long, so that times and iterations differ."""
    run = made(f"field={field}", "period=0.5", "robots.count=2", 'network.topology={use="none"}', scenario=FIELD)
    with pytest.raises(InputError, match=words):
        run.simulation.run()


def test_a_picture_of_values_too_large_for_numbers_is_refused() -> None:
    with pytest.raises(InputError, match=r"field\.values: the picture is inf in iteration 0"):
        made('field={use="picture", values=[[1.0, 1e9], [1.0, 1e9]], high=1e300}', scenario=FIELD)


def test_pictures_lie_on_the_page_with_their_first_row_at_the_top(tmp_path: Path) -> None:
    levels = np.array([[0, 255], [51, 102]], np.uint8)
    Image.fromarray(levels).save(tmp_path / "f.png")
    rows = read_rows(tmp_path / "f.png")
    assert_allclose(rows, [[0.0, 1.0], [0.2, 0.4]])
    field = PictureField(np.array(rows), PAGE)
    corners = np.array([(2.0, 3.0), (6.0, 3.0), (2.0, 1.0), (6.0, 1.0), (4.0, 2.0), (0.0, 4.0)])
    assert_allclose(field.value(0.0, corners), [0.0, 1.0, 0.2, 0.4, 0.4, 0.0], atol=1e-12)
    (tmp_path / "bad.png").write_bytes(b"no picture")
    with pytest.raises(InputError, match=r"bad\.png: cannot be read .*expected a PNG picture"):
        read_rows(tmp_path / "bad.png")
    with pytest.raises(InputError, match="values: rows of 2 and 3 values; expected a rectangle"):
        Picture(values=[[0.0, 1.0], [0.0, 1.0, 2.0]]).build(setting_of())


def test_estimates_are_those_of_regression_on_all_samples_at_once() -> None:
    run = made("stop.iterations=12", scenario=FIELD)
    computation = run.simulation.parts.computation
    prior, sigma = 1.0, 0.05
    own: dict[int, list[tuple[np.ndarray, float]]] = {robot: [] for robot in range(10)}
    for moment in moments_of(run):
        for robot in range(10):
            own[robot].append((moment.state.pose[robot, :2], moment.readings.field[robot]))
            senders = moment.links[moment.links[:, 0] == robot, 1]
            own[robot] += [(moment.state.pose[j, :2], moment.readings.field[j]) for j in senders]
        knowledge = moment.knowledge
    basis = Basis((0.0, 0.0, 8.0, 8.0), 1.0)
    for robot in (0, 7):
        phi = basis.at(np.array([place for place, _ in own[robot]]))
        values = np.array([value for _, value in own[robot]])
        augmented = np.concatenate([phi / sigma, np.eye(phi.shape[1]) / prior])
        target = np.concatenate([values / sigma, np.zeros(phi.shape[1])])
        expected = np.linalg.lstsq(augmented, target, rcond=None)[0]
        assert_allclose(knowledge.weights[robot], expected, atol=1e-8)
        assert knowledge.samples[robot] == len(values) == 12 * 4
        covariance = np.linalg.inv(phi.T @ phi / sigma**2 + np.eye(phi.shape[1]) / prior**2)
        at = basis.at(POINTS)
        assert_allclose(knowledge.variance(POINTS)[robot], np.einsum("kb,bc,kc->k", at, covariance, at), rtol=1e-6)
    assert computation.codec.size == 6 + 24


def errors(k: int, seed: int, iterations: int) -> np.ndarray:
    keys = (f"network.topology.k={k}", f"seed={seed}", f"stop.iterations={iterations}", "task.error=1e-9")
    keys = (*keys, 'mind.strategy={use="random-waypoint"}')
    return np.array([moment.measured.values["error"] for moment in moments_of(made(*keys, scenario=FIELD))])


@pytest.mark.thorough
def test_the_error_falls_with_time_and_with_the_number_of_robots_heard() -> None:
    runs = {(k, seed): errors(k, seed, 120) for k in (0, 2, 9) for seed in range(1, 6)}
    for (k, seed), run in runs.items():
        assert run[-1] < 0.8 * run[9], (k, seed)
    late = stats.kendalltau(*zip(*((k, run[-1]) for (k, _), run in runs.items()), strict=True), alternative="less")
    assert late.pvalue < 1e-4


@pytest.mark.thorough
def test_a_field_that_moves_is_followed_by_letting_evidence_fade() -> None:
    def late(keys: str) -> float:
        moments = moments_of(made(keys, "stop.iterations=250", scenario=MOVING))
        return float(np.mean([moment.measured.values["error"] for moment in moments[100:]]))

    assert late("mind.computation.half_life=8") < 0.5 * late("mind.computation.half_life=1e9")


@pytest.mark.thorough
def test_going_where_least_is_known_beats_going_anywhere() -> None:
    def needed(strategy: str, seed: int) -> int:
        run = made(f'mind.strategy={{use="{strategy}"}}', "task.error=0.2", f"seed={seed}", scenario=FIELD)
        assert run.simulation.run()
        return run.simulation.finished_after

    greedy, anywhere = ([needed(name, seed) for seed in range(1, 7)] for name in ("most-uncertain", "random-waypoint"))
    assert stats.mannwhitneyu(greedy, anywhere, alternative="less").pvalue < 0.02


def test_a_robot_that_forgets_starts_from_the_prior_and_one_that_dies_says_nothing() -> None:
    keys = ('faults=[{use="mind", failure="reboot", at=20, robots=[3]}, {use="crash", at=10, robots=[5]}]',)
    moments = moments_of(made(*keys, "stop.iterations=21", scenario=FIELD))
    assert np.isnan(moments[-1].readings.field[5])
    assert moments[-1].knowledge.samples[5] == moments[9].knowledge.samples[5]
    assert moments[-1].knowledge.samples[3] == 0
    assert_allclose(moments[-1].knowledge.weights[3], 0.0)
    assert (moments[-1].measured.robots["errors"] > 0.0).all()


def test_fields_that_are_not_there_or_too_fine_are_refused() -> None:
    with pytest.raises(InputError, match=r"mind\.computation\.use: 'field-estimate' estimates a field; expected"):
        made('mind.computation={use="field-estimate"}', 'mind.strategy={use="stand"}')
    with pytest.raises(InputError, match=r"mind\.computation\.spacing: 6400 bells at 0.1 m; expected 1000 at most"):
        made("mind.computation.spacing=0.1", scenario=FIELD)


def test_the_average_of_a_measured_field_is_agreed_on() -> None:
    keys = ('field={use="formula", formula="20 + x - y / 2"}', "mind.computation.values=[]")
    run = made(keys[0], scenario="operations/average-consensus")
    moments = moments_of(run)
    place = moments[0].state.pose
    assert_allclose(moments[-1].knowledge.value, (20 + place[:, 0] - place[:, 1] / 2).mean(), atol=1e-6)
    assert Formula(formula="x").noise == 0.0


def test_a_film_shows_the_field_as_robots_estimate_it(tmp_path: Path) -> None:
    run = made("stop.iterations=60", scenario=FIELD)
    moments = []

    class Keep:
        def sample(self, moment) -> None:
            moments.append(moment)

    with run.recorder(tmp_path / "r.h5") as recorder:
        run.simulation.run([recorder, Keep()])
    recording = Recording(tmp_path / "r.h5")
    replay = FieldReplay(recording, (0.0, 0.0, 8.0, 8.0))
    points = recording.lattice.centres(np.array([[10, 20], [40, 13]]))
    expected = moments[30].knowledge.at(points).mean(axis=0)
    assert_allclose(replay.mean(30)[[10, 40], [20, 13]], expected, atol=1e-12)
    scene = Scene(recording)
    shares = scene.estimate(59)
    assert np.nanmin(shares) == 0.0
    assert np.nanmax(shares) == 1.0
    assert np.isnan(shares[0, 0])
    canvas = Canvas(scene, (1280, 720))
    surface = canvas.draw(60)
    row, column = np.argwhere(shares == 1.0)[0]
    x, y = np.rint(canvas.pixels(recording.lattice.centres(np.array([row, column])))).astype(int)
    seen = np.array([surface.get_at((int(x) + dx, int(y) + dy))[:3] for dx in (-1, 0, 1) for dy in (-1, 0, 1)])
    assert (np.abs(seen - DARK.hot).max(axis=1) < 12).any()
    assert DARK.between("floor", "hot", np.array([0.0, 1.0])).tolist() == [list(DARK.floor), list(DARK.hot)]
    assert not Scene(_room(tmp_path)).has_field


def _room(folder: Path) -> Recording:
    run = made("stop.iterations=3")
    with run.recorder(folder / "room.h5") as recorder:
        run.simulation.run([recorder])
    return Recording(folder / "room.h5")


def test_a_swarm_of_the_dead_makes_no_progress() -> None:
    dead = 'faults=[{use="remove", at=1, robots=[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11], min_alive=0}]'
    last = moments_of(made("robots.count=12", "stop.iterations=3", dead, scenario=FIELD))[-1].measured
    assert (last.progress, last.finished) == (0.0, False)


@pytest.mark.parametrize("key", ["mind.computation.spacing", "mind.strategy.margin", "mind.strategy.nearness"])
def test_numbers_beyond_reason_are_refused(key: str) -> None:
    with pytest.raises(InputError, match=rf"{key}: expected `float` <= 1000000"):
        made("mind.strategy={use='most-uncertain'}", f"{key}=1e300", scenario=FIELD)
