"""The paper's tables with ours, as CSV, as LaTeX and as Markdown."""

import csv
import io
from collections.abc import Iterable, Mapping, Sequence

from flightapp.evaluation.paper_rows import Row
from flightapp.evaluation.paper_tables import paper_table_text
from flightapp.evaluation.tables import TextTable

_LATEX: Mapping[str, str] = {
    "\\": r"\textbackslash{}",
    "&": r"\&",
    "%": r"\%",
    "$": r"\$",
    "#": r"\#",
    "_": r"\_",
    "{": r"\{",
    "}": r"\}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "–": "--",
    "−": "$-$",
    "±": r"$\pm$",
    "×": r"$\times$",
    "≥": r"$\geq$",
    "√": r"$\surd$",
    "²": r"\textsuperscript{2}",
    "°": r"\textdegree{}",
    "µ": r"$\mu$",
    "‖": r"$\|$",
}
"""What LaTeX would take for its own, or may not know."""


def csv_text(rows: Iterable[Row]) -> str:
    """One line for each number of each table."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("table", "v_max", "vehicle", "flights", "good", "column", "ours", "deviation", "paper", "ratio"))
    for row in rows:
        for column in row.table.columns:
            numbers = (row.ours[column], row.deviation[column], (row.paper or {}).get(column), row.ratio[column])
            shown = ["" if value is None else f"{value:.6g}" for value in numbers]
            where = (row.table.number, f"{row.v_max:g}", row.vehicle, row.flights, row.good, column)
            writer.writerow((*where, *shown))
    return text.getvalue()


def latex_escaped(text: str) -> str:
    """``text`` as LaTeX prints it."""
    return "".join(_LATEX.get(letter, letter) for letter in text)


def latex_table(table: TextTable, label: str) -> str:
    """``table`` in the style of the package booktabs; its first column is left-aligned."""
    lines = [r"\begin{table}", r"\centering", rf"\caption{{{latex_escaped(table.title)}}}", rf"\label{{{label}}}"]
    lines += [rf"\begin{{tabular}}{{l{'r' * (len(table.columns) - 1)}}}", r"\toprule", _latex_row(table.columns)]
    lines += [r"\midrule", *map(_latex_row, table.rows), r"\bottomrule", r"\end{tabular}", r"\end{table}"]
    return "\n".join(lines) + "\n"


def latex_text(tables: Mapping[str, TextTable]) -> str:
    r"""All ``tables``, by their labels, to be \input into a document."""
    head = "% Needs \\usepackage{booktabs}, \\usepackage{textcomp}.\n\n"
    return head + "\n".join(latex_table(table, label) for label, table in tables.items())


def markdown_table(table: TextTable) -> str:
    """``table`` with its title."""
    head = "| " + " | ".join(_markdown(column) for column in table.columns) + " |"
    rule = "| --- |" + " ---: |" * (len(table.columns) - 1)
    rows = ["| " + " | ".join(_markdown(cell) for cell in row) + " |" for row in table.rows]
    return "\n".join((f"**{table.title}**", "", head, rule, *rows)) + "\n"


def tables_by_label(rows: Mapping[int, Sequence[Row]]) -> dict[str, TextTable]:
    """The tables of ``rows``, by "table:N"."""
    return {f"table:{number}": paper_table_text(of_it) for number, of_it in rows.items() if of_it}


def _latex_row(cells: Sequence[str]) -> str:
    return " & ".join(latex_escaped(cell) for cell in cells) + r" \\"


def _markdown(text: str) -> str:
    return text.replace("|", r"\|")
