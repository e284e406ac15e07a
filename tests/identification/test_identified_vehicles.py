"""Simulated vehicles that are not what their files say are identified from a flight, and then fly better."""

import datetime
from dataclasses import replace

import numpy as np
import pytest
from flown import ROOT, fly, overrides, true_drag, true_hover, true_vehicle

from flightapp.config import load_config
from flightapp.control.flatness import FlatnessController
from flightapp.evaluation.control_trials import Mismatch
from flightapp.identify_command import findings_json, identify_runs, vehicle_text
from flightapp.mission.loader import load_mission
from flightapp.plan_command import line_along
from sim.trials import fly as fly_alone

SIGMAS = 3.0
"""Standard errors by which a finding may be off."""
CASES = {
    "sim_racer": (Mismatch(mass=1.1, thrust=0.92, drag=1.8, motor=1.25, delay=0.01), 0.3, 41),
    "sim_px4": (Mismatch(mass=0.92, thrust=1.06, drag=0.6, motor=0.75, delay=0.008), 0.3, 42),
}


@pytest.fixture(scope="module", params=["sim_racer", pytest.param("sim_px4", marks=pytest.mark.soak)])
def identified(request, tmp_path_factory):
    """Vehicle file, mismatch, the flight, what was found, and the new file."""
    mismatch, gust, seed = CASES[request.param]
    out, base = tmp_path_factory.mktemp(request.param), ROOT / "config" / f"{request.param}.toml"
    flight = fly(out / "run", "identify", base, seed, *overrides(mismatch, gust))
    found = identify_runs([out / "run"], base)
    new = out / "new.toml"
    new.write_text(vehicle_text(found, base, "run", datetime.date(2026, 1, 2)))
    return base, mismatch, flight, found, new


def test_it_stays_in_its_cage(identified):
    truth = identified[2].truth
    flying = truth.stamp > identified[2].commands.stamp[0]
    assert np.abs(truth.position[flying, :2]).max() < 1.8
    assert truth.position[flying, 2].max() < 2.7
    assert np.linalg.norm(truth.velocity, axis=1).max() < 3.0


def test_everything_is_told(identified):
    found = identified[3]
    assert not found.refusals
    told = {
        "delay",
        "rate_lag",
        "yaw_rate_lag",
        "hover_thrust",
        "thrust_curve",
        "motor_lag",
        "drag x",
        "drag y",
        "drag z",
    }
    assert {f.name for f in found.findings} >= told
    assert all(f.sigma > 0.0 for f in found.findings if f.name in told)
    assert {entry["parameter"] for entry in findings_json(found)["found"]} >= told


def test_thrust_and_drag_are_the_true_ones(identified):
    base, mismatch, flight, found, _ = identified
    vehicle = true_vehicle(base, mismatch)
    truth = {"hover_thrust": true_hover(vehicle, found.value("hover_voltage") or vehicle.battery.rated_voltage)}
    truth |= {f"drag {axis}": value for axis, value in zip("xyz", true_drag(vehicle, flight), strict=True)}
    for one in found.findings:
        if one.name in truth:
            assert abs(one.value - truth[one.name]) < SIGMAS * one.sigma, one


def test_the_new_file_is_the_old_one_with_what_was_found(identified):
    base, _, _, found, new = identified
    before, after = load_config(base), load_config(new)
    assert after.vehicle.hover_thrust == pytest.approx(found.value("hover_thrust"), rel=0.01)
    assert after.vehicle.drag[2] == pytest.approx(found.value("drag z"), rel=0.05)
    assert after.model_copy(update={"vehicle": before.vehicle}) == before
    assert "± " in new.read_text() and "run, 2026-01-02" in new.read_text()


def test_it_flies_better_with_what_was_found(identified):
    base, mismatch, _, _, new = identified
    mission = load_mission(ROOT / "missions" / "lemniscate.py")
    settings = {**mission.settings, "race.v_max": 4.0}
    old = load_config(base, settings)
    line = line_along(mission.track, old)
    weather = [replace(mismatch, seed=seed, gust=0.5, noise=1.0) for seed in range(3)]
    configs = old, load_config(new, settings)
    errors = [[fly_alone(c, FlatnessController(c), line, one).rmse for one in weather] for c in configs]
    assert np.mean(errors[1]) < 0.9 * np.mean(errors[0]), errors
