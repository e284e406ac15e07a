"""Which gates may be flown through now."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightapp.messages import GateEstimate
from flightapp.planning.course import EXIT_RUN, KNOWN_YAW, course, horizontal_sigma, is_known

START = np.array((0.0, 0.0, 1.0))
FINISH = np.array((30.0, 0.0, 1.0))


def gate(gate_id, x, y=0.0, z=1.5, sigma=0.05, sightings=10, yaw=0.0):
    P = np.diag((sigma**2, sigma**2, sigma**2, 0.01))
    return GateEstimate(gate_id, np.array((x, y, z)), yaw, P, sightings, 0.0)


def test_known_gates_lead_to_the_finish():
    gates = [gate(1, 10.0), gate(2, 20.0)]
    leg = course(gates, START, FINISH, 0.3, 4.0, 8)
    assert [g.gate_id for g in leg.gates] == [1, 2]
    assert leg.waiting_for is None
    assert np.array_equal(leg.end, FINISH)


def test_an_unknown_gate_is_waited_for_a_standoff_before_it_and_none_behind_it_is_planned():
    gates = [gate(1, 10.0), gate(2, 20.0, sigma=1.5, sightings=0), gate(3, 25.0)]
    leg = course(gates, START, FINISH, 0.3, 4.0, 8)
    assert [g.gate_id for g in leg.gates] == [1]
    assert leg.waiting_for is gates[1]
    assert leg.end == pytest.approx((16.0, 0.0, 1.5))


def test_known_gates_beyond_the_horizon_are_left_for_later():
    gates = [gate(k, 10.0 * k) for k in range(1, 6)]
    leg = course(gates, START, FINISH, 0.3, 4.0, 3)
    assert [g.gate_id for g in leg.gates] == [1, 2, 3]
    assert leg.waiting_for is None
    assert leg.following is leg.beyond is gates[3]
    assert leg.end == pytest.approx((36.0, 0.0, 1.5))
    assert course(gates[2:], START, FINISH, 0.3, 4.0, 3).following is None


def test_where_nothing_is_known_of_the_next_gate_the_course_ends_looking_out_of_the_last():
    known = gate(1, 10.0, yaw=math.pi / 2)
    leg = course([known, None, gate(3, 25.0)], START, FINISH, 0.3, 4.0, 8)
    assert leg.gates == (known,)
    assert leg.blind
    assert leg.following is None
    assert leg.end == pytest.approx((10.0, EXIT_RUN, 1.5))


def test_with_no_gate_known_at_all_there_is_nowhere_to_go():
    leg = course([None, gate(2, 20.0)], START, FINISH, 0.3, 4.0, 8)
    assert leg.gates == ()
    assert leg.blind
    assert leg.end == pytest.approx(START)


def test_a_gate_is_not_flown_through_before_its_direction_is_known():
    vague = gate(1, 10.0)
    vague.covariance[3, 3] = (KNOWN_YAW + 0.01) ** 2
    assert not is_known(vague, 0.3)
    vague.covariance[3, 3] = (KNOWN_YAW - 0.01) ** 2
    assert is_known(vague, 0.3)


def test_near_the_unknown_first_gate_the_drone_stays_where_it_is():
    leg = course([gate(1, 3.0, sigma=1.5)], START, FINISH, 0.3, 4.0, 8)
    assert leg.gates == ()
    assert np.array_equal(leg.end, START)


def test_a_course_ends_behind_the_last_known_gate_even_when_the_next_is_near():
    known = gate(1, 10.0, yaw=math.pi / 2)
    leg = course([known, gate(2, 12.0, sigma=1.5)], START, FINISH, 0.3, 4.0, 8)
    assert leg.end == pytest.approx((10.0, EXIT_RUN, 1.5))


def test_sightings_count_as_much_as_their_covariance():
    assert is_known(gate(1, 0.0), 0.3)
    assert not is_known(gate(1, 0.0, sightings=2), 0.3)
    assert not is_known(gate(1, 0.0, sigma=0.31), 0.3)


@given(st.floats(0.01, 3.0), st.floats(0.01, 3.0), st.floats(-math.pi, math.pi))
def test_horizontal_sigma_is_the_long_axis_of_the_ellipse(a, b, angle):
    c, s = math.cos(angle), math.sin(angle)
    R = np.array(((c, -s), (s, c)))
    P = np.zeros((4, 4))
    P[:2, :2] = R @ np.diag((a * a, b * b)) @ R.T
    estimate = GateEstimate(1, np.zeros(3), 0.0, P, 0, 0.0)
    assert horizontal_sigma(estimate) == pytest.approx(max(a, b), rel=1e-6)


@given(st.floats(-20.0, 20.0), st.floats(-20.0, 20.0), st.floats(0.5, 8.0))
def test_the_waiting_point_keeps_the_standoff_wherever_the_gate_is(x, y, standoff):
    unknown = gate(1, x, y, sigma=1.5)
    leg = course([unknown], START, FINISH, 0.3, standoff, 8)
    distance = math.hypot(*(leg.end - unknown.position)[:2])
    assert distance >= min(standoff, math.hypot(x, y)) - 1e-9


@given(st.floats(-math.pi, math.pi), st.floats(-12.0, 12.0), st.floats(-12.0, 12.0))
def test_a_course_always_leads_clear_of_the_frame_of_the_gate_before(yaw, x, y):
    known = gate(1, 0.0, yaw=yaw)
    leg = course([known, gate(2, x, y, sigma=1.5)], START, FINISH, 0.3, 4.0, 8)
    out = math.cos(yaw) * leg.end[0] + math.sin(yaw) * leg.end[1]
    assert out >= EXIT_RUN - 1e-9
