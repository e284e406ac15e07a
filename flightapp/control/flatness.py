"""Trajectory tracking by differential flatness: position, velocity and more in, body rates and thrust out.

After D. Mellinger and V. Kumar, "Minimum snap trajectory generation and control for quadrotors" (2011) and
M. Faessler, A. Franchi and D. Scaramuzza, "Differential flatness of quadrotor dynamics subject to rotor
drag for accurate tracking of high-speed trajectories" (2018), with the vehicle's delay predicted away and
the lags of its rate loop and motors inverted from the trajectory's jerk and snap.
"""

import math

import numpy as np

from flightapp.config import Config
from flightapp.control.attitude import correction, feedforward, limited, thrust_turn
from flightapp.control.errors import ControllerError
from flightapp.control.parameters import Parameters, parameters_of, unpacked
from flightapp.control.prediction import ENTRY, HISTORY, MASK, Motion, acceleration, predict
from flightapp.control.vectors import Triple, along, axes, dot, scaled
from flightapp.frames import GRAVITY, Vector
from flightapp.jit import kernel
from flightapp.messages import RateCommand, VehicleState
from flightapp.trajectory import Trajectory, evaluate, hover

__all__ = ["ControllerError", "FlatnessController"]

SLOWEST = 0.05
"""s, longest time between commands over which a disturbance is learnt."""


@kernel
def _bounded(value: float, bound: float) -> float:
    return min(max(value, -bound), bound)


@kernel
def _usable(state: Vector) -> bool:
    """Whether ``state`` (14,) is finite and its quaternion has a direction."""
    total = 0.0
    for value in state:
        total += abs(value)
    return math.isfinite(total) and abs(state[4]) + abs(state[5]) + abs(state[6]) + abs(state[7]) > 1e-3


@kernel
def _motion(p: Parameters, state: Vector, end: float, history: Vector, count: int) -> Motion:
    """The motion that ``state`` (14,) (stamp, position, q_wb, velocity, rates) becomes at ``end``."""
    n = math.sqrt(state[4] ** 2 + state[5] ** 2 + state[6] ** 2 + state[7] ** 2)
    q = (state[4] / n, state[5] / n, state[6] / n, state[7] / n)
    position, velocity = (state[1], state[2], state[3]), (state[8], state[9], state[10])
    motion = (position, velocity, q, (state[11], state[12], state[13]), GRAVITY)
    return predict(p, motion, state[0], end, history, count)


@kernel
def _feedback(p: Parameters, motion: Motion, r: Vector) -> tuple[Triple, Triple]:
    """Acceleration (m/s²) that corrects ``motion`` towards the reference ``r`` (17,), and its rate (m/s³).

    Errors beyond `error_max` count no more, so that a jump of the estimate is flown off at the speed
    that the gains make of it. The rate lets the attitude follow the correction without lagging it.
    """
    position, velocity, q, _, thrust = motion
    a = acceleration(p, q, velocity, thrust)
    e = (r[0] - position[0], r[1] - position[1], r[2] - position[2])
    reach = min(1.0, p.error_max / max(math.sqrt(dot(e, e)), 1e-9))
    moving = 1.0 if reach == 1.0 else 0.0
    ev = (r[3] - velocity[0], r[4] - velocity[1], r[5] - velocity[2])
    ea = (r[6] - a[0], r[7] - a[1], r[8] - a[2])
    push = (
        p.kp_xy * reach * e[0] + p.kd_xy * ev[0],
        p.kp_xy * reach * e[1] + p.kd_xy * ev[1],
        p.kp_z * reach * e[2] + p.kd_z * ev[2],
    )
    rate = (
        p.kp_xy * moving * ev[0] + p.kd_xy * ea[0],
        p.kp_xy * moving * ev[1] + p.kd_xy * ea[1],
        p.kp_z * moving * ev[2] + p.kd_z * ea[2],
    )
    return push, rate


@kernel
def _learn(p: Parameters, learnt: Vector, push: Triple, height: float, stamp: float, free: bool) -> None:
    """Integrate the correction ``push`` into ``learnt``: horizontal push (m/s²), thrust trim, last stamp.

    The correction of an error that is flown off (a new setpoint, a jump of the estimate) integrates to
    zero; what a steady disturbance needs does not. What is missing in height is put down to the thrust
    (battery, mass), a factor that then holds at any tilt. Nothing is learnt on the ground or while a limit
    holds the command back.
    """
    elapsed = min(max(stamp - learnt[3], 0.0), SLOWEST)
    learnt[3] = stamp
    if not free or height < p.airborne_height:
        return
    gain = elapsed * p.integral
    x, y = learnt[0] + gain * push[0], learnt[1] + gain * push[1]
    cut = min(1.0, p.push_max / max(math.sqrt(x * x + y * y), 1e-9))
    learnt[0], learnt[1] = cut * x, cut * y
    learnt[2] = _bounded(learnt[2] + gain * push[2] / GRAVITY, p.trim_max)


@kernel
def _wanted_force(
    p: Parameters, body: tuple[Triple, Triple, Triple], r: Vector, push: Triple, rate: Triple
) -> tuple[Triple, Triple, Triple]:
    """Specific force (world, m/s²) for the reference ``r`` (17,) and its first two derivatives.

    Drag that is equal in all directions adds d v without turning with the body; the difference between
    the body's x and y is taken along the axes as they are, that of z only weakens the thrust.
    """
    d = 0.5 * (p.drag_x + p.drag_y)
    v, a, j = (r[3], r[4], r[5]), (r[6], r[7], r[8]), (r[9], r[10], r[11])
    force = along((a[0] + push[0], a[1] + push[1], a[2] + push[2] + GRAVITY), d, v)
    force = along(force, (p.drag_x - d) * dot(body[0], v), body[0])
    force = along(force, (p.drag_y - d) * dot(body[1], v), body[1])
    force_rate = along((j[0] + rate[0], j[1] + rate[1], j[2] + rate[2]), d, a)
    force_snap = along((r[12], r[13], r[14]), d, j)
    return force, force_rate, force_snap


@kernel
def _rates(p: Parameters, body: tuple[Triple, Triple, Triple], omega: Triple, turn: Triple) -> Triple:
    """Body rates within their limits: ``omega`` (world) as seen in ``body`` plus ``turn`` (body)."""
    x, y = dot(body[0], omega) + turn[0], dot(body[1], omega) + turn[1]
    cut = min(1.0, p.rate_max / max(math.sqrt(x * x + y * y), 1e-9))
    return cut * x, cut * y, _bounded(dot(body[2], omega) + turn[2], p.yaw_rate_max)


@kernel
def flatness_command(
    parameters: Vector,
    stamp: float,
    state: Vector,
    origin: float,
    knots: Vector,
    coefficients: Vector,
    yaw_knots: Vector,
    yaw_coefficients: Vector,
    history: Vector,
    count: int,
    learnt: Vector,
    scratch: Vector,
) -> float:
    """One command, sent at ``stamp``, for the trajectory that starts at ``origin``.

    ``parameters`` (23,) are `Parameters`; ``state`` (14,) is stamp, position, q_wb, velocity, body rates.
    Sent commands are remembered in ``history`` (HISTORY, ENTRY), of which ``count`` have been written;
    disturbances in ``learnt`` (4,). ``scratch`` (37,) gets the rates to send in its first three. Returns the
    specific force to send (m/s²), NaN when something was not finite; nothing is remembered then.
    """
    if not _usable(state):
        return math.nan
    p = unpacked(parameters)
    rates, r, ahead = scratch[0:3], scratch[3:20], scratch[20:37]
    effect = stamp + p.delay
    motion = _motion(p, state, effect, history, count)
    evaluate(knots, coefficients, yaw_knots, yaw_coefficients, effect - origin, r)
    evaluate(knots, coefficients, yaw_knots, yaw_coefficients, effect + p.yaw_rate_lag - origin, ahead)
    body = axes(motion[2])
    push, rate = _feedback(p, motion, r)
    steady = (push[0] + learnt[0], push[1] + learnt[1], push[2])
    force, force_rate, force_snap = _wanted_force(p, body, r, steady, rate)
    wanted, share = limited(p, force, p.thrust_min)
    length = math.sqrt(dot(wanted, wanted))
    z = body[2]
    if length > 1e-6:
        z = (wanted[0] / length, wanted[1] / length, wanted[2] / length)
    kept = scaled(share, force_rate)
    turn, bend = thrust_turn(z, wanted, kept, scaled(share, force_snap))
    omega, x, weight = feedforward(p, z, turn, bend, r[15], ahead[16])
    asked = _rates(p, body, omega, correction(p, body, z, x, weight))
    skew = p.drag_z - 0.5 * (p.drag_x + p.drag_y)
    v, a = (r[3], r[4], r[5]), (r[6], r[7], r[8])
    lead = p.motor_lag * (dot(body[2], kept) + skew * dot(body[2], a))
    thrust = dot(body[2], wanted) + skew * dot(body[2], v)
    sent = (thrust + lead) * (1.0 + learnt[2])
    bounded: float = min(max(sent, p.thrust_min), p.thrust_max)
    if not math.isfinite(sent + asked[0] + asked[1] + asked[2]):
        return math.nan
    entry = history[count & MASK]
    entry[0], entry[5] = effect, motion[4]
    entry[1], entry[2], entry[3], entry[4] = asked[0], asked[1], asked[2], bounded / (1.0 + learnt[2])
    free = share == 1.0 and bounded == sent and asked[0] ** 2 + asked[1] ** 2 < 0.99 * p.rate_max**2
    _learn(p, learnt, push, motion[0][2], stamp, free)
    rates[0], rates[1], rates[2] = asked
    return bounded


class FlatnessController:
    """Tracks a trajectory with body rates and thrust; see the module's sources."""

    def __init__(self, config: Config) -> None:
        self._parameters = np.array(parameters_of(config))
        self._oldest = config.safety.state_timeout
        self._state = np.zeros(14)
        self._history = np.zeros((HISTORY, ENTRY))
        self._learnt = np.zeros(4)
        self._scratch = np.zeros(37)
        self._count = 0
        self._trajectory: Trajectory | None = None
        self._pieces: tuple[Vector, Vector, Vector, Vector]
        self._compile()

    def reset(self) -> None:
        """Forget the commands sent and the disturbances learnt, at the start of a new flight."""
        self._count = 0
        self._learnt[:] = 0.0

    @property
    def push(self) -> float:
        """m/s², the steady horizontal push that it has learnt to lean against."""
        return math.hypot(self._learnt[0], self._learnt[1])

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
        packed = self._state
        packed[0] = state.stamp
        packed[1:4] = state.position
        packed[4:8] = state.orientation
        packed[8:11] = state.velocity
        packed[11:14] = state.angular_velocity
        thrust = flatness_command(
            self._parameters,
            stamp,
            packed,
            trajectory.stamp,
            *self._pieces,
            self._history,
            self._count,
            self._learnt,
            self._scratch,
        )
        if math.isnan(thrust):
            raise ControllerError(f"the state at {state.stamp:.3f} s is not finite, or too wild to be steered")
        self._count += 1
        return RateCommand(stamp, self._scratch[0:3].copy(), thrust)

    def _load(self, trajectory: Trajectory) -> None:
        """Take over a new trajectory as arrays of the one layout that the kernel is compiled for."""
        pieces = (trajectory.knots, trajectory.coefficients, trajectory.yaw_knots, trajectory.yaw_coefficients)
        knots, coefficients, yaw_knots, yaw_coefficients = (np.array(piece, float, order="C") for piece in pieces)
        arrays = (knots, coefficients, yaw_knots, yaw_coefficients)
        if not (math.isfinite(trajectory.stamp) and all(np.isfinite(array).all() for array in arrays)):
            raise ControllerError("the trajectory is not finite")
        self._pieces = arrays
        self._trajectory = trajectory

    def _compile(self) -> None:
        """Have the kernel compiled, or loaded from its cache, before anything flies."""
        upright, rest = np.array((1.0, 0.0, 0.0, 0.0)), np.zeros(3)
        state = VehicleState(0.0, rest, upright, rest, rest, np.zeros((9, 9)))
        self.command(0.0, state, hover(0.0, rest, 0.0))
        self.reset()
