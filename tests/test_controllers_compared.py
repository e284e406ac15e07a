from typing import get_args

from flightapp.config import Term
from flightapp.control_bench import control_tables, run_control_bench


def test_controllers_and_terms_are_flown_side_by_side():
    result = run_control_bench(("flatness", "pd"), runs=1, courses=(("lemniscate", 3.0),))
    rows = result["rows"]
    assert [(row["controller"], row["without"]) for row in rows[:2]] == [("flatness", ""), ("pd", "")]
    assert {row["without"] for row in rows[2:]} == set(get_args(Term))
    assert all(row["paper"] == 0.1381 for row in rows)
    assert rows[0]["nominal"]["rmse"] < 0.02 < rows[1]["nominal"]["rmse"]
    assert all(row["perturbed"]["runs"] == 1 for row in rows)
    controllers, paths, terms = control_tables(result)
    assert len(controllers.rows) == len(paths.rows) == 2
    assert rows[0]["nominal"]["contour"] <= rows[0]["nominal"]["rmse"]
    assert [row[0] for row in terms.rows] == ["nothing", *get_args(Term)]
    assert not any("–" in cell for row in terms.rows for cell in row)
