"""A table of texts as Markdown, LaTeX and CSV."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterable, Sequence
from typing import Final, Literal

Form = Literal["markdown", "latex", "csv"]
Rows = Iterable[Sequence[str]]

TEX: Final = str.maketrans(
    {**{one: f"\\{one}" for one in "&%$#_{}"}, "~": r"\textasciitilde{}", "^": r"\textasciicircum{}",
     "\\": r"\textbackslash{}", "<": r"\textless{}", ">": r"\textgreater{}", "±": r"$\pm$"}
)  # fmt: skip


def markdown(head: Sequence[str], rows: Rows) -> str:
    """A table in Markdown."""
    cells = [[str(one).replace("|", "\\|").replace("\n", " ") for one in row] for row in (head, *rows)]
    return "\n".join(f"| {' | '.join(row)} |" for row in (cells[0], ["---"] * len(head), *cells[1:]))


def latex(head: Sequence[str], rows: Rows) -> str:
    """A table in LaTeX with the lines of the package booktabs; all but the first column are aligned right."""
    first, *rest = (" & ".join(str(one).translate(TEX) for one in row) + r" \\" for row in (head, *rows))
    columns = "l" + "r" * (len(head) - 1)
    lines = [rf"\begin{{tabular}}{{{columns}}}", r"\toprule", first, r"\midrule", *rest, r"\bottomrule"]
    return "\n".join([*lines, r"\end{tabular}"])


def comma_separated(head: Sequence[str], rows: Rows) -> str:
    """A table as CSV."""
    file = io.StringIO()
    csv.writer(file, lineterminator="\n").writerows([head, *rows])
    return file.getvalue().rstrip("\n")


#: What writes a table, by form, and the suffix of its file.
WRITERS: Final[dict[Form, Callable[[Sequence[str], Rows], str]]] = {
    "markdown": markdown, "latex": latex, "csv": comma_separated,
}  # fmt: skip
SUFFIXES: Final[dict[Form, str]] = {"markdown": ".md", "latex": ".tex", "csv": ".csv"}
