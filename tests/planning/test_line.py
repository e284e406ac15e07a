"""The line being flown, scans and passages."""

import math
from dataclasses import replace

import numpy as np
import pytest

from flightapp.messages import GateEstimate
from flightapp.planning.line import Line, SpliceError
from flightapp.planning.passage import crossing, in_gate
from flightapp.trajectory import hover


def turning(stamp, yaw, turn, duration=1.0):
    """At rest at the origin, turning by ``turn``."""
    still = hover(stamp, np.zeros(3), yaw, duration)
    return replace(still, yaw_coefficients=np.array([[yaw, 0.0, 3.0 * turn / duration**2, -2.0 * turn / duration**3]]))


def moving(stamp, length=1.0, duration=2.0):
    """From rest at the origin to rest ``length`` m further along x."""
    line = hover(stamp, np.zeros(3), 0.0, duration)
    line.coefficients[0, 0, 4:] = np.array((35.0, -84.0, 70.0, -20.0)) * length / duration ** np.arange(4.0, 8.0)
    return line


def test_a_successor_takes_over_exactly_at_its_stamp():
    line = Line()
    assert line.at(0.0) is None
    first, second = hover(0.0, np.zeros(3), 0.0), turning(1.0, 0.0, 0.5)
    line.accept(first)
    line.accept(second)
    assert line.at(0.999) is first
    assert line.latest is second
    assert line.motion(2.0).yaw == pytest.approx(0.5)
    assert line.motion(0.5).yaw == 0.0
    assert line.at(1.0) is second
    assert line.at(2.0) is second


def test_a_newer_successor_replaces_one_that_has_not_begun():
    line = Line()
    first, second, third = (hover(t, np.zeros(3), 0.0) for t in (0.0, 2.0, 1.0))
    line.accept(first)
    line.accept(second)
    line.accept(third)
    assert line.at(0.5) is first
    assert line.at(1.5) is third
    assert line.at(2.5) is third


def test_a_successor_of_one_that_has_not_begun_leaves_it_its_time():
    line = Line()
    first, second, third = hover(0.0, np.zeros(3), 0.0), moving(1.0), hover(4.0, np.array((1.0, 0.0, 0.0)), 0.0)
    for trajectory in (first, second, third):
        line.accept(trajectory)
    assert line.motion(1.9).position == pytest.approx(second.sample(0.9).position)
    flown = [line.at(t) for t in (0.5, 1.5, 3.9, 4.0)]
    assert all(piece is wanted for piece, wanted in zip(flown, (first, second, second, third), strict=True))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({0: 2e-6}, "position jumps by 2e-06 m"),
        ({1: 0.5}, "velocity jumps by 0.5 m/s"),
        ({2: 0.5}, "acceleration jumps by 1 m/s²"),
        ({3: 0.5}, "jerk jumps by 3 m/s³"),
        ({1: math.nan}, "not finite"),
    ],
)
def test_what_does_not_start_on_the_line_is_refused_with_the_jump(change, words):
    line = Line()
    first, second = moving(0.0), moving(3.0)
    line.accept(first)
    second.coefficients[0, :, 0] = (1.0, 0.0, 0.0)
    for power, value in change.items():
        second.coefficients[0, 1, power] += value
    with pytest.raises(SpliceError, match=words):
        line.accept(second)
    assert line.at(3.5) is first


def test_a_heading_that_jumps_is_refused():
    line = Line()
    line.accept(turning(0.0, 0.0, 1.0, 2.0))
    with pytest.raises(SpliceError, match=r"yaw rate jumps by 0\.75 rad/s"):
        line.accept(hover(1.0, np.zeros(3), 0.5))
    with pytest.raises(SpliceError, match=r"yaw jumps by 0\.1 rad"):
        line.accept(hover(2.0, np.zeros(3), 0.9))


def test_what_would_not_end_at_rest_is_refused():
    line = Line()
    unfinished = moving(0.0)
    with pytest.raises(SpliceError, match="does not end at rest: velocity"):
        line.accept(replace(unfinished, knots=np.array((0.0, 1.0))))
    spinning = replace(hover(0.0, np.zeros(3), 0.0), yaw_coefficients=np.array([[0.0, 0.3, 0.0, 0.0]]))
    with pytest.raises(SpliceError, match=r"does not end at rest: yaw rate jumps by 0\.3"):
        line.accept(spinning)
    assert line.latest is None


def test_what_jumps_between_its_segments_is_refused():
    whole = moving(0.0)
    twice = np.concatenate((whole.coefficients, np.zeros((1, 3, 8))))
    twice[1, 0, 0] = 1.001
    broken = replace(whole, knots=np.array((0.0, 2.0, 3.0)), coefficients=twice)
    with pytest.raises(SpliceError, match=r"not smooth: position jumps by 0\.001 m"):
        Line().accept(broken)
    twice[1, 0, 0] = 1.0
    Line().accept(broken)


def test_a_segment_that_takes_no_time_is_refused():
    whole = moving(0.0)
    twice = replace(whole, knots=np.array((0.0, 2.0, 2.0)), coefficients=np.repeat(whole.coefficients, 2, axis=0))
    with pytest.raises(SpliceError, match="the trajectory's segments do not all take some time: 0 s"):
        Line().accept(twice)


def test_what_comes_after_its_start_is_late():
    line = Line()
    line.accept(hover(0.0, np.zeros(3), 0.0))
    line.at(2.0)
    with pytest.raises(SpliceError, match=r"late by 0\.500 s"):
        line.accept(hover(1.5, np.zeros(3), 0.0))


def test_a_line_is_at_rest_when_its_heading_is():
    line = Line()
    assert not line.at_rest(0.0)
    line.accept(replace(moving(0.0), yaw_knots=np.array((0.0, 3.0))))
    assert not line.at_rest(2.5)
    assert line.at_rest(3.0)


def test_a_cleared_line_has_nothing_to_follow():
    line = Line()
    line.accept(hover(0.0, np.zeros(3), 0.0))
    line.clear()
    assert line.at(1.0) is None
    assert line.latest is None
    with pytest.raises(LookupError):
        line.motion(1.0)


GATE = GateEstimate(1, np.array((5.0, 0.0, 1.5)), 0.0, np.zeros((4, 4)), 9, 0.0)


def test_a_crossing_is_noticed_with_its_offset():
    crossed = crossing(in_gate(np.array((4.0, 0.3, 1.5)), GATE), in_gate(np.array((6.0, 0.3, 1.9)), GATE))
    assert crossed is not None
    assert crossed.offset == pytest.approx(math.hypot(0.3, 0.2))


def test_a_correction_of_the_map_does_not_hide_a_crossing():
    """The gate turns out to be where the vehicle has just been: both points are behind the corrected plane."""
    corrected = replace(GATE, position=np.array((4.8, 0.0, 1.5)))
    before, after = np.array((4.85, 0.1, 1.5)), np.array((4.9, 0.1, 1.5))
    assert crossing(in_gate(before, corrected), in_gate(after, corrected)) is None
    assert crossing(in_gate(before, GATE), in_gate(after, corrected)) is not None


@pytest.mark.parametrize(
    ("before", "after"),
    [((6.0, 0.0, 1.5), (4.0, 0.0, 1.5)), ((3.0, 0.0, 1.5), (4.9, 0.0, 1.5)), ((5.1, 0.0, 1.5), (7.0, 0.0, 1.5))],
)
def test_backwards_before_and_beyond_are_not_crossings(before, after):
    assert crossing(in_gate(np.array(before), GATE), in_gate(np.array(after), GATE)) is None
