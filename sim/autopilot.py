"""The model of PX4 as the application's autopilot, in the same process."""

import asyncio
import math
from collections.abc import Callable

from flightapp.autopilot.local_frame import SETTLING, LocalFrame
from flightapp.autopilot.thrust import ThrustMap
from flightapp.channel import Topic
from flightapp.config import Config
from flightapp.interfaces import AutopilotError
from flightapp.messages import AutopilotStatus, Event, FlightMode, ImuSample, PoseSample, RateCommand
from sim.plant import Plant
from sim.px4.model import Px4
from sim.px4.modes import NavState, Reply

STATUS_PERIOD = 0.1
"""s"""
POSE_PERIOD = 0.02
"""s, least time between the poses that the estimator is given."""
ANSWER = 2.0
"""s that a command waits for its answer, asked for again meanwhile, as MAVSDK does."""
_EARLY = 1e-6
"""s, by which a pose may come early."""

MODES = {
    NavState.MANUAL: FlightMode.MANUAL,
    NavState.ALTCTL: FlightMode.ALTITUDE,
    NavState.POSCTL: FlightMode.POSITION,
    NavState.AUTO_MISSION: FlightMode.MISSION,
    NavState.AUTO_LOITER: FlightMode.HOLD,
    NavState.AUTO_RTL: FlightMode.RETURN,
    NavState.ACRO: FlightMode.ACRO,
    NavState.DESCEND: FlightMode.DESCEND,
    NavState.TERMINATION: FlightMode.OTHER,
    NavState.OFFBOARD: FlightMode.OFFBOARD,
    NavState.STAB: FlightMode.STABILIZED,
    NavState.AUTO_TAKEOFF: FlightMode.TAKEOFF,
    NavState.AUTO_LAND: FlightMode.LAND,
}


class SimAutopilot:
    """The simulated vehicle's autopilot; owns the ``plant`` and moves it with the world's time.

    ``time`` gives the present in the plant's time, and ``seed`` the errors of the autopilot's estimate. What turns
    specific force into throttle is the flight side's belief in ``config.vehicle``, not the plant's truth.
    """

    def __init__(self, config: Config, plant: Plant, seed: int, time: Callable[[], float]) -> None:
        self.px4 = Px4(config, plant, seed, time)
        self.status: Topic[AutopilotStatus] = Topic("autopilot")
        self.notices: Topic[Event] = Topic("notice")
        self.imu: Topic[ImuSample] = Topic("imu")
        self._time = time
        self._thrust = ThrustMap.of(config.vehicle)
        self._next_status = plant.time
        self._published = (-1, False)
        self._next_pose = plant.time
        self._frame = LocalFrame(config.external_vision.jump)
        self._connected = False
        self.silent_until = -math.inf
        """Until then nothing gets through, either way."""

    # The application's side.

    async def connect(self) -> None:
        """Nothing to find: the vehicle is in this process."""
        self._connected = True
        self._publish()

    async def close(self) -> None:
        """Nothing to give back."""

    async def takeoff(self, height: float) -> None:
        """Select PX4's takeoff to ``height`` m above the ground, which begins when armed; raises `AutopilotError`."""
        if not height > 0.0:
            raise AutopilotError(f"takeoff refused: the height must be positive, not {height} m")
        await self._reach("takeoff")
        if self._frame.move():
            await asyncio.sleep(SETTLING)
        self.px4.parameters.set("MIS_TAKEOFF_ALT", float(height))
        self._done("takeoff", self.px4.takeoff())

    async def arm(self) -> None:
        """Arm; raises `AutopilotError` with PX4's reason."""
        await self._reach("arming")
        self._done("arming", self.px4.arm())

    async def disarm(self) -> None:
        """Disarm on the ground; raises `AutopilotError` with PX4's reason."""
        await self._reach("disarming")
        self._done("disarming", self.px4.disarm())

    async def kill(self) -> None:
        """Stop the motors at once, in the air too."""
        await self._reach("kill")
        self._done("kill", self.px4.kill())

    async def hold(self) -> None:
        """Brake and stay; raises `AutopilotError` in flight without a global position."""
        await self._reach("hold")
        self._done("hold", self.px4.set_mode(NavState.AUTO_LOITER))

    async def land(self) -> None:
        """Descend, and disarm on the ground; raises `AutopilotError` without a local position."""
        await self._reach("land")
        self._done("land", self.px4.set_mode(NavState.AUTO_LAND))

    async def start_offboard(self) -> None:
        """Follow `send`; raises `AutopilotError` unless a command came within COM_OF_LOSS_T."""
        await self._reach("offboard")
        self._done("offboard", self.px4.set_mode(NavState.OFFBOARD))

    def send(self, command: RateCommand) -> None:
        """Take one command; it acts after the link's delay, while armed and in offboard mode."""
        if self._silent:
            return
        self.px4.attitude_target(command.rates.tolist(), self._thrust.throttle(float(command.thrust)))
        self._tell_changes()

    def send_pose(self, sample: PoseSample) -> None:
        """Give the estimator ``sample``, unless it had one just before."""
        if self._silent or sample.stamp < self._next_pose - _EARLY:
            return
        self._next_pose = sample.stamp + POSE_PERIOD
        place = self._frame.take(sample)
        self.px4.external_vision(sample.stamp, place, sample.orientation, sample.velocity, self._frame.resets)

    # The world's side.

    @property
    def plant(self) -> Plant:
        """The vehicle."""
        return self.px4.plant

    def advance(self, until: float) -> None:
        """Let the vehicle fly on to ``until``; the plant's trace then holds all of it."""
        self.px4.advance(until)
        self._tell_changes()
        if until >= self._next_status - 1e-9:
            self._publish()

    def feel(self, sample: ImuSample) -> None:
        """Pass on what the inertial sensors measure."""
        if not self._silent:
            self.imu.publish(sample)

    def crash(self) -> None:
        """Cut the motors for good."""
        self.px4.crash()
        self._tell_changes()

    @property
    def _silent(self) -> bool:
        return self._time() < self.silent_until

    async def _reach(self, what: str) -> None:
        """Wait for the link to get through with a command; raises `AutopilotError` after `ANSWER`."""
        if self._silent:
            await asyncio.sleep(min(ANSWER, self.silent_until - self._time()))
        if self._silent:
            raise AutopilotError(f"{what}: no answer within {ANSWER:g} s")

    def _done(self, what: str, reply: Reply) -> None:
        self._tell_changes()
        if not reply.accepted:
            raise AutopilotError(f"{what} refused: {reply.text}")

    def _tell_changes(self) -> None:
        # Unless the application flies by this adapter, another end of a link sends the texts.
        texts = self.px4.texts
        while texts and self._connected and not self._silent:
            self.notices.publish(Event(self._time(), "autopilot", texts.popleft().text))
        if (self.px4.changes, self.px4.ready) != self._published:
            self._publish()

    def _publish(self) -> None:
        now, px4 = self._time(), self.px4
        self._next_status = now + STATUS_PERIOD
        if self._silent:
            return
        self._published = (px4.changes, px4.ready)
        self._thrust.observe_voltage(px4.voltage, now)
        mode = MODES[px4.nav_state]
        self.status.publish(AutopilotStatus(now, mode, px4.armed, px4.on_ground, px4.ready, px4.voltage, px4.battery))
