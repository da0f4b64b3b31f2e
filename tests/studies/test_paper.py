"""A paper's folder: read whole and checked, with one message that names file and key for what is wrong."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from conftest import ROOT

from swarmsim.core.errors import InputError
from swarmsim.studies.paper import find_paper, open_paper
from swarmsim.studies.plan import open_study

KIT = ROOT / "papers" / "kit2018"
PAPERS = sorted(path.parent for path in (ROOT / "papers").glob("*/paper.toml"))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A copy of the reference paper's folder that may be spoilt."""
    (tmp_path / "scenarios").symlink_to(ROOT / "scenarios")
    return Path(shutil.copytree(KIT, tmp_path / "papers" / "kit2018"))


def spoil(file: Path, old: str, new: str) -> None:
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1))


def test_the_reference_paper_has_its_numbers_claims_and_readings() -> None:
    paper = open_paper(KIT)
    assert len(paper.published) == 15
    assert len(paper.claims) == 8
    assert [reading.name for reading in paper.read()] == ["letter", "arrival"]
    assert sum(number.value for number in paper.published) == 9591.0


@pytest.mark.parametrize("home", PAPERS, ids=lambda home: home.name)
def test_every_shipped_paper_is_whole_and_says_where_it_appeared(home: Path) -> None:
    paper = open_paper(home)
    assert paper.about.doi.startswith("10.")
    assert all(claim.source for claim in paper.claims)
    for check in (check for claim in paper.claims for check in claim.test):
        claim = next(claim for claim in paper.claims if check in claim.test)
        assert check.limit is None or claim.margin  # a limit has an origin
    for file in home.glob("*.toml"):
        if file.name not in ("paper.toml", "claims.toml", "readings.toml"):
            assert open_study(file, 1).conditions


@pytest.mark.parametrize(
    ("file", "old", "new", "message"),
    [
        ("paper.toml", "doi =", "dio =", "paper.toml: dio: unknown key; did you mean 'doi'?"),
        ("paper.toml", 'cite = "', 'site = "', "paper.toml: site: unknown key; did you mean 'cite'?"),
        ("paper.toml", "network.toml", "nowork.toml", "paper.toml: studies.network: there is no file"),
        ("paper.toml", 'study = "network"', 'study = "netwok"', "figure[2]: study: 'netwok' is not a study"),
        ("paper.toml", 'kind = "scaling"', 'kind = "pie"', "figure[3].kind: invalid enum value 'pie'; expected"),
        ("paper.toml", 'name = "scaling"', 'name = "../up"', "paper.toml: figure[3].name: "),
        ("paper.toml", '{"20-15-10-5 units"', '{"20-15 units"', "figure[0]: conditions: '20-15 units' is not in"),
        ("claims.toml", '"N=5", ', '"N=4", ', "claims.toml: claim[0].test[0]: conditions: 'N=4' is not in the study"),
        ("claims.toml", 'kind = "trend"', 'kind = "tend"', "claims.toml: claim[0].test[0].kind: invalid enum value"),
        ("claims.toml", 'margin = "close', 'margin_chosen = "close', "claim[6]: 'margin_chosen' says when"),
        ("claims.toml", "limit = 0.25", 'limit = "x"', "claims.toml: claim[1].test[0].limit: expected `float"),
        ("claims.toml", "limit = 0.25", "", "claims.toml: claim[1].test[0]: 'less-gain' takes limit"),
        ("claims.toml", 'but = ["1NN"]', 'but = ["0NN"]', "claim[3].test[0].but: '0NN' is not one of its conditions"),
        ("claims.toml", '"6NN", "5NN"]', '"6NN", "6NN"]', "claims.toml: claim[4].test[1]: conditions: '6NN' is twice"),
        ("published.csv", ",1273,", ",many,", "published.csv, line 2: iterations: 'many' is not a number above 0"),
        ("published.csv", ",1273,", ",-3,", "published.csv, line 2: iterations: '-3' is not a number above 0"),
        ("published.csv", ",N=10,", ",N=11,", "published.csv, line 3: conditions: 'N=11' is not in the study"),
        ("published.csv", "iterations", "steps", "published.csv: the column 'iterations' is missing"),
        ("readings.toml", '"1NN"', '"1N"', "readings.toml: reading[1].calibrated: '1N' is unknown"),
        ("readings.toml", "chain =", "chian =", "readings.toml: reading[0].conditions: 'chian' is unknown"),
        ("readings.toml", '"ring"', '"rung"', "conditions: 'rung' is not in the study 'network'"),
        ("readings.toml", '"arrival"', '"letter"', "reading[0].name: 'letter' is listed twice"),
        ("readings.toml", "calibration.toml", "no.toml", "readings.toml: reading[1].calibration: there is no file"),
    ],
)  # fmt: skip
def test_what_is_wrong_in_a_folder_is_told_with_file_and_key(folder, file, old, new, message) -> None:
    spoil(folder / file, old, new)
    with pytest.raises(InputError) as problem:
        open_paper(folder)
    assert message in str(problem.value)
    assert str(folder) in str(problem.value)


def test_a_folder_without_claims_is_refused(folder: Path) -> None:
    (folder / "claims.toml").unlink()
    with pytest.raises(InputError, match=r"claims\.toml: cannot be read .* expected claims of a paper"):
        open_paper(folder)


def test_a_paper_is_found_by_its_folder_and_a_shipped_one_by_its_name(folder: Path, monkeypatch) -> None:
    assert find_paper(str(folder)) == folder
    monkeypatch.chdir(folder.parent.parent.parent)
    assert find_paper("kit2018") == KIT
    assert find_paper("papers/kit2018") == KIT
    with pytest.raises(InputError, match=r"kit2019: no such paper; .* known: kit2018, shang2014"):
        find_paper("kit2019")


def test_a_reading_that_there_is_not_is_refused() -> None:
    with pytest.raises(InputError, match="lettre: no such reading; known: letter, arrival"):
        open_paper(KIT).read(["lettre"])
