"""Where the vehicle will be when a command takes effect, in closed form.

The same model as `prediction`, which goes from command to command. Here each command's entry in the history holds what
the lags have made of all before it, and the integrals of that, so that the turn and the impulse between any two moments
are differences of two sums, whatever the number of commands between them.
"""

from flightapp.control import layout as at
from flightapp.control.parameters import Parameters
from flightapp.control.vectors import Quaternion, Triple, along, axes, dot, product, small_turn, unit
from flightapp.frames import GRAVITY, Vector
from flightapp.jit import fused, shared

PIECE = 0.05
"""s, longest stretch over which one mean attitude and thrust stand for all."""
E3, E4, E5, E6 = 1.0 / 6.0, 1.0 / 24.0, 1.0 / 120.0, 1.0 / 720.0
"""Of the exponential's series."""

Lagged = tuple[float, float, float, float]
"""Body rates and thrust, or integrals of them."""
Body = tuple[Triple, Triple, Triple]


@fused
def _growth(x: float) -> float:
    """The exponential's series for x ≥ 0."""
    return 1.0 + x * (1.0 + x * (0.5 + x * (E3 + x * (E4 + x * (E5 + x * E6)))))


@shared
def decays(x: float, y: float, z: float) -> Triple:
    """exp(-x) and so on for x ≥ 0, to 3e-3, and to 1e-4 up to 1: one over the series, all by one division."""
    a, b, c = _growth(x), _growth(y), _growth(z)
    share = 1.0 / (a * b * c)
    return share * b * c, share * a * c, share * a * b


@fused
def newest(m: Vector, t: float) -> int:
    """Where the entry of the newest command that has taken effect by ``t`` lies; the oldest's if none has."""
    k = int(m[at.COUNT]) - 1
    oldest = max(k - at.MASK, 0)
    while k > oldest and m[at.HISTORY + (k & at.MASK) * at.ENTRY] > t:
        k -= 1
    return at.HISTORY + (k & at.MASK) * at.ENTRY


@fused
def _channel(m: Vector, e: int, i: int, lag: float, left: float, after: float, before: float) -> tuple[float, float]:
    """Value and integral of channel ``i`` so long ``after`` the entry at ``e``, or ``before`` it (not positive).

    ``left`` is the share of a difference that the lag leaves. Before the oldest entry all was as it was then.
    """
    told, was = m[e + at.ENTRY_COMMAND + i], m[e + at.ENTRY_MODEL + i]
    lacking = was - told
    total = m[e + at.ENTRY_SUM + i] + told * after + lacking * lag * (1.0 - left) + was * before
    return told + lacking * left, total


@fused
def lagged_at(p: Parameters, m: Vector, e: int, t: float) -> tuple[Lagged, Lagged]:
    """What the lags have made of the commands at ``t``, and its integral, from the entry at ``e``."""
    since = t - m[e]
    after, before = max(since, 0.0), min(since, 0.0)
    left, yaw_left, motor_left = decays(after * p.rate_pole, after * p.yaw_pole, after * p.motor_pole)
    x, y = (
        _channel(m, e, 0, p.rate_lag, left, after, before),
        _channel(m, e, 1, p.rate_lag, left, after, before),
    )
    z = _channel(m, e, 2, p.yaw_rate_lag, yaw_left, after, before)
    f = _channel(m, e, 3, p.motor_lag, motor_left, after, before)
    return (x[0], y[0], z[0], f[0]), (x[1], y[1], z[1], f[1])


@fused
def model_acceleration(drag: Triple, body: Body, v: Triple, thrust: float, push: Triple) -> Triple:
    """Acceleration (world, m/s²) under ``thrust``, linear ``drag`` (1/s), gravity and the disturbance ``push``."""
    x, y, z = body
    a = along((push[0], push[1], push[2] - GRAVITY), thrust - drag[2] * dot(z, v), z)
    a = along(a, -drag[0] * dot(x, v), x)
    return along(a, -drag[1] * dot(y, v), y)


@fused
def foresee(
    p: Parameters,
    m: Vector,
    motion: tuple[Triple, Triple, Quaternion, Triple],
    start: float,
    end: float,
    known: tuple[Lagged, Lagged],
    drag: Triple,
    push: Triple,
) -> tuple[Triple, Triple, Quaternion, Triple, Lagged, Lagged]:
    """Position, velocity, q_wb and body rates at ``end`` of the ``motion`` at ``start``.

    ``known`` is what the lags have made of the commands at ``start``. ``drag`` (1/s) and disturbance ``push`` (m/s²)
    are the model's. The last two results are as ``known``, at ``end``. What the measured rates have over the model's
    fades with the lag.
    """
    position, velocity, q, w = motion
    value, total = known
    over = (w[0] - value[0], w[1] - value[1], w[2] - value[2])
    now = start
    while now < end:
        until = min(end, now + PIECE)
        h = until - now
        value, then = lagged_at(p, m, newest(m, until), until)
        left, yaw_left, _ = decays(h * p.rate_pole, h * p.yaw_pole, 0.0)
        gone = p.rate_lag * (1.0 - left)
        half = (
            0.5 * (then[0] - total[0] + gone * over[0]),
            0.5 * (then[1] - total[1] + gone * over[1]),
            0.5 * (then[2] - total[2] + p.yaw_rate_lag * (1.0 - yaw_left) * over[2]),
        )
        step = small_turn(half)
        middle = product(q, step)
        a = model_acceleration(drag, axes(middle), velocity, (then[3] - total[3]) / h, push)
        position = along(along(position, h, velocity), 0.5 * h * h, a)
        velocity = along(velocity, h, a)
        q = unit(product(middle, step))
        over = (left * over[0], left * over[1], yaw_left * over[2])
        total, now = then, until
    rates = (value[0] + over[0], value[1] + over[1], value[2] + over[2])
    return position, velocity, q, rates, value, total


@fused
def remember(m: Vector, effect: float, command: Lagged, value: Lagged, total: Lagged) -> None:
    """Write a command that takes ``effect`` into the history, with what the lags have made of those before."""
    count = int(m[at.COUNT])
    e = at.HISTORY + (count & at.MASK) * at.ENTRY
    m[e] = effect
    for i in range(4):
        m[e + at.ENTRY_COMMAND + i] = command[i]
        m[e + at.ENTRY_MODEL + i] = value[i]
        m[e + at.ENTRY_SUM + i] = total[i]
    m[at.COUNT] = count + 1
