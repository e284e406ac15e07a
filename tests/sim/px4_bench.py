"""PX4's model on a simulated vehicle with a tracker, and a clock that moves when told."""

import numpy as np

from flightapp.config import load_config
from flightapp.frames import quat_from_yaw, quat_multiply, quat_rotate
from sim.plant import Plant
from sim.px4.model import Px4
from sim.px4.modes import NavState
from sim.vehicles import load_vehicle

STEP = 0.02


class Px4Bench:
    """``offset`` (3,) m and ``yaw`` rad are where the tracker believes to be, away from the truth."""

    def __init__(self, seed=1, name="racer", z=0.0, **parameters):
        self.now = 0.0
        vehicle = load_vehicle(name)
        config = load_config(overrides=[f"vehicle.hover_thrust={vehicle.hover_thrust}"])
        self.hover = vehicle.hover_thrust
        self.plant = Plant(vehicle, seed, position=(0.0, 0.0, z))
        self.px4 = Px4(config, self.plant, seed, lambda: self.now)
        for key, value in parameters.items():
            self.px4.parameters.set(key, value)
        self.offset, self.yaw, self.counter = np.zeros(3), 0.0, 0
        self.seeing = True
        self.stream = None
        """Body rates and throttle that are sent all the time."""
        self.texts = []

    def see(self):
        """One pose of the tracker."""
        turn = quat_from_yaw(self.yaw)
        position = self.plant.position + self.offset
        orientation = quat_multiply(turn, self.plant.orientation)
        velocity = quat_rotate(turn, self.plant.velocity)
        self.px4.external_vision(self.now, position, orientation, velocity, self.counter)

    def run(self, seconds, until=lambda: False):
        """Go on for so long, or ``until`` something; the seconds it took."""
        begin, end = self.now, self.now + seconds
        while self.now < end - 1e-9 and not until():
            if self.seeing:
                self.see()
            if self.stream is not None:
                self.px4.attitude_target(self.stream[:3], self.stream[3])
            self.now += STEP
            self.px4.advance(self.now)
            while self.px4.texts:
                self.texts.append(self.px4.texts.popleft().text)
        return self.now - begin

    def wait(self, until, patience=20.0):
        """Go on ``until`` it is so; the seconds it took."""
        took = self.run(patience, until)
        assert until(), f"not within {patience} s, mode {self.px4.nav_state.name}"
        return took

    def prepared(self):
        """With a local position."""
        self.wait(lambda: self.px4.ready)
        return self

    def hovering(self):
        """In the air, in takeoff mode."""
        self.prepared()
        assert self.px4.takeoff().accepted
        assert self.px4.arm().accepted
        self.run(6.0)
        return self

    def offboard(self):
        """Hovering on setpoints."""
        self.hovering()
        self.stream = (0.0, 0.0, 0.0, self.hover)
        self.run(0.1)
        assert self.px4.set_mode(NavState.OFFBOARD).accepted
        self.run(0.2)
        assert self.px4.nav_state is NavState.OFFBOARD
        return self
