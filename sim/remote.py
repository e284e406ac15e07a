"""The application's side of a simulated world in a process of its own, and the rig that flies it over MAVLink."""

import asyncio
import os
import socket
import subprocess
import sys
import tempfile
from collections.abc import AsyncIterator, Callable
from contextlib import ExitStack, suppress
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from flightapp.autopilot.connection import parse_connection
from flightapp.autopilot.link import Px4Link
from flightapp.channel import Topic
from flightapp.computer import OwnComputer
from flightapp.config import Config
from flightapp.inputs import BadInputError
from flightapp.interfaces import Autopilot, Computer, FrameSource, GroundTruthFeed, PoseSource, Worker
from flightapp.messages import Collision, CommandArrivals, Frame, GatePassage, GroundTruth
from flightapp.perception.camera import CameraModel
from flightapp.sensors.intake import PoseIntake
from flightapp.sensors.poses import SocketPoses
from flightapp.timing import monotonic_origin
from flightapp.track import Track
from flightapp.worker import ThreadWorker
from sim.clock import RealtimeLoop
from sim.orders import Answer, Ask, Lines, Order, WorldState
from sim.ring import FrameRing
from sim.survey import survey, true_gates
from sim.wire import NO_IMAGE, NOTICE_SIZE, Notice, unpack_notice, unpack_truth

START_TIMEOUT = 180.0
"""s; the first start on a computer compiles."""
ANSWER_TIMEOUT = 5.0
END_TIMEOUT = 3.0


class WorldEndedError(Exception):
    """The simulated world's process has ended by itself; the text is the last that it said."""


class RemoteWorld:
    """A simulated world in a process of its own; returns from the constructor once that serves.

    It ends when `close` is called or this process ends, whatever ends it (the thread that makes this object must
    outlive it). Raises `BadInputError` where the order can't be carried out, else `WorldEndedError` where it fails.
    """

    def __init__(self, order: Order) -> None:
        camera = order.config.camera
        self.ring = FrameRing.make(camera.width, camera.height)
        mine, theirs = zip(*(_pair(kind) for kind in _KINDS), strict=True)
        control, self.poses, self.frames, self.truth = mine
        self._control: Connection[Any, Answer] = Connection(control.detach())
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115 - open as long as the process runs
        control_end, poses_end, frames_end, truth_end = (end.fileno() for end in theirs)
        lines = Lines(control_end, poses_end, frames_end, truth_end, self.ring.descriptor)
        self._process = subprocess.Popen(
            [sys.executable, "-m", "sim.process", str(os.getpid()), *map(str, lines.descriptors())],
            stdin=subprocess.DEVNULL,
            stderr=self._errors,
            pass_fds=lines.descriptors(),
            # The terminal's ^C is for the application, which lands first.
            process_group=0,
        )
        for end in theirs:
            end.close()
        with ExitStack() as failed:
            failed.callback(self.close)
            self._control.send(order)
            self._receive(START_TIMEOUT)
            failed.pop_all()

    @property
    def process_id(self) -> int:
        """Of the world's process."""
        return self._process.pid

    def failure(self) -> str | None:
        """The last line that the world's process said if it has ended by itself; None while it runs."""
        return self._last_words() if self._process.poll() is not None else None

    def state(self) -> WorldState:
        """How things really are: for tests and reports, not for flight code."""
        state: WorldState = self._request(Ask.STATE)
        return state

    def statistics(self) -> Any:
        """What the MAVLink peer has seen, as `sim.mavlink.watch` counts it."""
        return self._request(Ask.STATISTICS)

    def fault(self, name: str, value: Any = None) -> None:
        """Inject a fault of `sim.mavlink.faults`; raises `BadInputError` for one that isn't known."""
        self._request(Ask.FAULT, (name, value))

    def close(self) -> None:
        """End the world, and give everything back."""
        with suppress(OSError):
            self._control.send((Ask.STOP, None))
        try:
            self._process.wait(END_TIMEOUT)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._control.close()
        for end in (self.frames, self.truth):
            end.close()
        self._errors.close()
        self.ring.close()

    def _request(self, ask: Ask, argument: Any = None) -> Any:
        """The answer; waits for it, usually less than a millisecond."""
        try:
            self._control.send((ask, argument))
        except OSError:
            raise WorldEndedError(self._last_words()) from None
        return self._receive(ANSWER_TIMEOUT)

    def _receive(self, timeout: float) -> Any:
        try:
            if not self._control.poll(timeout):
                raise WorldEndedError(f"no answer from the simulated world within {timeout:g} s")
            answer = self._control.recv()
        except (EOFError, ConnectionError):
            self._process.wait(END_TIMEOUT)
            raise WorldEndedError(self._last_words()) from None
        if answer.refusal:
            raise BadInputError(answer.refusal)
        return answer.content

    def _last_words(self) -> str:
        self._errors.seek(0)
        said = self._errors.read().decode(errors="replace").strip().splitlines()
        code = self._process.poll()
        return f"the simulated world has ended (exit status {code}): {said[-1] if said else 'without a word'}"


_KINDS = (socket.SOCK_STREAM, socket.SOCK_DGRAM, socket.SOCK_DGRAM, socket.SOCK_DGRAM)
"""Of the lines for control, poses, frames and truth."""


def _pair(kind: socket.SocketKind) -> tuple[socket.socket, socket.socket]:
    return socket.socketpair(socket.AF_UNIX, kind)


class RemoteCamera:
    """The simulated camera's frames, the newest each time."""

    WATCH = 0.5
    """s between looks at whether the world still runs, while no frame comes."""

    def __init__(self, config: Config, world: RemoteWorld) -> None:
        self._model = config.camera.model()
        self._world = world
        self._newest: Notice | None = None
        self._arrived = asyncio.Event()
        world.frames.setblocking(False)

    @property
    def model(self) -> CameraModel:
        """The calibration, of which `sim.calibration` says what is left wrong with it."""
        return self._model

    async def frames(self) -> AsyncIterator[Frame]:
        """Frames as they arrive; raises `WorldEndedError` when none will come any more. For one consumer."""
        loop = asyncio.get_running_loop()
        loop.add_reader(self._world.frames, self._take)
        try:
            while True:
                notice = await self._next()
                image = None
                if notice.slot != NO_IMAGE:
                    image = self._world.ring.read(notice.slot, notice.sequence)
                    if image is None:  # overtaken
                        continue
                yield Frame(notice.stamp, notice.sequence, image, notice.markers)
        finally:
            loop.remove_reader(self._world.frames)

    async def _next(self) -> Notice:
        while self._newest is None:
            self._arrived.clear()
            try:
                async with asyncio.timeout(self.WATCH):
                    await self._arrived.wait()
            except TimeoutError:
                if (words := self._world.failure()) is not None:
                    raise WorldEndedError(words) from None
        notice, self._newest = self._newest, None
        return notice

    def _take(self) -> None:
        for datagram in drain(self._world.frames):
            self._newest = unpack_notice(datagram)
            self._arrived.set()


def drain(receiver: socket.socket) -> list[bytes]:
    """All datagrams that wait in a non-blocking socket."""
    taken = []
    with suppress(OSError):  # empty
        while True:
            taken.append(receiver.recv(NOTICE_SIZE))
    return taken


class RemoteTruth:
    """Publishes the truth as it arrives, for the log."""

    def __init__(self, world: RemoteWorld) -> None:
        self.feed = GroundTruthFeed(
            Topic("truth"), Topic("passage"), Topic("collision"), Topic("true_gates"), Topic("arrivals")
        )
        self._receiver = world.truth
        self._receiver.setblocking(False)
        self._topics: dict[type, Topic[Any]] = {
            GroundTruth: self.feed.motion,
            GatePassage: self.feed.passages,
            Collision: self.feed.collisions,
            CommandArrivals: self.feed.arrivals,
        }
        asyncio.get_running_loop().add_reader(self._receiver, self._take)

    def close(self) -> None:
        """Publish what has arrived, and stop."""
        self._take()
        asyncio.get_running_loop().remove_reader(self._receiver)

    def _take(self) -> None:
        for datagram in drain(self._receiver):
            for message in unpack_truth(datagram):
                self._topics[type(message)].publish(message)


class MavlinkRig:
    """A simulated drone behind MAVLink, in a world of its own process, the same for the same ``seed``.

    The link listens where ``config.link.connection`` says, which must be a UDP port of this computer.
    """

    def __init__(self, config: Config, track: Track, seed: int) -> None:
        remote = _remote(config)
        self._survey_seed, self._exact = np.random.SeedSequence(seed).spawn(4)[3], config.sim.survey == "exact"
        self._gates = true_gates(track)
        origin = monotonic_origin(asyncio.get_running_loop())
        self.world = RemoteWorld(Order(config, track, seed, origin, remote))
        with ExitStack() as failed:
            failed.callback(self.world.close)
            self.autopilot: Autopilot = Px4Link(config)
            failed.pop_all()
        self._truth = RemoteTruth(self.world)
        self._poses = SocketPoses(self.world.poses, PoseIntake.of_body(config))
        self.camera: FrameSource = RemoteCamera(config, self.world)
        self.tracker: PoseSource = self._poses
        self.worker: Worker = ThreadWorker()
        self.computer: Computer = OwnComputer()
        self.truth: GroundTruthFeed | None = self._truth.feed

    @staticmethod
    def loop_factory(realtime: bool) -> Callable[[], asyncio.AbstractEventLoop]:
        """The event loop to fly in: always on the wall clock."""
        return RealtimeLoop

    def survey(self, track: Track) -> Track:
        """``track`` as it is known before the flight."""
        self._truth.feed.gates.publish(self._gates)
        return survey(track, np.random.default_rng(self._survey_seed), self._exact)

    async def close(self) -> None:
        """End the world, and give back the lines to it."""
        self._truth.close()
        self._poses.close()
        self.world.close()


def _remote(config: Config) -> tuple[str, int]:
    """Where the simulated vehicle must send to; raises `BadInputError`."""
    connection = parse_connection(config.link.connection)
    host, _, _ = connection.url.removeprefix("udpin://").partition(":")
    if connection.device is not None or host not in ("127.0.0.1", "0.0.0.0"):
        raise BadInputError(
            f"link.connection = '{connection.url}': the simulated vehicle is on this computer; give udpin://127.0.0.1:PORT"
        )
    return "127.0.0.1", connection.number
