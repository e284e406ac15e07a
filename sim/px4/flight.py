"""What the vehicle does in the modes that PX4 flies by itself.

After src/modules/flight_mode_manager/tasks and the takeoff state machine of the position controller (PX4 v1.16):
takeoff climbs at MPC_TKO_SPEED after COM_SPOOLUP_TIME, landing sinks at MPC_LAND_SPEED without a height to follow
(FlightTaskAuto.cpp), descending stays level and, without a height, sinks with a fixed acceleration
(FlightTaskDescend.cpp). Once landed the motors idle until a takeoff is asked for, whatever the land detector makes of
it meanwhile (Takeoff.cpp). Without a global position a takeoff leads over the origin of the local frame, since the
place where the vehicle stands then reads as latitude, longitude and altitude 0 (takeoff.cpp and navigator_main.cpp).
"""

import math

import numpy as np

from flightapp.autopilot.thrust import ThrustMap
from flightapp.frames import GRAVITY, quat_yaw
from sim.px4.estimator import Estimate
from sim.px4.landing import Felt, LandDetector
from sim.px4.modes import NavState
from sim.px4.parameters import Parameters
from sim.px4.position_control import ACCELERATION, THRUST_MIN, PositionController, turn

SINK = 0.15
"""m/s², downwards, of a descent without a height."""
REACHED = 0.15
"""m, below the takeoff height, where the climb counts as complete."""
CRUISE = 5.0
"""m/s, MPC_XY_CRUISE."""
TICK = 0.01
"""s, period of the position controller."""

BY_POSITION = frozenset(
    {NavState.AUTO_TAKEOFF, NavState.AUTO_LOITER, NavState.AUTO_LAND, NavState.AUTO_MISSION, NavState.AUTO_RTL}
    | {NavState.POSCTL}
)
LEVEL = frozenset({NavState.DESCEND, NavState.ALTCTL})

Command = tuple[tuple[float, float, float], float]
"""Body rates in rad/s, FLU, and throttle 0..1."""
IDLE: Command = ((0.0, 0.0, 0.0), 0.0)


class Flight:
    """Gives the commands of the modes that are flown without setpoints from outside."""

    def __init__(self, parameters: Parameters, curve: float) -> None:
        self._parameters = parameters
        self._curve = curve
        self._known = parameters.version
        self._controller = PositionController(self._map())
        self.detector = LandDetector(float(parameters["MPC_THR_HOVER"]), THRUST_MIN)
        self.throttle = 0.0
        """0..1, last given."""
        self._flying = False
        self.target = np.full(3, math.nan)
        """(3,) m, where a takeoff leads to."""
        self.sticks = (0.0, 0.0)
        """m/s, local frame, that a pilot's sticks ask for in a mode that follows positions; centred: 0."""

    def _map(self) -> ThrustMap:
        return ThrustMap(float(self._parameters["MPC_THR_HOVER"]), self._curve)

    @property
    def climb_wanted(self) -> float:
        """m/s, upwards."""
        return self._controller.climb

    def enter(self, mode: NavState, estimate: Estimate, located: bool) -> None:
        """Begin ``mode`` where the vehicle is; ``located`` where it has a global position."""
        if self._known != self._parameters.version:
            self._known = self._parameters.version
            self._controller.thrust = self._map()
        if mode is NavState.AUTO_TAKEOFF:
            self.target = estimate.position.copy() if located else np.zeros(3)
            self.target[2] += float(self._parameters["MIS_TAKEOFF_ALT"])
        moving = np.zeros(3) if self.detector.landed else estimate.velocity
        self._controller.begin(estimate.position, moving, float(quat_yaw(estimate.orientation)))

    def shift(self, estimate_move: np.ndarray, turned: float) -> None:
        """Stay where it is although the estimate was reset by (3,) m and ``turned`` rad."""
        self._controller.shift(estimate_move, turned)
        self.target += estimate_move

    def climbed(self, estimate: Estimate) -> bool:
        """Whether a takeoff is complete."""
        return bool(estimate.position[2] > self.target[2] - REACHED)

    def disarmed(self) -> None:
        """Stand there with the motors off."""
        self.detector.reset()
        self.throttle, self._flying = 0.0, False

    def watch_ground(self, now: float, mode: NavState, estimate: Estimate, throttle: float) -> None:
        """Let the land detector judge; ``throttle`` 0..1 is in force."""
        controlled = mode in BY_POSITION or mode in LEVEL
        climb, sideways = math.nan, math.nan
        if estimate.altitude_valid:
            climb = float(estimate.velocity[2])
        if estimate.position_valid:
            sideways = math.hypot(float(estimate.velocity[0]), float(estimate.velocity[1]))
        turning = math.hypot(float(estimate.angular_velocity[0]), float(estimate.angular_velocity[1]))
        wanted = (self._controller.climb if estimate.altitude_valid else math.nan) if controlled else None
        self.detector.update(now, Felt(climb, sideways, turning), throttle, wanted)
        self._flying = not controlled or (self._flying and not self.detector.landed)

    def command(self, mode: NavState, estimate: Estimate, spooling: bool) -> Command:
        """One step of `TICK` in ``mode``; ``spooling`` while the motors still come up to speed."""
        self._flying |= mode is NavState.AUTO_TAKEOFF and not spooling
        rates, self.throttle = self._command(mode, estimate)
        return rates, self.throttle

    def _command(self, mode: NavState, estimate: Estimate) -> Command:
        controller = self._controller
        if not self._flying or (self.detector.touched and not self.detector.landed):
            sinking = -self._sink_speed if mode in (NavState.AUTO_LAND, NavState.DESCEND) else 0.0
            controller.reset(estimate.position, np.array((0.0, 0.0, sinking)), controller.yaw)
            return IDLE
        if mode in BY_POSITION:
            controller.steer(self._wanted(mode), TICK)
            if mode is NavState.AUTO_LAND:
                controller.sink(float(estimate.position[2]), self._sink_speed)
            return controller.command(estimate.position, estimate.velocity, estimate.orientation, TICK)
        if mode in LEVEL and estimate.altitude_valid:
            climb = -self._sink_speed if mode is NavState.DESCEND else 0.0
            return controller.command_level(climb, float(estimate.velocity[2]), estimate.orientation, TICK)
        if mode is NavState.ACRO:
            return (0.0, 0.0, 0.0), controller.command_force(GRAVITY, estimate.orientation)[1]
        force = GRAVITY - SINK if mode is NavState.DESCEND else GRAVITY
        return controller.command_force(force, estimate.orientation)

    @property
    def _sink_speed(self) -> float:
        return float(self._parameters["MPC_LAND_SPEED"])

    def _wanted(self, mode: NavState) -> tuple[float, float, float]:
        """Velocity of the setpoint as ``mode`` asks; sideways it brakes but for a takeoff from beside its target."""
        if mode is NavState.AUTO_LAND:
            return 0.0, 0.0, -self._sink_speed
        if mode is NavState.POSCTL:
            return *self.sticks, 0.0
        if mode is not NavState.AUTO_TAKEOFF:
            return 0.0, 0.0, 0.0
        x, y, up = (self.target - self._controller.position).tolist()
        away = math.hypot(x, y)
        share = _approach(away, CRUISE) / away if away > 0.0 else 0.0
        return share * x, share * y, _approach(max(up, 0.0), float(self._parameters["MPC_TKO_SPEED"]))


def _approach(left: float, fastest: float) -> float:
    """Speed at which to go the ``left`` m, so that it ends there."""
    return min(fastest, math.sqrt(ACCELERATION * left), left / TICK)


def attitude_rates(wanted: np.ndarray, estimate: Estimate) -> tuple[float, float, float]:
    """Body rates in rad/s that turn the vehicle into ``wanted`` (4,), local frame."""
    p, q, r = turn(wanted, estimate.orientation).tolist()
    return p, q, r
