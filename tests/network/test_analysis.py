from __future__ import annotations

import json
import os
import subprocess
import sys
import warnings
from itertools import combinations, permutations

import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from swarmsim.cli import app
from swarmsim.core.errors import InputError
from swarmsim.network.analysis import Spells, contacts, meetings, reach, snapshots
from swarmsim.recording.reader import Recording

checked = settings(derandomize=True, deadline=None, max_examples=60)
runner = CliRunner()


def links(*pairs):
    return np.array(pairs, dtype=np.int32).reshape(-1, 2)


@st.composite
def windows(draw, longest=8, most=6):
    """Random graphs among live robots, some of which die, for a few iterations."""
    robots, length = draw(st.integers(1, most)), draw(st.integers(1, longest))
    pairs = list(permutations(range(robots), 2))
    dies = draw(st.lists(st.integers(0, 2 * length), min_size=robots, max_size=robots))
    alive = np.arange(length)[:, None] < np.array(dies)
    graphs = []
    for row in range(length):
        chosen = draw(st.lists(st.sampled_from(pairs), unique=True)) if pairs else []
        graphs.append(links(*sorted((i, j) for i, j in chosen if alive[row, i] and alive[row, j])))
    return graphs, alive


def digraph(pairs, alive):
    graph = nx.DiGraph()
    graph.add_nodes_from(np.flatnonzero(alive).tolist())
    graph.add_edges_from(pairs.tolist())
    return graph


@checked
@given(windows(longest=3, most=9))
def test_every_iteration_is_measured_as_networkx_does(window):
    for pairs, alive, found in zip(*window, snapshots(*window), strict=True):
        graph = digraph(pairs, alive)
        assert found.degrees.tolist() == [graph.out_degree(robot) for robot in graph]  # networkx: receiver to sender
        assert found.listeners.tolist() == [graph.in_degree(robot) for robot in graph]
        weak, strong = list(nx.weakly_connected_components(graph)), list(nx.strongly_connected_components(graph))
        assert (found.weak_components, found.strong_components) == (len(weak), len(strong))
        if not len(graph):
            assert np.isnan([found.mean_degree, found.most_degree, found.clustering, found.weak_share]).all()
            continue
        assert found.weak_share == max(map(len, weak)) / len(graph)
        assert found.strong_share == max(map(len, strong)) / len(graph)
        assert found.clustering == pytest.approx(nx.average_clustering(graph))
        assert (found.least_degree, found.most_degree) == (min(found.degrees), max(found.degrees))
        if len(pairs):
            assert found.reciprocity == pytest.approx(nx.overall_reciprocity(graph))
        else:
            assert np.isnan(found.reciprocity)


@checked
@given(windows())
def test_turnover_is_the_mean_jaccard_distance_of_neighbour_sets(window):
    graphs, alive = window
    found = [snapshot.turnover for snapshot in snapshots(*window)]
    assert np.isnan(found[0])
    for row in range(1, len(graphs)):
        heard = [
            [set(pairs[pairs[:, 0] == robot, 1].tolist()) for robot in range(alive.shape[1])]
            for pairs in graphs[row - 1 : row + 1]
        ]
        distances = [
            1 - len(heard[0][i] & heard[1][i]) / len(heard[0][i] | heard[1][i]) if heard[0][i] | heard[1][i] else 0.0
            for i in range(alive.shape[1])
            if alive[row - 1, i] and alive[row, i]
        ]
        assert found[row] == pytest.approx(np.mean(distances)) if distances else np.isnan(found[row])


def test_a_small_graph_by_hand():
    # 0 hears 1 and 2, 1 hears 0, 2 hears 1, and 3 nobody
    (found,) = snapshots([links((0, 1), (0, 2), (1, 0), (2, 1))], np.ones((1, 4), bool))
    assert found.degrees.tolist() == [2, 1, 1, 0]
    assert found.listeners.tolist() == [1, 2, 1, 0]
    assert found.reciprocity == 0.5
    assert (found.weak_components, found.strong_components) == (2, 2)
    assert (found.weak_share, found.strong_share) == (0.75, 0.75)
    assert (found.mean_degree, found.least_listeners, found.most_listeners) == (1.0, 0.0, 2.0)


def test_a_sender_that_has_died_is_heard_but_holds_no_piece_together():
    (found,) = snapshots([links((0, 2), (1, 2))], np.array([[True, True, False]]))
    assert found.degrees.tolist() == [1, 1]
    assert found.weak_components == 2
    assert np.isnan(found.reciprocity)


def spells_of(found: Spells):
    columns = (found.start, found.length, found.begun, found.ended)
    rows = zip(found.pairs.tolist(), *(column.tolist() for column in columns), strict=True)
    return [(tuple(pair), *rest) for pair, *rest in rows]


def contacts_by_hand(graphs, alive, first):
    """Walk through the iterations of every pair, one by one."""
    together, apart = [], []
    length, robots = alive.shape
    for pair in permutations(range(robots), 2):
        there = [pair in set(map(tuple, pairs.tolist())) for pairs in graphs]
        lived = [max(np.flatnonzero(alive[:, robot]), default=-1) for robot in pair]
        row = 0
        while row < length:
            if not there[row]:
                row += 1
                continue
            end = row
            while end + 1 < length and there[end + 1]:
                end += 1
            together.append((pair, first + row, end - row + 1, row > 0 or first == 0, end < length - 1))
            later = [at for at in range(end + 1, length) if there[at]]
            until = later[0] - 1 if later else min(lived)
            if until > end:
                apart.append((pair, first + end + 1, until - end, True, bool(later)))
            row = end + 1
    return together, apart


@checked
@given(windows(most=4), st.sampled_from([0, 7]))
def test_contacts_are_those_found_by_walking_through_every_pair(window, first):
    found = contacts(*window, first)
    assert tuple(map(spells_of, found)) == contacts_by_hand(*window, first)


def test_contacts_at_the_ends_of_a_window_are_told_from_whole_ones():
    graphs = [links((0, 1)), links((0, 1)), links(), links((0, 1)), links(), links((0, 1))]
    alive = np.ones((6, 2), bool)
    together, apart = contacts(graphs, alive, first=10)
    assert spells_of(together) == [
        ((0, 1), 10, 2, False, True),  # may have begun before
        ((0, 1), 13, 1, True, True),
        ((0, 1), 15, 1, True, False),  # may go on
    ]
    assert spells_of(apart) == [((0, 1), 12, 1, True, True), ((0, 1), 14, 1, True, True)]
    assert contacts(graphs, alive, first=0)[0].begun.all()


def test_time_apart_is_censored_where_one_of_the_two_dies():
    alive = np.array([[True, True]] * 4 + [[True, False]] * 3)
    _, apart = contacts([links((0, 1)), *[links()] * 6], alive)
    assert spells_of(apart) == [((0, 1), 1, 3, True, False)]


def test_meetings_have_no_direction():
    assert meetings(links((2, 1), (1, 2), (0, 2), (2, 1))).tolist() == [[0, 2], [1, 2]]


def lasting(lengths, ended, begun=True):
    count = len(lengths)
    zeros = np.zeros((count, 2), np.int64)
    return Spells(zeros, zeros[:, 0], np.array(lengths), np.broadcast_to(begun, count), np.array(ended, bool))


def test_survival_is_kaplan_and_meiers():
    # At 1 one of 5 ends; at 2 one of 4, and one is censored; at 4 one of 2; at 5 the last is censored.
    lengths, outlasting = lasting([1, 2, 2, 4, 5], [1, 1, 0, 1, 0]).survival()
    assert dict(zip(lengths, outlasting, strict=True)) == pytest.approx({1: 0.8, 2: 0.6, 4: 0.3, 5: 0.3})
    assert lasting([1, 2, 2, 4, 5], [1, 1, 0, 1, 0]).median() == 4.0


def test_there_is_no_median_where_most_spells_are_censored_or_none_was_seen_to_begin():
    assert lasting([1, 5, 5], [1, 0, 0]).median() is None
    assert lasting([1, 2], [1, 1], begun=False).median() is None
    assert lasting([], []).median() is None
    assert lasting([3, 3], [1, 1], begun=np.array([True, False])).median() == 3.0


def test_the_median_of_spells_seen_to_end_is_outlasted_by_half_of_them():
    for half in range(1, 40):
        assert lasting(np.arange(1, 2 * half + 1), [True] * (2 * half)).median() == half


def test_who_was_dead_all_along_is_nobody_to_be_heard():
    found = reach([links((0, 2))], np.array([[True, True, False]]))
    assert found.share[0, :2].tolist() == [0.0, 0.0]
    assert np.isnan(found.share[0, 2])
    assert found.first_heard[0].tolist() == [-1, -1, 0]


@checked
@given(windows(), st.integers(0, 5))
def test_reach_is_what_going_through_all_links_finds(window, first):
    graphs, alive = window
    found = reach(graphs, alive, first)
    present = np.flatnonzero(alive.any(axis=0)).tolist()
    heard = {}
    for row, pairs in enumerate(graphs):
        for pair in map(tuple, pairs.tolist()):
            heard.setdefault(pair, first + row)
        for robot in range(alive.shape[1]):
            count = sum((robot, other) in heard for other in present)
            wanted = count / (len(present) - 1) if robot in present and len(present) > 1 else np.nan
            assert found.share[row, robot] == pytest.approx(wanted, nan_ok=True)
    expected = np.full(found.first_heard.shape, -1)
    for pair, iteration in heard.items():
        expected[pair] = iteration
    np.testing.assert_array_equal(found.first_heard, expected)
    ordered = [heard.get(pair) for pair in permutations(present, 2)]
    assert found.all_heard == (max(ordered) if ordered and None not in ordered else None)
    met = [min([heard[p] for p in ((i, j), (j, i)) if p in heard], default=None) for i, j in combinations(present, 2)]
    assert found.all_met == (max(met) if met and None not in met else None)
    union = digraph(links(*heard), alive.any(axis=0))
    assert found.strongly_connected == (len(union) == 0 or nx.is_strongly_connected(union))


def test_nothing_is_passed_on():
    # 1 hears 0, then 2 hears 1: what 0 said does not reach 2
    found = reach([links((1, 0)), links((2, 1))], np.ones((2, 3), bool))
    assert found.first_heard[2].tolist() == [-1, 1, -1]


@pytest.mark.parametrize("measure", [snapshots, contacts, reach])
@pytest.mark.parametrize(("graphs", "length"), [([], 0), ([links()], 2)])
def test_windows_that_do_not_fit_are_refused(measure, graphs, length):
    with pytest.raises(ValueError, match=f"links of {len(graphs)} iterations, robots alive in {length}"):
        measure(graphs, np.ones((length, 2), bool))


# The command line, on a run in which messages are lost and a robot vanishes.

PLAN = """<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 6 3">
<g id="walls"><path fill-rule="evenodd" d="M0 0H6V3H0Z M.3 .3V2.7H5.7V.3Z"/></g>
<g id="pillars"><circle cx="3" cy="1.5" r="0.3"/></g>
<g id="spawn"><rect id="room" x="0.6" y="0.6" width="1.2" height="1.2"/></g></svg>"""
SCENARIO = """title = "five in a hall"
world = "w.svg"
[robots]
count = 5
spawn = "room"
[network.topology]
use = "knn"
k = 2
[network.channel]
use = "bernoulli"
loss = 0.4
[[faults]]
use = "remove"
at = 20
count = 1
[stop]
iterations = 40
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("network")
    (folder / "w.svg").write_text(PLAN)
    (folder / "s.toml").write_text(SCENARIO)
    done = runner.invoke(app, ["run", str(folder / "s.toml"), "--out", str(folder / "run"), "--quiet"])
    assert done.exit_code in (0, 1), done.output
    return folder / "run"


def invoke(*arguments):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return runner.invoke(app, list(map(str, arguments)))


def test_the_network_of_a_run_is_told_in_tables(run):
    done = invoke("network", run)
    assert done.exit_code == 0, done.output
    for said in ("five in a hall", "turnover", "heard", "loss", "busiest links", "contacts: median", "reciprocity"):
        assert said in done.output


def test_json_agrees_with_the_recording(run):
    told = json.loads(invoke("network", run, "--from", 5, "--to", 35, "--json").output)
    recording = Recording(run)
    assert (told["from"], told["to"], told["robots"]) == (5, 35, 5)
    letters = np.concatenate([recording.letters(t) for t in range(5, 35)])
    for fate, name in enumerate(recording.fates):
        chosen = letters[letters[:, 4] == fate]
        assert told["messages"][name] == {"messages": len(chosen), "bytes": int(chosen[:, 3].sum())}
    assert told["messages"]["loss"]["messages"] > 0
    heard = told["graphs"]["heard"]
    alive = int(recording["alive"][5:35].sum())
    assert sum(heard["in-degrees"]) == sum(heard["out-degrees"]) == alive
    assert (
        sum(degree * count for degree, count in enumerate(heard["in-degrees"])) == told["messages"]["heard"]["messages"]
    )
    busiest = told["busiest links"][0]
    pair = [busiest["receiver"], busiest["sender"]]
    assert busiest["heard"] == ((letters[:, :2] == pair).all(axis=1) & (letters[:, 4] == 0)).sum()
    lengths = heard["contacts, one way"]
    assert sum(int(n) * c for kind in ("whole", "censored", "begun before") for n, c in lengths[kind].items()) == len(
        letters[letters[:, 4] == 0]
    )


def test_figures_are_drawn_in_both_formats_and_are_not_blank(run, tmp_path):
    from PIL import Image

    assert invoke("network", run, "--plots", tmp_path).exit_code == 0
    maps = invoke("figure", "local-maps", run, "--robots", "0,1, 2,4", "--at", 30, "--out", tmp_path / "maps")
    assert maps.exit_code == 0, maps.output
    assert invoke("figure", "network", run, "--at", 2, "--and", 30).exit_code == 0
    drawn = sorted(path.stem for path in tmp_path.glob("*.svg"))
    assert drawn == ["contact-times", "course", "degrees", "maps", "who-heard-whom"]
    for stem in [*(tmp_path / name for name in drawn), run / "network-2-30"]:
        with Image.open(stem.with_suffix(".png")) as picture:
            pixels = np.asarray(picture.convert("L"))
        assert min(pixels.shape) > 500
        assert 0.001 < (pixels < 200).mean() < 0.9
        assert stem.with_suffix(".svg").read_text().count("<path") > 10


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("network", "--from", 40), "--from 40: no such iteration; expected 0 to 39"),
        (("network", "--from", -1), "--from -1: no such iteration; expected 0 to 39"),
        (("network", "--from", 5, "--to", 5), "--to 5: not after --from within the run; expected 6 to 40"),
        (("network", "--to", 41), "--to 41: not after --from within the run; expected 1 to 40"),
        (("figure local-maps", "--robots", "1,5", "--at", 3), "no robot 5 in the run; expected numbers from 0 to 4"),
        (("figure local-maps", "--robots", "1;2", "--at", 3), "--robots 1;2: not a list of robots"),
        (("figure local-maps", "--robots", "1", "--at", 40), "--at 40: no such iteration; expected 0 to 39"),
        (("figure network", "--at", 1, "--and", 99), "--and 99: no such iteration; expected 0 to 39"),
        (("figure network", "--at", 1, "--and", 1), "--and 1: the same iteration as at"),
    ],
)
def test_what_is_not_in_the_run_is_refused_with_its_range(run, arguments, message):
    verb, *options = arguments
    done = invoke(*verb.split(), run, *options)
    assert isinstance(done.exception, InputError)
    assert message in str(done.exception)


@pytest.mark.parametrize("verb", ["network", "figure network --at 1 --and 2", "figure local-maps --robots 0 --at 1"])
def test_what_is_no_recording_is_refused(tmp_path, verb):
    done = invoke(*verb.split(), tmp_path / "none")
    assert isinstance(done.exception, InputError)
    assert "no such recording; expected a run's folder" in str(done.exception)


def test_a_place_that_cannot_be_written_is_named(run, tmp_path):
    (tmp_path / "file").write_text("")
    done = invoke("figure", "network", run, "--at", 1, "--and", 2, "--out", tmp_path / "file" / "figure")
    assert isinstance(done.exception, InputError)
    assert "--out" in str(done.exception)


def test_bad_input_ends_with_one_line_and_exit_code_2(run):
    command = [sys.executable, "-m", "swarmsim", "network", str(run), "--to", "99"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=dict(os.environ))
    assert done.returncode == 2
    assert done.stderr == "swarmsim: --to 99: not after --from within the run; expected 1 to 40\n"


def test_the_verbs_show_an_example():
    for verb in ("network", "figure local-maps", "figure network"):
        assert f"Example: swarmsim {verb}" in invoke(*verb.split(), "--help").output


def test_importing_the_verbs_imports_nothing_heavy():
    code = "import sys, swarmsim.cli; print({'numpy', 'matplotlib', 'scipy'} & set(sys.modules))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "set()\n"
