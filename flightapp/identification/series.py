"""From a flight log to what the vehicle was told, and what it did meanwhile."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from flightapp.autopilot.thrust import ThrustMap
from flightapp.config import Vehicle
from flightapp.evaluation.flight import Flight
from flightapp.frames import Vector
from flightapp.messages import AutopilotStatus, FlightMode

GAP = 0.05
"""s between commands, or states, from which a stretch is over."""
SETTLING = 1.0
"""s after the first command, in which what was before fades."""
SHORTEST = 3.0
"""s, of a stretch that is used."""
VOLTAGE_SMOOTHING = 1.0
"""s, time constant over which the battery's voltage is followed: its sag under short loads belongs to the motors."""


@dataclass(frozen=True, slots=True)
class Stretch:
    """A part of a flight in which the autopilot followed our commands without a break."""

    sent: Vector
    """(n,) s, stamps of the commands."""
    rates: Vector
    """(n, 3) rad/s, commanded."""
    throttle: Vector
    """(n,) 0..1, commanded."""
    stamp: Vector
    """(m,) s, of the states; the first is `SETTLING` after the first command."""
    orientation: Vector
    """(m, 4) q_wb."""
    velocity: Vector
    """(m, 3) m/s, world."""
    angular_velocity: Vector
    """(m, 3) rad/s, body."""
    voltage: Vector
    """(m,) V, smoothed; NaN where it is not known."""

    @property
    def duration(self) -> float:
        """s."""
        return float(self.stamp[-1] - self.stamp[0])


def stretches(flight: Flight, vehicle: Vehicle) -> list[Stretch]:
    """The usable parts of ``flight``, which flew with the configuration ``vehicle``."""
    commands, states = flight.commands, flight.states
    if commands.stamp.size == 0 or states.stamp.size == 0:
        return []
    throttle = _throttle(flight, vehicle)
    followed = _followed(flight.statuses, commands.stamp)
    found = []
    for first, last in _runs(commands.stamp, followed):
        begin, end = commands.stamp[first] + SETTLING, commands.stamp[last]
        inside = (states.stamp >= begin) & (states.stamp <= end) & (states.doubtful == 0)
        for a, b in _runs(states.stamp, inside):
            if states.stamp[b] - states.stamp[a] < SHORTEST:
                continue
            part, to = slice(a, b + 1), slice(first, last + 1)
            motion = (states.orientation[part], states.velocity[part], states.angular_velocity[part])
            sent = (commands.stamp[to], commands.rates[to], throttle[to])
            found.append(Stretch(*sent, states.stamp[part], *motion, _voltage(flight.statuses, states.stamp[part])))
    return found


def _throttle(flight: Flight, vehicle: Vehicle) -> Vector:
    """(n,) what each command was turned into for the autopilot."""
    thrust, commands = ThrustMap.of(vehicle), flight.commands
    statuses = iter(flight.statuses)
    status = next(statuses, None)
    throttle = np.empty(commands.stamp.size)
    for i, (stamp, force) in enumerate(zip(commands.stamp.tolist(), commands.thrust.tolist(), strict=True)):
        while status is not None and status.stamp <= stamp:
            thrust.observe_voltage(status.voltage, status.stamp)
            status = next(statuses, None)
        throttle[i] = thrust.throttle(force)
    return throttle


def _followed(statuses: tuple[AutopilotStatus, ...], stamps: Vector) -> Vector:
    """(n,) whether the autopilot was following commands in the air at each of ``stamps``."""
    if not statuses:
        return np.zeros(stamps.size, bool)
    flying = np.array([s.armed and not s.landed and s.mode is FlightMode.OFFBOARD for s in statuses])
    newest = np.searchsorted([s.stamp for s in statuses], stamps, side="right") - 1
    return np.where(newest >= 0, flying[np.maximum(newest, 0)], False)


def _runs(stamps: Vector, wanted: Vector) -> list[tuple[int, int]]:
    """First and last index of each run of ``wanted`` stamps without a `GAP`."""
    indices = np.flatnonzero(wanted)
    if indices.size == 0:
        return []
    broken = (np.diff(indices) > 1) | (np.diff(stamps[indices]) > GAP)
    ends = np.flatnonzero(broken)
    firsts, lasts = np.concatenate(([0], ends + 1)), np.concatenate((ends, [indices.size - 1]))
    return [(int(indices[a]), int(indices[b])) for a, b in zip(firsts, lasts, strict=True)]


def _voltage(statuses: tuple[AutopilotStatus, ...], at: Vector) -> Vector:
    """(m,) the battery's voltage at ``at``, smoothed to both sides alike; NaN where it was never told."""
    told = [(s.stamp, s.voltage) for s in statuses if math.isfinite(s.voltage) and s.voltage > 0.0 and s.armed]
    if len(told) < 2:
        return np.full(at.size, np.nan)
    stamps, volts = np.array(told).T
    times = np.arange(at[0], at[-1], 0.1)
    even: Vector = np.interp(times, stamps, volts)
    keep = math.exp(-0.1 / (0.5 * VOLTAGE_SMOOTHING))
    for _ in range(2):
        even, _ = lfilter([1.0 - keep], [1.0, -keep], even, zi=[keep * even[0]])
        even = even[::-1]
    smoothed: Vector = np.interp(at, times, even)
    return smoothed
