"""Which collisions a fault forces on a vehicle: those with what it could not have stopped before.

From the moment of some faults on nobody steers: nothing reaches the autopilot, there is no state to steer by, or a
pilot has taken over. The vehicle flies on as it did for a known time, then the autopilot leans back and brakes. What
stands nearer, by the truth, than it takes to stop so may be hit whatever the application does; anything else may not.

Where commands end, the autopilot flies the last body rates on for as long. What these turn over meanwhile comes down
as it can.
"""

import math

import numpy as np

from flightapp.frames import Vector
from flightapp.messages import GateEstimate
from flightapp.planning.below import ASIDE
from flightapp.planning.obstacles import OWNER, Margins, distance, packed
from flightapp.track import Track

BRAKING = 3.0
"""m/s², with which the autopilot brakes (MPC_ACC_HOR)."""
LEANING = 0.25
"""s lost until it brakes so. PX4 builds it up with at most MPC_JERK_AUTO, 4 m/s³ by default, which would take more."""


def stopping_distance(speed: float, blind: float) -> float:
    """m that a vehicle of ``speed`` m/s needs that flies on for ``blind`` s before the autopilot brakes.

    What a landing may go aside is in it.
    """
    return speed * (blind + LEANING) + speed * speed / (2.0 * BRAKING) + ASIDE


def turned_over(tilt: float, rate: float, held: float) -> bool:
    """Whether body rates of ``rate`` rad/s, flown on for ``held`` s, may lay a vehicle on its side, or worse.

    It is tilted by ``tilt`` rad when they begin; where nothing is flown on it is not turned at all.
    """
    return held > 0.0 and tilt + rate * held > 0.5 * math.pi


def gap(track: Track, obstacle: str, place: Vector, radius: float) -> float:
    """m between a ball of ``radius`` m at ``place`` (3,) and what ``obstacle`` names; infinite for the ground.

    Names are those of collisions: "gate 1", or an obstacle's own.
    """
    gates = [
        GateEstimate(gate.id, np.array(gate.position), gate.yaw, np.zeros((4, 4)), 1, 0.0, surveyed=True)
        for gate in track.gates
    ]
    rows = packed(track.obstacles, gates, track.gate, Margins(radius, 0.0, 0.0))
    names = [solid.name for solid in track.obstacles] + [f"gate {gate.id}" for gate in track.gates]
    gradient = np.empty(3)
    gaps = [
        distance(np.ascontiguousarray(place, float), rows, i, gradient) - radius
        for i in range(rows.shape[0])
        if names[int(rows[i, OWNER])] == obstacle
    ]
    return min(gaps, default=np.inf)


def is_forced(track: Track, obstacle: str, place: Vector, speed: float, radius: float, blind: float) -> bool:
    """Whether a vehicle that was at ``place`` (3,) m with ``speed`` m/s when nobody steered any more must hit it."""
    return gap(track, obstacle, place, radius) <= stopping_distance(speed, blind)
