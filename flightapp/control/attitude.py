"""From a wanted specific force and its derivatives to body rates: the attitude half of the flatness controller."""

import math

from flightapp.control.line import direction
from flightapp.control.parameters import Parameters
from flightapp.control.vectors import Triple, along, cross, dot, scaled
from flightapp.jit import shared

YAW_FADE = (0.2, 0.5)
"""Sine of the angle between thrust and the heading's normal: no yaw control below the first, full above the second."""
YAW_SLOPE = 1.0 / (YAW_FADE[1] - YAW_FADE[0])
SOFTEST = 1.0
"""m/s², turning the thrust vector is planned for no weaker thrust than this: the rate would grow without bound."""

Frame = tuple[Triple, Triple, Triple]


@shared
def limited(p: Parameters, force: Triple, vertical: float) -> tuple[Triple, float]:
    """``force`` (world, m/s²) within thrust and tilt limits, and the factor its horizontal part was cut by.

    Height comes first: the vertical part is kept, the horizontal one gets what thrust and tilt leave.
    Below a tilt limit of 90° the vertical part is at least ``vertical``; above it, pointing down is
    allowed as far as the limit.
    """
    x, y, z = force
    z = min(max(z, -p.thrust_max), p.thrust_max)
    if p.tilt_cotangent > 0.0:
        z = max(z, vertical)
    across = x * x + y * y
    # Both squares rounded in other ways must not leave less than nothing.
    most = max(p.thrust_max * p.thrust_max - z * z, 0.0)
    if p.tilt_cotangent > 0.0:
        most = min(most, (z / p.tilt_cotangent) ** 2)
    share = 1.0
    if across > most:
        share = math.sqrt(most / across)
    if p.tilt_cotangent <= 0.0:
        z = max(z, p.tilt_cotangent * share * math.sqrt(across))
    return (share * x, share * y, z), share


@shared
def thrust_turn(z: Triple, force: Triple, force_rate: Triple, force_snap: Triple) -> tuple[Triple, Triple]:
    """First and second time derivative (1/s, 1/s²) of the unit vector ``z`` along ``force``.

    With force = f z, its derivatives are f' z + f z' and f'' z + 2 f' z' + f z''; z' and z'' follow
    (D. Mellinger and V. Kumar, "Minimum snap trajectory generation and control for quadrotors", 2011).
    """
    share = 1.0 / max(math.sqrt(dot(force, force)), SOFTEST)
    f1 = dot(force_rate, z)
    turn = scaled(share, along(force_rate, -f1, z))
    bend = along(force_snap, -2.0 * f1, turn)
    bend = scaled(share, along(bend, -dot(bend, z), z))
    return turn, along(bend, -dot(turn, turn), z)


@shared
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
    c, s = direction(yaw)
    normal = (-s, c, 0.0)
    x = cross(normal, z)
    sine = math.sqrt(dot(x, x))
    weight = min(max(YAW_SLOPE * (sine - YAW_FADE[0]), 0.0), 1.0)
    along_z = 0.0
    if weight > 0.0:
        inverse = 1.0 / sine
        x = scaled(inverse, x)
        along_z = weight * inverse * (dot(turn, x) * dot(z, normal) + inverse * yaw_rate * z[2])
    omega = along(cross(z, turn), along_z, z)
    lead = along(cross(z, bend), along_z, turn)
    return along(omega, p.rate_lead, lead), x, weight


@shared
def correction(p: Parameters, body: Frame, z: Triple, x: Triple, weight: float) -> Triple:
    """Body rates (rad/s) that turn ``body`` (its axes in the world) towards thrust axis ``z`` and heading axis ``x``.

    Tilt and heading are split so that the thrust vector takes the short way and the heading never
    bends it (D. Brescianini and R. D'Andrea, "Tilt-prioritized quadrocopter attitude control", 2018).
    The tilt rate is proportional to 2 sin(θ/2), which grows up to half a turn; upside down it rolls.
    """
    e = (dot(body[0], z), dot(body[1], z), dot(body[2], z))
    share = 1.0 / max(1.0 + e[2], 1e-9)
    # 2 sin(θ/2) / sin θ = √(2 / (1 + cos θ)).
    turn = math.sqrt(2.0 * share)
    roll, pitch = -turn * e[1], turn * e[0]
    if e[2] < 1e-9 - 1.0:
        roll, pitch = 2.0, 0.0
    v = (dot(body[0], x), dot(body[1], x), dot(body[2], x))
    fold = v[2] * share
    weight *= max(e[2], 0.0)
    heading = weight * _double_half_tangent(v[0] - fold * e[0], v[1] - fold * e[1])
    return p.attitude_gain * roll, p.attitude_gain * pitch, p.yaw_gain * heading


@shared
def _double_half_tangent(x: float, y: float) -> float:
    """2 tan(θ/2) of the angle θ of (``x``, ``y``): the angle where it is small, large where it is half a turn."""
    return 2.0 * y / max(math.sqrt(x * x + y * y) + x, 1e-3)
