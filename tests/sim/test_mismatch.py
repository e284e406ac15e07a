import numpy as np
import pytest

from flightapp.config import Simulation, load_config
from flightapp.evaluation.control_trials import Mismatch, drawn
from flightapp.inputs import BadInputError
from sim.mismatch import mismatched, perturbed
from sim.vehicles import load_vehicle


def test_without_a_mismatch_a_vehicle_is_what_its_file_says():
    assert mismatched(Simulation(), 7) == load_vehicle("racer")


def test_it_is_what_was_given():
    sim = Simulation(mass_factor=1.1, thrust_factor=0.9, drag_factor=2.0, motor_factor=1.3, delay_extra=0.01)
    plain, off = load_vehicle("racer"), mismatched(sim, 0)
    assert off.hover_thrust == pytest.approx(plain.hover_thrust * 1.1 / 0.9)
    assert off.specific_drag == pytest.approx(plain.specific_drag * 2.0 / 1.1)
    assert off.motor_up == pytest.approx(1.3 * plain.motor_up)
    assert off.delay == pytest.approx(plain.delay + 0.01)
    # Rotors that turn as fast for more thrust.
    assert off.thrust_max / off.thrust_coefficient == pytest.approx(plain.thrust_max / plain.thrust_coefficient)


def test_a_delay_cannot_become_negative():
    assert perturbed(load_vehicle("px4"), Mismatch(delay=-0.5)).delay == 0.0


def test_draws_fill_their_range_and_are_repeatable():
    draws = [drawn(seed) for seed in range(300)]
    assert draws == [drawn(seed) for seed in range(300)]
    rows = np.array([(d.mass, d.thrust, d.drag, d.motor, d.delay) for d in draws])
    low, high = np.array((0.9, 0.9, 0.5, 0.7, -0.01)), np.array((1.1, 1.1, 2.0, 1.3, 0.01))
    assert np.all(rows >= low) and np.all(rows <= high)
    assert np.all(rows.min(axis=0) < low + 0.1 * (high - low)) and np.all(rows.max(axis=0) > high - 0.1 * (high - low))


def test_none_is_drawn_unless_it_is_asked_for():
    assert drawn(5, 0.0) == Mismatch(5)
    assert mismatched(Simulation(mismatch=1.0), 1) != mismatched(Simulation(mismatch=1.0), 2)


def test_what_no_vehicle_is_is_refused():
    with pytest.raises(BadInputError, match="mass_factor"):
        load_config(None, None, ("sim.mass_factor=0",))
