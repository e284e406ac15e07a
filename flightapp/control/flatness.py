"""Trajectory tracking by differential flatness: position, velocity and more in, body rates and thrust out.

After D. Mellinger and V. Kumar, "Minimum snap trajectory generation and control for quadrotors" (2011) and
M. Faessler, A. Franchi and D. Scaramuzza, "Differential flatness of quadrotor dynamics subject to rotor
drag for accurate tracking of high-speed trajectories" (2018), with the vehicle's delay predicted away,
the lags of its rate loop and motors inverted from the trajectory's jerk and snap, and an observer of
what the model does not explain. Each term can be left out (`control.without`).
"""

import math
from collections.abc import Collection
from typing import ClassVar

import numpy as np

from flightapp.config import Config
from flightapp.control import layout as at
from flightapp.control.attitude import correction, feedforward, limited, thrust_turn
from flightapp.control.disturbance import observe
from flightapp.control.errors import ControllerError
from flightapp.control.foresight import Body, foresee, lagged_at, model_acceleration, newest, remember
from flightapp.control.line import Reference, heading, packed_line, reference
from flightapp.control.parameters import Parameters, parameters_of, unpacked
from flightapp.control.vectors import Quaternion, Triple, along, axes, dot, scaled, unit
from flightapp.frames import GRAVITY, Vector
from flightapp.jit import fused, fused_kernel, lean_kernel
from flightapp.messages import RateCommand, VehicleState
from flightapp.trajectory import Trajectory, hover

__all__ = ["ControllerError", "FlatnessController", "control_memory", "flatness_command", "flatness_law", "forget"]

WILDEST = 1e9
"""Numbers of a state that add up to more are none."""
STATE = 14

Moving = tuple[Triple, Triple, Quaternion, float]
"""Position, velocity, q_wb and thrust."""


@fused
def _usable(m: Vector) -> bool:
    """Whether the state is finite and its quaternion has a direction."""
    total = 0.0
    for i in range(at.STATE, at.STATE + STATE):
        total += abs(m[i])
    q = at.STATE + 4
    return total < WILDEST and abs(m[q]) + abs(m[q + 1]) + abs(m[q + 2]) + abs(m[q + 3]) > 1e-3


@fused
def _feedback(
    p: Parameters, position: Triple, velocity: Triple, a: Triple, goal: tuple[Triple, Triple, Triple]
) -> tuple[Triple, Triple]:
    """Acceleration (m/s²) that corrects a motion towards the ``goal`` (position and two derivatives), and its rate.

    Errors beyond `error_max` count no more, so that a jump of the estimate is flown off at the speed
    that the gains make of it. The rate (m/s³) lets the attitude follow the correction without lagging it.
    """
    r, v, b = goal
    e = (r[0] - position[0], r[1] - position[1], r[2] - position[2])
    ev = (v[0] - velocity[0], v[1] - velocity[1], v[2] - velocity[2])
    ea = (b[0] - a[0], b[1] - a[1], b[2] - a[2])
    reach, moving = 1.0, p.error_rate
    square = dot(e, e)
    if square > p.error_max * p.error_max:
        reach, moving = p.error_max / math.sqrt(square), 0.0
    k, c = reach * p.kp_xy, reach * p.kp_z
    push = (k * e[0] + p.kd_xy * ev[0], k * e[1] + p.kd_xy * ev[1], c * e[2] + p.kd_z * ev[2])
    k, c = moving * p.kp_xy, moving * p.kp_z
    j, h = p.error_rate * p.kd_xy, p.error_rate * p.kd_z
    return push, (k * ev[0] + j * ea[0], k * ev[1] + j * ea[1], c * ev[2] + h * ea[2])


@fused
def _wanted_force(
    p: Parameters, drag: Triple, body: Body, goal: Reference, push: Triple, rate: Triple
) -> tuple[Triple, Triple, Triple]:
    """Specific force (world, m/s²) for the reference ``goal`` and its first two derivatives.

    Drag that is equal in all directions adds d v without turning with the body; the difference between
    the body's x and y is taken along the axes as they are, that of z only weakens the thrust.
    """
    d = 0.5 * (drag[0] + drag[1])
    _, v, a, j, n = goal
    force = along((push[0], push[1], push[2] + GRAVITY), p.acceleration, a)
    force = along(force, d, v)
    force = along(force, (drag[0] - d) * dot(body[0], v), body[0])
    force = along(force, (drag[1] - d) * dot(body[1], v), body[1])
    force_rate = along(along(rate, p.jerk, j), p.jerk * d, a)
    return force, force_rate, along(scaled(p.snap, n), p.snap * d, j)


@fused
def _rates(p: Parameters, body: Body, omega: Triple, turn: Triple) -> Triple:
    """Body rates within their limits: ``omega`` (world) as seen in ``body`` plus ``turn`` (body)."""
    x, y = dot(body[0], omega) + turn[0], dot(body[1], omega) + turn[1]
    square = x * x + y * y
    cut = 1.0
    if square > p.rate_max * p.rate_max:
        cut = p.rate_max / math.sqrt(square)
    return cut * x, cut * y, min(max(dot(body[2], omega) + turn[2], -p.yaw_rate_max), p.yaw_rate_max)


@fused
def _begin(m: Vector) -> None:
    """Take what the vehicle is doing at its first state for the effect of a command before."""
    w = at.STATE + 11
    told = (m[w], m[w + 1], m[w + 2], GRAVITY)
    remember(m, m[at.STATE], told, told, (0.0, 0.0, 0.0, 0.0))


@fused
def _state(m: Vector) -> tuple[Triple, Triple, Quaternion, Triple]:
    """Position, velocity, q_wb and body rates that were seen."""
    s = at.STATE
    q = unit((m[s + 4], m[s + 5], m[s + 6], m[s + 7]))
    return (m[s + 1], m[s + 2], m[s + 3]), (m[s + 8], m[s + 9], m[s + 10]), q, (m[s + 11], m[s + 12], m[s + 13])


@fused
def _drag(p: Parameters, m: Vector) -> Triple:
    """The drag as it is known by now, 1/s."""
    share = 1.0 + m[at.DRAG]
    return share * p.drag_x, share * p.drag_y, share * p.drag_z


@fused
def flatness_law(
    p: Parameters, m: Vector, effect: float, motion: Moving, drag: Triple, disturbance: Triple
) -> tuple[Triple, float, bool]:
    """Rates and specific force for the ``motion`` at the moment ``effect``, and whether no limit cut them but the last.

    The trajectory is that in ``m``. The force (m/s²) is not yet within the thrust's limits along the body's axis.
    """
    position, velocity, q, thrust = motion
    body, t = axes(q), effect - m[at.ORIGIN]
    goal = reference(m, t)
    yaw, yaw_rate = heading(m, t, p.yaw_lead)
    a = model_acceleration(drag, body, velocity, thrust, disturbance)
    push, rate = _feedback(p, position, velocity, a, (goal[0], goal[1], goal[2]))
    force, force_rate, force_snap = _wanted_force(p, drag, body, goal, along(push, -1.0, disturbance), rate)
    wanted, share = limited(p, force, p.thrust_min)
    square = dot(wanted, wanted)
    z = body[2]
    if square > 1e-12:
        z = scaled(1.0 / math.sqrt(square), wanted)
    kept = scaled(share, force_rate)
    turn, bend = thrust_turn(z, wanted, kept, scaled(share, force_snap))
    omega, x, weight = feedforward(p, z, turn, bend, yaw, yaw_rate)
    asked = _rates(p, body, omega, correction(p, body, z, x, weight))
    skew = drag[2] - 0.5 * (drag[0] + drag[1])
    lead = p.thrust_lead * (dot(body[2], kept) + skew * dot(body[2], goal[2]))
    free = share == 1.0 and asked[0] * asked[0] + asked[1] * asked[1] < 0.99 * p.rate_max * p.rate_max
    return asked, dot(body[2], wanted) + skew * dot(body[2], goal[1]) + lead, free


@fused
def _keep(m: Vector, position: Triple, velocity: Triple, q: Quaternion, rates: Triple, thrust: float) -> None:
    """Leave what is foreseen for those who plan on from there."""
    f = at.FORESEEN
    m[f], m[f + 1], m[f + 2] = position
    m[f + 3], m[f + 4], m[f + 5] = velocity
    m[f + 6], m[f + 7], m[f + 8], m[f + 9] = q
    m[f + 10], m[f + 11], m[f + 12] = rates
    m[f + 13] = thrust


@fused_kernel
def flatness_command(m: Vector) -> float:
    """One command, from the numbers in ``m``, which are laid out as `layout` says.

    Stamp and state are read, the rates to send are left in ``m[RATES]``, what is foreseen of the moment of their
    effect in ``m[FORESEEN]``, and the command is remembered. Returns the specific force to send (m/s²), NaN when
    something was not finite; nothing is remembered then.
    """
    if not _usable(m):
        return math.nan
    p = unpacked(m)
    if m[at.COUNT] == 0.0:
        _begin(m)
    start, effect = m[at.STATE], m[at.STAMP] + p.delay
    seen = _state(m)
    known = lagged_at(p, m, newest(m, start), start)
    observe(p, m, start, seen, known[0][3], _drag(p, m))
    drag, disturbance = _drag(p, m), (m[at.DISTURBANCE], m[at.DISTURBANCE + 1], m[at.DISTURBANCE + 2])
    end = start + p.foresight * (effect - start)
    now = (seen[0], along(seen[1], 1.0, (m[at.DRIFT], m[at.DRIFT + 1], m[at.DRIFT + 2])), seen[2], seen[3])
    position, velocity, q, rates, value, total = foresee(p, m, now, start, end, known, drag, disturbance)
    _keep(m, position, velocity, q, rates, value[3])
    asked, force, free = flatness_law(p, m, effect, (position, velocity, q, value[3]), drag, disturbance)
    trim = 1.0 + m[at.TRIM]
    sent = force * trim
    bounded: float = min(max(sent, p.thrust_min), p.thrust_max)
    # A comparison: the compiler may take a sum less itself, which is what `isfinite` asks for, for nothing.
    if not abs(sent) + abs(asked[0]) + abs(asked[1]) + abs(asked[2]) < WILDEST:
        return math.nan
    remember(m, end, (asked[0], asked[1], asked[2], bounded / trim), value, total)
    m[at.FREE] = 1.0 if free and bounded == sent else 0.0
    m[at.RATES], m[at.RATES + 1], m[at.RATES + 2] = asked
    return bounded


@lean_kernel
def forget(m: Vector) -> None:
    """Forget the commands sent and the disturbances learnt."""
    m[at.COUNT] = 0.0
    for i in range(at.FREE, at.ORIGIN):
        m[i] = 0.0
    m[at.SEEN] = at.NEVER


def control_memory(parameters: Parameters, trajectory: Trajectory, state: Vector | None = None) -> Vector:
    """The array that `flatness_command` works on, for a ``trajectory``; with a ``state`` (14,) or at rest upright."""
    line = packed_line(trajectory)
    m = np.zeros(at.LINE + line.size)
    m[at.PARAMETERS : at.PARAMETERS + len(parameters)] = parameters
    m[at.STATE + 4], m[at.SEEN] = 1.0, at.NEVER
    if state is not None:
        m[at.STATE : at.STATE + STATE] = state
    m[at.ORIGIN] = trajectory.stamp
    m[at.SEGMENTS], m[at.TURNS] = trajectory.knots.size - 1, trajectory.yaw_knots.size - 1
    m[at.LINE :] = line
    return m


class FlatnessController:
    """Tracks a trajectory with body rates and thrust; see the module's sources."""

    WITHOUT: ClassVar[Collection[str]] = ()
    """Terms of the law that it never has."""

    def __init__(self, config: Config) -> None:
        self._parameters = parameters_of(config, self.WITHOUT)
        self._oldest = config.safety.state_timeout
        self._trajectory = hover(0.0, np.zeros(3), 0.0)
        self._memory = control_memory(self._parameters, self._trajectory)
        self._compile()

    def reset(self) -> None:
        """Forget the commands sent and the disturbances learnt, at the start of a new flight."""
        forget(self._memory)

    def retune(self, config: Config) -> None:
        """Go on with the gains of ``config``, remembering the commands sent and what was learnt.

        What an observer has learnt that has no bandwidth any more is let go: nothing would correct it.
        """
        p = self._parameters = parameters_of(config, self.WITHOUT)
        m = self._memory
        m[at.PARAMETERS : at.PARAMETERS + len(p)] = p
        if p.disturbance == 0.0:
            m[at.DISTURBANCE : at.TRIM] = 0.0
        if p.drift == 0.0:
            m[at.DRIFT : at.ORIGIN] = 0.0

    @property
    def push(self) -> float:
        """m/s², the steady horizontal push that it has learnt to lean against."""
        return math.hypot(self._memory[at.STEADY], self._memory[at.STEADY + 1])

    @property
    def report(self) -> str:
        """Nothing: every command is its own."""
        return ""

    def command(self, stamp: float, state: VehicleState, trajectory: Trajectory) -> RateCommand:
        """Body rates and specific force to send at ``stamp``, from the newest ``state``.

        It is taken for sent: the next commands count on its effect. Raises `ControllerError` when the
        state is older than `safety.state_timeout`, or the state or the trajectory is not finite.
        """
        if trajectory is not self._trajectory:
            self._load(trajectory)
        age = stamp - state.stamp
        if not abs(age) <= self._oldest:
            raise ControllerError(f"the state is {age:.3f} s old; at most {self._oldest:g} s can be bridged")
        m, s = self._memory, at.STATE
        m[at.STAMP], m[s] = stamp, state.stamp
        m[s + 1 : s + 4] = state.position
        m[s + 4 : s + 8] = state.orientation
        m[s + 8 : s + 11] = state.velocity
        m[s + 11 : s + 14] = state.angular_velocity
        thrust = flatness_command(m)
        if math.isnan(thrust):
            raise ControllerError(f"the state at {state.stamp:.3f} s is not finite, or too wild to be steered")
        return RateCommand(stamp, m[at.RATES : at.RATES + 3].copy(), thrust)

    def _load(self, trajectory: Trajectory) -> None:
        """Take over a new trajectory, and what has been learnt with it."""
        memory = control_memory(self._parameters, trajectory)
        if not (math.isfinite(trajectory.stamp) and np.isfinite(memory[at.LINE :]).all()):
            raise ControllerError("the trajectory is not finite")
        kept = (slice(at.COUNT, at.ORIGIN), slice(at.HISTORY, at.LINE))
        for part in kept:
            memory[part] = self._memory[part]
        self._memory, self._trajectory = memory, trajectory

    def _compile(self) -> None:
        """Have the kernel compiled, or loaded from its cache, before anything flies."""
        upright, rest = np.array((1.0, 0.0, 0.0, 0.0)), np.zeros(3)
        state = VehicleState(0.0, rest, upright, rest, rest, np.zeros((9, 9)))
        self.command(0.0, state, self._trajectory)
        self.reset()
