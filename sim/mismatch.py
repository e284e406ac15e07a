"""Vehicles that are not what their files say: heavier, weaker, slower."""

from dataclasses import replace

from flightapp.config import Simulation
from flightapp.evaluation.control_trials import Mismatch, drawn
from sim.vehicles import VehicleParameters, load_vehicle


def perturbed(vehicle: VehicleParameters, mismatch: Mismatch) -> VehicleParameters:
    """``vehicle`` as ``mismatch`` has it; a delay cannot become negative."""
    mass, thrust, drag, motor = mismatch.mass, mismatch.thrust, mismatch.drag, mismatch.motor
    return vehicle.model_copy(
        update={
            "mass": mass * vehicle.mass,
            "inertia": tuple(mass * moment for moment in vehicle.inertia),
            # Rotors that give more thrust at the same speed: their speeds, and so their torque over thrust, stay.
            "thrust_max": thrust * vehicle.thrust_max,
            "thrust_coefficient": thrust * vehicle.thrust_coefficient,
            "linear_drag": tuple(drag * d for d in vehicle.linear_drag),
            "drag_area": drag * vehicle.drag_area,
            "motor_up": motor * vehicle.motor_up,
            "motor_down": motor * vehicle.motor_down,
            "delay": max(vehicle.delay + mismatch.delay, 0.0),
        }
    )


def mismatched(sim: Simulation, seed: int) -> VehicleParameters:
    """The vehicle that ``sim`` describes, with what it draws from ``seed``; raises `BadInputError` if there is none."""
    of_seed = drawn(seed, sim.mismatch)
    given = replace(
        of_seed,
        mass=sim.mass_factor * of_seed.mass,
        thrust=sim.thrust_factor * of_seed.thrust,
        drag=sim.drag_factor * of_seed.drag,
        motor=sim.motor_factor * of_seed.motor,
        delay=sim.delay_extra + of_seed.delay,
    )
    return perturbed(load_vehicle(sim.vehicle), given)
