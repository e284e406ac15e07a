"""Which messages a link streams, and how often.

Defaults are those of PX4 v1.16 in software-in-the-loop (Mavlink::configure_streams_to_default in mavlink_main.cpp, and
the rates that its start-up script sets); a stream is no faster than what it tells is published, as measured.
"""

import heapq
import math
from collections.abc import Iterator
from enum import Enum
from typing import NamedTuple

from sim.mavlink.codec import Kind, named
from sim.mavlink.snapshot import Builder, Snapshot
from sim.px4.parameters import Parameters

HEARTBEAT = 0
IMU_RATE = 250.0
"""Hz, of PX4's simulated sensors; the estimator runs at every so many of their samples (EKF2_PREDICT_US)."""
GROUPING = 5e-4
"""s that a message may be early, to leave together with another."""


class Profile(Enum):
    """What a link is for: MAVLINK_MODE_ONBOARD, MAVLINK_MODE_NORMAL."""

    ONBOARD = 0
    GROUND = 1


class Stream(NamedTuple):
    """Rates in Hz; 0 is sent on request only."""

    onboard: float
    ground: float
    highest: float

    def default(self, profile: Profile) -> float:
        """On a link of this kind."""
        return self.onboard if profile is Profile.ONBOARD else self.ground


ESTIMATOR_BOUND = math.nan
"""As fast as EKF2 publishes."""
STREAMS = {
    "HEARTBEAT": Stream(1.0, 1.0, 1.0),
    "TIMESYNC": Stream(10.0, 0.0, 1000.0),
    "HIGHRES_IMU": Stream(50.0, 0.0, 246.0),
    "LOCAL_POSITION_NED": Stream(30.0, 1.0, ESTIMATOR_BOUND),
    "ATTITUDE": Stream(100.0, 15.0, 225.0),
    "ATTITUDE_QUATERNION": Stream(50.0, 10.0, 225.0),
    "ODOMETRY": Stream(30.0, 0.0, ESTIMATOR_BOUND),
    "ALTITUDE": Stream(10.0, 1.0, ESTIMATOR_BOUND),
    "ATTITUDE_TARGET": Stream(10.0, 2.0, 250.0),
    "BATTERY_STATUS": Stream(0.5, 0.5, 100.0),
    "CURRENT_MODE": Stream(0.5, 0.5, 250.0),
    "ESTIMATOR_STATUS": Stream(1.0, 0.5, ESTIMATOR_BOUND),
    "EXTENDED_SYS_STATE": Stream(5.0, 1.0, 250.0),
    "PING": Stream(1.0, 0.1, 1000.0),
    "SYS_STATUS": Stream(5.0, 1.0, 100.0),
    "SYSTEM_TIME": Stream(1.0, 0.0, 1000.0),
    "VFR_HUD": Stream(10.0, 4.0, 225.0),
    "AUTOPILOT_VERSION": Stream(0.0, 0.0, 1.0),
    "PROTOCOL_VERSION": Stream(0.0, 0.0, 1.0),
    "HOME_POSITION": Stream(0.5, 0.5, 1.0),
    "GLOBAL_POSITION_INT": Stream(50.0, 5.0, 1.0),
}


class Streams:
    """The streams of one link."""

    def __init__(self, profile: Profile, builders: dict[str, Builder], parameters: Parameters, now: float) -> None:
        self._parameters = parameters
        self._profile = profile
        self._builders = {named(name).id: (named(name), build) for name, build in builders.items()}
        self._periods: dict[int, float] = {}
        self._queue: list[tuple[float, int]] = []
        self._following: dict[int, float] = {}
        self._sent: dict[int, float] = {}
        for name in STREAMS:
            self.reset(named(name), now)

    def knows(self, message: Kind) -> bool:
        """Whether PX4 could stream it."""
        return message.name in STREAMS

    def period(self, message: Kind) -> float:
        """s between two; 0 when it isn't streamed."""
        return self._periods.get(message.id, 0.0)

    def reset(self, message: Kind, now: float) -> None:
        """Take up the default rate."""
        self.set_rate(message, STREAMS[message.name].default(self._profile), now)

    def set_rate(self, message: Kind, rate: float, now: float) -> None:
        """Send it at ``rate`` Hz, as far as PX4 gets so fast; 0 stops it."""
        highest = STREAMS[message.name].highest
        if math.isnan(highest):
            highest = IMU_RATE / max(int(self._parameters.get("EKF2_PREDICT_US", 10000)) * IMU_RATE // 1e6, 1.0)
        period = 1.0 / min(rate, highest) if rate > 0.0 else 0.0
        self._periods[message.id] = period
        self._following.pop(message.id, None)
        if period and message.id in self._builders:
            # A change of the rate leaves the phase as it is.
            following = max(self._sent.get(message.id, -math.inf) + period, now)
            self._following[message.id] = following
            heapq.heappush(self._queue, (following, message.id))

    @property
    def next(self) -> float:
        """When something is due; infinity if never."""
        return self._queue[0][0] if self._queue else math.inf

    def due(self, now: float, moment: Snapshot) -> Iterator[tuple[Kind, bytes]]:
        """Messages with payloads that are to be sent by ``now``."""
        queue = self._queue
        while queue and queue[0][0] <= now + GROUPING:
            when, number = queue[0]
            if self._following.get(number) != when:  # its rate was changed meanwhile
                heapq.heappop(queue)
                continue
            period = self._periods[number]
            following = when + period if when + period > now - period else now + period
            self._following[number], self._sent[number] = following, when
            heapq.heapreplace(queue, (following, number))
            made = self._build(number, moment)
            if made is not None:
                yield made

    def request(self, message: Kind, moment: Snapshot) -> bytes | None:
        """The payload of one message that was asked for; None where there is none."""
        made = self._build(message.id, moment)
        return None if made is None else made[1]

    def _build(self, number: int, moment: Snapshot) -> tuple[Kind, bytes] | None:
        known = self._builders.get(number)
        if known is None:
            return None
        payload = known[1](moment)
        return None if payload is None else (known[0], payload)
