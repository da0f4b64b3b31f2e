"""Links of one's own, listed in the scenario or in a file beside it."""

import pytest
from test_topology import pairs, topology

from swarmsim.core.errors import InputError
from swarmsim.core.scenario.file import load
from swarmsim.core.scenario.files import with_files


def test_edges_are_the_listed_links_in_order():
    assert pairs("edges", [True] * 4, links=[[3, 0], [0, 2], [0, 1]]) == [(0, 1), (0, 2), (3, 0)]
    assert pairs("edges", [True] * 4, links=[]) == []


@pytest.mark.parametrize(
    ("links", "message"),
    [
        ([[0, 1], [1, 4]], r"links\[1\]: there is no robot 4; expected ids from 0 to 3"),
        ([[2, 2]], r"links\[0\]: robot 2 hears itself; expected two different robots"),
        ([[0, 1], [1, 0], [0, 1]], r"links\[2\]: \[0, 1\] repeats links\[0\]; expected each link once"),
        ([[0, -1]], r"links\[0\]\[1\]: .*>= 0"),
        ([[0, 1.5]], r"links\[0\]\[1\]: .*`int`"),
        ([[0, 1, 2]], r"links\[0\]: .*length 2"),
        ({"file": "net.csv"}, r"links: .*`array`"),
    ],
)
def test_links_that_cannot_be_are_refused(links, message):
    with pytest.raises(InputError, match=f"^{message}"):
        topology("edges", 4, links=links)


def scenario_with(folder, text):
    (folder / "nets").mkdir()
    (folder / "nets" / "net.csv").write_bytes(text)
    path = folder / "s.toml"
    path.write_text(
        'title = "t"\nworld = "w.svg"\n[robots]\ncount = 4\nspawn = "room"\n'
        '[network.topology]\nuse = "edges"\nlinks = {file = "nets/net.csv"}\n'
    )
    return path


@pytest.mark.parametrize("text", [b"0,1\n1, 2\n", b"\xef\xbb\xbf0,1\r\n\r\n1,2"], ids=["plain", "from a spreadsheet"])
def test_links_in_a_file_become_part_of_the_scenario(tmp_path, text):
    read = load(scenario_with(tmp_path, text))
    assert read.network.topology.table == {"use": "edges", "links": [[0, 1], [1, 2]]}


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        (b"0,1\nreceiver,sender\n", ["net.csv, line 2", "expected numbers"]),
        (b"0,1\n\n1;2\n", ["net.csv, line 3"]),
        (b"0,nan\n", ["net.csv, line 1"]),
        (b"0,1.5\n", ["links[0][1]", "`int`"]),
        (b"\xff\xfe", ["net.csv: not UTF-8"]),
    ],
)
def test_a_file_that_is_not_a_table_of_numbers_is_refused_with_its_line(tmp_path, text, parts):
    path = scenario_with(tmp_path, text)
    with pytest.raises(InputError) as refused:
        load(path)
    for part in [f"{path}: network.topology.links", *parts]:
        assert part in str(refused.value)
    assert "receiver,sender" not in str(refused.value)  # the contents of a file are never repeated


def test_a_file_that_is_not_there_is_refused(tmp_path):
    path = scenario_with(tmp_path, b"")
    with pytest.raises(InputError, match=r"network\.topology\.links: .*none\.csv: cannot be read"):
        load(path, ['network.topology.links={file="none.csv"}'])


def test_files_are_found_in_inner_tables_too_and_other_tables_left_alone(tmp_path):
    (tmp_path / "a.csv").write_text("1.5,2\n")
    given = {"x": {"y": {"file": "a.csv"}, "z": {"file": "a.csv", "more": 1}}, "file": "a.csv"}
    assert with_files(given, tmp_path) == {"x": {"y": [[1.5, 2]], "z": {"file": "a.csv", "more": 1}}, "file": "a.csv"}
    assert given["x"]["y"] == {"file": "a.csv"}
    with pytest.raises(InputError, match=r"^x\.y: .*b\.csv: cannot be read"):
        with_files({"x": {"y": {"file": "b.csv"}}}, tmp_path)
