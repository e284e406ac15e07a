"""The vehicle's UDP endpoint: its links, its faults, and what the peers were seen to do."""

import asyncio
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial

from sim.mavlink.codec import Decoder, Frame
from sim.mavlink.faults import Faults
from sim.mavlink.parameters import standard_parameters
from sim.mavlink.session import Session
from sim.mavlink.snapshot import Snapshot
from sim.mavlink.socket_link import LOOPBACK, Address, SocketLink
from sim.mavlink.streams import Profile
from sim.mavlink.watch import Watch
from sim.px4.model import Px4

TEXT_PERIOD = 0.05
"""s, PX4 sends its status texts at 20 Hz."""
SHORTEST = 5e-4
"""s between two rounds of sending."""


@dataclass(frozen=True, slots=True)
class Link:
    """A UDP port of this computer that the vehicle has, and where it sends until somebody speaks to it there."""

    port: int
    """0 for any that is free."""
    remote: Address | None = None
    """None sends nothing before somebody has spoken."""
    profile: Profile = Profile.ONBOARD


ONBOARD = Link(14580, (LOOPBACK, 14540))
GROUND = Link(18570, (LOOPBACK, 14550), Profile.GROUND)
"""The links of PX4 in software-in-the-loop."""


class _Line:
    """A link that is open."""

    def __init__(self, link: Link, received: Callable[["_Line", bytes, float, Address], None]) -> None:
        self.link = link
        self.socket = SocketLink(link.port, partial(received, self))
        self.remote = link.remote
        self.session: Session


class MavlinkEndpoint:
    """Serves ``px4`` on ``links`` between `start` and `close`, in the running event loop.

    ``time`` is the vehicle's clock, in step with the loop's; somebody else must advance the vehicle. ``seed`` decides
    which packets a lossy link loses.
    """

    def __init__(
        self, px4: Px4, time: Callable[[], float], links: Sequence[Link] = (ONBOARD, GROUND), seed: int = 0
    ) -> None:
        self._px4 = px4
        self._time = time
        px4.parameters.add(standard_parameters())
        self.faults = Faults(px4, time, seed)
        self.watch = Watch()
        self._decoder = Decoder()
        self._lines = [_Line(link, self._on_datagram) for link in links]
        for line in self._lines:
            line.session = Session(px4, self.faults, line.link.profile, time, partial(self._send, line))
        self._booted = True
        self._next_texts = 0.0
        self._timer: asyncio.TimerHandle | None = None

    async def start(self) -> None:
        """Open all links and begin to stream; raises `BadInputError` for a port that can't be had."""
        with ExitStack() as failed:
            for line in self._lines:
                line.socket.open()
                failed.callback(line.socket.close)
            failed.pop_all()
        self._tick()

    async def close(self) -> None:
        """Fall silent and give the ports back."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        for line in self._lines:
            line.socket.close()

    @property
    def addresses(self) -> tuple[Address, ...]:
        """Where it listens, link by link, once started."""
        return tuple(line.socket.address for line in self._lines)

    def poll(self, now: float) -> float:
        """Do what is due at ``now``; tells when there is something to do next."""
        self.faults.run(now)
        if self._px4.booting:
            self._booted = False
            return now + TEXT_PERIOD
        if not self._booted:
            self._boot(now)
        if now >= self._next_texts:
            self._next_texts = now + TEXT_PERIOD
            while self._px4.texts:
                text = self._px4.texts.popleft()
                for line in self._lines:
                    line.session.tell(text.severity, text.text)
        moment = Snapshot(self._px4, self.faults.telemetry_nan)
        for line in self._lines:
            line.session.poll(now, moment)
        return min(self._next_texts, *(line.session.next for line in self._lines))

    def _boot(self, now: float) -> None:
        self._booted = True
        for line in self._lines:
            line.remote = line.link.remote
            line.session.boot(now)

    def _tick(self) -> None:
        following = self.poll(self._time())
        wait = max(following - self._time(), SHORTEST)
        self._timer = asyncio.get_running_loop().call_later(wait, self._tick)

    # Packets.

    def _send(self, line: _Line, packet: bytes) -> None:
        remote = line.remote
        if remote is None:
            return
        if self.faults.harmless:
            line.socket.send(packet, remote)
            return
        delay = self.faults.delay(self.faults.loss_out)
        if delay is not None:
            asyncio.get_running_loop().call_later(delay, line.socket.send, packet, remote)

    def _on_datagram(self, line: _Line, datagram: bytes, stamp: float, sender: Address) -> None:
        frames = list(self._decoder.frames(datagram))
        self.watch.corrupt = self._decoder.corrupt
        for frame in frames:
            self.watch.message(frame.kind.name, frame.system, frame.component)
            if frame.kind.name == "SET_ATTITUDE_TARGET":
                self.watch.arrived(stamp, *frame.values()[9:11])
        if not frames or self._px4.booting:
            return
        if self.faults.harmless:
            self._deliver(line, frames, sender)
            return
        delay = self.faults.delay(self.faults.loss_in)
        if delay is not None:
            asyncio.get_running_loop().call_later(delay, self._deliver, line, frames, sender)

    def _deliver(self, line: _Line, frames: list[Frame], sender: Address) -> None:
        if self._px4.booting:
            return
        line.remote = sender
        line.session.handle(frames)
        self.watch.setpoint = line.session.setpoint or self.watch.setpoint
