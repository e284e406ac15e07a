"""Parameter grids."""

import pytest

from flightapp.evaluation.grid import combinations, label, read_grid
from flightapp.inputs import BadInputError


def test_every_combination_of_all_values():
    grid = read_grid(["race.v_max=2, 4,6", "control.controller=paper,mpc"])
    assert grid == [("race.v_max", ("2", "4", "6")), ("control.controller", ("paper", "mpc"))]
    labels = [label(chosen) for chosen in combinations(grid)]
    assert labels[:3] == [
        "race.v_max=2, control.controller=paper",
        "race.v_max=2, control.controller=mpc",
        "race.v_max=4, control.controller=paper",
    ]
    assert len(set(labels)) == 6
    assert combinations([]) == [()]


def test_commas_inside_brackets_and_quotes_are_not_between_values():
    grid = read_grid(["sim.faults=[],[[8.0,'pose_silent',0.5]]", "mission.parameters={a=1,b=2},{}", "x.y='a,b'"])
    assert [len(values) for _, values in grid] == [2, 2, 1]
    assert grid[0][1][1] == "[[8.0,'pose_silent',0.5]]"


@pytest.mark.parametrize("text", ["race.v_max", "race.v_max=", "=2", "race.v_max=2,,3", "race.v_max=2,2"])
def test_what_is_no_grid_is_told(text):
    with pytest.raises(BadInputError, match="--grid"):
        read_grid([text])


def test_a_setting_given_twice_is_told():
    with pytest.raises(BadInputError, match=r"race\.v_max is given twice"):
        read_grid(["race.v_max=2", "race.v_max=4"])
