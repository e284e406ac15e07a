"""One link of the vehicle: what it streams there, and what it makes of what comes in."""

import math
from collections.abc import Callable, Iterable

from sim.mavlink.codec import Frame, Kind, encode, kind, named, pack
from sim.mavlink.commands import Code, Commands, Order, StreamControl, order
from sim.mavlink.faults import Faults
from sim.mavlink.identity import AUTOPILOT, autopilot_version, protocol_version
from sim.mavlink.parameters import ParameterServer
from sim.mavlink.parameters import Reply as Told
from sim.mavlink.setpoints import Setpoint, Setpoints
from sim.mavlink.snapshot import Builder, Snapshot
from sim.mavlink.streams import Profile, Streams
from sim.mavlink.telemetry import BUILDERS, CurrentMode, Imu
from sim.mavlink.timesync import Timesync
from sim.mavlink.vision import Pose, UnsupportedError, from_odometry, from_position_estimate
from sim.px4.model import Px4
from sim.px4.modes import NavState, Reply, Result

CRITICAL, INFO = 2, 6
"""MAV_SEVERITY."""
LISTING_PERIOD = 0.01
"""s between bursts of a list of parameters."""
_ACK, _TEXT, _TIMESYNC, _PING = named("COMMAND_ACK"), named("STATUSTEXT"), named("TIMESYNC"), named("PING")
_PARAMETER = named("PARAM_VALUE")
_CHUNK = 50
"""Characters in one STATUSTEXT."""


class Session:
    """Speaks for the vehicle on one link; frames to send go to ``send``."""

    def __init__(
        self, px4: Px4, faults: Faults, profile: Profile, time: Callable[[], float], send: Callable[[bytes], None]
    ) -> None:
        self._px4, self._faults, self._profile, self._time, self._send = px4, faults, profile, time, send
        self._handlers: dict[str, Callable[[Frame], None]] = {
            "SET_ATTITUDE_TARGET": self._on_setpoint,
            "ODOMETRY": lambda frame: self._on_vision(frame, from_odometry),
            "VISION_POSITION_ESTIMATE": lambda frame: self._on_vision(frame, _position_estimate),
            "TIMESYNC": self._on_timesync,
            "COMMAND_LONG": lambda frame: self._on_command(frame, order(frame)),
            "COMMAND_INT": lambda frame: self._on_command(frame, order(frame)),
            "SET_MODE": self._on_set_mode,
            "PARAM_REQUEST_READ": self._on_parameter,
            "PARAM_REQUEST_LIST": self._on_parameter,
            "PARAM_SET": self._on_parameter,
            "PING": self._on_ping,
            "MISSION_REQUEST_LIST": self._on_mission,
            "SET_GPS_GLOBAL_ORIGIN": self._on_origin,
        }
        self.boot(time())

    def boot(self, now: float) -> None:
        """Begin anew, with the default streams."""
        px4 = self._px4
        self.system = int(px4.parameters["MAV_SYS_ID"])
        self._sequence = self._pings = self._texts = 0
        self._timesync = Timesync()
        self._setpoints = Setpoints(px4, self.system, AUTOPILOT)
        self._commands = Commands(px4, self.tell)
        self._parameters = ParameterServer(px4.parameters, lambda: self._faults.missing)
        self._next_burst = now
        builders: dict[str, Builder] = {
            **BUILDERS,
            "HIGHRES_IMU": Imu(self.system),
            "CURRENT_MODE": CurrentMode(),
            "ATTITUDE_TARGET": self._attitude_target,
            "TIMESYNC": lambda _: _TIMESYNC.layout.pack(0, self._nanoseconds()),
            "PING": self._ping,
            "AUTOPILOT_VERSION": lambda _: autopilot_version(self.system),
            "PROTOCOL_VERSION": lambda _: protocol_version(),
        }
        self._streams = Streams(self._profile, builders, px4.parameters, now)
        self._control = StreamControl(self._set_rate, self._tell_interval, self._send_once)

    @property
    def setpoint(self) -> Setpoint | None:
        """The last one that the vehicle took from this link."""
        return self._setpoints.last

    @property
    def next(self) -> float:
        """When something is to be sent."""
        return min(self._streams.next, self._next_burst) if self._parameters.listing else self._streams.next

    def poll(self, now: float, moment: Snapshot) -> None:
        """Send what is due."""
        for message, payload in self._streams.due(now, moment):
            self._emit(message, payload)
        if self._parameters.listing and now >= self._next_burst:
            self._next_burst = now + LISTING_PERIOD
            for payload in self._parameters.next_burst():
                self._emit(_PARAMETER, payload)

    def handle(self, frames: Iterable[Frame]) -> None:
        """Take what came in."""
        for frame in frames:
            handler = self._handlers.get(frame.kind.name)
            if handler is not None and (frame.system, frame.component) != (self.system, AUTOPILOT):
                handler(frame)

    def tell(self, severity: int, text: str) -> None:
        """Send a status text; a long one goes in several, which have a number in common."""
        data = text.encode()
        chunks = [data[at : at + _CHUNK] for at in range(0, len(data), _CHUNK)] or [b""]
        number = 0
        if len(chunks) > 1:
            self._texts = number = self._texts % 0xFFFF + 1
        for count, chunk in enumerate(chunks):
            self._emit(_TEXT, encode(_TEXT, severity=severity, text=chunk, id=number, chunk_seq=count))

    def _emit(self, message: Kind, payload: bytes) -> None:
        self._send(pack(message, payload, self._sequence, self.system, AUTOPILOT))
        self._sequence = (self._sequence + 1) & 0xFF

    def _since_boot(self) -> float:
        return self._time() - self._px4.boot_time

    def _nanoseconds(self) -> int:
        return int(1e9 * self._since_boot())

    # What comes in.

    def _on_setpoint(self, frame: Frame) -> None:
        if not self._faults.setpoints_ignored:
            self._setpoints.take(frame)

    def _on_vision(self, frame: Frame, read: Callable[[Frame, int], Pose | None]) -> None:
        if self._faults.vision_ignored:
            return
        try:
            pose = read(frame, int(self._px4.parameters.get("EKF2_EV_QMIN", 0)))
        except UnsupportedError as error:
            self.tell(CRITICAL, str(error))
            return
        if pose is not None:
            stamp = self._px4.boot_time + self._timesync.translate(pose.stamp, self._since_boot())
            self._px4.external_vision(stamp, pose.position, pose.orientation, pose.velocity, pose.reset_counter)

    def _on_timesync(self, frame: Frame) -> None:
        answered, asked = frame.values()[:2]
        if answered == 0:
            self._emit(_TIMESYNC, _TIMESYNC.layout.pack(self._nanoseconds(), asked))
        elif answered > 0:
            self._timesync.add(1e-9 * asked, 1e-9 * answered, self._since_boot())

    def _on_command(self, frame: Frame, given: Order) -> None:
        everywhere = given.code in (Code.REQUEST_AUTOPILOT_CAPABILITIES, Code.REQUEST_PROTOCOL_VERSION)
        if not (everywhere and given.system == 0) and not self._is_me(given.system, given.component):
            return
        if given.code == Code.DO_SET_MODE and self._faults.acknowledged_early:
            self._acknowledge(frame, given.code, Reply(Result.ACCEPTED))
        self._acknowledge(frame, given.code, self._commands.obey(given, self._control))

    def _on_set_mode(self, frame: Frame) -> None:
        values = frame.decode()
        if values["target_system"] != self.system:
            return
        custom = values["custom_mode"]
        reply = self._commands.set_mode(values["base_mode"], custom >> 16 & 0xFF, custom >> 24 & 0xFF)
        self._acknowledge(frame, Code.DO_SET_MODE, reply)

    def _acknowledge(self, frame: Frame, command: int, reply: Reply) -> None:
        fields = {"command": command, "result": int(reply.result)}
        self._emit(_ACK, encode(_ACK, **fields, target_system=frame.system, target_component=frame.component))

    def _is_me(self, system: int, component: int) -> bool:
        return system == self.system and component in (0, AUTOPILOT)

    def _on_parameter(self, frame: Frame) -> None:
        values = frame.decode()
        if self._is_me(values["target_system"], values["target_component"]):
            told: Told = self._parameters.handle(frame)
            self._next_burst = self._time()
            for payload in told.payloads:
                self._emit(_PARAMETER, payload)
            if told.text:
                self.tell(INFO, told.text)

    def _on_ping(self, frame: Frame) -> None:
        asked = frame.decode()
        if asked["target_system"] == 0 and asked["target_component"] == 0:
            answer = {**asked, "target_system": frame.system, "target_component": frame.component}
            self._emit(_PING, encode(_PING, **answer))

    def _on_mission(self, frame: Frame) -> None:
        """There is none."""
        asked = frame.decode()
        if self._is_me(asked["target_system"], asked["target_component"]):
            message = named("MISSION_COUNT")
            fields = {"mission_type": asked["mission_type"], "target_system": frame.system}
            self._emit(message, encode(message, **fields, target_component=frame.component))

    def _on_origin(self, frame: Frame) -> None:
        if frame.decode()["target_system"] == self.system:
            self._px4.set_global_origin()

    # Streams.

    def _set_rate(self, message: int, rate: float | None) -> bool:
        known = kind(message)
        if known is None or not self._streams.knows(known):
            return False
        if rate is None:
            self._streams.reset(known, self._time())
        else:
            self._streams.set_rate(known, rate, self._time())
        return True

    def _tell_interval(self, message: int) -> bool:
        known, answer = kind(message), named("MESSAGE_INTERVAL")
        period = 0.0 if known is None else self._streams.period(known)
        self._emit(answer, encode(answer, message_id=message & 0xFFFF, interval_us=round(1e6 * period)))
        return period > 0.0

    def _send_once(self, message: int) -> bool:
        known = kind(message)
        if known is None or not self._streams.knows(known):
            return False
        payload = self._streams.request(known, Snapshot(self._px4, self._faults.telemetry_nan))
        if payload is not None:
            self._emit(known, payload)
        return payload is not None

    def _ping(self, moment: Snapshot) -> bytes:
        self._pings += 1
        return encode(_PING, time_usec=moment.microseconds, seq=self._pings)

    def _attitude_target(self, moment: Snapshot) -> bytes | None:
        """ATTITUDE_TARGET: what is flown in OFFBOARD."""
        last = self._setpoints.last
        if last is None or not self._px4.armed or self._px4.nav_state is not NavState.OFFBOARD:
            return None
        thrust = 0.0 if math.isnan(last.thrust) else last.thrust
        layout = named("ATTITUDE_TARGET").layout
        return layout.pack(moment.milliseconds, *last.orientation, *last.rates, thrust, last.mask)


def _position_estimate(frame: Frame, _: int) -> Pose | None:
    return from_position_estimate(frame)
