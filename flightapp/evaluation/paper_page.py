"""The paper's experiments on one page, and as a page of Markdown."""

from collections.abc import Mapping, Sequence
from typing import Any

from flightapp.evaluation.experiments import Experiment
from flightapp.evaluation.page import Heading, page_html
from flightapp.evaluation.paper_documents import markdown_table, tables_by_label
from flightapp.evaluation.paper_figures import paper_figures
from flightapp.evaluation.paper_rows import Row
from flightapp.evaluation.paper_tables import profile_table
from flightapp.evaluation.tables import TextTable

REMARKS = "Ratios that are not below 1 (*), and flights that failed"
DIFFERS = "What is not the same"
LEGEND = (
    "Means over the successful flights ± standard deviation over the seeds. RMSE as the paper defines it: position or"
    " velocity, reference − estimate; below it the same by ground truth. total: √ mean ‖e‖²."
)

Rows = Mapping[int, Sequence[Row]]
Remarks = Sequence[tuple[str, str]]
"""Where, and why."""


def all_tables(rows: Rows, profile: Sequence[Mapping[str, Any]], limit: TextTable | None) -> dict[str, TextTable]:
    """Every table that there is, by its label."""
    tables = tables_by_label(rows)
    if profile:
        tables["table:14"] = profile_table(profile)
    if limit is not None:
        tables["table:limit"] = limit
    return tables


def counted(rows: Rows) -> tuple[int, int]:
    """How many numbers of which less is better there are beside one of the paper's, and how many are less."""
    pairs = [(row, column) for of_it in rows.values() for row in of_it if row.paper for column in row.table.judged]
    ratios = [row.ratio[column] for row, column in pairs]
    return len(ratios), sum(ratio is not None and ratio < 1.0 for ratio in ratios)


def paper_page(
    rows: Rows,
    traces: Mapping[tuple[str, float], Mapping[str, Any]],
    tables: Mapping[str, TextTable],
    experiments: Sequence[Experiment],
    remarks: Remarks,
    command: str,
) -> str:
    """The page; ``command`` made it."""
    numbers, better = counted(rows)
    flown = {(row.table.number, row.v_max, row.vehicle): row for of_it in rows.values() for row in of_it}
    one_each = {(row.v_max, row.vehicle, row.table.mission): row for row in flown.values()}
    facts = (
        ("numbers of which less is better", str(numbers)),
        ("less than the paper's", str(better)),
        ("flights", str(sum(row.flights for row in one_each.values()))),
        ("of them successful", str(sum(row.good for row in one_each.values()))),
    )
    figures = paper_figures(traces)
    parts = list(tables.values())
    if remarks:
        parts.append(TextTable(REMARKS, ("where, and why",), [[f"{where}: {why}"] for where, why in remarks]))
    parts.append(TextTable(DIFFERS, ("experiment",), [[f"{e.title}: {e.differs}"] for e in experiments]))
    wide = [name for name in figures if name[4:] in {"a", "b", "c"} or name in {"fig5", "fig7"}]
    wide += [table.title for table in parts]
    good = numbers == better
    heading = Heading(
        "The paper's experiments", f"{better} of {numbers} numbers below the paper's", good, f"{LEGEND} · {command}"
    )
    return page_html(heading, facts, figures, parts, wide)


def paper_markdown(
    rows: Rows, tables: Mapping[str, TextTable], experiments: Sequence[Experiment], remarks: Remarks, command: str
) -> str:
    """The same without figures."""
    numbers, better = counted(rows)
    lines = ["# The paper's experiments, flown in simulation", ""]
    lines += [f"Made by `{command}`.", "", f"{LEGEND} A star marks ratios that are not below 1.", ""]
    lines += [f"Of {numbers} RMSEs and elapsed times that the paper gives, {better} are less here.", ""]
    lines += ["## What is not the same", "", *(f"- **{e.title}**: {e.differs}" for e in experiments), ""]
    lines += ["## Tables", "", *(markdown_table(table) for table in tables.values())]
    if remarks:
        lines += [f"## {REMARKS}", "", *(f"- {where}: {why}" for where, why in remarks), ""]
    return "\n".join(lines)
