"""The simulated vehicle alone behind MAVLink, for a ground station or any other client."""

import asyncio
import signal
import socket
from collections.abc import Callable, Coroutine, Sequence
from pathlib import Path
from typing import Any, Literal

from flightapp.config import Config
from flightapp.inputs import BadInputError
from flightapp.messages import PoseSample
from flightapp.sensors.address import parse_address
from flightapp.sensors.poses import encode_pose
from flightapp.timing import monotonic_origin
from flightapp.track import Start, Track
from sim.clock import RealtimeLoop
from sim.live import LiveWorld, run_until
from sim.mavlink.endpoint import GROUND, ONBOARD, Link, MavlinkEndpoint
from sim.outbox import Outbox

EMPTY = Track(name="empty", start=Start(position=(0.0, 0.0, 0.0)), waypoints=((0.0, 0.0, 1.5),))

Vision = Literal["internal", "external"]


def serve_alone(
    config: Config,
    track: Track | None = None,
    *,
    seed: int = 0,
    remotes: Sequence[str] = (),
    parameters: Sequence[str] = (),
    vision: Vision = "internal",
    poses_to: str | None = None,
    announce: Callable[[str], object],
) -> None:
    """Serve a simulated PX4 vehicle over MAVLink on the wall clock until SIGINT or SIGTERM.

    ``remotes`` are "HOST:PORT" of this computer where MAVLink goes to instead of the usual 14540 and 14550;
    ``parameters`` are "NAME=VALUE" over PX4's. With ``vision`` "internal" the tracker feeds the vehicle's EKF2 itself,
    with "external" a client must send the poses, which it can get as datagrams (`POSE_RECORD`) by ``poses_to``, a path
    or 127.0.0.1:PORT. ``announce`` is told one line when it serves. Raises `BadInputError`.
    """
    links = [Link(0, _remote(text)) for text in remotes] or [ONBOARD, GROUND]
    target = None if poses_to is None else _target(poses_to)

    async def main() -> None:
        live = LiveWorld(config, track or EMPTY, seed)
        endpoint = live.endpoint(links, parameters)
        await endpoint.start()
        stop, loop = asyncio.Event(), asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, stop.set)
        try:
            announce(_line(endpoint, links, vision))
            await run_until(stop, *_work(live, vision, target))
        finally:
            await endpoint.close()

    with asyncio.Runner(loop_factory=RealtimeLoop) as runner:
        runner.run(main())


def _work(live: LiveWorld, vision: Vision, target: Outbox | None) -> list[Coroutine[Any, Any, None]]:
    origin = monotonic_origin(asyncio.get_running_loop())

    def send(sample: PoseSample) -> None:
        if target is not None:
            target.send(encode_pose(sample, origin))
        if vision == "internal":
            live.feed(sample)

    return [live.advance(), live.track(send)]


def _line(endpoint: MavlinkEndpoint, links: Sequence[Link], vision: Vision) -> str:
    ends = zip(endpoint.addresses, links, strict=True)
    ports = ", ".join(f"UDP {port} → {link.remote[0]}:{link.remote[1]}" for (_, port), link in ends if link.remote)
    return f"simulated PX4 on {ports}; {vision} vision; ends on ^C"


def _remote(text: str) -> tuple[str, int]:
    address = _parsed(text)
    if isinstance(address, Path):
        raise BadInputError(f"'{text}': MAVLink goes to a UDP port, 127.0.0.1:PORT")
    return address


def _target(text: str) -> Outbox:
    address = _parsed(text)
    sender = socket.socket(socket.AF_UNIX if isinstance(address, Path) else socket.AF_INET, socket.SOCK_DGRAM)
    return Outbox(sender, 0, str(address) if isinstance(address, Path) else address)


def _parsed(text: str) -> Path | tuple[str, int]:
    try:
        return parse_address(text)
    except ValueError as error:
        raise BadInputError(str(error)) from None
