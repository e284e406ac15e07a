"""Which collisions a fault forces."""

import numpy as np
import pytest

from flightapp.evaluation.forced import BRAKING, LEANING, gap, is_forced, stopping_distance, turned_over
from flightapp.planning.below import ASIDE
from flightapp.track import Box, Gate, GateShape, Start, Track

RADIUS = 0.2
TRACK = Track(
    name="one",
    start=Start(position=(0.0, 0.0, 0.0)),
    finish=(12.0, 0.0, 1.5),
    gate=GateShape(opening=1.4, border=0.4, layout="top"),
    gates=(Gate(id=7, position=(8.0, 0.0, 1.5), yaw_deg=0.0, markers=(0,)),),
    obstacles=(Box(name="table", centre=(4.0, 5.0, 0.5), size=(1.0, 1.0, 1.0)),),
)


def test_gaps_are_those_to_the_frame_and_to_obstacles_by_their_names():
    assert gap(TRACK, "gate 7", np.array((8.0, 0.0, 1.5)), RADIUS) == pytest.approx(0.7 - RADIUS)
    assert gap(TRACK, "gate 7", np.array((6.0, 1.0, 1.5)), RADIUS) == pytest.approx(2.0 - 0.025 - RADIUS, abs=0.03)
    assert gap(TRACK, "table", np.array((4.0, 3.0, 0.5)), RADIUS) == pytest.approx(1.5 - RADIUS)
    assert gap(TRACK, "ground", np.array((4.0, 3.0, 0.5)), RADIUS) == np.inf


def test_it_takes_longer_to_stop_from_a_higher_speed_and_where_nobody_brakes_for_a_while():
    assert stopping_distance(0.0, 1.0) == ASIDE
    assert stopping_distance(3.0, 0.0) == pytest.approx(3.0 * LEANING + 9.0 / (2.0 * BRAKING) + ASIDE)
    assert stopping_distance(3.0, 0.6) == pytest.approx(1.8 + 0.75 + 1.5 + ASIDE)


@pytest.mark.parametrize(
    ("x", "speed", "blind", "forced"),
    [(5.0, 3.0, 0.6, True), (5.0, 1.0, 0.6, False), (2.0, 3.0, 0.6, False), (7.9, 0.5, 0.0, False)],
)
def test_only_what_is_nearer_than_it_takes_to_stop_is_forced(x, speed, blind, forced):
    place = np.array((x, 0.0, 1.5))
    assert is_forced(TRACK, "gate 7", place, speed, RADIUS, blind) is forced
    assert not is_forced(TRACK, "ground", place, speed, RADIUS, blind)


def test_what_the_last_body_rates_lay_on_its_side_is_turned_over():
    assert turned_over(0.0, 3.0, 0.6)
    assert not turned_over(0.0, 2.0, 0.6)
    assert turned_over(0.5, 2.0, 0.6)
    assert not turned_over(2.0, 8.0, 0.0)
