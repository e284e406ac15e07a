"""Flying a plan slower and faster again: the same path, no jump, no new limit broken."""

import math
from dataclasses import replace

import numpy as np
import pytest
from planning_tracks import FIVE_GATES, TRACKS, motion_at, request_for

from flightapp.config import Config, load_config
from flightapp.frames import GRAVITY
from flightapp.interfaces import Limits
from flightapp.messages import GateEstimate
from flightapp.planning.caution import BAND, PATIENCE, Caution
from flightapp.planning.pacer import Paced, Pacer
from flightapp.planning.pacing import STEADY, Pace, paced
from flightapp.planning.polynomial import PolynomialPlanner
from flightapp.planning.splice import splice_fault
from flightapp.track import GateShape

CONFIG = Config()
REQUEST = request_for(FIVE_GATES, v_max=8.0, a_max=12.0)
PLAN = PolynomialPlanner(CONFIG).plan(REQUEST)
SHAPE = GateShape()


def places(pace, start, begun, times):
    """s of the plan at ``times`` (n,) s after ``start``."""
    return begun + np.array([pace.progress(start, start + t) for t in times])


def flying(pacer, plan=PLAN, rate=1.0):
    """Have ``pacer`` fly ``plan`` from rest at ``rate``."""
    choice = next(pacer.offers(plan, REQUEST, rate))
    pacer.took(choice)
    return choice


@pytest.mark.parametrize("rates", [(1.0, 0.6), (0.6, 1.0), (0.9, 0.3)])
@pytest.mark.parametrize("begun", [0.0, 1.234, float(PLAN.knots[2]), float(PLAN.knots[2]) - 1e-4])
@pytest.mark.parametrize("ramp", [0.6, 2.0])
def test_a_change_of_pace_follows_the_path(rates, begun, ramp):
    pace = Pace(3.01, *rates, ramp)
    flown = paced(PLAN, begun, pace, 3.0)
    times = np.linspace(0.0, flown.duration, 4001)
    tau = places(pace, 3.0, begun, times)
    assert tau[-1] == pytest.approx(PLAN.duration, abs=1e-9)
    ours, planned = flown.sample(times), PLAN.sample(np.minimum(tau, PLAN.duration))
    np.testing.assert_allclose(ours.position, planned.position, atol=1e-5)
    rate = np.array([pace.rate(3.0 + t) for t in times])
    np.testing.assert_allclose(ours.velocity, planned.velocity * rate[:, None], atol=1e-3)
    np.testing.assert_allclose(ours.yaw, planned.yaw, atol=1e-4)
    assert splice_fault(flown, None) == ""


def test_a_takeover_at_another_pace_continues_the_motion():
    slower = Pace(2.01, 1.0, 0.6, 0.9)
    first = paced(PLAN, 2.0, slower, 2.0)
    assert splice_fault(first, motion_at(PLAN, 2.0)) == ""
    faster = Pace(3.51, 0.6, 1.0, 0.9)
    again = paced(PLAN, 2.0 + slower.progress(2.0, 3.5), faster, 3.5)
    assert splice_fault(again, motion_at(first, 1.5)) == ""


def test_back_at_full_pace_the_plan_is_flown_to_the_last_digit():
    slower, faster = Pace(2.01, 1.0, 0.6, 0.9), Pace(3.51, 0.6, 1.0, 0.9)
    begun = 2.0 + slower.progress(2.0, 3.5)
    again = paced(PLAN, begun, faster, 3.5)
    times = np.linspace(1.0, again.duration, 1000)
    tau = np.minimum(places(faster, 3.5, begun, times), PLAN.duration)
    ours, planned = again.sample(times), PLAN.sample(tau)
    for name in ("position", "velocity", "acceleration", "jerk", "yaw", "yaw_rate"):
        np.testing.assert_allclose(getattr(ours, name), getattr(planned, name), atol=1e-9)


def test_many_changes_accumulate_nothing():
    pacer = Pacer(CONFIG)
    slow_plan = PolynomialPlanner(CONFIG).plan(request_for(FIVE_GATES, v_max=2.0))
    flying(pacer, slow_plan)
    stamp = 0.0
    for wanted in (0.7, 1.0) * 6:
        stamp += 1.5
        choice = pacer.change(pacer.flying.flown, stamp, wanted, REQUEST.limits)
        assert choice.pace.after == wanted
        assert splice_fault(choice.flown, motion_at(pacer.flying.flown, stamp - pacer.flying.flown.stamp)) == ""
        pacer.took(choice)
    end = pacer.flying
    t = end.flown.duration - 1.0
    np.testing.assert_allclose(
        end.flown.sample(t).position, slow_plan.sample(end.place(end.flown.stamp + t)).position, atol=1e-9
    )


def test_gates_and_the_end_come_when_the_path_gets_there():
    pace = Pace(2.01, 1.0, 0.7, 1.4)
    flown = paced(PLAN, 2.0, pace, 2.0)
    assert flown.gate_ids == PLAN.gate_ids
    for time, planned in zip(flown.gate_times, PLAN.gate_times, strict=True):
        assert 2.0 + pace.progress(2.0, 2.0 + time) == pytest.approx(planned, abs=1e-9)
        if time > 0.0:
            np.testing.assert_allclose(flown.sample(time).position, PLAN.sample(planned).position, atol=1e-5)
        else:
            assert planned < 2.0
    np.testing.assert_allclose(flown.sample(flown.duration).position, REQUEST.end, atol=1e-9)


def test_a_constant_pace_scales_what_the_vehicle_has_to_do():
    flown = paced(PLAN, 0.0, Pace(PLAN.stamp, 0.5, 0.5, 0.0), PLAN.stamp)
    half, full = flown.limits(), PLAN.limits()
    assert flown.duration == pytest.approx(2.0 * PLAN.duration)
    assert half.speed == pytest.approx(0.5 * full.speed, rel=1e-3)
    assert half.acceleration == pytest.approx(0.25 * full.acceleration, rel=1e-3)


def test_as_planned_nothing_is_made_anew():
    assert paced(PLAN, 0.0, STEADY, PLAN.stamp) is PLAN


def test_the_motion_at_full_pace_is_the_plans():
    pace = Pace(2.01, 1.0, 0.6, 0.9)
    flown = paced(PLAN, 2.0, pace, 2.0)
    for t in (0.0, 0.3, 0.7, 1.5):
        full = pace.full(motion_at(flown, t), 2.0 + t)
        planned = motion_at(PLAN, 2.0 + pace.progress(2.0, 2.0 + t))
        np.testing.assert_allclose(full.velocity, planned.velocity, atol=1e-4)
        np.testing.assert_allclose(full.acceleration, planned.acceleration, atol=1e-2)
        assert full.yaw_rate == pytest.approx(planned.yaw_rate, abs=1e-2)


def test_a_new_plan_takes_over_in_the_middle_of_a_change():
    pace = Pace(1.51, 1.0, 0.7, 1.4)
    flown = paced(PLAN, 1.5, pace, 1.5)
    stamp = 2.2
    start = pace.full(motion_at(flown, stamp - 1.5), stamp)
    gates = tuple(g for g, t in zip(REQUEST.gates, flown.gate_times, strict=True) if t > stamp - 1.5)
    request = replace(REQUEST, stamp=stamp, start=start, gates=gates)
    pacer = Pacer(CONFIG)
    pacer.took(Paced(PLAN, 1.5, pace, flown))
    plan = PolynomialPlanner(CONFIG).plan(request)
    (choice,) = pacer.offers(plan, request, 0.7)
    assert choice.pace == pace
    assert splice_fault(choice.flown, motion_at(flown, stamp - 1.5)) == ""


@pytest.mark.parametrize("track", TRACKS)
@pytest.mark.parametrize(("before", "after"), [(1.0, 0.6), (0.6, 1.0)])
def test_a_change_asks_nothing_new_of_the_vehicle(track, before, after):
    request = request_for(TRACKS[track], v_max=8.0, a_max=12.0)
    plan = PolynomialPlanner(CONFIG).plan(request)
    peak = plan.limits()
    changed = 0
    for stamp in np.linspace(0.4, 0.6 * plan.duration, 12):
        pacer = Pacer(CONFIG)
        flying(pacer, plan, before)
        choice = pacer.change(pacer.flying.flown, float(stamp), after, request.limits)
        if choice is None:
            continue
        changed += 1
        asked = choice.flown.limits()
        assert asked.acceleration <= 1.03 * max(request.limits.a_max, peak.acceleration)
        assert asked.speed <= 1.001 * max(request.limits.v_max, peak.speed)
        assert asked.specific_force <= 1.03 * max(0.9 * CONFIG.vehicle.thrust_max, peak.specific_force)
        assert asked.body_rate <= 1.05 * max(0.6 * CONFIG.vehicle.rate_max, peak.body_rate)
    assert changed >= 10


def test_slower_plans_are_offered_down_to_the_least_pace():
    pacer = Pacer(load_config(None, {"planning.pace_min": 0.75}))
    rates = [choice.pace.after for choice in pacer.offers(PLAN, REQUEST, 1.0)]
    assert rates == pytest.approx([1.0, 0.97, 0.94, 0.9, 0.85, 0.8])
    pacer = Pacer(load_config(None, {"planning.pace_min": 1.0}))
    assert [choice.pace.after for choice in pacer.offers(PLAN, REQUEST, 1.0)] == [1.0]


def test_nothing_changes_that_is_over_or_not_ours():
    pacer = Pacer(CONFIG)
    assert pacer.change(PLAN, 1.0, 0.7, REQUEST.limits) is None
    choice = flying(pacer)
    assert pacer.change(replace(PLAN), 1.0, 0.7, REQUEST.limits) is None
    assert pacer.change(choice.flown, PLAN.duration + 1.0, 0.7, REQUEST.limits) is None
    assert pacer.change(choice.flown, 1.0, 1.0, REQUEST.limits) is None


def estimate(gate, sigma=0.05, last_seen=0.0):
    return GateEstimate(gate.gate_id, gate.position, gate.yaw, np.diag((sigma**2,) * 3 + (0.01,)), 9, last_seen)


def wanted(caution, stamp, gates, voltage=math.nan, plan=PLAN, push=0.0):
    return caution.wanted(stamp, Paced(plan, 0.0, STEADY, plan), gates, SHAPE, voltage, push)


def test_a_gate_that_is_badly_known_is_approached_slowly():
    caution, near = Caution(CONFIG), PLAN.gate_times[0] - 1.0
    sure, unsure = estimate(REQUEST.gates[0], 0.05, near), estimate(REQUEST.gates[0], 0.32, near)
    assert wanted(caution, near, (sure,))[0] == 1.0
    rate, why = wanted(caution, near, (unsure,))
    assert rate == pytest.approx(0.5 / (2.0 * 0.32), abs=1e-3)
    assert why == "gate 0 is known to 0.32 m"
    assert wanted(caution, PLAN.gate_times[0] - 3.0, (unsure,))[0] == 1.0
    assert wanted(caution, PLAN.gate_times[0] + 0.1, (unsure,))[0] == 1.0


def test_no_reason_goes_below_the_least_pace():
    caution = Caution(load_config(None, {"planning.pace_min": 0.5}))
    assert wanted(caution, 1.0, (), push=50.0) == (0.5, "the wind takes 50.0 m/s²")
    assert wanted(caution, 1.0, (), push=0.4)[0] == 1.0
    off = Caution(load_config(None, {"planning.pace_min": 1.0}))
    assert wanted(off, PLAN.gate_times[0] - 1.0, (estimate(REQUEST.gates[0], 3.0),), 9.0)[0] == 1.0


def test_a_low_battery_slows_down_to_what_its_thrust_can_do():
    config = load_config(None, {"vehicle.hover_voltage": 16.0, "planning.pace_min": 0.2})
    plan = PolynomialPlanner(config).plan(request_for(FIVE_GATES, v_max=10.0, a_max=18.0))
    caution = Caution(config)
    assert wanted(caution, 0.5, (), 16.1, plan)[0] == 1.0
    voltage = 11.0
    rate, why = wanted(caution, 0.5, (), voltage, plan)
    assert 0.2 < rate < 1.0
    assert why == "the battery gives 11.0 V"
    available = config.planning.thrust_share * (voltage / 16.0) ** 2 * config.vehicle.thrust_max
    slow = paced(plan, 0.5, Pace(plan.stamp, rate, rate, 0.0), plan.stamp)
    force = slow.sample(np.linspace(0.0, slow.duration, 2000)).acceleration + np.array((0.0, 0.0, GRAVITY))
    assert np.linalg.norm(force, axis=1).max() == pytest.approx(available, rel=0.02)


def test_the_pace_goes_down_at_once_and_up_with_patience():
    caution = Caution(CONFIG)
    assert not caution.changes(0.0, 1.0, 1.0)
    assert not caution.changes(0.0, 1.0, 1.0 - 0.5 * BAND)
    assert caution.changes(0.0, 1.0, 1.0 - 2.0 * BAND)
    assert not caution.changes(1.0, 0.8, 1.0)
    assert not caution.changes(1.0 + 0.5 * PATIENCE, 0.8, 0.8)
    assert not caution.changes(1.0 + PATIENCE, 0.8, 1.0)
    assert caution.changes(1.0 + 2.1 * PATIENCE, 0.8, 1.0)
    small = Caution(CONFIG)
    assert not small.changes(0.0, 0.97, 1.0)
    assert small.changes(PATIENCE, 0.97, 1.0)


def test_without_limits_of_acceleration_the_vehicle_itself_is_the_limit():
    pacer = Pacer(CONFIG)
    flying(pacer)
    limits = Limits(math.inf, math.inf, 3.0)
    assert pacer.change(pacer.flying.flown, 1.0, 0.7, limits) is not None
