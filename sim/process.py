"""The simulated world as a process of its own, which an application flies over MAVLink.

The application can so be measured, stalled and killed as seen from the other end of the link, and simulating costs its
event loop nothing. Poses, frames and truth leave as datagrams that are lost rather than waited for; requests come in
over a pipe. The process ends when its pipe is closed or its parent is gone, and leaves nothing behind: sockets and
memory have no names. Run by `sim.remote`, never by hand.
"""

import asyncio
import ctypes
import gc
import os
import signal
import socket
import sys
from collections.abc import Collection
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any

from flightapp.inputs import BadInputError
from flightapp.messages import Collision, CommandArrivals, Frame, GatePassage, GroundTruth, PoseSample
from flightapp.sensors.poses import encode_pose
from sim.clock import RealtimeLoop
from sim.live import LiveWorld, run_until
from sim.mavlink.endpoint import Link, MavlinkEndpoint
from sim.mavlink.watch import Watch
from sim.orders import Answer, Ask, Lines, Order, WorldState
from sim.outbox import Outbox
from sim.ring import FrameRing
from sim.wire import NO_IMAGE, Notice, pack_arrivals, pack_motions, pack_notice, pack_verdict

PR_SET_PDEATHSIG = 1
SWITCH_INTERVAL = 2e-4
"""s that the camera's thread may keep the interpreter from the world."""
BATCH = 10
"""True motions in one datagram: the application wakes less often."""
REPORT_PERIOD = 0.2
"""s between reports of when commands arrived."""
TRUTH_DEPTH = 4096
"""Datagrams of truth kept while the application is busy; the log shall miss none."""


class WorldProcess:
    """The child's side of the lines: the world's sensors out, requests in."""

    def __init__(self, order: Order, lines: Lines, control: "Connection[Answer, tuple[Ask, Any]]") -> None:
        camera = order.config.camera
        self._order = order
        self._control = control
        self._live = LiveWorld(order.config, order.track, order.seed)
        self._ring = FrameRing(lines.memory, camera.width, camera.height)
        self._poses, self._frames = Outbox(_socket(lines.poses), 0), Outbox(_socket(lines.frames), 0)
        self._truth = Outbox(_socket(lines.truth), TRUTH_DEPTH)
        self._motions: list[GroundTruth] = []
        self._verdicts: list[GatePassage | Collision] = []
        self._stop = asyncio.Event()
        feed = self._live.world.truth
        feed.motion.tap(self._on_motion)
        feed.passages.tap(self._on_verdict)
        feed.collisions.tap(self._on_verdict)

    async def serve(self) -> None:
        """Simulate until told to stop; raises `BadInputError` where the link can't be opened."""
        loop, live = asyncio.get_running_loop(), self._live
        endpoint = live.endpoint([Link(0, self._order.remote)])
        await endpoint.start()
        loop.add_reader(self._control.fileno(), self._on_request, endpoint)
        try:
            gc.collect()
            gc.freeze()
            self._control.send(Answer())
            await run_until(
                self._stop,
                live.advance(),
                live.track(self._on_pose),
                live.film(self._on_frame),
                self._report_arrivals(endpoint.watch),
            )
        finally:
            loop.remove_reader(self._control.fileno())
            await endpoint.close()
            self._ring.close()

    async def _report_arrivals(self, watch: Watch) -> None:
        """Tell the log when commands arrived, for ever."""
        told = 0
        while True:
            await asyncio.sleep(REPORT_PERIOD)
            stamps = watch.since(told) - self._order.origin
            told = watch.count
            if len(stamps):
                self._truth.send(pack_arrivals(CommandArrivals(float(stamps[-1]), stamps)))

    def _on_pose(self, sample: PoseSample) -> None:
        self._poses.send(encode_pose(sample, self._order.origin))

    def _on_frame(self, frame: Frame) -> None:
        slot = NO_IMAGE if frame.image is None else self._ring.write(frame.sequence, frame.image)
        self._frames.send(pack_notice(Notice(frame.stamp, frame.sequence, slot, frame.markers)))

    def _on_motion(self, truth: GroundTruth) -> None:
        self._motions.append(truth)
        if len(self._motions) >= BATCH:
            self._truth.send(pack_motions(self._motions))
            self._motions.clear()

    def _on_verdict(self, verdict: GatePassage | Collision) -> None:
        self._verdicts.append(verdict)
        self._truth.send(pack_verdict(verdict))

    def _on_request(self, endpoint: MavlinkEndpoint) -> None:
        try:
            ask, argument = self._control.recv()
        except (EOFError, ConnectionError):  # the application is gone
            self._stop.set()
            return
        try:
            answer = Answer(self._answer(endpoint, ask, argument))
        except BadInputError as error:
            answer = Answer(refusal=str(error))
        self._control.send(answer)

    def _answer(self, endpoint: MavlinkEndpoint, ask: Ask, argument: Any) -> Any:
        if ask is Ask.STATE:
            return self._state()
        if ask is Ask.STATISTICS:
            return endpoint.watch.statistics()
        if ask is Ask.FAULT:
            endpoint.faults.apply(*argument)
        elif ask is Ask.STOP:
            self._stop.set()
        return None

    def _state(self) -> WorldState:
        world = self._live.world
        world.advance()
        px4 = self._live.px4
        motion = world.state_at(world.plant.time)
        return WorldState(motion, px4.nav_state.name, px4.armed, px4.on_ground, tuple(self._verdicts))


def _socket(descriptor: int) -> socket.socket:
    return socket.socket(fileno=descriptor)


def _die_with(parent: int) -> None:
    """End when the process ``parent`` does, whatever this one is doing then."""
    if ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, signal.SIGKILL) != 0:
        raise OSError(ctypes.get_errno(), "prctl")
    if os.getppid() != parent:  # it was quicker
        sys.exit(1)


def _leave(cpus: Collection[int]) -> None:
    """Keep off the ``cpus`` that the application has taken for itself, where there are others."""
    if others := set(range(os.cpu_count() or 1)).difference(cpus):
        with suppress(OSError):  # none of the others is permitted
            os.sched_setaffinity(0, others)


def main() -> None:
    """Take the order from the parent and serve; the arguments are its process id and the `Lines`."""
    parent, *descriptors = map(int, sys.argv[1:])
    # The application decides when its world ends: it lands first, then closes the line.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    _die_with(parent)
    sys.setswitchinterval(SWITCH_INTERVAL)
    lines = Lines(*descriptors)
    control: Connection[Answer, Any] = Connection(lines.control)
    order: Order = control.recv()
    if order.config.realtime.cpus:
        _leave(order.config.realtime.cpus)

    async def serve() -> None:
        await WorldProcess(order, lines, control).serve()

    with asyncio.Runner(loop_factory=lambda: RealtimeLoop(order.origin)) as runner:
        try:
            runner.run(serve())
        except BadInputError as error:
            control.send(Answer(refusal=str(error)))


if __name__ == "__main__":
    main()
