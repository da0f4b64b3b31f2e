import colorsys
import re
import subprocess
import sys
import zlib
from collections.abc import Callable, Iterator
from functools import cache
from itertools import pairwise
from xml.etree import ElementTree as ET

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.axis import Axis
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.text import Text

from swarmsim.core.errors import InputError
from swarmsim.network.analysis import contacts, meetings, reach, snapshots
from swarmsim.view import plots
from swarmsim.view.plots.rewiring import changes, spread

LONG = [f"robustness, {20 + row} robots, kind {row}" for row in range(15)]
SHORT = [f"{row}NN" for row in range(4)]
LOST = np.array([0.0, 0.25, 0.5, 0.75])
MEANS = np.array([400.0, 500.0, 700.0, np.nan])
SPANS = np.column_stack([0.9 * MEANS, 1.1 * MEANS])


def runs(labels):
    """Thirty synthetic runs for each condition, of which the first condition leaves two unfinished at 3000."""
    random = np.random.default_rng(3)
    times = {label: np.round(300.0 + 60 * row + random.normal(0, 40, 30)) for row, label in enumerate(labels)}
    finished = {label: np.ones(30, dtype=bool) for label in labels}
    times[labels[0]][:2], finished[labels[0]][:2] = 3000.0, False
    return times, finished


def coverage(labels=("chain", "2NN")):
    curves = {label: [np.linspace(0, 1, 80 + 9 * run + row) for run in range(6)] for row, label in enumerate(labels)}
    return plots.curves(curves, "Coverage", {labels[0]: (20, 40), labels[1]: (40,)})


def distributions(labels=SHORT):
    times, finished = runs(labels)
    estimates = {label: (taken.mean(), taken.mean() - 30, taken.mean() + 30) for label, taken in times.items()}
    return plots.distributions(times, finished, "Times", dict.fromkeys(labels[1:], 430.0), estimates)


def comparison(labels=SHORT):
    means = np.linspace(300, 1200, len(labels))
    near, far = (np.outer(means, (1 - part, 1 + part)) for part in (0.05, 0.3))
    published = np.where(np.arange(len(labels)) == 1, np.nan, 1.1 * means)
    return plots.comparison(labels, means, near, far, published, "Ours and theirs", [30] * len(labels))


def scaling():
    robots = np.array([5, 10, 20])
    spans = np.array([[1000.0, 1200], [700, 800], [480, 520]])
    return plots.scaling(
        robots, spans.mean(axis=1), spans, (300.0, 4000.0), {5: 1273, 15: 583}, "More robots", [30] * 3
    )


def steps(unfinished=(0.0, 0.0, 0.1, 1.0)):
    return plots.Steps(100.0 * LOST, MEANS, SPANS, np.array(unfinished), [30, 28, 30, 30])


def degradation():
    return plots.sweep({"": steps()}, {}, "robots lost, %", "Loss")


def sweep():
    across = plots.Steps(np.zeros(1), MEANS[:1], SPANS[:1], np.zeros(1), [30])
    return plots.sweep({"knn": steps((0,) * 4), "k-random": steps((0,) * 4)}, {"chain": across}, "k", "Neighbours")


def window(robots=7, length=90):
    """Random links of which every third is lost, among robots of which the last dies half way."""
    random = np.random.default_rng(5)
    alive = np.ones((length, robots), dtype=bool)
    alive[length // 2 :, -1] = False
    linked = [np.argwhere(random.random((robots, robots)) < 0.3) for _ in range(length)]
    linked = [pairs[(pairs[:, 0] != pairs[:, 1]) & alive[t][pairs].all(axis=1)] for t, pairs in enumerate(linked)]
    return linked, [pairs[::3] for pairs in linked], alive


def graphs():
    linked, heard, alive = window()
    return {"linked": snapshots(linked, alive), "heard": snapshots(heard, alive)}


def network_course():
    return plots.network_course(graphs(), 10, "Network")


def degrees():
    return plots.degrees(graphs(), "Degrees")


def who_heard_whom():
    _, heard, alive = window()
    return plots.who_heard_whom(reach(heard, alive), "Who")


def contact_times():
    _, heard, alive = window()
    both = {"one way": contacts(heard, alive), "two robots": contacts([meetings(pairs) for pairs in heard], alive)}
    return plots.contact_times(both, "Contacts")


FIGURES = [
    coverage, distributions, comparison, scaling, degradation, sweep,
    network_course, degrees, who_heard_whom, contact_times,
]  # fmt: skip
CROWDED = [lambda: coverage(LONG), lambda: distributions(LONG), lambda: comparison(LONG)]


@cache
def drawn(draw: Callable[[], Figure]) -> Figure:
    """A figure for tests that only look at it."""
    return draw()


def words(figure: Figure) -> Iterator[str]:
    return (text.get_text() for text in figure.findobj(Text) if text.get_text())


def ticks_in_view(axis: Axis) -> list[Text]:
    low, high = axis.get_view_interval()
    within = [tick.label1 for tick in axis.get_major_ticks() if axis.axes.axison and low <= tick.get_loc() <= high]
    return [label for label in within if label.get_visible()]


@pytest.mark.parametrize(
    ("draw", "said"),
    [
        (coverage, ["iteration", "coverage, %", "chain", "2NN", "95 % of the runs, n = 6"]),
        (distributions, ["iterations until done", "0NN", "one run, n = 30", "unfinished, at its limit", "published"]),
        (comparison, ["iterations until done", "0NN", "our mean, 95 % interval, n = 30", "published"]),
        (scaling, ["robots", "iterations until done", "T = 300 + 4000 / N", "mean, 95 % interval, n = 30"]),
        (
            degradation,
            ["robots lost, %", "iterations until done", "unfinished\nruns, %", "mean, 95 % interval, n = 28 to 30"],
        ),
        (sweep, ["k", "knn", "mean, 95 % interval, n = 28 to 30", "chain, n = 30"]),
        (network_course, ["neighbour turnover", "clustering", "iteration", "heard: running mean of 2 iterations"]),
        (
            degrees,
            ["others heard (in-degree)", "live robots, %", "linked, n = 585 robots x iterations"],
        ),
        (who_heard_whom, ["robot heard", "robot that hears", "first heard in iteration"]),
        (contact_times, ["contact time, iterations", "time between contacts, iterations", "share that lasts longer"]),
    ],
)
def test_figures_say_what_they_show_in_which_unit_and_from_how_many_runs(draw, said):
    assert set(said) <= set(words(drawn(draw)))


def test_a_run_that_is_over_keeps_its_last_value():
    curves = [np.array([0.2, 1.0]), np.array([0.1, 0.3, 0.5, 0.6])]
    figure = plots.curves({"a": curves}, "Coverage")
    (line,) = figure.axes[0].lines
    np.testing.assert_array_equal(line.get_xdata(), [1, 2, 3, 4])
    np.testing.assert_allclose(line.get_ydata(), [15.0, 65.0, 75.0, 80.0])
    band = figure.axes[0].collections[0].get_paths()[0].vertices
    assert band[band[:, 0] == 4][:, 1].min() == pytest.approx(60.0 + 0.025 * 40.0)
    assert band[band[:, 0] == 4][:, 1].max() == pytest.approx(100.0 - 0.025 * 40.0)
    assert "a (1 below 100 %)" in words(figure)


def test_long_curves_are_thinned_but_keep_their_ends():
    (line,) = plots.curves({"a": [np.linspace(0, 1, 5000)]}, "Coverage").axes[0].lines
    assert len(line.get_xdata()) == plots.FINEST
    assert line.get_xdata()[[0, -1]].tolist() == [1, 5000]


def test_faults_that_share_an_iteration_are_dashed_in_turns():
    upright = [line for line in coverage().axes[0].lines if np.ptp(line.get_xdata()) == 0]
    assert [(line.get_xdata()[0], line.get_color()) for line in upright] == [
        (20, plots.COLOURS[0]),
        (40, plots.COLOURS[0]),
        (40, plots.COLOURS[1]),
    ]


def test_conditions_without_runs_and_unknown_conditions_are_refused():
    with pytest.raises(ValueError, match="at least one run"):
        plots.curves({"a": []}, "Coverage")
    with pytest.raises(ValueError, match="no such condition: b; there are a"):
        plots.curves({"a": [np.ones(2)]}, "Coverage", {"b": (1,)})
    with pytest.raises(ValueError, match=r"spans of shape \(2, 4\)"):
        plots.sweep({"": plots.Steps(LOST, MEANS, SPANS.T, np.zeros(4), [30] * 4)}, {}, "k", "Neighbours")


def test_unfinished_runs_are_hollow_triangles_at_their_limit():
    hollow = [line for line in distributions().axes[0].lines if line.get_marker() == ">"]
    assert all(line.get_markerfacecolor() == "none" for line in hollow)
    assert [line.get_xdata().tolist() for line in hollow] == [[3000.0, 3000.0], [], [], []]
    times, finished = runs(SHORT)
    assert "unfinished, at its limit" not in words(plots.distributions({"a": times["1NN"]}, {"a": finished["1NN"]}, ""))


def test_the_box_spans_the_quartiles():
    figure = plots.distributions({"a": np.arange(1.0, 6)}, {"a": np.ones(5, dtype=bool)}, "Times")
    (box,) = figure.axes[0].patches
    assert (box.get_x(), box.get_width()) == (2.0, 2.0)


@pytest.mark.parametrize("draw", [*FIGURES, *CROWDED])
def test_nothing_drawn_lies_outside_its_axes_or_the_figure(draw):
    figure = drawn(draw)
    figure.draw_without_rendering()  # another test may have saved it, in which case letters are as large as in SVG
    for axes in figure.axes:
        box = axes.bbox.padded(1.0)
        for line in axes.lines:
            if line.get_transform() == axes.transData:
                spots = axes.transData.transform(line.get_xydata())
                assert all(box.contains(*spot) for spot in spots if np.isfinite(spot).all())
        for lines in axes.collections:
            for path in lines.get_paths():
                assert all(
                    box.contains(*spot) for spot in axes.transData.transform(path.vertices) if spot[1] == spot[1]
                )
    ticks = {axis: ticks_in_view(axis) for axes in figure.axes for axis in (axes.xaxis, axes.yaxis)}
    unseen = {label for axis, seen in ticks.items() for label in axis.get_ticklabels() if label not in seen}
    inside = figure.bbox.padded(1.0)
    for text in set(figure.findobj(Text)) - unseen:
        if text.get_text():
            assert all(inside.contains(*corner) for corner in text.get_window_extent().corners()), text


def long_sweep():
    return plots.sweep(
        {"": plots.Steps(np.arange(90.0), np.arange(90.0), np.ones((90, 2)), np.zeros(90), [1] * 90)}, {}, "k", ""
    )


@pytest.mark.parametrize("draw", [*FIGURES, *CROWDED, long_sweep])
def test_tick_labels_do_not_overlap(draw):
    for axes in draw().axes:
        for along, axis in enumerate((axes.xaxis, axes.yaxis)):
            labels = [label for label in ticks_in_view(axis) if label.get_text()]
            if labels and labels[0].get_rotation():
                # Parallel slanted lines of text are clear of each other when their anchors are, across the text.
                slant = np.radians(labels[0].get_rotation())
                places = [axes.transData.transform((label.get_position()[0], 0))[0] for label in labels]
                for label in labels:
                    label.set_rotation(0)
                height = max(label.get_window_extent().height for label in labels)
                assert np.diff(places).min() * np.sin(slant) > height
            else:
                boxes = [label.get_window_extent() for label in labels]
                assert all(second.min[along] > first.max[along] for first, second in pairwise(boxes))


def test_names_of_conditions_stand_upright_in_rows_and_take_at_most_half_of_the_width():
    for labels in (LONG, SHORT):
        figure = distributions(labels)
        names = figure.axes[0].get_yticklabels()
        assert [name.get_text().replace("\n", " ") for name in names] == labels
        assert {name.get_rotation() for name in names} == {0.0}
        assert max(name.get_window_extent().width for name in names) < 0.5 * figure.bbox.width


@pytest.mark.parametrize("draw", [*FIGURES, *CROWDED])
def test_legends_cover_nothing_that_is_drawn(draw):
    figure = draw()
    legends = [*figure.legends, *(axes.get_legend() for axes in figure.axes if axes.get_legend())]
    boxes = [legend.get_window_extent() for legend in legends]
    for legend in legends:
        legend.remove()
    for axes in figure.axes:
        axes.grid(False)
    figure.canvas.draw()
    pixels = np.asarray(figure.canvas.buffer_rgba())[::-1, :, :3]
    for box in boxes:
        (left, low), (right, high) = np.ceil(box.min).astype(int), np.floor(box.max).astype(int)
        assert (pixels[low:high, left:right] == 255).all()


@pytest.mark.parametrize(
    "draw",
    [pytest.param(draw, marks=pytest.mark.slow) if draw in (network_course, degrees) else draw for draw in FIGURES],
)
def test_saved_bytes_are_always_the_same(draw, tmp_path):
    figure = drawn(draw)
    first, second = plots.save(figure, tmp_path / "new" / "fig.1"), plots.save(figure, tmp_path / "again")
    with mpl.rc_context({"font.size": 20, "svg.fonttype": "none", "axes.grid": False}):
        third = plots.save(draw(), tmp_path / "third")
        assert mpl.rcParams["font.size"] == 20
    assert [path.name for path in first] == ["fig.1.png", "fig.1.svg"]
    assert [path.read_bytes() for path in first] == [path.read_bytes() for path in second]
    assert [path.read_bytes() for path in first] == [path.read_bytes() for path in third]
    assert b"Date" not in first[1].read_bytes() + first[0].read_bytes()


def test_labels_are_no_formulae():
    assert "a $x_1$" in words(plots.curves({"a $x_1$": [np.ones(3)]}, "costs $5 and $6"))


def test_neither_pyplot_nor_pygame_is_imported():
    code = "import sys, swarmsim.view.plots; print({'matplotlib.pyplot', 'pygame'} & set(sys.modules))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "set()\n"


def test_networks_in_which_nothing_happens_can_be_drawn():
    nobody, alive = [np.empty((0, 2), int)] * 3, np.zeros((3, 4), dtype=bool)
    plots.network_course({"heard": snapshots(nobody, alive)}, 0, "")
    plots.degrees({"heard": snapshots(nobody, alive)}, "")
    assert "never heard (0 of 0 ordered pairs)" in words(plots.who_heard_whom(reach(nobody, alive), ""))
    assert "a: no median, n = 0, 0 censored" in words(plots.contact_times({"a": contacts(nobody, alive)}, ""))
    lonely = np.ones((1, 1), dtype=bool)
    assert plots.who_heard_whom(reach(nobody[:1], lonely), "").axes


def test_the_matrix_shows_receivers_down_and_senders_across():
    found = reach([np.array([[2, 0]]), np.array([[1, 0]])], np.ones((2, 3), dtype=bool), first=5)
    figure = plots.who_heard_whom(found, "")
    shown = figure.axes[0].images[1].get_array()
    assert shown[2, 0] == 5
    assert shown[1, 0] == 6
    assert shown.count() == 2
    assert "never heard (4 of 6 ordered pairs)" in words(figure)


def test_a_running_mean_passes_over_what_is_not_defined():
    (snapshot,) = snapshots([np.array([[0, 1], [1, 0]])], np.ones((1, 3), dtype=bool))
    (nothing,) = snapshots([np.empty((0, 2), int)], np.ones((1, 3), dtype=bool))
    figure = plots.network_course({"heard": [snapshot, nothing, snapshot] * 40}, 0, "")
    reciprocity = next(axes for axes in figure.axes if axes.get_title("left") == "reciprocity")
    np.testing.assert_array_equal(reciprocity.lines[-1].get_ydata(), 1.0)


def test_the_robots_whose_neighbours_differ_are_named_with_what_they_lost_and_found():
    assert changes([{1, 2}, {0}, set()], [{2, 3}, {0}, {1}]) == {0: ([1], [3]), 2: ([], [1])}


def test_places_are_spread_until_none_is_too_close_and_lonely_ones_stay():
    random = np.random.default_rng(2)
    crowd = np.vstack([0.3 * random.random((12, 2)), [[50.0, 50.0]]])
    moved = spread(crowd, 1.0)
    apart = np.hypot(*(moved[:, None] - moved[None]).transpose(2, 0, 1)) + 9 * np.eye(13)
    assert apart.min() >= 1.0
    assert moved[-1].tolist() == [50.0, 50.0]
    np.testing.assert_allclose(moved.mean(axis=0), crowd.mean(axis=0))


def test_iterations_have_an_axis_in_time_beside_them() -> None:
    times = {"a": np.array([300.0, 600.0, 900.0])}
    figure = plots.distributions(times, {"a": np.ones(3, dtype=bool)}, "Times", period=0.5)
    (axes,) = figure.axes
    (second,) = axes.child_axes
    assert second.get_xlabel() == "time, min"
    assert second.get_xlim() == pytest.approx(np.array(axes.get_xlim()) * 0.5 / 60.0)
    steps = plots.Steps(100.0 * LOST, MEANS, SPANS, np.zeros(4), [30] * 4)
    for period, unit in ((0.1, "s"), (10.0, "min"), (20.0, "h")):  # the axis ends at 816 iterations; h from 3 h on
        (second,) = plots.sweep({"": steps}, {}, "k", "", period=period).axes[0].child_axes
        assert second.get_ylabel() == f"time, {unit}"
    assert not plots.sweep({"": steps}, {}, "k", "").axes[0].child_axes


def test_curves_of_one_period_have_an_axis_in_time_and_those_of_several_lie_along_seconds() -> None:
    runs = {"a": [np.linspace(0, 1, 100)], "b": [np.linspace(0, 1, 40)]}
    (axes,) = plots.curves(runs, "Coverage", {"b": (10,)}, periods={"a": 1.0, "b": 1.0}).axes
    assert [one.get_xlabel() for one in axes.child_axes] == ["time, s"]
    assert axes.get_xlabel() == "iteration"
    (axes,) = plots.curves(runs, "Coverage", {"b": (10,)}, periods={"a": 1.0, "b": 4.0}).axes
    assert (axes.get_xlabel(), axes.child_axes) == ("time, s", [])
    assert [line.get_xdata()[-1] for line in axes.lines] == [100.0, 160.0, 40.0]  # the last is the fault


COLUMN = "252pt"


@pytest.mark.parametrize("draw", [*FIGURES, *CROWDED])
def test_in_a_column_of_a_paper_letters_keep_their_size_and_nothing_overlaps(draw):
    with plots.printing(width=COLUMN):
        figure = draw()
    assert figure.get_figwidth() == 252 / 72
    assert min(text.get_fontsize() for text in figure.findobj(Text) if text.get_text()) > 6.5
    assert {axes.xaxis.label.get_fontsize() for axes in figure.axes} == {8.0}
    test_nothing_drawn_lies_outside_its_axes_or_the_figure(lambda: figure)
    test_tick_labels_do_not_overlap(lambda: figure)
    panels = [axes.get_tightbbox() for axes in figure.axes]
    pairs = [(one, two) for at, one in enumerate(panels) for two in panels[:at]]
    assert not any(one.padded(-1.0).overlaps(two.padded(-1.0)) for one, two in pairs)


def streams(pdf: bytes) -> list[bytes]:
    found = re.findall(rb"stream\r?\n(.*?)\r?\nendstream", pdf, re.DOTALL)
    return [zlib.decompress(one) for one in found]


def test_a_pdf_has_its_letters_inside_and_its_text_can_be_selected(tmp_path):
    with plots.printing(width=COLUMN, title=False, font="STIXGeneral"):
        (pdf,), (other,) = (plots.save(coverage(), tmp_path / name) for name in ("figure.pdf", "again.pdf"))
    data = pdf.read_bytes()
    assert data == other.read_bytes()
    objects = data + b"".join(streams(data))
    assert re.search(rb"/MediaBox \[ ?0 0 252 ", objects)
    assert b"/CIDFontType2" in objects  # TrueType, as journals ask for, and not the shapes of Type 3
    assert b"/FontFile2" in objects
    assert b"/Type3" not in objects
    assert b"STIXGeneral" in objects
    maps = b"".join(re.findall(rb"beginbfrange(.*?)endbfrange", objects, re.DOTALL))
    assert maps  # from glyphs to letters
    drawn_as = re.findall(rb"\[\(?<?([^\]]*)\] ?TJ|\(([^)]*)\) ?Tj", b"".join(streams(data)))
    assert drawn_as


def test_text_stays_text_in_an_svg(tmp_path):
    with plots.printing(kinds=["svg"], font="DejaVu Serif"):
        (svg,) = plots.save(coverage(), tmp_path / "figure.pdf")
    assert svg.name == "figure.svg"
    texts = ET.parse(svg).iter("{http://www.w3.org/2000/svg}text")
    assert {"coverage, %", "chain", "Coverage"} <= {"".join(one.itertext()) for one in texts}
    assert "DejaVu Serif" in svg.read_text()


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"width": "252"}, r"--width 252: expected a width from 1\.5in to 40in in pt, mm, cm or in, such as 252pt"),
        ({"width": "3pt"}, "--width 3pt: expected a width"),
        ({"font": "DejaVu Sanss"}, "--font DejaVu Sanss: no such font is installed; did you mean 'DejaVu Sans'"),
        ({"style": "pale"}, "--style pale: expected paper or slides or dark"),
        ({"kinds": ["gif"]}, "--kinds gif: expected png or svg or pdf"),
    ],
)
def test_what_cannot_be_printed_is_refused(keys, words):
    with pytest.raises(InputError, match=words), plots.printing(**keys):
        pass


@pytest.mark.parametrize("draw", [coverage, distributions, sweep, who_heard_whom])
def test_on_a_dark_ground_all_that_was_black_is_light(draw):
    with plots.printing(style="dark"):
        figure = draw()
    dark = [text for text in figure.findobj(Text) if text.get_text() and sum(to_rgba(text.get_color())[:3]) < 1.5]
    assert max(to_rgba(figure.get_facecolor())[:3]) < 0.15
    assert not dark
    lines = [line for axes in figure.axes for line in axes.lines]
    inks = [colour for line in lines for colour in (line.get_color(), line.get_markerfacecolor()) if colour != "none"]
    assert all(colorsys.rgb_to_hls(*to_rgba(ink)[:3])[1] > 0.4 for ink in inks)


def test_slides_have_large_letters_and_no_title_where_none_is_asked_for():
    with plots.printing(style="slides", title=False):
        figure = coverage()
    assert figure.axes[0].xaxis.label.get_fontsize() == 16.0
    assert "Coverage" not in words(figure)
    assert figure.get_figwidth() == 10.0
    assert coverage().axes[0].xaxis.label.get_fontsize() == 10.0  # outside the context all is as before
