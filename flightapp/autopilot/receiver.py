"""What comes from the autopilot, from MAVSDK's callback thread to topics of the event loop."""

import asyncio
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from mavsdk.plugins.mavlink_direct import MavlinkDirect, MavlinkMessage

from flightapp.autopilot.clock import ClockOffset
from flightapp.autopilot.commands import AUTOPILOT, StatusText
from flightapp.autopilot.local_frame import LocalFrame
from flightapp.autopilot.mailbox import Mailbox
from flightapp.autopilot.telemetry import Fields, Identity, StatusBoard, identity, inertial, number, odometry
from flightapp.channel import Topic
from flightapp.messages import AutopilotStatus, ImuSample, PoseSample

TEXT_LENGTH = 50
"""Characters in one STATUSTEXT."""
REBOOTED = 1.0
"""s that the autopilot's clock, which counts from its boot, must have gone back for it to have booted anew."""


@dataclass(frozen=True, slots=True)
class TimeRequest:
    """The autopilot asks for our time: TIMESYNC with its own in ``sent``, ns."""

    stamp: float
    sent: int


class Receiver:
    """Listens to the autopilot of one vehicle. Topics hold the newest value, which carries its stamp.

    Its odometry, which is in the autopilot's local ``frame``, is told in the tracker's.
    """

    def __init__(
        self,
        system_id: int,
        status: Topic[AutopilotStatus],
        poses: Topic[PoseSample],
        imu: Topic[ImuSample],
        frame: LocalFrame,
    ) -> None:
        self._system_id = system_id
        self._loop = asyncio.get_running_loop()
        self.status = status
        self.odometry = poses
        self.imu = imu
        self.texts: Topic[StatusText] = Topic("autopilot_texts")
        self.time_requests: Topic[TimeRequest] = Topic("time_requests")
        self.reboots: Topic[float] = Topic("reboots")
        """Stamp of each reboot that was noticed."""
        self.identities: Topic[Identity] = Topic("identities")
        self.clock = ClockOffset()
        self._frame = frame
        self.refused = 0
        """Messages whose content could not be used: not finite, other frames, other fields."""
        self._board = StatusBoard()
        self._begun = (0, "")
        self._mailboxes: dict[str, Mailbox[str]] = {}

    def listen(self, direct: MavlinkDirect) -> None:
        """Begin to receive."""
        handlers: Mapping[str, tuple[Callable[[float, Fields], None], int]] = {
            "HEARTBEAT": (lambda stamp, fields: self._publish(self._board.heartbeat(stamp, fields)), 1),
            "CURRENT_MODE": (lambda stamp, fields: self._publish(self._board.current_mode(stamp, fields)), 1),
            "EXTENDED_SYS_STATE": (lambda _, fields: self._publish(self._board.landed(fields)), 1),
            "LOCAL_POSITION_NED": (lambda stamp, _: self._publish(self._board.local_position(stamp)), 1),
            "BATTERY_STATUS": (lambda _, fields: self._publish(self._board.battery(fields)), 1),
            "ODOMETRY": (self._on_odometry, 1),
            "HIGHRES_IMU": (self._on_imu, 4),
            "TIMESYNC": (self._on_timesync, 8),
            "STATUSTEXT": (self._on_text, 32),
            "AUTOPILOT_VERSION": (self._on_version, 1),
        }
        for name, (handle, depth) in handlers.items():
            mailbox = self._mailboxes[name] = Mailbox[str](self._parsing(handle), depth)
            direct.subscribe_message(name, self._put_into(mailbox))

    def rates(self) -> dict[str, float]:
        """Messages per second lately, by name."""
        return {name: mailbox.rate() for name, mailbox in self._mailboxes.items()}

    def _put_into(self, mailbox: Mailbox[str]) -> Callable[[MavlinkMessage, object], None]:
        """What MAVSDK's thread calls: no other component, and no other vehicle, is listened to."""

        def receive(message: MavlinkMessage, _: object) -> None:
            if message.system_id == self._system_id and message.component_id == AUTOPILOT:
                mailbox.put(message.fields_json)

        return receive

    def _parsing(self, handle: Callable[[float, Fields], None]) -> Callable[[float, str], None]:
        def deliver(stamp: float, text: str) -> None:
            try:
                handle(stamp, json.loads(text))
                self._publish(self._board.heard(stamp))
            except (KeyError, TypeError, ValueError, OverflowError):
                self.refused += 1

        return deliver

    def _publish(self, status: AutopilotStatus | None) -> None:
        if status is not None:
            self.status.publish(status)

    def _on_odometry(self, stamp: float, fields: Fields) -> None:
        sample = odometry(self._measured(stamp, fields), fields)
        if sample is None:
            self.refused += 1
        else:
            self.odometry.publish(replace(sample, position=sample.position + self._frame.origin))

    def _on_imu(self, stamp: float, fields: Fields) -> None:
        sample = inertial(self._measured(stamp, fields), fields)
        if sample is None:
            self.refused += 1
        else:
            self.imu.publish(sample)

    def _measured(self, stamp: float, fields: Fields) -> float:
        """When that was measured, by our clock, which arrived at ``stamp``."""
        ours = self.clock.to_ours(1e-6 * number(fields["time_usec"]))
        # An offset that doesn't fit yet must not make stamps from the future.
        return stamp if ours is None or not 0.0 <= stamp - ours < 0.5 else ours

    def _on_timesync(self, stamp: float, fields: Fields) -> None:
        answered, asked = int(fields["tc1"]), int(fields["ts1"])
        if answered == 0:
            self.time_requests.publish(TimeRequest(stamp, asked))
        else:
            before = self.clock.offset
            self.clock.add(1e-9 * asked, 1e-9 * answered, stamp)
            if before is not None and self.clock.offset is not None and self.clock.offset < before - REBOOTED:
                self.reboots.publish(stamp)

    def _on_text(self, stamp: float, fields: Fields) -> None:
        """A text longer than one message comes in pieces of the same id; the last one is not full."""
        piece, number_of = str(fields["text"]).split("\0", 1)[0], int(fields.get("id", 0))
        before, begun = self._begun
        text = begun + piece if number_of != 0 and number_of == before else piece
        whole = number_of == 0 or len(piece) < TEXT_LENGTH
        self._begun = (0, "") if whole else (number_of, text)
        if whole and text.strip():
            self.texts.publish(StatusText(stamp, int(fields["severity"]), text.strip()))

    def _on_version(self, _: float, fields: Fields) -> None:
        self.identities.publish(identity(self._system_id, fields))
