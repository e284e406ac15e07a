"""The contouring controller: its commands, how its progress fits the line's time, and how it flies."""

from dataclasses import replace

import numpy as np
import pytest
from lag_plant import LagPlant, Lags, Noise, at_start, believing, fly, lemniscate
from planned import CONFIG, REST, state

from flightapp.config import Config
from flightapp.control.flatness import FlatnessController
from flightapp.control.mpc import Fallback
from flightapp.control.mpcc import MpccController
from flightapp.evaluation.control_trials import Flown, Mismatch, trial
from flightapp.frames import GRAVITY, quat_from_euler
from flightapp.planning.pacer import TOLERATED
from flightapp.trajectory import hover
from sim.trials import fly as fly_vehicle


def test_what_cannot_be_planned_is_left_to_the_flatness_controller_and_counted():
    controller, simple, line = MpccController(CONFIG), FlatnessController(CONFIG), hover(0.0, REST, 0.0)
    over = state(q=(0.0, 1.0, 0.0, 0.0))
    astray, expected = (c.command(0.0, over, line) for c in (controller, simple))
    assert (*astray.rates, astray.thrust) == (*expected.rates, expected.thrust)
    controller._room.off[:] = np.nan
    assert np.isfinite(controller.command(0.004, state(0.004), line).thrust)
    assert controller.fallbacks == {Fallback.ASTRAY: 1, Fallback.NOT_FINITE: 1}
    controller.command(0.008, state(0.008), line)
    controller.command(0.108, state(0.108), line)
    assert controller.report == "1 of 4 commands planned; by flatness: astray 1, late 1, not finite 1"
    assert controller.lead == 0.0


def race(v_peak, real=None, noise=None, config=None, controller=None):
    """A lemniscate as it was flown, and the greatest lead (s) either way."""
    line, config = lemniscate(v_peak), config or believing(Lags())
    controller = controller or MpccController(config)
    leads = []

    class Watched:
        def command(self, stamp, state, trajectory):
            command = controller.command(stamp, state, trajectory)
            leads.append(getattr(controller, "lead", 0.0))
            return command

    rows, _, _ = fly(Watched(), at_start(real or Lags(), line), line, line.duration, noise)
    times = np.arange(len(rows)) / 250.0
    flown = trial(line, Flown(times, rows[:, 0:3], np.linalg.norm(rows[:, 7:10], axis=1), False, 0))
    return flown, max(leads), min(leads)


@pytest.mark.parametrize("v_peak", [3.0, 7.0])
def test_the_vehicle_it_believes_in_flies_the_path_to_millimetres_and_sooner(v_peak):
    flown, most, _ = race(v_peak)
    plain, _, _ = race(v_peak, controller=FlatnessController(believing(Lags())))
    assert flown.contour < 0.01
    assert flown.time < plain.time - 0.05
    # As much as the planner leaves a change of pace.
    assert flown.speed < TOLERATED * plain.speed
    assert 0.05 < most <= Config().mpcc.ahead + 0.01


def test_without_leave_to_run_ahead_it_keeps_the_lines_time():
    config = believing(Lags())
    config = config.model_copy(update={"mpcc": config.mpcc.model_copy(update={"ahead": 0.0})})
    flown, most, least = race(5.0, config=config)
    assert flown.rmse < 0.05
    assert -0.05 < least <= most < 0.01


def test_where_thrust_is_lacking_it_comes_late_rather_than_off_the_path():
    config = believing(Lags())
    config = config.model_copy(update={"vehicle": config.vehicle.model_copy(update={"thrust_to_weight": 1.5})})
    flown, _, least = race(9.0, config=config)
    plain, _, _ = race(9.0, controller=FlatnessController(config))
    assert flown.contour < 0.25 * plain.contour
    assert least < -0.1


@pytest.mark.parametrize(
    "real", [Lags(thrust_factor=0.9), Lags(gust=0.3), Lags(rate_lag=0.06), Lags(delay=0.03)], ids=str
)
def test_a_vehicle_that_is_not_as_believed_stays_on_the_path(real):
    assert race(6.0, real=real)[0].contour < 0.06


def test_noise_of_a_tracking_camera_does_not_shake_it():
    assert race(5.0, noise=Noise(0.01, 0.05, 0.01, age=5))[0].contour < 0.015


@pytest.mark.parametrize("roll", [0.5 * np.pi, np.pi], ids=["on its side", "upside down"])
def test_it_recovers_from_a_tumble(roll):
    plant = LagPlant(Lags(), REST + np.array([0.0, 0.0, 5.0]), quat_from_euler(roll, 0.0, 0.0))
    rows, references, _ = fly(MpccController(CONFIG), plant, hover(0.0, REST, 0.0), 8.0)
    assert np.linalg.norm(rows[-1, 0:3] - references[-1]) < 0.05
    assert rows[:, 2].min() > 1.0


def test_wrong_thrust_and_a_steady_push_leave_no_error():
    plant = LagPlant(Lags(thrust_factor=0.85), REST.copy())
    rows, _, sent = fly(MpccController(CONFIG), plant, hover(0.0, REST, 0.0), 12.0)
    assert np.linalg.norm(rows[-1, 0:3] - REST) < 0.005
    assert sent[-1].thrust == pytest.approx(GRAVITY / 0.85, rel=0.01)


def followed(controller, stamp, line):
    """The line that the controller follows after a command on ``line`` with the vehicle where its time has come."""
    seen = line.setpoint(stamp)
    controller.command(stamp, state(stamp, seen.position, seen.velocity), line)
    return controller._trajectory


def test_a_line_that_goes_on_takes_over_when_the_progress_has_come_to_its_start():
    line, controller = lemniscate(5.0), MpccController(CONFIG)
    following, begun = replace(line), 2.0
    later = replace(
        line,
        stamp=begun,
        knots=np.array((0.0, 9.0)),
        coefficients=np.zeros((1, 3, 8)),
        yaw_knots=np.array((0.0, 9.0)),
        yaw_coefficients=np.zeros((1, 4)),
    )
    seen = line.setpoint(begun)
    later.coefficients[0, :, 0], later.coefficients[0, :, 1] = seen.position, seen.velocity
    assert followed(controller, 1.9, line) is line
    controller._lead = -0.2
    assert followed(controller, 2.0, later) is line
    assert followed(controller, 2.1, later) is line
    lead = controller.lead
    assert lead < -0.1
    assert followed(controller, 2.3, later) is later
    assert controller.lead < 0.0
    assert followed(controller, 2.304, following) is following


def test_a_line_elsewhere_or_from_rest_is_flown_from_its_own_time():
    line, controller = lemniscate(5.0), MpccController(CONFIG)
    followed(controller, 1.9, line)
    controller._lead = 0.2
    away = hover(1.95, REST + np.array([1.0, 0.0, 0.0]), 0.0)
    assert followed(controller, 1.95, away) is away
    assert controller.lead == 0.0


def test_on_the_simulated_vehicle_it_is_faster_and_no_further_off_the_path():
    config, line = Config(), lemniscate(6.0)
    ours, plain = (fly_vehicle(config, kind(config), line, Mismatch()) for kind in (MpccController, FlatnessController))
    assert ours.time < plain.time - 0.05
    assert ours.contour < plain.contour + 0.003
    assert ours.stood_in <= 5
