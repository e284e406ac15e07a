"""Identification flights of simulated vehicles that are not what their files say, and the truth about these."""

from pathlib import Path

import numpy as np

from flightapp import app
from flightapp.config import Config, load_config
from flightapp.evaluation.control_trials import Mismatch
from flightapp.evaluation.flight import Flight
from flightapp.frames import Vector, quat_to_matrix
from flightapp.recording.reader import read_flight
from sim.mismatch import perturbed
from sim.vehicles import AIR_DENSITY, VehicleParameters, load_vehicle

ROOT = Path(__file__).parents[2]
CORNERS = "sim.camera='corners'"


def overrides(mismatch: Mismatch, gust: float = 0.0) -> tuple[str, ...]:
    """Settings of a vehicle with ``mismatch`` in gusts (m/s)."""
    return (
        f"sim.mass_factor={mismatch.mass}",
        f"sim.thrust_factor={mismatch.thrust}",
        f"sim.drag_factor={mismatch.drag}",
        f"sim.motor_factor={mismatch.motor}",
        f"sim.delay_extra={mismatch.delay}",
        f"sim.gust={gust}",
        CORNERS,
    )


def fly(out: Path, mission: str, vehicle: Path, seed: int, *settings: str) -> Flight:
    """The log of a flight."""
    plan = app.FlightPlan(ROOT / "missions" / f"{mission}.py", out, "sim", vehicle, settings, seed)
    flown = app.fly(plan)
    assert flown.ending.outcome == "GOAL_ACHIEVED", flown.ending
    return read_flight(out / "flight.mcap")


def true_vehicle(vehicle: Path, mismatch: Mismatch) -> VehicleParameters:
    """What flies in simulation where ``vehicle`` is its file."""
    config: Config = load_config(vehicle)
    return perturbed(load_vehicle(config.sim.vehicle), mismatch)


def true_hover(vehicle: VehicleParameters, voltage: float) -> float:
    """Throttle 0..1 of a hover at ``voltage`` V; PX4 knows the motors' curve of all these vehicles."""
    assert vehicle.motor_curve == vehicle.rate_loop.thrust_curve
    return vehicle.hover_thrust * (vehicle.battery.rated_voltage / voltage) ** 2


def true_drag(vehicle: VehicleParameters, flight: Flight) -> Vector:
    """(3,) 1/s, body axes: rotor drag, and body drag by the least squares of its force on the ``flight``'s velocity."""
    truth = flight.truth
    body = np.array([quat_to_matrix(q).T @ v for q, v in zip(truth.orientation, truth.velocity, strict=True)])
    speed = np.linalg.norm(body, axis=1, keepdims=True)
    quadratic = 0.5 * AIR_DENSITY * vehicle.drag_area * np.sum(speed * body**2, axis=0) / np.sum(body**2, axis=0)
    drag: Vector = (np.array(vehicle.linear_drag) + quadratic) / vehicle.mass
    return drag
