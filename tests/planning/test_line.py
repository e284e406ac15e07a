"""The line being flown, scans and passages."""

import math

import numpy as np
import pytest

from flightapp.messages import GateEstimate
from flightapp.planning.line import Line
from flightapp.planning.passage import crossing
from flightapp.planning.scan import heading, yaw_scan
from flightapp.trajectory import hover


def test_a_successor_takes_over_exactly_at_its_stamp():
    line = Line()
    assert line.at(0.0) is None
    first, second = hover(0.0, np.zeros(3), 0.0), hover(1.0, np.ones(3), 0.5)
    line.accept(first)
    line.accept(second)
    assert line.at(0.999) is first
    assert line.latest is second
    assert line.motion(1.0).yaw == 0.5
    assert line.motion(0.5).yaw == 0.0
    assert line.at(1.0) is second
    assert line.at(2.0) is second


def test_a_newer_successor_replaces_one_that_has_not_begun():
    line = Line()
    first, second, third = (hover(t, np.full(3, t), 0.0) for t in (0.0, 2.0, 1.0))
    line.accept(first)
    line.accept(second)
    line.accept(third)
    assert line.at(0.5) is first
    assert line.at(1.5) is third
    assert line.at(2.5) is third


def test_a_cleared_line_has_nothing_to_follow():
    line = Line()
    line.accept(hover(0.0, np.zeros(3), 0.0))
    line.clear()
    assert line.at(1.0) is None
    assert line.latest is None
    with pytest.raises(LookupError):
        line.motion(1.0)


def test_a_scan_sees_both_sides_at_its_rate_and_starts_without_a_jump():
    scan = yaw_scan(0.0, np.array((1.0, 2.0, 3.0)), yaw=0.2, centre=0.5, half_width=1.0, yaw_rate=0.8)
    samples = scan.sample(np.linspace(0.0, scan.duration, 2000))
    assert samples.yaw[0] == pytest.approx(0.2)
    assert samples.yaw[-1] == pytest.approx(0.5)
    assert samples.yaw.max() == pytest.approx(1.5, abs=1e-3)
    assert samples.yaw.min() == pytest.approx(-0.5, abs=1e-3)
    assert np.abs(samples.yaw_rate).max() <= 0.8 + 1e-9
    assert np.abs(np.diff(samples.yaw)).max() < 0.02
    assert np.array_equal(samples.position[777], (1.0, 2.0, 3.0))


def test_heading_points_at_the_target():
    assert heading(np.zeros(3), np.array((-1.0, 1.0, 5.0))) == pytest.approx(3 * math.pi / 4)


GATE = GateEstimate(1, np.array((5.0, 0.0, 1.5)), 0.0, np.zeros((4, 4)), 9, 0.0)


def test_a_crossing_is_noticed_with_its_offset():
    crossed = crossing(np.array((4.0, 0.3, 1.5)), np.array((6.0, 0.3, 1.9)), GATE)
    assert crossed is not None
    assert crossed.offset == pytest.approx(math.hypot(0.3, 0.2))


@pytest.mark.parametrize(
    ("before", "after"),
    [((6.0, 0.0, 1.5), (4.0, 0.0, 1.5)), ((3.0, 0.0, 1.5), (4.9, 0.0, 1.5)), ((5.1, 0.0, 1.5), (7.0, 0.0, 1.5))],
)
def test_backwards_before_and_beyond_are_not_crossings(before, after):
    assert crossing(np.array(before), np.array(after), GATE) is None
