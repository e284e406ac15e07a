import json
import math

import numpy as np
import pytest

from flightapp.evaluation.plan_table import plan_rows, rows_json, rows_table, yardsticks
from flightapp.inputs import BadInputError
from flightapp.interfaces import PlanningError
from flightapp.planning.polynomial import PolynomialPlanner


def test_the_courses_are_as_long_as_their_least_times_say():
    for course in yardsticks().courses:
        way = np.vstack((course.start, course.points, course.finish))
        length = np.linalg.norm(np.diff(way, axis=0), axis=1).sum()
        for v_max, least, full in course.optimum:
            slack = 2.0 * yardsticks().radius * len(course.points)
            assert math.isinf(v_max) or least > (length - slack) / v_max
            assert least <= 1.005 * full


def test_a_row_tells_how_a_plan_compares_and_what_it_exceeds():
    row = next(plan_rows(["polynomial"]))
    assert (row.course, row.v_max, row.planner, row.optimum) == ("lemniscate", 3.0, "polynomial", 10.23)
    assert row.ratio == pytest.approx(row.duration / 10.23)
    assert 1.0 < row.ratio < 1.5
    assert -0.5 < row.excess < 1e-3
    assert row.excess == max(row.speed_excess, row.thrust_excess, row.least_thrust_excess, row.rate_excess)
    assert row.optimum < row.stored < row.duration
    assert row.offset < 0.02
    assert row.plan_time > 0.0


def test_a_speed_without_limit_is_null_in_json_and_a_dash_in_the_table(monkeypatch):
    def refuse(*_):
        raise PlanningError("no")

    monkeypatch.setattr(PolynomialPlanner, "through", refuse)
    rows = list(plan_rows(["polynomial"]))
    made = json.loads(json.dumps(rows_json(rows), allow_nan=False))["rows"]
    assert [row["v_max"] for row in made[:4]] == [3.0, 5.0, 7.0, None]
    assert made[0]["duration"] is None
    assert made[0]["why"] == "no"
    assert rows_table(rows).rows[3][1] == "–"


def test_an_unknown_planner_is_named():
    with pytest.raises(BadInputError, match="polynomal"):
        next(plan_rows(["polynomal"]))
