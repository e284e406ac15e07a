"""What a horizon is to follow: the trajectory's motion, and the attitude, thrust and inputs that it needs."""

import math

from flightapp.control.attitude import feedforward, thrust_turn
from flightapp.control.line import Reference, direction, heading, reference
from flightapp.control.mpc_work import Work
from flightapp.control.parameters import Parameters
from flightapp.control.vectors import Triple, along, cross, dot, scaled
from flightapp.frames import GRAVITY, Vector
from flightapp.jit import fused

Needs = tuple[Triple, Triple, Triple, float, float, float]


@fused
def _unit(force: Triple) -> tuple[Triple, float]:
    """Direction and length of ``force``; up where it has none."""
    square = dot(force, force)
    if square < 1e-12:
        return (0.0, 0.0, 1.0), 0.0
    length = math.sqrt(square)
    return scaled(1.0 / length, force), length


@fused
def needed(p: Parameters, goal: Reference, yaw: float, yaw_rate: float, push: Triple) -> Needs:
    """What the motion ``goal`` needs against ``push`` (m/s²): thrust axis, heading axis and body rates (world).

    And the heading's weight, the thrust (m/s²) and its rate (m/s³). Drag turns with the body: its mean is taken first,
    then the difference between the body's axes along the axes found (after M. Faessler, A. Franchi and D. Scaramuzza,
    "Differential flatness of quadrotor dynamics subject to rotor drag", 2018). The rates lead by the rate loop's lag,
    with ``yaw_rate`` already ahead.
    """
    d = 0.5 * (p.drag_x + p.drag_y)
    _, v, a, j, n = goal
    force = along(along((-push[0], -push[1], GRAVITY - push[2]), p.acceleration, a), d, v)
    z, _ = _unit(force)
    c, s = direction(yaw)
    x, sine = _unit(cross((-s, c, 0.0), z))
    if sine > 0.0:
        force = along(force, (p.drag_x - d) * dot(x, v), x)
        y = cross(z, x)
        force = along(force, (p.drag_y - d) * dot(y, v), y)
    z, length = _unit(force)
    force_rate = along(scaled(p.jerk, j), p.jerk * d, a)
    turn, bend = thrust_turn(z, force, force_rate, along(scaled(p.snap, n), p.snap * d, j))
    omega, x, weight = feedforward(p, z, turn, bend, yaw, yaw_rate)
    skew = p.drag_z - d
    return z, x, omega, weight, length + skew * dot(z, v), dot(z, force_rate) + skew * dot(z, a)


@fused
def look_ahead(p: Parameters, m: Vector, begin: float, push: Triple, work: Work) -> None:
    """Fill `reference` and `asked` of ``work`` for the horizon that begins ``begin`` s after the trajectory's start.

    The trajectory is that in ``m``; the state from which it begins is the first of `x`. As in the flatness controller
    position errors beyond `error_max` count no more: the whole reference is drawn as near.
    """
    first, _, _, _, _ = reference(m, begin)
    away = (first[0] - work.x[0, 0], first[1] - work.x[0, 1], first[2] - work.x[0, 2])
    beyond = 1.0 - min(1.0, p.error_max / max(math.sqrt(dot(away, away)), 1e-9))
    for k in range(work.u.shape[0]):
        middle = begin + work.grid[k, 4]
        yaw, yaw_rate = heading(m, middle, p.yaw_lead)
        _, _, omega, _, thrust, thrust_rate = needed(p, reference(m, middle), yaw, yaw_rate, push)
        asked, row = work.asked[k], work.reference[k + 1]
        asked[0], asked[1], asked[2] = omega
        asked[3] = thrust + p.thrust_lead * thrust_rate
        end = middle + 0.5 * work.grid[k, 0]
        goal, (yaw, _) = reference(m, end), heading(m, end, 0.0)
        z, x, _, weight, thrust, _ = needed(p, goal, yaw, 0.0, push)
        row[0], row[1], row[2] = along(goal[0], -beyond, away)
        row[3], row[4], row[5] = goal[1]
        row[6], row[7], row[8] = z
        row[9], row[10], row[11] = x
        row[12], row[13] = thrust, weight
