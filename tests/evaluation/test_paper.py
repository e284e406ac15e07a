"""The paper's numbers, and ours beside them."""

import pytest

from flightapp.evaluation.paper import compared_tables, paper_tables, profiling_times


def test_every_table_is_there_with_its_rows():
    tables = {table.number: table for table in paper_tables()}
    assert list(tables) == list(range(1, 14))
    assert tables[1].row(5.0) == {"x": 0.2120, "y": 0.1372, "z": 0.0322, "total": 0.2249}
    assert tables[13].row(0.5) == {"v_peak": 0.5316, "v_avg": 0.2060, "elapsed": 79.1}
    assert tables[9].metric == "estimation_rmse"
    assert profiling_times()["controller"]["jetson_xavier_nx"] == 219.0e-9


@pytest.mark.parametrize(
    ("mission", "v_max", "numbers"),
    [
        ("lemniscate", 7.0, [1, 2, 3, 4, 5, 6]),
        ("five_gates", 4.0, [7, 8]),
        ("one_gate", 1, [9, 10, 11]),
        ("four_gates", 0.5, [12, 13]),
        ("five_gates", 10.0, []),
        ("mine", 4.0, []),
        ("five_gates", None, []),
    ],
)
def test_only_the_same_experiment_is_compared(mission, v_max, numbers):
    assert [table.number for table in compared_tables(mission, v_max)] == numbers
