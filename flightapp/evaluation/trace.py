"""A flight's motion, thinned, so that many of them can be kept and drawn."""

from typing import Any

import numpy as np

from flightapp.evaluation.flight import Flight, Motions, Setpoints
from flightapp.evaluation.metrics import interpolated, racing_window
from flightapp.frames import Vector

STEP = 0.05
"""s between the moments that are kept, at least."""
MOST = 600
"""Moments that are kept, at most."""
DECIMALS = 4


def trace(flight: Flight) -> dict[str, Any]:
    """The flight inside its racing window: "time" (s), and of each source "position" (m) and "velocity" (m/s) rows.

    The sources are "reference", "estimate" and "truth", each interpolated at the same moments; "gates" are the true
    ones' (x, y, z, yaw), in the order in which they were passed first. A source that was not recorded is missing.
    """
    window = racing_window(flight)
    count = int(min(max(window.duration / STEP, 1.0), MOST)) + 1
    at = np.linspace(window.start, window.end, count)
    sources: dict[str, Motions | Setpoints] = {
        "reference": flight.setpoints,
        "estimate": flight.states,
        "truth": flight.truth,
    }
    rows = {name: _rows(motion, at) for name, motion in sources.items() if motion.stamp.size}
    gates = {gate.gate_id: gate for report in flight.true_gates for gate in report}
    places = [[*np.round(g.position, DECIMALS).tolist(), round(float(g.yaw), DECIMALS)] for g in gates.values()]
    return {"time": np.round(at - window.start, DECIMALS).tolist(), **rows, "gates": places}


def _rows(motion: Motions | Setpoints, at: Vector) -> dict[str, Any]:
    columns = {"position": motion.position, "velocity": motion.velocity}
    return {
        name: np.round(interpolated(motion.stamp, values, at), DECIMALS).tolist() for name, values in columns.items()
    }
