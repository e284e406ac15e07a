import math

from hypothesis import given
from hypothesis import strategies as st

from flightapp.tuning.search import Range, pattern_search

RANGES = (Range("a", 0.1, 30.0), Range("b", 0.1, 30.0))


def valley(x, y, a, b):
    """A bent valley in logarithms, least at (a, b)."""
    u, v = math.log(x / a), math.log(y / b)
    return 0.1 + u * u + 3.0 * (u - v) ** 2


@given(st.floats(0.5, 10.0), st.floats(0.5, 10.0))
def test_it_finds_the_bottom_of_a_valley(a, b):
    found, cost = pattern_search(lambda p: valley(p["a"], p["b"], a, b), {"a": 2.0, "b": 2.0}, RANGES, 200)
    # The last step is by h = log 1.4 / 4. No step across the valley helps within h / 2 of its floor, and then none
    # along it within 2 h + 3 h / 2 of its bottom.
    h = math.log(1.4) / 4.0
    assert abs(math.log(found["a"] / a)) < 3.5 * h
    assert cost < 0.1 + (3.5 * h) ** 2 + 3.0 * (0.5 * h) ** 2


def test_it_stays_within_the_ranges_and_the_budget():
    asked = []

    def cost(point):
        asked.append(dict(point))
        return -point["a"] - point["b"]

    found, _ = pattern_search(cost, {"a": 1.0, "b": 1.0}, RANGES, 30)
    assert len(asked) <= 31
    assert all(r.low <= point[r.name] <= r.high for point in asked for r in RANGES)
    assert found["a"] > 5.0


def test_where_nothing_is_better_it_stays():
    start = {"a": 2.0, "b": 3.0}
    found, cost = pattern_search(lambda p: valley(p["a"], p["b"], 2.0, 3.0), start, RANGES, 100)
    assert found == start
    assert cost == valley(2.0, 3.0, 2.0, 3.0)
