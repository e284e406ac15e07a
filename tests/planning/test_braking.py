"""Coming to rest along the line."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from flightapp.config import load_config
from flightapp.interfaces import Limits, Motion, PlanRequest
from flightapp.planning.braking import Brakes
from flightapp.planning.line import Line
from flightapp.planning.polynomial import PolynomialPlanner
from flightapp.trajectory import hover

CONFIG = load_config()
BRAKES = Brakes(CONFIG)
ORIGIN = np.array((0.0, 0.0, 1.5))
WAY = np.array([(6.0, 2.0, 1.5), (12.0, -2.0, 2.5), (20.0, 0.0, 1.5)])


def flown(v_max=6.0, a_max=8.0):
    """A flight through three points, and its limits."""
    limits = Limits(v_max, a_max, 3.0)
    rest = Motion(ORIGIN, *np.zeros((3, 3)), 0.0, 0.0)
    request = PlanRequest(10.0, rest, (), WAY[-1], limits)
    return PolynomialPlanner(CONFIG).through(WAY, request), limits


LINE, LIMITS = flown()


@settings(deadline=None, max_examples=100)
@given(st.floats(0.0, 1.0))
@example(1e-6)  # just before the end the rate is nothing by rounding
def test_it_takes_over_without_a_jump_stays_on_the_path_and_rests(share):
    stamp = LINE.stamp + share * LINE.duration
    braked = BRAKES.brake(LINE, stamp, LIMITS)
    if braked is None:
        assert LINE.end_stamp - stamp <= 0.5 * 0.6 + 1e-9
        return
    line = Line()
    line.accept(hover(LINE.stamp - 1.0, ORIGIN, float(LINE.sample(0.0).yaw)))
    line.accept(LINE)
    line.at(stamp)
    line.accept(braked)
    assert braked.end_stamp <= max(LINE.end_stamp, stamp + 6.0)
    path = LINE.sample(np.linspace(0.0, LINE.duration, 20001)).position
    for place in braked.sample(np.linspace(0.0, braked.duration, 50)).position:
        assert np.linalg.norm(path - place, axis=1).min() < 2e-3


@pytest.mark.parametrize("share", [0.1, 0.3, 0.5, 0.7])
def test_it_is_within_the_limits_and_soon_over(share):
    stamp = LINE.stamp + share * LINE.duration
    braked = BRAKES.brake(LINE, stamp, LIMITS)
    peaks = braked.limits()
    assert peaks.acceleration <= 1.02 * LIMITS.a_max
    assert peaks.specific_force <= 1.02 * CONFIG.planning.thrust_share * CONFIG.vehicle.thrust_max
    assert peaks.speed <= 1.001 * LINE.limits().speed
    speed = np.linalg.norm(LINE.setpoint(stamp).velocity)
    assert braked.duration <= 0.61 + 3.0 * speed / LIMITS.a_max


def test_gates_that_are_not_reached_any_more_are_not_on_it():
    line = type(LINE)(
        **{name: getattr(LINE, name) for name in LINE.__slots__}
        | {"gate_ids": (1, 2), "gate_times": (0.2 * LINE.duration, 0.9 * LINE.duration)}
    )
    braked = BRAKES.brake(line, line.stamp + 0.1 * line.duration, LIMITS)
    assert 2 not in braked.gate_ids


def test_a_line_that_is_over_needs_no_braking():
    assert BRAKES.brake(LINE, LINE.end_stamp + 1.0, LIMITS) is None
