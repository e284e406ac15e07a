"""The filter's numbers from the configuration."""

import numpy as np

from flightapp.config import Estimation, GateMapping
from flightapp.estimation import process as at
from flightapp.frames import Vector

POSE_GATE = 50.0
"""χ² (3 dof) beyond which a pose is not believed: what is wrong with poses is mostly found before."""


def process_settings(e: Estimation, m: GateMapping) -> Vector:
    """The row of settings that the kernels of `process` and `correction` take."""
    s = np.zeros(at.SETTINGS)
    s[at.ACCELEROMETER], s[at.MANOEUVRE], s[at.BIAS_WALK] = e.accelerometer_noise, e.manoeuvre, e.accelerometer_walk
    s[at.WALK], s[at.WALK_AT_REST] = e.drift_walk, e.drift_at_rest
    s[at.YAW_WALK], s[at.YAW_AT_REST] = e.yaw_walk, e.yaw_at_rest
    s[at.SLIP_ACROSS], s[at.SLIP_TIME] = e.slip_across, e.slip_time
    s[at.CLIMB_SIZE], s[at.CLIMB_TIME], s[at.CLIMB_FADES] = e.slip_up, e.slip_up_time, e.slip_fades
    s[at.TILT_SIZE], s[at.TILT_TIME] = e.tilt_error, e.tilt_time
    s[at.POSITION_NOISE], s[at.VELOCITY_NOISE] = e.position_noise, e.velocity_noise
    s[at.GATING], s[at.GATE_WALK] = POSE_GATE, m.gate_walk
    return s
