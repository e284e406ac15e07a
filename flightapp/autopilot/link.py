"""PX4 behind MAVSDK, in process.

Setpoints go out as SET_ATTITUDE_TARGET through MAVSDK's direct interface and never through its offboard plugin, which
would go on sending the last one for ever, even with the interpreter hung: here, when Python stalls or dies, the stream
ends with the last tick, and PX4's own offboard-loss failsafe acts.
"""

import asyncio
import contextlib
import math
from collections.abc import Callable, Coroutine
from typing import Any

from mavsdk.plugins.mavlink_direct import MavlinkDirect, MavlinkDirectError, MavlinkMessage
from mavsdk.plugins.param import Param
from mavsdk.system import System

from flightapp.autopilot import modes
from flightapp.autopilot.clock import RoundTrip
from flightapp.autopilot.commands import AUTOPILOT, Command, Commander, StatusText
from flightapp.autopilot.hover_thrust import HoverThrust
from flightapp.autopilot.library import open_library
from flightapp.autopilot.local_frame import SETTLING, LocalFrame
from flightapp.autopilot.parameter_store import ParameterStore
from flightapp.autopilot.receiver import Receiver, TimeRequest
from flightapp.autopilot.telemetry import Identity
from flightapp.autopilot.thrust import ThrustMap
from flightapp.autopilot.vision import VisionEncoder
from flightapp.channel import Reader, Topic
from flightapp.config import Config
from flightapp.interfaces import AutopilotError
from flightapp.messages import AutopilotStatus, Event, FlightMode, ImuSample, PoseSample, RateCommand
from flightapp.timing import monotonic_origin

IGNORE_ATTITUDE = 128
"""ATTITUDE_TARGET_TYPEMASK_ATTITUDE_IGNORE: body rates and thrust count."""
SET_CUSTOM_MODE = 1
"""MAV_MODE_FLAG_CUSTOM_MODE_ENABLED."""
KILL = 21196
"""Magic number that makes PX4 disarm in the air."""
TIMESYNC_PERIOD = 0.5
MODE_WAIT, ARMED_WAIT = 2.0, 2.5
"""s from the acceptance of a mode, or of arming, to its being told, which heartbeats do once a second."""
INFO = 6  # MAV_SEVERITY
LOCAL_POSITION_NED, BATTERY_STATUS, AUTOPILOT_VERSION, EXTENDED_SYS_STATE = 32, 147, 148, 245
ODOMETRY, CURRENT_MODE, HIGHRES_IMU = 331, 436, 105
"""MAVLink message ids."""


class Px4Link:
    """One PX4 vehicle; an `interfaces.Autopilot`.

    Opens the connection at once, within the event loop, and raises `BadInputError` where that can't be done. Nothing
    is sent to the vehicle before `connect` has found it.
    """

    def __init__(self, config: Config) -> None:
        self._link = config.link
        self._loop = asyncio.get_running_loop()
        self._origin = monotonic_origin(self._loop)
        self._mavsdk = open_library(config.link.connection, config.link.system_id)
        self.status: Topic[AutopilotStatus] = Topic("autopilot")
        self.odometry: Topic[PoseSample] = Topic("autopilot_pose")
        self.imu: Topic[ImuSample] = Topic("imu")
        self.notices: Topic[Event] = Topic("autopilot_notice")
        self._flying = False
        self.send_failures = 0
        """Messages that could not be handed to the operating system."""
        self._frame = LocalFrame(config.external_vision.jump)
        self._receiver = Receiver(config.link.system_id, self.status, self.odometry, self.imu, self._frame)
        self._receiver.texts.tap(self._on_text)
        self._receiver.reboots.tap(self._on_reboot)
        if config.external_vision.timesync:
            self._receiver.time_requests.tap(self._answer)
        self._thrust = ThrustMap.of(config.vehicle)
        self._hover = HoverThrust(config, self._thrust) if config.vehicle.learn_hover_thrust else None
        self._late = config.guard.late
        self.status.tap(self._on_status)
        self._vision = VisionEncoder(config.external_vision, self._frame)
        self._tasks: set[asyncio.Task[None]] = set()
        self._direct: MavlinkDirect | None = None
        self._commander: Commander | None = None
        self._parameters: ParameterStore | None = None
        self._setpoint = self._message("SET_ATTITUDE_TARGET")
        self._pose = self._message(self._vision.name)
        self._time = self._message("TIMESYNC")

    def _message(self, name: str) -> MavlinkMessage:
        """A message to the vehicle, to be filled in and sent again and again."""
        return MavlinkMessage(name, 0, 0, self._link.system_id, AUTOPILOT, "")

    async def connect(self) -> None:
        """Find the configured vehicle and ask for its telemetry; raises `AutopilotError`."""
        system = await self._find()
        direct = MavlinkDirect(system)
        self._commander = Commander(direct, self._link.system_id)
        self._parameters = ParameterStore(Param(system))
        self._receiver.listen(direct)
        self._direct = direct
        self._start(self._keep_time())
        try:
            async with asyncio.timeout(self._link.connect_timeout):
                await Reader(self.status).newest()
        except TimeoutError:
            raise AutopilotError("the autopilot was found, but its heartbeats stopped") from None
        await self._request_streams()
        with contextlib.suppress(AutopilotError):  # a vehicle that doesn't tell its version still flies
            await self._commander.send("request of the version", Command.REQUEST_MESSAGE, AUTOPILOT_VERSION)

    async def _find(self) -> System:
        link = self._link
        deadline = self._loop.time() + link.connect_timeout
        while True:
            systems = self._mavsdk.get_systems()
            for system in systems:
                if system.get_system_id() == link.system_id and system.has_autopilot():
                    return system
            if self._loop.time() > deadline:
                heard = ", ".join(str(system.get_system_id()) for system in systems)
                rest = f"heard there: system {heard}" if heard else "nothing at all was heard there"
                raise AutopilotError(
                    f"no autopilot with system id {link.system_id} on {link.connection} within"
                    f" {link.connect_timeout:g} s; {rest}"
                )
            await asyncio.sleep(0.1)

    async def _request_streams(self) -> None:
        """Ask for the rates that the application needs; what is refused keeps PX4's own rate and is told."""
        wanted = {
            CURRENT_MODE: 50.0,
            EXTENDED_SYS_STATE: 10.0,
            LOCAL_POSITION_NED: 10.0,
            BATTERY_STATUS: 2.0,
            ODOMETRY: self._link.odometry_rate,
            HIGHRES_IMU: self._link.imu_rate,
        }
        for message, rate in wanted.items():
            try:
                what = f"rate of message {message}"
                await self._command(what, Command.SET_MESSAGE_INTERVAL, message, round(1e6 / rate))
            except AutopilotError as error:
                self._notice(str(error))

    # What the application asks for.

    async def takeoff(self, height: float) -> None:
        """Select PX4's takeoff to ``height`` m above where the vehicle stands; it begins when armed."""
        if self._frame.move():
            await asyncio.sleep(SETTLING)
        await self.parameters.write("MIS_TAKEOFF_ALT", float(height))
        nan = math.nan
        await self._command("takeoff", Command.NAV_TAKEOFF, nan, 0.0, 0.0, nan, nan, nan, nan)

    async def arm(self) -> None:
        """Arm, and see it armed; raises `AutopilotError` with PX4's reason."""
        await self._command("arming", Command.COMPONENT_ARM_DISARM, 1.0)
        if not await self._until(lambda status: status.armed, ARMED_WAIT):
            raise AutopilotError(f"arming: accepted, but not armed after {ARMED_WAIT:g} s")

    async def disarm(self) -> None:
        """Disarm on the ground; raises `AutopilotError` with PX4's reason."""
        await self._command("disarming", Command.COMPONENT_ARM_DISARM, 0.0)

    async def kill(self) -> None:
        """Stop the motors at once, in the air too; raises `AutopilotError`."""
        await self._command("kill", Command.COMPONENT_ARM_DISARM, 0.0, KILL)

    async def hold(self) -> None:
        """Stop and hold the position; PX4 refuses where it has no global position, as indoors."""
        await self._mode("hold", modes.LOITER, FlightMode.HOLD)

    async def land(self) -> None:
        """Land here and disarm; raises `AutopilotError`."""
        await self._mode("landing", modes.LAND, FlightMode.LAND)

    async def start_offboard(self) -> None:
        """Follow `send`; raises `AutopilotError` unless PX4 follows the stream of commands within two seconds."""
        await self._mode("offboard", modes.OFFBOARD, FlightMode.OFFBOARD)

    @property
    def parameters(self) -> ParameterStore:
        """The vehicle's parameters; raises `AutopilotError` before `connect`."""
        if self._parameters is None:
            raise AutopilotError("not connected")
        return self._parameters

    @property
    def identity(self) -> Identity | None:
        """Which vehicle it is; None until it has said so."""
        return self._receiver.identities.latest

    @property
    def round_trip(self) -> RoundTrip | None:
        """Time to the autopilot and back; None before the first answer."""
        return self._receiver.clock.round_trip

    def rates(self) -> dict[str, float]:
        """Hz at which each message comes in, by its MAVLink name."""
        return self._receiver.rates()

    def send(self, command: RateCommand) -> None:
        """Send one command at once, unless the process was held up since it was made.

        What MAVSDK has in hand already when the process is stopped, within a tenth of a millisecond, can't be recalled:
        when the process wakes that one command goes out, and PX4 follows it until it is told to land.
        """
        p, q, r = command.rates.tolist()
        throttle = self._thrust.throttle(float(command.thrust))
        if self._hover is not None and self._flying:
            self._hover.sent(self._loop.time(), throttle)
        self._setpoint.fields_json = (
            f'{{"time_boot_ms":{int(1e3 * command.stamp) & 0xFFFFFFFF},"target_system":{self._link.system_id},'
            f'"target_component":{AUTOPILOT},"type_mask":{IGNORE_ATTITUDE},"q":[1,0,0,0],"body_roll_rate":{p:.7g},'
            f'"body_pitch_rate":{-q:.7g},"body_yaw_rate":{-r:.7g},"thrust":{throttle:.7g},"thrust_body":[0,0,0]}}'
        )
        if (age := self._loop.time() - command.stamp) > self._late:
            self._notice(f"a command was held up for {age:.2f} s and is not sent")
            return
        self._post(self._setpoint)

    def send_pose(self, sample: PoseSample) -> None:
        """Offer the tracker's newest pose to EKF2, and learn the hover thrust from it.

        Poses that come sooner than the configured rate are left out.
        """
        if self._direct is None:
            return
        if self._hover is not None and (learnt := self._hover.observe(sample)) is not None:
            self._thrust.learn(learnt)
        fields = self._vision.encode(sample, int(1e6 * (sample.stamp + self._origin)))
        if fields is not None:
            self._pose.fields_json = fields
            self._post(self._pose)

    async def close(self) -> None:
        """Give the link back."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        direct, self._direct = self._direct, None
        # A message that is under way is handed over while MAVSDK ends: what is called then must be there until it has.
        called = list(getattr(direct, "_subscriptions", {}).values())
        await asyncio.to_thread(self._mavsdk.destroy)
        del called

    # What keeps it going.

    def _post(self, message: MavlinkMessage) -> None:
        if self._direct is None:
            return
        try:
            self._direct.send_message(message)
        except MavlinkDirectError as error:
            self.send_failures += 1
            if self.send_failures == 1:
                self._notice(f"{message.message_name} could not be sent: {error.result.name.lower()}")

    async def _command(self, what: str, command: Command, *parameters: float) -> None:
        if self._commander is None:
            raise AutopilotError(f"{what}: not connected")
        await self._commander.send(what, command, *parameters)

    async def _mode(self, what: str, wanted: tuple[int, int], expected: FlightMode) -> None:
        await self._command(what, Command.DO_SET_MODE, SET_CUSTOM_MODE, *wanted)
        if not await self._until(lambda status: status.mode is expected, MODE_WAIT):
            mode = "unknown" if self.status.latest is None else self.status.latest.mode
            raise AutopilotError(f"{what}: accepted, but the mode is {mode} after {MODE_WAIT:g} s")

    async def _until(self, wanted: Callable[[AutopilotStatus], bool], seconds: float) -> bool:
        """Whether the status has become as ``wanted`` within ``seconds``."""
        status = Reader(self.status)
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(seconds):
                while (latest := self.status.latest) is None or not wanted(latest):
                    await status.newest()
                return True
        return False

    async def _keep_time(self) -> None:
        """Ask for the autopilot's time now and then."""
        while True:
            self._time.fields_json = f'{{"tc1":0,"ts1":{int(1e9 * self._loop.time())}}}'
            self._post(self._time)
            await asyncio.sleep(TIMESYNC_PERIOD)

    def _answer(self, request: TimeRequest) -> None:
        """Tell the autopilot our time, by the clock that stamps the poses it gets."""
        self._time.fields_json = f'{{"tc1":{int(1e9 * (request.stamp + self._origin))},"ts1":{request.sent}}}'
        self._post(self._time)

    def _on_status(self, status: AutopilotStatus) -> None:
        self._flying = status.armed and not status.landed and status.mode is FlightMode.OFFBOARD
        self._thrust.observe_voltage(status.voltage, status.stamp)

    def _on_text(self, text: StatusText) -> None:
        if self._commander is not None:
            self._commander.heard(text)
        if text.severity <= INFO:
            self._notice(text.text)

    def _on_reboot(self, stamp: float) -> None:
        self._notice("the autopilot has rebooted")
        self._start(self._request_streams())

    def _notice(self, text: str) -> None:
        self.notices.publish(Event(self._loop.time(), "autopilot", text))

    def _start(self, coroutine: Coroutine[Any, Any, None]) -> None:
        task = asyncio.create_task(coroutine)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
