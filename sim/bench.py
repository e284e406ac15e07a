"""How fast the simulation alone is."""

from collections.abc import Callable

from sim.plant import Plant
from sim.vehicles import VehicleParameters, load_vehicle

SIMULATED = 10.0
"""s of flight in one measurement."""
PERIOD = 0.004
"""s between commands."""


def rows() -> list[tuple[str, float, Callable[[], object]]]:
    """Name, simulated seconds and the function that simulates them."""
    vehicle = load_vehicle("racer")
    return [("sim_vehicle", SIMULATED, lambda: _hover(vehicle))]


def _hover(vehicle: VehicleParameters) -> Plant:
    plant = Plant(vehicle, 0, wind=1.0, gust=0.5, position=(0.0, 0.0, 50.0))
    throttle = vehicle.hover_thrust
    for tick in range(int(SIMULATED / PERIOD)):
        now = tick * PERIOD
        plant.command(now, (0.1, -0.1, 0.2), throttle)
        plant.advance(now + PERIOD)
    return plant
