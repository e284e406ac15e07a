"""Whether a vehicle would stay on a trajectory: the closed loop flown in compiled code before anything flies it.

The flight controller's own kernel flies the vehicle as the configuration describes it: lags of rates and thrust, drag
and limits. All runs on the time at which commands take effect: a vehicle that is as described behaves as if there
were no delay, since the controller predicts it away (O. J. Smith, 1957). Tracking is either centimetres or a tumble,
so that one pass tells them apart.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from flightapp.config import Config
from flightapp.control import layout as at
from flightapp.control.attitude import thrust_turn
from flightapp.control.flatness import control_memory, flatness_command
from flightapp.control.foresight import remember
from flightapp.control.parameters import Parameters, parameters_of, unpacked
from flightapp.control.prediction import ENTRY, HISTORY, MASK, Motion, predict
from flightapp.control.vectors import Quaternion, Triple, axes, cross, dot
from flightapp.frames import GRAVITY, Vector
from flightapp.jit import kernel
from flightapp.planning.pacing import contiguous
from flightapp.trajectory import Trajectory, evaluate

LOST = 3.0
"""Times the greatest error allowed, beyond which it is not worth flying on."""
NEAR = 1.0
"""s from a gate within which a fault is near it."""
BOUND = 0.999
"""Share of a limit at which a command counts as held back by it."""

COLLECTIVE = 0.96
"""Share of the full thrust that is to be had while turning: near it the rotors that turn the vehicle take from it."""


@dataclass(frozen=True, slots=True)
class Feasibility:
    """How the closed loop flew a trajectory."""

    ok: bool
    error: float
    """m, greatest distance from the line."""
    when: float
    """s since the start at which that was."""
    thrust: float
    """s for which a limit of the thrust held the command back."""
    tilt: float
    """s for which the line asks for more tilt than the controller may command."""
    turning: float
    """s for which the limit of the body rates held the command back."""
    why: str
    """Why it is not feasible; empty where it is."""


@kernel
def _upright(z: Triple, yaw: float) -> Quaternion:
    """q_wb with the body's z axis along the unit vector ``z`` and its x axis in the vertical plane of ``yaw``."""
    n = math.sqrt(max(2.0 + 2.0 * z[2], 1e-9))
    w, x, y = 0.5 * n, -z[1] / n, z[0] / n
    front = cross((-math.sin(yaw), math.cos(yaw), 0.0), z)
    # The front as the tilted body sees it: turned back by the tilt (w, x, y, 0).
    ex = (1.0 - 2.0 * y * y, 2.0 * x * y, -2.0 * w * y)
    ey = (2.0 * x * y, 1.0 - 2.0 * x * x, 2.0 * w * x)
    half = 0.5 * math.atan2(dot(ey, front), dot(ex, front))
    c, s = math.cos(half), math.sin(half)
    return w * c, x * c + y * s, y * c - x * s, w * s


@kernel
def _reference_force(p: Parameters, r: Vector) -> Triple:
    """Specific force (world, m/s²) for the reference ``r`` (17,), with the mean of the horizontal drag."""
    d = 0.5 * (p.drag_x + p.drag_y)
    return r[6] + d * r[3], r[7] + d * r[4], r[8] + d * r[5] + GRAVITY


@kernel
def _too_tilted(p: Parameters, r: Vector) -> bool:
    """Whether the reference asks for more tilt than may be commanded."""
    force = _reference_force(p, r)
    return force[2] < p.tilt_cotangent * math.sqrt(force[0] ** 2 + force[1] ** 2)


@kernel
def _begin(p: Parameters, r: Vector) -> Motion:
    """The motion of a vehicle that follows the reference ``r`` (17,)."""
    d = 0.5 * (p.drag_x + p.drag_y)
    v, a, j = (r[3], r[4], r[5]), (r[6], r[7], r[8]), (r[9], r[10], r[11])
    force = _reference_force(p, r)
    force_rate = (j[0] + d * a[0], j[1] + d * a[1], j[2] + d * a[2])
    length = max(math.sqrt(dot(force, force)), 1e-6)
    z = (force[0] / length, force[1] / length, force[2] / length)
    q = _upright(z, r[15])
    body = axes(q)
    turn, _ = thrust_turn(z, force, force_rate, (0.0, 0.0, 0.0))
    omega = cross(z, turn)
    rates = (dot(body[0], omega), dot(body[1], omega), r[16] * z[2])
    thrust = length + (p.drag_z - d) * dot(body[2], v)
    return (r[0], r[1], r[2]), v, q, rates, thrust


@kernel
def _tell(m: Vector, stamp: float, motion: Motion) -> None:
    """Have the controller at ``stamp`` see ``motion`` as it is."""
    position, velocity, q, rates, _ = motion
    s = at.STATE
    m[at.STAMP] = m[s] = stamp
    m[s + 1], m[s + 2], m[s + 3] = position
    m[s + 4], m[s + 5], m[s + 6], m[s + 7] = q
    m[s + 8], m[s + 9], m[s + 10] = velocity
    m[s + 11], m[s + 12], m[s + 13] = rates


@kernel
def closed_loop(
    m: Vector,
    knots: Vector,
    coefficients: Vector,
    yaw_knots: Vector,
    yaw_coefficients: Vector,
    period: float,
    lost: float,
    report: Vector,
) -> None:
    """Fly a trajectory from its start to its end with one command every ``period`` s, or until ``lost`` m off it.

    ``m`` is the controller's memory with the same trajectory, from 0 on. ``report`` (5,) gets the greatest error (m),
    its time (s), and the seconds during which the limits of thrust, tilt and body rates were in the way.
    """
    p = unpacked(m)
    history, r = np.zeros((HISTORY, ENTRY)), np.empty(17)
    evaluate(knots, coefficients, yaw_knots, yaw_coefficients, 0.0, r)
    motion = _begin(p, r)
    # What the vehicle is doing is the effect of a command before.
    rates, thrust = motion[3], motion[4]
    first = history[0]
    first[0], first[4], first[5] = -period, thrust, thrust
    first[1], first[2], first[3] = rates
    told = (rates[0], rates[1], rates[2], thrust)
    remember(m, -period, told, told, (0.0, 0.0, 0.0, 0.0))
    count = 1
    for i in range(report.size):
        report[i] = 0.0
    for tick in range(math.ceil(knots[-1] / period)):
        stamp = tick * period
        _tell(m, stamp, motion)
        sent = flatness_command(m)
        if math.isnan(sent):
            report[0], report[1] = math.inf, stamp
            return
        entry = history[count & MASK]
        entry[0], entry[4], entry[5] = stamp + p.delay, sent / (1.0 + m[at.TRIM]), motion[4]
        entry[1], entry[2], entry[3] = m[at.RATES], m[at.RATES + 1], m[at.RATES + 2]
        count += 1
        if sent >= BOUND * p.thrust_max or sent <= p.thrust_min / BOUND:
            report[2] += period
        if m[at.RATES] ** 2 + m[at.RATES + 1] ** 2 >= (BOUND * p.rate_max) ** 2:
            report[4] += period
        motion = predict(p, motion, stamp, stamp + period, history, count)
        evaluate(knots, coefficients, yaw_knots, yaw_coefficients, stamp + period, r)
        if _too_tilted(p, r):
            report[3] += period
        off = (motion[0][0] - r[0], motion[0][1] - r[1], motion[0][2] - r[2])
        error = math.sqrt(dot(off, off))
        if not error <= report[0]:
            report[0], report[1] = error, stamp + period
        if not error <= lost:
            return


class Screen:
    """Tells trajectories that fly from those that would not."""

    def __init__(self, config: Config) -> None:
        thrust_max = COLLECTIVE * config.vehicle.thrust_max
        self._parameters = parameters_of(config)._replace(delay=0.0, thrust_max=thrust_max)
        self._period = 1.0 / config.control.rate
        self._allowed = config.planning.screen_error

    def check(self, trajectory: Trajectory) -> Feasibility:
        """How ``trajectory`` would be flown from its own start motion on."""
        report = np.zeros(5)
        knots, coefficients = contiguous(trajectory.knots), contiguous(trajectory.coefficients)
        turns, headings = contiguous(trajectory.yaw_knots), contiguous(trajectory.yaw_coefficients)
        lost = LOST * self._allowed
        memory = control_memory(self._parameters, replace(trajectory, stamp=0.0))
        closed_loop(memory, knots, coefficients, turns, headings, self._period, lost, report)
        error, when, thrust, tilt, turning = (float(value) for value in report)
        ok = error <= self._allowed
        flown = Feasibility(ok, error, when, thrust, tilt, turning, "")
        return flown if ok else replace(flown, why=_why(trajectory, flown))


def _why(trajectory: Trajectory, flown: Feasibility) -> str:
    text = f"would be off the line by {flown.error:.1f} m at {flown.when:.1f} s"
    gates = [(abs(t - flown.when), gate) for gate, t in zip(trajectory.gate_ids, trajectory.gate_times, strict=True)]
    away, gate = min(gates, default=(math.inf, 0))
    if away <= NEAR:
        text += f", near gate {gate}"
    spent = {"thrust saturated": flown.thrust, "too much tilt": flown.tilt, "body rates saturated": flown.turning}
    causes = [f"{name} for {seconds:.1f} s" for name, seconds in spent.items() if seconds >= 0.05]
    return text + (f": {', '.join(causes)}" if causes else "")
