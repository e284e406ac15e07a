"""The paper's tables beside ours: rows by hand, and the documents they go to."""

import csv
import io
import math
import re
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightapp.evaluation.experiments import EXPERIMENTS, needed, read_only
from flightapp.evaluation.paper import AXES, paper_tables
from flightapp.evaluation.paper_documents import csv_text, latex_escaped, latex_table, latex_text, markdown_table
from flightapp.evaluation.paper_page import counted, paper_markdown
from flightapp.evaluation.paper_rows import row_json, row_of
from flightapp.evaluation.paper_tables import paper_table_text, profile_remarks, profile_table, remark_lines
from flightapp.evaluation.tables import TextTable
from flightapp.inputs import BadInputError

TABLES = {table.number: table for table in paper_tables()}
LEMNISCATE = next(experiment for experiment in EXPERIMENTS if experiment.name == "lemniscate_sim")
FOUR = next(experiment for experiment in EXPERIMENTS if experiment.name == "four_gates_real")


def result(factor=1.0, outcome="GOAL_ACHIEVED", elapsed=10.0):
    errors = {"x": 0.01 * factor, "y": 0.02 * factor, "z": 0.02 * factor, "total": 0.03 * factor}
    kinds = ("tracking_rmse", "tracking_rmse_truth", "speed_rmse", "speed_rmse_truth", "estimation_rmse")
    times = {"v_peak": 3.0, "v_avg": 2.0, "elapsed": elapsed}
    summary = {"outcome": outcome, "gates": [], "collisions": [], **dict.fromkeys(kinds, errors), **times}
    return {"seed": 0, "label": "x", "parameters": {}, "command": "", "reason": "", "summary": summary}


def test_a_row_by_hand():
    flown = [result(1.0), result(3.0), result(9.0, "WRONG_PROGRESS"), {"seed": 3, "why": "its process died"}]
    row = row_of(TABLES[1], LEMNISCATE, 3.0, flown)
    assert (row.flights, row.good) == (4, 2)
    assert row.ours["total"] == pytest.approx(0.06)
    assert row.deviation["x"] == pytest.approx(0.01 * math.sqrt(2.0))
    assert row.ratio["total"] == pytest.approx(0.06 / 0.1381)
    assert row.other["total"] == pytest.approx(0.06)
    z = "z 3.20 × the paper's: not explained"
    assert row.why == ("2 of 4 flights failed: 1 × WRONG_PROGRESS, 1 × its process died", z)
    told = row_json(row)
    assert told["ratio"]["z"] == pytest.approx(0.04 / 0.0125)
    assert told["paper"]["z"] == 0.0125
    assert told["by_truth"]["y"] == pytest.approx(0.04)


def test_a_total_that_the_paper_makes_smaller_than_its_axes_is_said_to_be():
    (why,) = [text for text in row_of(TABLES[2], LEMNISCATE, 3.0, [result(4.0)]).why if text.startswith("total")]
    root = math.sqrt(0.2033**2 + 0.1287**2 + 0.0325**2)
    assert why.startswith("total 1.11 × the paper's: the paper's total, 0.1077, is less than its x, 0.2033;")
    assert f"{root:.4f}" in why
    assert why.endswith(f"the ratio is {0.12 / root:.2f}")


def test_flights_that_are_closer_to_the_papers_tell_what_makes_the_difference():
    row = row_of(TABLES[1], LEMNISCATE, 3.0, [result()], [result(0.5), result(9.0, "PROCESS_FAILURE")])
    assert row.why == ("z 1.60 × the paper's: with the simulator's state it is 0.80 ×",)
    assert paper_table_text([row]).rows[2] == ["with the simulator's state", "0.0050", "0.0100", "0.0100", "0.0150", ""]
    assert row_json(row)["closer"]["z"] == pytest.approx(0.01)


def test_an_estimate_that_is_worse_than_the_bare_tracker_is_said_to_be():
    gate = next(experiment for experiment in EXPERIMENTS if experiment.name == "one_gate_real")
    flown = result(4.0)
    flown["summary"]["tracker_rmse"] = {"x": 0.1, "y": 0.00865, "z": 0.2, "total": 0.224}
    (why,) = row_of(TABLES[9], gate, 2.0, [flown]).why
    told = (
        "y 4.62 × the paper's: the tracker alone is at 0.50 × there; fused with sightings of one gate it goes to this"
    )
    assert why == f"{told}, and the total from 0.224 to 0.120 m"


def test_where_the_papers_state_was_exact_ours_is_judged_by_truth_too():
    flown = result(0.5)
    flown["summary"]["tracking_rmse_truth"] = {"x": 0.1, "y": 0.1, "z": 0.1, "total": 0.173}
    told = f"by truth, as the paper's state was exact, total is {0.173 / 0.1381:.2f} ×, the tracker's errors included"
    assert row_of(TABLES[1], LEMNISCATE, 3.0, [flown]).why == (told,)
    near = row_of(TABLES[1], LEMNISCATE, 3.0, [flown], [result(0.5)]).why
    assert near == (f"{told}; with the simulator's state it is {0.015 / 0.1381:.2f} ×",)
    real = next(experiment for experiment in EXPERIMENTS if experiment.name == "lemniscate_real")
    assert row_of(TABLES[4], real, 3.0, [flown]).why == ()


def test_without_a_success_there_are_no_numbers_and_a_speed_beyond_has_no_ratio():
    row = row_of(TABLES[12], FOUR, 1.0, [result(1.0, "PROCESS_FAILURE")])
    assert set(row.ours.values()) == set(row.ratio.values()) == {None}
    assert row.why == ("1 of 1 flights failed: 1 × PROCESS_FAILURE",)
    beyond = row_of(TABLES[13], FOUR, 4.0, [result()])
    assert beyond.paper is None
    assert beyond.why == ()
    lines = paper_table_text([row, beyond]).rows
    assert lines[-1] == ["v_max 4, f330: ours", "3.0000", "2.0000", "10.00", "1 of 1"]


def test_only_less_elapsed_time_is_better_among_the_speeds():
    slow = row_of(TABLES[3], LEMNISCATE, 3.0, [result(elapsed=30.0)])
    assert slow.why == (f"elapsed {30.0 / 27.7:.2f} × the paper's: not explained",)
    assert counted({3: [slow], 1: [row_of(TABLES[1], LEMNISCATE, 5.0, [result()])]}) == (5, 4)
    assert remark_lines({3: [slow]}) == [("table 3, v_max 3", slow.why[0])]
    assert paper_table_text([slow]).rows[-1][-2].endswith("*")


def test_csv_has_every_number():
    row = row_of(TABLES[3], LEMNISCATE, 3.0, [result(), result(elapsed=20.0)])
    lines = list(csv.DictReader(io.StringIO(csv_text([row]))))
    assert [line["column"] for line in lines] == ["v_peak", "v_avg", "elapsed"]
    assert (lines[2]["ours"], lines[2]["paper"], lines[2]["good"]) == ("15", "27.7", "2")
    assert float(lines[2]["deviation"]) == pytest.approx(50.0**0.5, rel=1e-5)


@given(st.text(st.sampled_from("ab &%$#_{}~^\\<>±×−√²|")))
def test_escaped_text_has_nothing_that_latex_takes_for_its_own(text):
    escaped = latex_escaped(text)
    commands = r"\\(textbackslash|textasciitilde|textasciicircum|textless|textgreater|textsuperscript|textdegree)\{2?\}"
    left = re.sub(commands, "", escaped)
    left = re.sub(r"\$(\\[a-z]+|-|\\\|)\$", "", left)
    left = re.sub(r"\\[&%$#_{}]", "", left)
    assert not set(left) & set("&%$#_{}~^\\")
    assert escaped.count("&") == text.count("&")


def test_a_latex_table_has_as_many_cells_in_each_row_as_columns():
    table = TextTable("50 % & more_or_less", ("", "a_b", "c"), [["x & y", "0.1 ± 0.2", "–"], ["{", "}", "\\"]])
    made = latex_table(table, "table:x")
    assert r"\caption{50 \% \& more\_or\_less}" in made
    assert r"\begin{tabular}{lrr}" in made
    body = made.split(r"\toprule")[1].split(r"\bottomrule")[0].replace(r"\midrule", "")
    rows = [row for row in body.splitlines() if row.strip()]
    assert len(rows) == 3
    assert all(row.endswith(r" \\") for row in rows)
    assert [len(re.findall(r"(?<!\\)&", row)) for row in rows] == [2, 2, 2]
    unescaped = re.sub(r"\\[{}]", "", made)
    assert unescaped.count("{") == unescaped.count("}")
    assert latex_text({"table:x": table, "table:y": table}).count(r"\end{table}") == 2


def test_markdown():
    row = row_of(TABLES[1], LEMNISCATE, 3.0, [result()])
    text = markdown_table(paper_table_text([row]))
    assert len({line.count(" |") for line in text.splitlines()[2:]}) == 1
    page = paper_markdown(
        {1: [row]}, {"table:1": paper_table_text([row])}, [LEMNISCATE], remark_lines({1: [row]}), "flightapp paper"
    )
    assert LEMNISCATE.differs in page
    assert "- table 1, v_max 3: z 1.60 × the paper's: not explained" in page


def test_profiles():
    measured = [{"name": "plan_6", "p50": 1e-4}, {"name": "race_plan", "p50": 1e-2}]
    assert profile_table(measured).rows == [["trajectory, 6 points", "100 µs", "13.7 ms", "51.5 ms", "0.0073"]]
    assert profile_remarks(measured) == []
    slow = [{"name": "controller", "p50": 2.0 * 62.3e-9}, {"name": "plan_6", "p50": 1.0}]
    where = ["table 14, controller, one command", "table 14, trajectory, 6 points"]
    assert [place for place, _ in profile_remarks(slow)] == where
    assert profile_table(slow).rows[0][-1] == "2.0000*"


def test_every_table_of_the_paper_has_an_experiment_that_flies_its_rows():
    for table in TABLES.values():
        flown = {f"{v_max:g}" for e in EXPERIMENTS if table.number in e.tables for v_max in e.v_max}
        assert flown == set(table.rows), table.number
        assert all(set(numbers) <= {*AXES, "v_peak", "v_avg", "elapsed"} for numbers in table.rows.values())


def test_tables_are_chosen_by_their_numbers():
    assert read_only(None) == tuple(range(1, 15))
    assert read_only("table7, 8") == (7, 8)
    assert [experiment.name for experiment in needed((7,))] == ["five_gates_sim"]
    assert needed((14,)) == []
    with pytest.raises(BadInputError, match="'table15' is no table of the paper; table1 to table14"):
        read_only("table15")
    assert replace(LEMNISCATE, beyond=(9.0,)).beyond == (9.0,)
