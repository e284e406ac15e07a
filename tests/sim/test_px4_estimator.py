"""EKF2 on external vision."""

import numpy as np
import pytest
from px4_bench import Px4Bench

from flightapp.frames import quat_yaw
from sim.px4.modes import NavState


def believed(bench, seconds=2.0):
    """Mean of the estimate's position, away from the truth, m."""
    differences = []

    def look():
        differences.append(bench.px4.estimate().position - bench.plant.position)
        return False

    bench.run(seconds, look)
    return np.mean(differences, axis=0)


def test_the_estimate_is_never_exact_but_close():
    bench = Px4Bench().hovering()
    differences = []
    for _ in range(60):
        bench.run(0.2)
        estimate = bench.px4.estimate()
        differences.append([*(estimate.position - bench.plant.position), *(estimate.velocity - bench.plant.velocity)])
    spread = np.std(differences, axis=0)
    assert np.all((spread[:3] > 0.01) & (spread[:3] < 0.06))
    assert np.all((spread[3:] > 0.02) & (spread[3:] < 0.14))


def test_it_flies_in_the_trackers_drifting_frame():
    bench = Px4Bench().hovering()
    for _ in range(100):
        bench.offset = bench.offset + np.array((0.01, -0.005, 0.0))
        bench.run(0.1)
    bench.run(3.0)
    assert believed(bench)[:2] == pytest.approx((1.0, -0.5), abs=0.1)
    assert bench.plant.position[:2] == pytest.approx((-1.0, 0.5), abs=0.25)
    assert bench.px4.estimate().resets == 1


def test_a_fast_drift_with_its_velocity_is_followed_without_a_reset():
    bench = Px4Bench(z=60.0)
    bench.run(0.2)
    for _ in range(50):
        moved = bench.plant.position + bench.offset
        moving = bench.plant.velocity + np.array((0.0, 0.0, -1.4))
        bench.seeing = False
        bench.px4.external_vision(bench.now, moved, bench.plant.orientation, moving, 0)
        bench.run(0.02)
        bench.offset = bench.offset + np.array((0.0, 0.0, -0.028))
    assert bench.px4.estimate().resets == 1
    error = bench.px4.estimate().position - bench.plant.position
    assert error[2] == pytest.approx(-1.4, abs=0.15)


def test_a_heading_that_drifts_is_taken_over():
    bench = Px4Bench().hovering()
    for _ in range(20):
        bench.yaw += 0.02
        bench.run(0.1)
    bench.run(1.5)
    assert quat_yaw(bench.px4.estimate().orientation) - quat_yaw(bench.plant.orientation) == pytest.approx(
        0.4, abs=0.02
    )


def test_a_jump_with_the_same_counter_is_rejected_then_reset_to():
    bench = Px4Bench().hovering()
    bench.offset = np.array((1.0, 0.0, 0.0))
    bench.run(0.9)
    assert bench.px4.estimate().resets == 1
    assert believed(bench, 0.06)[0] == pytest.approx(0.0, abs=0.12)
    took = bench.wait(lambda: bench.px4.estimate().resets == 2)
    assert took < 0.2
    assert believed(bench, 0.5)[0] == pytest.approx(1.0, abs=0.12)
    assert bench.px4.ready
    assert bench.px4.nav_state is NavState.AUTO_TAKEOFF


def test_a_jump_with_a_raised_counter_is_taken_at_once():
    bench = Px4Bench().hovering()
    bench.offset, bench.counter = np.array((0.0, 2.0, 0.0)), 1
    bench.run(0.04)
    assert bench.px4.estimate().resets == 2
    assert believed(bench, 0.5)[1] == pytest.approx(2.0, abs=0.12)


def test_the_vehicle_does_not_jump_with_its_estimate():
    bench = Px4Bench().hovering()
    before = bench.plant.position
    bench.offset, bench.yaw, bench.counter = np.array((3.0, -2.0, 1.0)), 1.0, 1
    bench.run(4.0)
    assert np.linalg.norm(bench.plant.position - before) < 0.4
    assert abs(quat_yaw(bench.plant.orientation)) < 0.1


def test_a_short_outage_is_survived_by_dead_reckoning():
    bench = Px4Bench().hovering()
    bench.seeing = False
    bench.run(3.0)
    assert bench.px4.ready
    assert bench.px4.nav_state is NavState.AUTO_TAKEOFF
    drifted = np.linalg.norm(bench.px4.estimate().position - bench.plant.position)
    assert 0.02 < drifted < 2.0
    bench.seeing = True
    bench.run(0.1)
    assert bench.px4.estimate().resets == 2


@pytest.mark.parametrize("change", [{"EKF2_EV_CTRL": 0}, {"EKF2_EV_CTRL": 7}, {"EKF2_EV_CTRL": 14}])
def test_without_fusing_position_and_heading_there_is_no_position(change):
    bench = Px4Bench(**change)
    bench.run(3.0)
    assert not bench.px4.ready
    assert not bench.px4.estimate().position_valid


def test_height_comes_from_vision_or_the_barometer():
    for control, baro, valid in ((13, 0, False), (13, 1, True), (15, 0, True), (11, 0, True)):
        bench = Px4Bench(EKF2_EV_CTRL=control, EKF2_BARO_CTRL=baro)
        bench.run(2.0)
        assert bench.px4.estimate().altitude_valid is valid
        bench.px4.takeoff()
        assert bench.px4.arm().accepted is valid


def test_vision_that_is_too_slow_never_starts():
    bench = Px4Bench()
    bench.seeing = False
    for _ in range(12):
        bench.see()
        bench.run(0.24)
    assert not bench.px4.estimate().position_valid


def test_nonsense_and_stale_poses_are_ignored():
    bench = Px4Bench().hovering()
    before = bench.px4.estimate().resets
    good = bench.plant.position, bench.plant.orientation
    bench.px4.external_vision(bench.now, good[0] * np.nan, good[1], None, 9)
    bench.px4.external_vision(bench.now - 1.5, good[0] + 5.0, good[1], None, 9)
    bench.px4.external_vision(0.5, good[0] + 5.0, good[1], None, 9)
    assert bench.px4.estimate().resets == before
    assert np.all(np.isfinite(bench.px4.estimate().position))


def test_a_delay_that_is_told_is_corrected():
    """The vehicle moves; poses arrive 60 ms late and are stamped on receipt."""
    errors = {}
    for told in (0.0, 60.0):
        bench = Px4Bench(z=20.0, EKF2_EV_DELAY=told)
        bench.seeing = False
        late = []
        for _ in range(60):
            state = bench.plant.state_at(max(bench.now - 0.06, 0.0))
            bench.px4.external_vision(bench.now, state[1:4].copy(), state[4:8].copy(), None, 0)
            bench.run(0.02)
            late.append(bench.px4.estimate().position[2] - bench.plant.position[2])
        errors[told] = abs(np.mean(late[-20:]))
    assert errors[60.0] < 0.1
    assert errors[0.0] > 0.25


def test_velocities_that_contradict_the_positions_are_rejected_then_reset_to():
    bench = Px4Bench().hovering()
    bench.seeing = False
    slipping, off = np.array((3.0, 0.0, 0.0)), []
    for _ in range(70):
        bench.px4.external_vision(
            bench.now, bench.plant.position, bench.plant.orientation, bench.plant.velocity + slipping, 0
        )
        bench.run(0.02)
        off.append(bench.px4.estimate().velocity[0] - bench.plant.velocity[0])
    assert np.abs(off[:45]).max() < 0.5
    assert max(off[45:60]) > 2.0


def test_the_barometer_bounds_how_fast_a_blind_estimate_sinks():
    worst = {}
    for baro in (0, 1):
        bench = Px4Bench(EKF2_BARO_CTRL=baro, seed=4).hovering()
        bench.seeing = False
        errors = []
        for _ in range(80):
            bench.run(0.5)
            errors.append(bench.px4.estimate().velocity[2] - bench.plant.velocity[2])
        worst[baro] = float(np.abs(errors).max())
    assert worst[1] < 0.7 < worst[0]
