"""A safety pilot who has taken the vehicle over: brakes, flies clear of what stands below, lands."""

import math

import numpy as np

from flightapp.config import Config
from flightapp.frames import Vector, quat_yaw
from flightapp.messages import GateEstimate
from flightapp.planning.below import Below
from flightapp.track import Track
from sim.px4.model import Px4
from sim.px4.modes import NavState

LOOK = 0.1
"""s between two looks."""
SPEED = 0.8
"""m/s at which a pilot flies clear."""
SLOW = 0.25
"""m/s of a vehicle that has stopped."""
FAR = np.arange(0.2, 4.1, 0.2)
"""m ahead and behind at which a pilot looks for a free place."""


class Pilot:
    """Sees where the vehicle is and what stands where, and has sticks; the vehicle is in a mode of theirs.

    Until ``patient`` (s of the plant's time) the sticks stay centred.
    """

    def __init__(self, config: Config, track: Track, px4: Px4, patient: float) -> None:
        gates = [
            GateEstimate(gate.id, np.array(gate.position), gate.yaw, np.zeros((4, 4)), 1, 0.0, surveyed=True)
            for gate in track.gates
        ]
        self._below = Below(config, track, gates)
        self._px4, self._patient = px4, patient
        self._next_look = -math.inf

    def fly(self, now: float) -> bool:
        """Look and steer at ``now``; whether the landing has been asked for."""
        if now < self._next_look:
            return False
        self._next_look = now + LOOK
        plant = self._px4.plant
        place, speed = plant.position, float(np.linalg.norm(plant.velocity))
        if self._below.what(place):
            push = self._way_out(place, float(quat_yaw(plant.orientation))) if now >= self._patient else np.zeros(2)
            self._px4.push_sticks(float(push[0]), float(push[1]))
            return False
        self._px4.push_sticks(0.0, 0.0)
        if now < self._patient or speed > SLOW:
            return False
        self._px4.set_mode(NavState.AUTO_LAND)
        return True

    def _way_out(self, place: Vector, yaw: float) -> Vector:
        """(2,) m/s towards the nearest free place ahead or behind; nothing where there is none."""
        ahead = np.array((math.cos(yaw), math.sin(yaw), 0.0))
        steps = np.column_stack((FAR, -FAR)).ravel()
        free = steps[self._below.free(place + steps[:, None] * ahead)]
        return SPEED * math.copysign(1.0, free[0]) * ahead[:2] if free.size else np.zeros(2)
