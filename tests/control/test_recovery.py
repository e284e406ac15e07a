"""What becomes of a vehicle that is not where or how it should be: PX4's rate loop and all, judged by the truth."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from flightapp.config import Config
from flightapp.control.flatness import FlatnessController
from flightapp.frames import GRAVITY, quat_from_euler, quat_to_matrix
from flightapp.messages import VehicleState
from flightapp.trajectory import hover
from sim import layout as at
from sim.plant import Plant
from sim.vehicles import load_vehicle

CONFIG = Config()
RACER = load_vehicle("racer")
HOVER = CONFIG.vehicle.hover_thrust
AGE = 0.005
WARM = 0.3
"""s in which the rotors get up to speed."""


@dataclass
class Flown:
    """Truth at each tick."""

    positions: np.ndarray
    tilts: np.ndarray
    """deg."""
    thrusts: np.ndarray
    """m/s², commanded."""

    def off(self, goal):
        return np.linalg.norm(self.positions - goal, axis=1)

    def settled(self, goal, within):
        """s from when on it stays so near to ``goal``."""
        outside = np.flatnonzero(self.off(goal) > within)
        return 0.0 if not outside.size else (outside[-1] + 1) / 250.0


def released(
    goal, seconds, *, vehicle=RACER, orientation=None, velocity=(0.0, 0.0, 0.0), gust=0.0, shift=None, at_xyz=None
):
    """Fly to ``goal`` from ``at_xyz``, there if None; ``shift`` s → (3,) is what the estimate is off by."""
    start = np.array(goal if at_xyz is None else at_xyz, float)
    plant = Plant(vehicle, 3, gust=gust, position=start)
    plant.command(0.0, (0.0, 0.0, 0.0), HOVER)
    plant.advance(WARM)
    plant.memory[0:3] = start
    plant.memory[at.VELOCITY : at.OMEGA] = velocity
    if orientation is not None:
        plant.memory[at.ORIENTATION : at.VELOCITY] = orientation
    controller, line = FlatnessController(CONFIG), hover(0.0, np.array(goal, float), 0.0)
    positions, tilts, thrusts = [], [], []
    for tick in range(1, round(250.0 * seconds) + 1):
        stamp = WARM + tick / 250.0
        plant.advance(stamp)
        assert not plant.on_ground
        positions.append(plant.position)
        tilts.append(np.degrees(np.arccos(np.clip(quat_to_matrix(plant.orientation)[2, 2], -1.0, 1.0))))
        x = plant.state_at(max(stamp - AGE, WARM + 0.001))
        wrong = np.zeros(3) if shift is None else shift(stamp)
        seen = VehicleState(max(stamp - AGE, WARM + 0.001), x[1:4] + wrong, x[4:8], x[8:11], x[11:14], np.zeros((9, 9)))
        command = controller.command(stamp, seen, line)
        thrusts.append(command.thrust)
        plant.command(stamp + vehicle.delay, command.rates, command.thrust * HOVER / GRAVITY)
    return Flown(np.array(positions), np.array(tilts), np.array(thrusts))


@pytest.mark.parametrize(
    ("roll", "loss", "time"), [(0.5 * np.pi, 1.0, 3.0), (np.pi, 3.0, 4.0)], ids=["side", "inverted"]
)
def test_released_at_two_metres_a_second_and_rolled_it_recovers(roll, loss, time):
    goal = np.array([0.0, 0.0, 5.0])
    flown = released(goal, 6.0, orientation=quat_from_euler(roll, 0.0, 0.0), velocity=(2.0, 0.0, 0.0))
    assert flown.positions[:, 2].min() > goal[2] - loss
    assert flown.settled(goal, 0.1) < time
    assert flown.tilts[-250:].max() < 3.0


def test_gusts_of_one_metre_per_second_squared_move_it_by_centimetres():
    drag = CONFIG.vehicle.drag[0]
    goal = np.array([0.0, 0.0, 2.0])
    flown = released(goal, 20.0, gust=1.0 / drag)
    assert flown.off(goal).max() < 0.15
    assert np.sqrt(np.mean(flown.off(goal) ** 2)) < 0.05


def test_a_fall_that_saturates_the_motors_is_caught_and_climbed_back_without_overshoot():
    goal = np.array([0.0, 0.0, 12.0])
    weak = RACER.model_copy(update={"thrust_max": 0.8 * RACER.thrust_max})
    flown = released(goal, 10.0, vehicle=weak, at_xyz=(2.0, 0.0, 8.0), velocity=(0.0, 0.0, -8.0))
    assert flown.thrusts.max() > 0.999 * CONFIG.vehicle.thrust_max
    assert flown.positions[:, 2].min() > 8.0 - 3.5
    assert flown.positions[:, 2].max() < goal[2] + 0.3
    assert flown.settled(goal, 0.05) < 9.0
    assert flown.tilts.max() < CONFIG.control.tilt_max_deg + 2.0


def test_a_state_that_jumps_is_followed_without_overshoot():
    goal, jump, when = np.array([0.0, 0.0, 2.0]), np.array([0.3, 0.0, 0.0]), 1.0
    flown = released(goal, 5.0, shift=lambda stamp: jump if stamp > when else np.zeros(3))
    after = replace(flown, positions=flown.positions[round(250 * (when - WARM)) :])
    assert after.settled(goal - jump, 0.03) < 1.5
    assert after.positions[:, 0].min() > -jump[0] - 0.05
    assert flown.tilts.max() < 30.0
