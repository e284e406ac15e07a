"""Coming to rest along the line being flown: its path, which is known to be free, at a rate that falls to nothing."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flightapp.config import Config
from flightapp.frames import Vector
from flightapp.interfaces import Limits
from flightapp.planning.pacer import TOLERATED
from flightapp.planning.pacing import Pace, paced
from flightapp.trajectory import Trajectory

RAMPS = (0.6, 0.75, 0.9, 1.15, 1.4, 1.7, 2.0, 2.5, 3.0, 4.5, 6.0)
"""s, durations of the braking that are tried, the shortest first."""
TURNING = 0.9
"""Of the greatest body rate that braking may take, which is more than plans do: it ends soon, and all depends on it."""
FURTHER = 0.05
"""s of the line's own time between places to stop at that are looked at."""

Free = Callable[[Vector], NDArray[np.bool_]]
"""Whether each of (n, 3) m is a place to stop at."""


class Brakes:
    """Knows what braking may ask of the vehicle."""

    def __init__(self, config: Config) -> None:
        planning, vehicle = config.planning, config.vehicle
        self._most = planning.thrust_share * vehicle.thrust_max
        self._least = config.guard.thrust_min
        self._turning = TURNING * vehicle.rate_max

    def brake(self, flown: Trajectory, stamp: float, limits: Limits, free: Free | None = None) -> Trajectory | None:
        """``flown`` from ``stamp`` on, brought to rest along its own path as soon as the limits allow.

        Where that would not be at a ``free`` place it goes on to the next one, if there is any, before it brakes, so
        that the braking may begin later than ``stamp``. None where ``flown`` is at its end before any of it could make
        a difference, or ends at the next free place. It takes over from ``flown`` without a jump. Where no braking
        keeps to the limits (``flown`` itself does not) the longest is taken.
        """
        begun, braked, stop = stamp - flown.stamp, None, 0.0
        for ramp in RAMPS:
            if begun + 0.5 * ramp >= flown.duration:
                break
            stop = begun + 0.5 * ramp
            braked, good = self._rest(flown, begun, stop, limits)
            if good:
                break
        if braked is None or free is None or free(flown.sample(np.array([stop])).position)[0]:
            return braked
        return self._further(flown, begun, stop, limits, free, braked)

    def _further(
        self, flown: Trajectory, begun: float, stop: float, limits: Limits, free: Free, braked: Trajectory
    ) -> Trajectory | None:
        """To rest at the first free place after ``stop``; ``braked`` where there is none."""
        stops = np.append(np.arange(stop, flown.duration, FURTHER)[1:], flown.duration)
        among = stops[free(flown.sample(stops).position)]
        if among.size == 0:
            return braked
        if among[0] == flown.duration:
            return None
        later = braked
        for ramp in RAMPS:
            if among[0] - 0.5 * ramp < begun:
                break
            later, good = self._rest(flown, among[0] - 0.5 * ramp, among[0], limits)
            if good:
                break
        return later

    def _rest(self, flown: Trajectory, begin: float, stop: float, limits: Limits) -> tuple[Trajectory, bool]:
        """``flown``, braked from ``begin`` on to rest at ``stop`` (s of its own), and whether that is in the limits."""
        ahead, stamp = _until(flown, stop), flown.stamp + begin
        braked = paced(ahead, begin, Pace(stamp, 1.0, 0.0, 2.0 * (stop - begin)), stamp)
        return braked, self._can(braked, ahead, limits)

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
