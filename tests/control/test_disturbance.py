"""What is learnt of what the model does not explain, and what each term of the law is worth."""

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
from lag_plant import LagPlant, Lags, at_start, believing, fly, lemniscate, rmse

from flightapp.config import Config, Term
from flightapp.control.baselines import PaperController, PdController
from flightapp.control.flatness import FlatnessController
from flightapp.control.parameters import SWITCHES, parameters_of
from flightapp.evaluation.control_trials import Mismatch, draws
from flightapp.trajectory import hover
from sim.trials import fly as fly_vehicle

PLACE = np.array([0.0, 0.0, 2.0])


def hovering(controller, mismatch):
    line = hover(0.0, PLACE, 0.0, duration=6.0)
    return fly_vehicle(Config(), controller, line, mismatch)


def test_the_push_learnt_is_that_of_the_wind():
    controller = FlatnessController(Config())
    flown = hovering(controller, Mismatch(wind=3.0))
    # Rotor drag alone, without the part that the configuration adds for the body at speed.
    assert 0.7 < controller.push / (3.0 * 0.35) < 1.3
    assert flown.rmse < 0.03
    controller.reset()
    assert controller.push == 0.0


def test_what_is_learnt_is_bounded():
    config = Config()
    bounded = config.model_copy(update={"control": config.control.model_copy(update={"push_max": 0.5})})
    controller = FlatnessController(bounded)
    hovering(controller, Mismatch(wind=6.0))
    assert controller.push == pytest.approx(0.5, rel=0.05)


def test_nothing_is_learnt_while_a_limit_holds_the_command_back():
    controller = FlatnessController(believing(Lags()))
    learnt = []
    for seconds in (0.3, 2.0):
        plant = LagPlant(Lags(drag=(1.0, 1.0, 1.0)), PLACE, velocity=np.array([15.0, 0.0, 0.0]))
        fly(controller, plant, hover(0.0, PLACE, 0.0), seconds)
        learnt.append(controller.push)
        controller.reset()
    assert learnt[0] == 0.0
    assert learnt[1] > 0.01


class Biased:
    """A controller that sees velocities that are off by ``bias`` (3,) m/s."""

    def __init__(self, controller, bias):
        self.controller, self.bias = controller, np.array(bias)

    def command(self, stamp, state, trajectory):
        return self.controller.command(stamp, replace(state, velocity=state.velocity + self.bias), trajectory)


@pytest.mark.parametrize(("without", "least", "most"), [((), 0.0, 0.01), (("drift",), 0.05, 0.1)])
def test_a_velocity_that_does_not_fit_the_positions_does_not_keep_it_off(without, least, most):
    biased = Biased(FlatnessController(believing(Lags(), without=without)), (0.1, 0.0, -0.1))
    rows, references, _ = fly(biased, LagPlant(Lags(), PLACE), hover(0.0, PLACE, 0.0), 6.0)
    assert least <= rmse(rows[-250:], references[-250:]) < most


def test_each_term_has_its_switch():
    assert set(SWITCHES) == set(get_args(Term))
    whole = parameters_of(Config())
    for term in get_args(Term):
        assert parameters_of(Config(), (term,)) != whole


@pytest.mark.parametrize("term", ["acceleration", "jerk", "snap", "drag", "prediction", "rate_lead"])
def test_no_term_is_there_for_nothing(term):
    line = lemniscate(7.0)

    def error(without):
        controller = FlatnessController(believing(Lags(), without=("disturbance", *without)))
        rows, references, _ = fly(controller, at_start(Lags(), line), line, line.duration)
        return rmse(rows, references)

    assert error((term,)) > 1.2 * error(())


def test_the_disturbance_is_worth_most_where_the_vehicle_is_not_as_believed():
    config, line = Config(), lemniscate(5.0)
    bare = config.model_copy(update={"control": config.control.model_copy(update={"without": ("disturbance",)})})
    for mismatch in draws(3, 400):
        with_it = fly_vehicle(config, FlatnessController(config), line, mismatch)
        without = fly_vehicle(bare, FlatnessController(bare), line, mismatch)
        assert with_it.rmse < 0.5 * without.rmse
        assert with_it.rmse < 0.1


def test_more_of_the_law_tracks_closer():
    config, line = Config(), lemniscate(5.0)
    errors = [
        fly_vehicle(config, kind(config), line, Mismatch()).rmse
        for kind in (FlatnessController, PaperController, PdController)
    ]
    assert errors[0] < 0.5 * errors[1] < 0.25 * errors[2]
