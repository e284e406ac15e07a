"""PX4's land detector."""

import math

import pytest
from px4_bench import Px4Bench

from sim.px4.landing import Felt, LandDetector
from sim.px4.modes import NavState

HOVER, LEAST = 0.5, 0.12
STILL = Felt(0.0, 0.0, 0.0)
BLIND = Felt(math.nan, math.nan, 0.0)
TICK = 0.01


def after(detector, seconds, felt, throttle, climb_wanted, begin=0.0):
    """``detector`` once it has been so for ``seconds``; when that is."""
    steps = round(seconds / TICK)
    for step in range(steps + 1):
        detector.update(begin + TICK * step, felt, throttle, climb_wanted)
    return begin + TICK * steps


def flying():
    """A detector in the air."""
    detector = LandDetector(HOVER, LEAST)
    detector.update(-1.0, STILL, HOVER, 0.0)
    assert not (detector.touched or detector.maybe_landed or detector.landed)
    return detector


def test_each_stage_takes_its_time():
    detector, seen = flying(), []
    for step in range(120):
        detector.update(TICK * step, STILL, 0.0, -0.7)
        seen.append((detector.touched, detector.maybe_landed, detector.landed))
    firsts = [TICK * [stage[k] for stage in seen].index(True) for k in range(3)]
    assert firsts == pytest.approx([1 / 3, 2 / 3, 1.0], abs=2.1 * TICK)


@pytest.mark.parametrize(
    ("felt", "throttle", "climb_wanted"),
    [
        (Felt(-0.4, 0.0, 0.0), 0.0, -0.7),
        (Felt(0.0, 2.0, 0.0), 0.0, -0.7),
        (Felt(0.0, 0.0, 0.5), 0.0, -0.7),
        (STILL, HOVER, -0.7),
        (STILL, 0.3, -0.7),
        (STILL, 0.0, 0.0),
        (STILL, 0.0, math.nan),
    ],
)
def test_what_sinks_slides_turns_pulls_or_was_not_asked_down_has_not_landed(felt, throttle, climb_wanted):
    detector = flying()
    after(detector, 5.0, felt, throttle, climb_wanted)
    assert not detector.landed


def test_landed_ends_with_the_vertical_velocity_and_comes_back_after_eight_idle_seconds():
    detector = flying()
    now = after(detector, 2.0, STILL, 0.0, -0.7)
    assert detector.landed
    now = after(detector, 5.0, BLIND, 0.0, math.nan, now)
    assert not detector.landed
    now = after(detector, 3.0, BLIND, 0.0, math.nan, now)
    assert detector.landed
    detector.update(now, BLIND, HOVER, math.nan)
    assert not detector.landed


def test_what_has_landed_stays_down_when_its_position_is_lost_and_disarms():
    bench = Px4Bench(EKF2_BARO_CTRL=0, COM_DISARM_LAND=2.0).hovering()
    assert bench.px4.land().accepted
    bench.wait(lambda: bench.plant.position[2] < 0.8)
    bench.seeing = False
    # A position that is lost too soon after the touchdown for the disarming, but not for the land detector.
    bench.wait(lambda: bench.px4.on_ground)
    bench.px4.parameters.set("EKF2_NOAID_TOUT", 100_000)
    bench.wait(lambda: bench.px4.nav_state is NavState.DESCEND)
    bench.run(0.2)
    assert not bench.px4.on_ground
    highest = 0.0
    while bench.px4.armed:
        bench.run(0.1)
        highest = max(highest, bench.plant.position[2])
        assert bench.now < 40.0
    assert highest < 0.02
