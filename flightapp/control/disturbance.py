"""What pushes the vehicle that its model does not explain: wind, wrong drag, a wrong mass, a weak battery.

An observer of the velocity with the disturbance as its second state (a Luenberger observer, as in the disturbance
observer of K. Ohnishi, 1987, and the state predictor of L1 adaptive control, N. Hovakimyan and C. Cao, 2010): what the
velocity gains beyond what thrust, drag and gravity give it, through a second-order low-pass. What of it lasts along the
thrust is put down to the thrust, a factor that then holds at any tilt, and what lasts along the velocity to the drag.
All are bounded, and nothing is learnt on the ground or where a limit held the last command back.
"""

import math

from flightapp.control import layout as at
from flightapp.control.foresight import model_acceleration
from flightapp.control.parameters import Parameters
from flightapp.control.vectors import Quaternion, Triple, along, axes, dot
from flightapp.frames import GRAVITY, Vector
from flightapp.jit import fused

DAMPING = 1.0
"""Of the observer's two poles."""
DRIFT_MAX = 0.4
"""m/s."""
LONGEST = 0.05
"""s between states, beyond which the observer begins with the newest."""
JUMP = 0.1
"""m, by which a position that is off the velocities' is a new place, not a drift."""
CRAWL = 2.0
"""m/s, speeds well below which say nothing of the drag."""
STEADY = 0.5
"""1/s, at which the steady part of the disturbance follows the whole."""


@fused
def _bounded(value: float, bound: float) -> float:
    return min(max(value, -bound), bound)


@fused
def _bounded_push(p: Parameters, x: float, y: float, z: float) -> Triple:
    cut = min(1.0, p.push_max / max(math.sqrt(x * x + y * y), 1e-9))
    return cut * x, cut * y, _bounded(z, p.push_max)


@fused
def _learn(p: Parameters, m: Vector, velocity: Triple, z: Triple, thrust: float, off: Triple, dt: float) -> None:
    """Follow the ``velocity``'s excess ``off`` (m/s) over the observer's by one step ``dt``.

    ``z`` is the thrust's axis.
    """
    push = (m[at.DISTURBANCE], m[at.DISTURBANCE + 1], m[at.DISTURBANCE + 2])
    d, gain = at.DISTURBANCE, dt * p.disturbance * p.disturbance
    m[d], m[d + 1], m[d + 2] = _bounded_push(
        p, m[d] + gain * off[0], m[d + 1] + gain * off[1], m[d + 2] + gain * off[2]
    )
    m[at.STEADY] += dt * STEADY * (m[d] - m[at.STEADY])
    m[at.STEADY + 1] += dt * STEADY * (m[d + 1] - m[at.STEADY + 1])
    gain = dt * p.trim_rate
    m[at.TRIM] = _bounded(m[at.TRIM] - gain * dot(push, z) * thrust / (GRAVITY * GRAVITY), p.trim_max)
    drag = 0.5 * (p.drag_x + p.drag_y)
    if drag > 0.0:
        along_path = dot(push, velocity) / (drag * (dot(velocity, velocity) + CRAWL * CRAWL))
        m[at.DRAG] = _bounded(m[at.DRAG] - gain * along_path, p.drag_trim_max)


@fused
def _compare(p: Parameters, m: Vector, dt: float, position: Triple, velocity: Triple) -> None:
    """Learn by how much the positions seen move faster than the velocities seen, by an observer of the position.

    A tracker's velocity is off by up to a tenth of a metre per second for seconds; feedback of both would settle
    between them.
    """
    i, d = at.PLACE, at.DRIFT
    drift = (m[d], m[d + 1], m[d + 2])
    middle = along(velocity, -0.5 * dt, (m[at.SLOPE], m[at.SLOPE + 1], m[at.SLOPE + 2]))
    there = along((m[i], m[i + 1], m[i + 2]), dt, along(middle, 1.0, drift))
    off = (position[0] - there[0], position[1] - there[1], position[2] - there[2])
    if dt > LONGEST or dot(off, off) > JUMP * JUMP:
        m[i], m[i + 1], m[i + 2] = position
        return
    gain = dt * p.drift * p.drift
    m[i], m[i + 1], m[i + 2] = along(there, min(2.0 * DAMPING * p.drift * dt, 1.0), off)
    m[d] = _bounded(drift[0] + gain * off[0], DRIFT_MAX)
    m[d + 1] = _bounded(drift[1] + gain * off[1], DRIFT_MAX)
    m[d + 2] = _bounded(drift[2] + gain * off[2], DRIFT_MAX)


@fused
def observe(
    p: Parameters, m: Vector, stamp: float, seen: tuple[Triple, Triple, Quaternion, Triple], thrust: float, drag: Triple
) -> None:
    """Take over the state ``seen`` at ``stamp``, unless it is no newer than the last.

    ``thrust`` (m/s²) and ``drag`` (1/s) are the model's then.
    """
    dt = stamp - m[at.SEEN]
    if dt <= 0.0:
        return
    position, velocity, q, _ = seen
    _compare(p, m, dt, position, velocity)
    v, s, d = at.VELOCITY, at.SLOPE, at.DISTURBANCE
    body = axes(q)
    model = model_acceleration(drag, body, velocity, thrust, (0.0, 0.0, 0.0))
    mean = (0.5 * (m[s] + model[0]), 0.5 * (m[s + 1] + model[1]), 0.5 * (m[s + 2] + model[2]))
    expected = along((m[v], m[v + 1], m[v + 2]), dt, along(mean, 1.0, (m[d], m[d + 1], m[d + 2])))
    off = (velocity[0] - expected[0], velocity[1] - expected[1], velocity[2] - expected[2])
    follow = 1.0
    if dt <= LONGEST and position[2] >= p.airborne_height:
        follow = min(2.0 * DAMPING * p.disturbance * dt, 1.0)
        if m[at.FREE] > 0.0:
            _learn(p, m, velocity, body[2], thrust, off, dt)
    m[v], m[v + 1], m[v + 2] = along(expected, follow, off)
    m[s], m[s + 1], m[s + 2] = model
    m[at.SEEN] = stamp
