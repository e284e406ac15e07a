"""Coming to rest along the line being flown: its path, which is known to be free, at a rate that falls to nothing."""

from dataclasses import replace

import numpy as np

from flightapp.config import Config
from flightapp.frames import Vector
from flightapp.interfaces import Limits
from flightapp.planning.pacer import TOLERATED
from flightapp.planning.pacing import Pace, paced
from flightapp.trajectory import Trajectory

RAMPS = (0.6, 0.9, 1.4, 2.0, 3.0, 4.5, 6.0)
"""s, durations of the braking that are tried, the shortest first."""


class Brakes:
    """Knows what braking may ask of the vehicle."""

    def __init__(self, config: Config) -> None:
        planning, vehicle = config.planning, config.vehicle
        self._most = planning.thrust_share * vehicle.thrust_max
        self._least = config.guard.thrust_min
        self._turning = planning.rate_share * vehicle.rate_max

    def brake(self, flown: Trajectory, stamp: float, limits: Limits) -> Trajectory | None:
        """``flown`` from ``stamp`` on, brought to rest along its own path as soon as the limits allow.

        None where it is at its end before that could make a difference. It takes over from ``flown`` without a jump.
        Where no braking keeps to the limits (``flown`` itself does not) the longest is taken.
        """
        begun, braked = stamp - flown.stamp, None
        for ramp in RAMPS:
            if begun + 0.5 * ramp >= flown.duration:
                break
            ahead = _until(flown, begun + 0.5 * ramp)
            braked = paced(ahead, begun, Pace(stamp, 1.0, 0.0, ramp), stamp)
            if self._can(braked, ahead, limits):
                break
        return braked

    def _can(self, braked: Trajectory, ahead: Trajectory, limits: Limits) -> bool:
        asked, own = braked.limits(), ahead.limits()
        return (
            asked.acceleration <= TOLERATED * max(limits.a_max, own.acceleration)
            and asked.specific_force <= TOLERATED * max(self._most, own.specific_force)
            and asked.specific_force_min >= min(self._least, own.specific_force_min) / TOLERATED
            and asked.body_rate <= TOLERATED * max(self._turning, own.body_rate)
        )


def _until(plan: Trajectory, end: float) -> Trajectory:
    """``plan`` up to ``end`` (s since its start), which is before its own."""
    gates = [(gate, time) for gate, time in zip(plan.gate_ids, plan.gate_times, strict=True) if time < end]
    knots, coefficients = _cut(plan.knots, plan.coefficients, end)
    yaw_knots, yaw_coefficients = _cut(plan.yaw_knots, plan.yaw_coefficients, end)
    return replace(
        plan,
        knots=knots,
        coefficients=coefficients,
        yaw_knots=yaw_knots,
        yaw_coefficients=yaw_coefficients,
        gate_ids=tuple(gate for gate, _ in gates),
        gate_times=tuple(time for _, time in gates),
    )


def _cut(knots: Vector, coefficients: Vector, end: float) -> tuple[Vector, Vector]:
    if end >= knots[-1]:
        return knots, coefficients
    kept = int(np.searchsorted(knots, end))
    return np.append(knots[:kept], end), coefficients[:kept]
