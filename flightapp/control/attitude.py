"""From a wanted specific force and its derivatives to body rates: the attitude half of the flatness controller."""

import math

from flightapp.control.parameters import Parameters
from flightapp.control.vectors import Triple, along, cross, dot, scaled
from flightapp.jit import kernel

YAW_FADE = (0.2, 0.5)
"""Sine of the angle between thrust and the heading's normal: no yaw control below the first, full above the second."""
SOFTEST = 1.0
"""m/s², turning the thrust vector is planned for no weaker thrust than this: the rate would grow without bound."""

Frame = tuple[Triple, Triple, Triple]


@kernel
def limited(p: Parameters, force: Triple, vertical: float) -> tuple[Triple, float]:
    """``force`` (world, m/s²) within thrust and tilt limits, and the factor its horizontal part was cut by.

    Height comes first: the vertical part is kept, the horizontal one gets what thrust and tilt leave.
    Below a tilt limit of 90° the vertical part is at least ``vertical``; above it, pointing down is
    allowed as far as the limit.
    """
    x, y, z = force
    z = min(max(z, -p.thrust_max), p.thrust_max)
    h = math.sqrt(x * x + y * y)
    if p.tilt_cotangent > 0.0:
        z = max(z, vertical)
    h_max = math.sqrt(p.thrust_max * p.thrust_max - z * z)
    if p.tilt_cotangent > 0.0:
        h_max = min(h_max, z / p.tilt_cotangent)
    share = 1.0 if h <= h_max else h_max / h
    if p.tilt_cotangent <= 0.0:
        z = max(z, p.tilt_cotangent * share * h)
    return (share * x, share * y, z), share


@kernel
def thrust_turn(z: Triple, force: Triple, force_rate: Triple, force_snap: Triple) -> tuple[Triple, Triple]:
    """First and second time derivative (1/s, 1/s²) of the unit vector ``z`` along ``force``.

    With force = f z, its derivatives are f' z + f z' and f'' z + 2 f' z' + f z''; z' and z'' follow
    (D. Mellinger and V. Kumar, "Minimum snap trajectory generation and control for quadrotors", 2011).
    """
    f = max(math.sqrt(dot(force, force)), SOFTEST)
    f1 = dot(force_rate, z)
    turn = scaled(1.0 / f, along(force_rate, -f1, z))
    bend = along(force_snap, -2.0 * f1, turn)
    bend = scaled(1.0 / f, along(bend, -dot(bend, z), z))
    return turn, along(bend, -dot(turn, turn), z)


@kernel
def feedforward(
    p: Parameters, z: Triple, turn: Triple, bend: Triple, yaw: float, yaw_rate: float
) -> tuple[Triple, Triple, float]:
    """Body rate as a world vector that turns the thrust with ``turn``, the heading's x axis, and yaw's weight.

    The body's x axis is kept in the vertical plane of the heading ``yaw``, as in M. Faessler,
    A. Franchi and D. Scaramuzza, "Differential flatness of quadrotor dynamics subject to rotor drag"
    (2018). That fixes no heading where the thrust is along the plane's normal (90° of roll), so the
    weight falls to zero there. The rate leads by the rate loop's lag: Ω + τ dΩ/dt with
    Ω = z × z' + ω_z z and dΩ/dt = z × z'' + ω_z z'; the caller samples ``yaw_rate`` ahead instead.
    """
    c, s = math.cos(yaw), math.sin(yaw)
    normal = (-s, c, 0.0)
    x = cross(normal, z)
    sine = math.sqrt(dot(x, x))
    weight = min(max((sine - YAW_FADE[0]) / (YAW_FADE[1] - YAW_FADE[0]), 0.0), 1.0)
    along_z = 0.0
    if weight > 0.0:
        x = scaled(1.0 / sine, x)
        along_z = weight * (dot(turn, x) * dot(z, normal) + yaw_rate * z[2] / sine) / sine
    omega = along(cross(z, turn), along_z, z)
    lead = along(cross(z, bend), along_z, turn)
    return along(omega, p.rate_lag, lead), x, weight


@kernel
def correction(p: Parameters, body: Frame, z: Triple, x: Triple, weight: float) -> Triple:
    """Body rates (rad/s) that turn ``body`` (its axes in the world) towards thrust axis ``z`` and heading axis ``x``.

    Tilt and heading are split so that the thrust vector takes the short way and the heading never
    bends it (D. Brescianini and R. D'Andrea, "Tilt-prioritized quadrocopter attitude control", 2018).
    The tilt rate is proportional to 2 sin(θ/2), which grows up to half a turn; upside down it rolls.
    """
    e = (dot(body[0], z), dot(body[1], z), dot(body[2], z))
    sine = math.sqrt(e[0] * e[0] + e[1] * e[1])
    chord = math.sqrt(max(2.0 - 2.0 * e[2], 0.0))
    if sine > 1e-9:
        roll, pitch = -chord * e[1] / sine, chord * e[0] / sine
    else:
        roll, pitch = chord, 0.0
    v = (dot(body[0], x), dot(body[1], x), dot(body[2], x))
    fold = v[2] / max(1.0 + e[2], 1e-3)
    heading = math.atan2(v[1] - fold * e[1], v[0] - fold * e[0])
    weight *= max(e[2], 0.0)
    return p.attitude_gain * roll, p.attitude_gain * pitch, p.yaw_gain * weight * heading
