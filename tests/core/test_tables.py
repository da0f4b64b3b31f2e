"""Tables for documents can be read back, whatever their cells hold."""

from __future__ import annotations

import csv
import io

from markdown_it import MarkdownIt

from swarmsim.core.tables import comma_separated, latex, markdown

HEAD = ("condition", "mean, s")
ROWS = [("k=1, 50 % \\ #2 & a_b|c", "1.5 ± 0.2"), ("{x} ~ ^ < >", "2")]


def test_csv_is_read_back() -> None:
    assert list(csv.reader(io.StringIO(comma_separated(HEAD, ROWS)))) == [list(row) for row in (HEAD, *ROWS)]


def test_markdown_is_a_table_with_a_cell_for_each() -> None:
    page = MarkdownIt("commonmark").enable("table").render(markdown(HEAD, ROWS))
    assert page.count("<td>") == 4
    assert "a_b|c" in page


def test_latex_has_no_mark_of_its_own_in_a_cell() -> None:
    lines = latex(HEAD, ROWS).splitlines()
    assert lines[:4] == [r"\begin{tabular}{lr}", r"\toprule", r"condition & mean, s \\", r"\midrule"]
    assert lines[4] == r"k=1, 50 \% \textbackslash{} \#2 \& a\_b|c & 1.5 $\pm$ 0.2 \\"
    assert lines[5] == r"\{x\} \textasciitilde{} \textasciicircum{} \textless{} \textgreater{} & 2 \\"
