"""PX4 as the application meets it: modes, refusals, failsafes and its own position controller.

Parameters are PX4's defaults (parameter reference) but for COM_OF_LOSS_T and COM_DISARM_LAND, which are set as for
indoor racing. The position that it flies by is the truth with the error of an EKF2 on external vision.
"""

import math
from collections.abc import Callable

import numpy as np

from flightapp.autopilot.thrust import ThrustMap
from flightapp.channel import Topic
from flightapp.config import Config
from flightapp.frames import Vector, quat_yaw
from flightapp.interfaces import AutopilotError
from flightapp.messages import AutopilotStatus, FlightMode, RateCommand
from sim.landing import LandDetector
from sim.plant import Plant
from sim.position_control import ACCELERATION, PositionController

TICK = 0.01
"""s, period of the position controller."""
READY_AFTER = 1.0
"""s, until the position estimate has converged."""
STATUS_PERIOD = 0.1
OFFBOARD_LOSS = 0.5
"""s, COM_OF_LOSS_T."""
SPOOL_UP = 1.0
"""s, COM_SPOOLUP_TIME."""
PREFLIGHT_DISARM = 10.0
"""s, COM_DISARM_PRFLT."""
CLIMB_SPEED = 1.5
"""m/s, MPC_TKO_SPEED."""
LAND_SPEED = 0.7
"""m/s, MPC_LAND_SPEED."""
REACHED = 0.15
"""m, below the takeoff height, where holding begins."""
ESTIMATE_ERROR = np.array((0.03, 0.03, 0.03, 0.07, 0.07, 0.07))
"""m and m/s: standard deviation of the estimate's error (1–5 cm and 2–13 cm/s measured)."""
ESTIMATE_ERROR_RATE = 1.0 / np.array((2.0, 2.0, 2.0, 0.5, 0.5, 0.5))
"""1/s, inverse of its correlation time."""

CLOSED_LOOP = (FlightMode.TAKEOFF, FlightMode.HOLD, FlightMode.LAND)


class SimAutopilot:
    """The simulated vehicle's autopilot; owns the ``plant`` and moves it with the world's time.

    ``time`` gives the present in the plant's time, and ``seed`` the errors of the position estimate. What turns
    specific force into throttle is the flight side's belief in ``config.vehicle``, not the plant's truth.
    """

    def __init__(self, config: Config, plant: Plant, seed: int, time: Callable[[], float]) -> None:
        self.plant = plant
        self.status: Topic[AutopilotStatus] = Topic("autopilot")
        self._time = time
        self._thrust = ThrustMap(config.vehicle.hover_thrust, config.vehicle.thrust_curve)
        self._delay = plant.vehicle.delay
        self._controller = PositionController(self._thrust)
        self._detector = LandDetector(config.vehicle.hover_thrust)
        self._rng = np.random.default_rng([seed, 0xA9])
        self._error = ESTIMATE_ERROR * self._rng.standard_normal(6)
        self._error_time = self._tick = self._began = plant.time
        self._next_status = plant.time
        self._mode = FlightMode.MANUAL
        self._armed = self._crashed = self._flown = False
        self._armed_at = -math.inf
        self._target = 0.0
        self._last: RateCommand | None = None
        self._last_at = -math.inf

    # The application's side.

    async def connect(self) -> None:
        """Nothing to find: the vehicle is in this process."""
        self._publish()

    async def close(self) -> None:
        """Nothing to give back."""

    async def arm(self) -> None:
        """Arm; raises `AutopilotError` with PX4's reason."""
        now = self._time()
        if self._armed:
            return
        if self._crashed:
            raise AutopilotError("arming denied: motor failure")
        if not self._ready(now):
            raise AutopilotError("arming denied: system is not ready, no valid local position estimate yet")
        if self._mode is FlightMode.LAND:
            raise AutopilotError("arming denied: switch to another mode than land first")
        if self._mode is FlightMode.OFFBOARD and not self._fresh(now):
            raise AutopilotError("arming denied: no offboard signal")
        self._armed, self._armed_at, self._flown = True, now, False
        self._detector.reset()
        self._enter(FlightMode.HOLD if self._mode is FlightMode.MANUAL else self._mode, now)

    async def takeoff(self, height: float) -> None:
        """Climb to ``height`` m above the ground, at once or when armed; raises `AutopilotError`."""
        now = self._time()
        if not self._ready(now):
            raise AutopilotError("takeoff refused: no valid local position estimate yet")
        if not height > 0.0:
            raise AutopilotError(f"takeoff refused: the height must be positive, not {height} m")
        here = float(self._estimate(now)[0][2])
        self._target = height + (here if self._detector.ground is None else self._detector.ground)
        self._enter(FlightMode.TAKEOFF, now)

    async def hold(self) -> None:
        """Brake and stay; raises `AutopilotError` before there is a position."""
        now = self._time()
        if not self._ready(now):
            raise AutopilotError("hold refused: no valid local position estimate yet")
        self._enter(FlightMode.HOLD, now)

    async def land(self) -> None:
        """Descend, and disarm on the ground."""
        self._enter(FlightMode.LAND, self._time())

    async def start_offboard(self) -> None:
        """Follow `send`; raises `AutopilotError` unless a command came within the last half second."""
        now = self._time()
        if self._last is None or not self._fresh(now):
            raise AutopilotError("offboard refused: no offboard signal, send setpoints before switching")
        self._enter(FlightMode.OFFBOARD, now)
        self._follow(self._last, now)

    def send(self, command: RateCommand) -> None:
        """Take one command; it acts after the link's delay, while armed and in offboard mode."""
        self._last, self._last_at = command, self._time()
        if self._armed and self._mode is FlightMode.OFFBOARD:
            self._follow(command, self._last_at)

    # The world's side.

    def advance(self, until: float) -> None:
        """Let the vehicle fly on to ``until``; the plant's trace then holds all of it."""
        event = self._next_event()
        self.plant.advance(event if event < until else until)
        while event <= until:
            self._act(event)
            event = self._next_event()
            self.plant.advance(event if event < until else until, extend=True)
        if until >= self._next_status - 1e-9:
            self._publish()

    def crash(self) -> None:
        """Cut the motors for good."""
        self._crashed = True
        self._disarm()

    # What PX4 does by itself.

    def _next_event(self) -> float:
        """When the mode logic must run next."""
        if not self._armed:
            return math.inf
        if self._mode in CLOSED_LOOP:
            return self._tick
        return min(self._tick, self._last_at + OFFBOARD_LOSS)

    def _act(self, now: float) -> None:
        """Run the mode logic at ``now``, the time of the next event, which it moves on."""
        if self._mode is FlightMode.OFFBOARD and now >= self._last_at + OFFBOARD_LOSS:
            self._enter(FlightMode.LAND, now)
        position, velocity = self._estimate(now)
        self._watch_ground(position, velocity, now)
        if not self._armed:
            return
        if self._mode in CLOSED_LOOP:
            self._fly(position, velocity, now)
            self._tick = now + TICK
        else:
            self._tick = now + STATUS_PERIOD

    def _watch_ground(self, position: Vector, velocity: Vector, now: float) -> None:
        landed = self._detector.landed
        self._detector.update(now, position[2], velocity[2], self._controller.climb, self._throttle())
        self._flown |= not self._detector.landed
        idle = now - self._armed_at > PREFLIGHT_DISARM
        if self._detector.disarms(now) if self._flown else idle:
            self._disarm()
        elif landed != self._detector.landed:
            self._publish()

    def _throttle(self) -> float | None:
        """The throttle in force where the application gives it; None where the position controller does."""
        if self._mode is FlightMode.OFFBOARD and self._last is not None:
            return self._thrust.throttle(self._last.thrust)
        return None

    def _fly(self, position: Vector, velocity: Vector, now: float) -> None:
        """One run of the position controller in a mode that PX4 flies by itself."""
        controller = self._controller
        idle = self._mode is not FlightMode.TAKEOFF or now - self._armed_at < SPOOL_UP
        if (self._detector.landed and idle) or self._detector.touched:
            sinking = -LAND_SPEED if self._mode is FlightMode.LAND else 0.0
            controller.reset(position, np.array((0.0, 0.0, sinking)), controller.yaw)
            self.plant.command(now, (0.0, 0.0, 0.0), 0.0)
            return
        controller.steer(self._wanted_climb(), TICK)
        rates, throttle = controller.command(position, velocity, self.plant.orientation, TICK)
        self.plant.command(now, rates, throttle)
        if self._mode is FlightMode.TAKEOFF and position[2] > self._target - REACHED:
            self._mode = FlightMode.HOLD
            self._publish()

    def _wanted_climb(self) -> float:
        """Vertical velocity of the setpoint as the mode asks; sideways it brakes."""
        if self._mode is FlightMode.LAND:
            return -LAND_SPEED
        if self._mode is FlightMode.TAKEOFF:
            left = max(self._target - self._controller.height, 0.0)
            return min(CLIMB_SPEED, math.sqrt(ACCELERATION * left), left / TICK)
        return 0.0

    def _enter(self, mode: FlightMode, now: float) -> None:
        self._mode = mode
        self.plant.drop_pending()
        self._tick = now
        if mode in CLOSED_LOOP:
            position, velocity = self._estimate(now)
            moving = np.zeros(3) if self._detector.landed else velocity
            self._controller.reset(position, moving, float(quat_yaw(self.plant.orientation)))
        self._publish()

    def _follow(self, command: RateCommand, now: float) -> None:
        if self._armed:
            throttle = self._thrust.throttle(float(command.thrust))
            self.plant.command(now + self._delay, command.rates.tolist(), throttle)

    def _disarm(self) -> None:
        self._armed = False
        self._mode = FlightMode.MANUAL
        self.plant.stop_motors()
        self._detector.reset()
        self._publish()

    def _ready(self, now: float) -> bool:
        return not self._crashed and now - self._began >= READY_AFTER - 1e-9

    def _fresh(self, now: float) -> bool:
        return now - self._last_at <= OFFBOARD_LOSS

    def _estimate(self, now: float) -> tuple[Vector, Vector]:
        """Position and velocity (3,) as PX4 believes them: the truth and an Ornstein-Uhlenbeck error."""
        dt = max(now - self._error_time, 0.0)
        self._error_time = now
        keep = np.exp(-dt * ESTIMATE_ERROR_RATE)
        noise = self._rng.standard_normal(6)
        self._error = keep * self._error + ESTIMATE_ERROR * np.sqrt(1.0 - keep * keep) * noise
        return self.plant.position + self._error[:3], self.plant.velocity + self._error[3:]

    def _publish(self) -> None:
        now = self._time()
        self._next_status = now + STATUS_PERIOD
        plant = self.plant
        landed = not self._armed or self._detector.landed
        self.status.publish(
            AutopilotStatus(now, self._mode, self._armed, landed, self._ready(now), plant.voltage, plant.charge)
        )
