"""What a first-order lag behind a delay makes of commands."""

import math

import numpy as np

from flightapp.frames import Vector
from flightapp.jit import kernel

SHORTEST = 1e-5
"""s, a shorter lag is none."""


@kernel
def lagged(stamps: Vector, values: Vector, delay: float, lag: float, at: Vector) -> Vector:
    """(m,) the answer at the ascending times ``at`` (m,) to commands ``values`` (n,) sent at ``stamps`` (n,).

    Each is held until the next, acts ``delay`` s later and is followed with the time constant ``lag`` s, exactly.
    Before the first has acted, the answer is as if it had always been in force.
    """
    out = np.empty(at.size)
    value = values[0]
    i = -1
    for k in range(at.size):
        while i + 1 < stamps.size and stamps[i + 1] + delay <= at[k]:
            if i >= 0:
                value = _followed(value, values[i], stamps[i + 1] - stamps[i], lag)
            i += 1
        out[k] = value if i < 0 else _followed(value, values[i], at[k] - stamps[i] - delay, lag)
    return out


@kernel
def _followed(value: float, command: float, duration: float, lag: float) -> float:
    """``value`` after ``duration`` s of a ``command``."""
    if lag < SHORTEST:
        return command
    return command + (value - command) * math.exp(-duration / lag)
