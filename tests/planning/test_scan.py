"""Looking around on the spot."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightapp.config import load_config
from flightapp.planning.scan import TURN_SHARE, around, heading, turn_rate, turns
from flightapp.planning.splice import splice_fault

PLACE = np.array((1.0, 2.0, 3.0))
ANGLES = st.floats(-10.0, 10.0)


@given(st.lists(ANGLES, min_size=2, max_size=5), st.floats(0.2, 3.0))
def test_turns_go_through_their_headings_smoothly_and_at_their_rate(yaws, rate):
    if max(abs(b - a) for a, b in itertools.pairwise(yaws)) < 1e-6:
        return
    scan = turns(5.0, PLACE, yaws, rate)
    assert splice_fault(scan, None) == ""
    samples = scan.sample(np.linspace(0.0, scan.duration, 3000))
    assert samples.yaw[0] == pytest.approx(yaws[0])
    assert samples.yaw[-1] == pytest.approx(yaws[-1])
    assert samples.yaw.max() == pytest.approx(max(yaws), abs=1e-3)
    assert samples.yaw.min() == pytest.approx(min(yaws), abs=1e-3)
    assert np.abs(samples.yaw_rate).max() <= rate + 1e-9
    assert np.array_equal(samples.position[777], PLACE)


@given(ANGLES, ANGLES, st.floats(0.1, math.pi))
def test_a_scan_sees_all_round_and_what_is_ahead_first(yaw, centre, half_width):
    first, side, end = around(yaw, centre, half_width)
    assert first == yaw
    assert abs(end - side) == pytest.approx(2.0 * math.pi)
    assert abs(math.remainder(side - centre, 2.0 * math.pi)) == pytest.approx(half_width)
    # From the first side the scan leads over the centre to the other side before all else.
    over = math.copysign(1.0, end - side)
    assert math.remainder(side + over * half_width - centre, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-9)
    assert abs(side - yaw) <= math.pi + 1e-9


def test_a_scan_is_no_faster_than_the_camera_and_the_vehicle_allow():
    brisk = load_config(overrides=["camera.exposure=0.0001"])
    assert turn_rate(brisk) == pytest.approx(TURN_SHARE * brisk.vehicle.yaw_rate_max)
    slow = load_config(overrides=["camera.exposure=0.02"])
    assert turn_rate(slow) * slow.camera.exposure * slow.camera.focal[0] == pytest.approx(1.5)


def test_heading_points_at_the_target():
    assert heading(np.zeros(3), np.array((-1.0, 1.0, 5.0))) == pytest.approx(3 * math.pi / 4)
