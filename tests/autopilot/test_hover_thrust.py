"""The hover thrust learnt in flight: by itself on motion made up, and in the loop with the real controller."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from thrust_flight import Flight

from flightapp.autopilot.hover_thrust import SHARE, HoverThrust
from flightapp.autopilot.thrust import ThrustMap
from flightapp.config import Config, load_config
from flightapp.frames import GRAVITY, quat_from_rotvec, quat_to_matrix
from flightapp.messages import VehicleState
from flightapp.trajectory import hover

CONFIGS = Path(__file__).parents[2] / "config"
LINE = hover(0.0, np.array((0.0, 0.0, 1.5)), 0.0)
REST = np.zeros(3)
LEVEL = np.array((1.0, 0.0, 0.0, 0.0))


def configured(vehicle, factor=1.0, **settings):
    """The simulated ``vehicle``'s config with its hover thrust wrong by ``factor``."""
    file = CONFIGS / f"sim_{vehicle}.toml"
    right = load_config(file).vehicle.hover_thrust
    settings = {key.replace("__", "."): value for key, value in settings.items()}
    return load_config(file, {"vehicle.hover_thrust": right * factor, **settings})


def moving(stamp, velocity=REST, orientation=LEVEL):
    return VehicleState(stamp, REST, orientation, velocity, REST, np.zeros((9, 9)))


def learner(config=None):
    config = config or Config()
    return HoverThrust(config, ThrustMap.of(config.vehicle))


def feed(learner, effectiveness, begin=0.0, duration=3.0, tilt=0.0):
    """Hold the configured hover thrust, and move as a dragless vehicle on which that has ``effectiveness``."""
    q = quat_from_rotvec(np.array((0.0, tilt, 0.0)))
    pull = effectiveness * GRAVITY * quat_to_matrix(q)[:, 2] - (0.0, 0.0, GRAVITY)
    outcomes = []
    for tick in range(round(duration / 0.005)):
        now = begin + tick * 0.005
        learner.sent(now, 0.25)
        # Back and forth, so that it never gets fast.
        outcomes.append(learner.observe(moving(now, pull * (tick % 200) * 0.005, q)))
    return [outcome for outcome in outcomes if outcome is not None]


STILL = configured("racer", vehicle__drag=[0.0, 0.0, 0.0], vehicle__motor_lag=0.0)


@pytest.mark.parametrize("tilt", [0.0, 0.5])
@pytest.mark.parametrize("effectiveness", [0.8, 1.0, 1.2])
def test_what_the_motion_says_is_learnt_at_any_tilt(effectiveness, tilt):
    estimate = feed(learner(STILL), effectiveness, tilt=tilt)[-1]
    assert estimate == pytest.approx(0.25 / effectiveness, rel=0.02)


def test_the_commands_curve_is_taken_out():
    config = STILL.model_copy(update={"vehicle": STILL.vehicle.model_copy(update={"thrust_curve": 0.6})})
    thrust = ThrustMap.of(config.vehicle)
    estimate = feed(HoverThrust(config, thrust), 0.85)[-1]
    thrust.learn(estimate)
    assert thrust.specific_force(0.25) == pytest.approx(0.85 * GRAVITY, rel=0.02)


def test_nothing_is_learnt_of_commands_that_are_not_followed():
    idle = learner()
    assert all(idle.observe(moving(0.005 * tick)) is None for tick in range(1000))
    assert idle.value == 0.25


@pytest.mark.parametrize(
    ("tilt", "speed", "throttle"), [(1.0, 0.0, 0.25), (0.0, 7.0, 0.25), (0.0, 0.0, 0.1), (0.0, 0.0, 0.6)]
)
def test_nothing_is_learnt_beyond_the_model(tilt, speed, throttle):
    wild = learner()
    q = quat_from_rotvec(np.array((tilt, 0.0, 0.0)))
    for tick in range(1000):
        wild.sent(0.005 * tick, throttle)
        assert wild.observe(moving(0.005 * tick, np.array((speed, 0.0, 0.0)), q)) is None
    assert wild.value == 0.25


def test_a_jump_of_the_velocity_hardly_counts():
    steady = learner(STILL)
    feed(steady, 1.0)
    before = steady.value
    for tick in range(100):
        steady.sent(3.0 + 0.005 * tick, 0.25)
        steady.observe(moving(3.0 + 0.005 * tick, np.array((0.0, 0.0, 1.0 if tick >= 50 else 0.0))))
    assert steady.value == pytest.approx(before, rel=0.005)


def test_a_clock_that_starts_again_is_followed():
    restarted = learner(STILL)
    feed(restarted, 1.0, begin=100.0)
    assert feed(restarted, 0.9, begin=0.0, duration=6.0)[-1] == pytest.approx(0.25 / 0.9, rel=0.02)


anything = st.floats(allow_nan=True, allow_infinity=True)
sometimes = st.sampled_from((0.005, 0.005, 0.005, 0.01, 0.1, 0.0, -1.0))
near = st.floats(-3.0, 3.0)


@given(st.lists(st.tuples(sometimes, st.floats(0.0, 1.0), near, near, near), min_size=1, max_size=40), st.floats(0, 1))
def test_it_never_leaves_its_bounds(steps, throttle):
    wild = learner()
    stamp = 0.0
    for elapsed, sent, *velocity in steps * 10:
        stamp += elapsed
        wild.sent(stamp, 0.5 * (sent + throttle))
        estimate = wild.observe(moving(stamp, np.array(velocity)))
        assert estimate is None or estimate == wild.value
        assert (1.0 - SHARE) * 0.25 <= wild.value <= (1.0 + SHARE) * 0.25


@pytest.mark.parametrize("effectiveness", [0.3, 0.6, 1.6])
def test_it_stops_at_its_bounds(effectiveness):
    bounded = learner(STILL)
    feed(bounded, effectiveness, duration=20.0)
    edge = 1.0 + SHARE if effectiveness < 1.0 else 1.0 - SHARE
    assert bounded.value == pytest.approx(0.25 * edge)


@given(
    st.lists(
        st.tuples(st.integers(0, 599), st.integers(0, 8), st.sampled_from((math.nan, math.inf, -math.inf, 1e200)))
    ),
    st.lists(st.tuples(anything, anything), max_size=5),
)
def test_what_is_no_number_changes_nothing(faults, commands):
    """A state or a command that isn't finite costs the window it falls into, and moves the estimate nowhere."""
    hurt = learner(STILL)
    bad = {tick: (place, value) for tick, place, value in faults}
    for tick in range(600):
        now = tick * 0.005
        hurt.sent(now, 0.25)
        for stamp, throttle in commands:
            if not (math.isfinite(stamp) and 0.0 <= throttle <= 1.0):
                hurt.sent(stamp, throttle)
        numbers = [now, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
        if tick in bad:
            place, value = bad[tick]
            if 0 < place < len(numbers) or not math.isfinite(value):
                numbers[min(place, 7)] = value
        hurt.observe(moving(numbers[0], np.array(numbers[5:8]), np.array(numbers[1:5])))
        assert hurt.value == pytest.approx(0.25, abs=1e-9)


@pytest.mark.parametrize("vehicle", ["racer", "px4", "f330"])
@pytest.mark.parametrize("factor", [0.8, 1.2])
def test_a_wrong_hover_thrust_is_corrected_and_the_controllers_trim_goes_back(vehicle, factor):
    flown = Flight(configured(vehicle, factor), LINE).fly(14.0)
    ratio = flown.hover / flown.real
    assert abs(ratio[0] - 1.0) > 0.15
    assert np.abs(ratio[flown.time > 3.0] - 1.0).max() < 0.03
    assert np.abs(flown.trim[flown.time > 12.0]).max() < 0.02
    assert np.abs(flown.height_error[flown.time > 10.0]).max() < 0.01


def test_without_learning_the_trim_has_to_carry_it():
    flown = Flight(configured("racer", 0.8), LINE, learning=False).fly(14.0)
    assert flown.trim[-1] > 0.2


def test_a_battery_that_empties_is_followed():
    """Ten times as fast as in flight; without learning the controller's trim makes up for it."""
    errors, trims = [], []
    for learning in (False, True):
        flight = Flight(configured("f330"), LINE, learning)
        flight.drain(10.0)
        late = flight.fly(25.0).from_to(6.0, 25.0)
        errors.append(np.abs(late.height_error).max())
        trims.append(np.abs(late.trim).max())
    assert max(errors) < 0.01
    assert trims[1] < 0.35 * trims[0]


def test_with_the_voltage_known_what_is_learnt_does_not_depend_on_it():
    known = {"vehicle__battery_scale": True, "vehicle__hover_voltage": 12.15}
    learnt = []
    for charge in (1.0, 0.4):
        flight = Flight(configured("f330", 1.1, **known), LINE, charge=charge)
        flight.fly(8.0)
        learnt.append(flight.thrust.hover_thrust)
    assert learnt[1] == pytest.approx(learnt[0], rel=0.01)


def test_a_change_of_mass_is_followed():
    flight = Flight(configured("racer"), LINE)
    dropped = []

    def drop(now):
        if now > 8.0 and not dropped:
            dropped.append(now)
            flight.make_heavier(0.85)

    flown = flight.fly(15.0, drop)
    ratio = flown.hover / flown.real - 1.0
    assert ratio[flown.time > 8.0][0] > 0.14
    assert np.abs(ratio[flown.time > 13.0]).max() < 0.03


def test_gusts_do_not_upset_it():
    """Gusts of 1 m/s push this vehicle by a tenth of its weight; a third of that may be taken for its thrust."""
    flown = Flight(configured("px4"), LINE, gust=1.0).fly(30.0)
    push = configured("px4").vehicle.drag[2] * 1.0 / GRAVITY
    assert np.std(flown.hover / flown.real) < push / 3.0
    assert np.abs(flown.hover / flown.real - 1.0).max() < push
