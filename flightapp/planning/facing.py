"""Gives a planned path its heading, which makes it a trajectory."""

from collections.abc import Sequence

import numpy as np

from flightapp.config import Config
from flightapp.frames import Vector
from flightapp.interfaces import PlanRequest
from flightapp.planning.heading import brake, heading_pieces, most_pieces
from flightapp.trajectory import Trajectory

_NOWHERE: Vector = np.full(3, np.nan)
_NO_GATES: Vector = np.empty((0, 3))
_NO_TIMES: Vector = np.empty(0)


class Heading:
    """Where the camera looks, as the configuration wants it; every planner's last step.

    `planning.yaw` is "gates": at the next gate, then at the request's `look_at`, else along the path; "path": along
    the path; or "fixed": as at the start. The heading keeps to the request's yaw rate and to the configuration's yaw
    acceleration.
    """

    def __init__(self, config: Config) -> None:
        self._mode = config.planning.yaw
        self._acceleration = float(config.planning.yaw_acceleration)

    def complete(
        self, knots: Vector, coefficients: Vector, passages: Sequence[float], request: PlanRequest
    ) -> Trajectory:
        """The trajectory along ``knots`` (n + 1,) s and ``coefficients`` (n, 3, 8).

        ``passages`` are the times (s since the start) at which it is in each of the request's gates, empty where it
        does not fly through them.
        """
        # One layout for all trajectories: a kernel would compile anew, in flight, for another.
        knots, coefficients = np.ascontiguousarray(knots, float), np.ascontiguousarray(coefficients, float)
        gates = request.gates if len(passages) else ()
        yaw_knots, yaw_coefficients = self._pieces(knots, coefficients, passages, request)
        ids = tuple([gate.gate_id for gate in gates])
        times = tuple([float(time) for time in passages])
        return Trajectory(request.stamp, knots, coefficients, yaw_knots, yaw_coefficients, ids, times)

    def _pieces(
        self, knots: Vector, coefficients: Vector, passages: Sequence[float], request: PlanRequest
    ) -> tuple[Vector, Vector]:
        """Yaw knots (m + 1,) and coefficients (m, 4)."""
        start = np.array((request.start.yaw, request.start.yaw_rate), float)
        if self._mode == "fixed":
            return self._held(float(knots[-1]), start)
        aims, times, watch = _NO_GATES, _NO_TIMES, _NOWHERE
        if self._mode == "gates":
            if len(passages):
                aims = np.array([gate.position for gate in request.gates], float)
                times = np.array(passages, float)
            if request.look_at is not None:
                watch = np.array(request.look_at, float)
        limits = np.array((request.limits.yaw_rate_max, self._acceleration), float)
        most = most_pieces(float(knots[-1]), len(times))
        places, pieces = np.empty(most + 1), np.empty((most, 4))
        used = heading_pieces(knots, coefficients, start, aims, times, watch, limits, places, pieces)
        return places[: used + 1], pieces[:used]

    def _held(self, duration: float, start: Vector) -> tuple[Vector, Vector]:
        """The heading comes to rest at once, and stays."""
        yaw, rate = float(start[0]), float(start[1])
        places, pieces = np.zeros(3), np.zeros((2, 4))
        used = brake(yaw, rate, self._acceleration, 0.0, 0, places, pieces)
        time = float(places[used])
        pieces[used, 0] = yaw + 0.5 * rate * time
        places[used + 1] = max(duration, time + 1e-3)
        return places[: used + 2], pieces[: used + 1]
