"""How planning time grows with the number of points."""

import pytest

from flightapp.evaluation.growth import Growth, growth_page, growth_tables, measure_growth, wavy_course


def test_the_exponent_is_that_of_the_power():
    points = (10, 20, 50, 100)
    assert Growth("race", points, tuple(1e-4 * n for n in points)).exponent == pytest.approx(1.0)
    assert Growth("race", points, tuple(1e-4 * n**2 for n in points)).exponent == pytest.approx(2.0)


def test_each_planner_has_a_figure_and_a_table():
    measured = tuple(measure_growth({"polynomial": (6, 14), "race": (3, 4)}))
    assert all(taken > 0.0 for growth in measured for taken in growth.seconds)
    page = growth_page(measured)
    for growth, table in zip(measured, growth_tables(measured), strict=True):
        assert f'id="figure-{growth.planner}"' in page
        assert [row[0] for row in table.rows] == [str(n) for n in growth.points]


def test_a_course_has_as_many_points_as_it_should():
    request, waypoints = wavy_course(14)
    assert len(waypoints) == 13
    assert request.end.shape == (3,)
