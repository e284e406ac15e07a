"""The simulated world on the wall clock: what moves it, films it and tracks it."""

import asyncio
import difflib
import math
from collections.abc import Callable, Coroutine, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

import numpy as np

from flightapp.config import Config
from flightapp.frames import Vector
from flightapp.inputs import BadInputError
from flightapp.messages import Frame, PoseSample
from flightapp.timing import Ticker
from flightapp.track import Track
from sim.mavlink.endpoint import Link, MavlinkEndpoint
from sim.px4.parameters import Parameters
from sim.rig import SimCamera, SimTracker, exercise, number
from sim.world import World

ADVANCE_RATE = 250.0
"""Hz, at least so often the world is brought to the present."""
VISION_PERIOD = 0.025
"""s between poses from a tracker on the vehicle to its own autopilot."""


class Glimpse:
    """The true motion around one exposure, which another thread may look at while the world moves on."""

    def __init__(self, world: World, stamp: float, exposure: float, step: float = 0.001) -> None:
        count = max(math.ceil(exposure / step), 1)
        self._first, self._step = stamp - 0.5 * exposure, exposure / count
        self._rows = [world.pose_at(self._first + k * self._step) for k in range(count + 1)]

    def pose_at(self, stamp: float) -> tuple[Vector, Vector]:
        """True position (3,) m and orientation q_wb (4,) at a ``stamp`` within the exposure, interpolated."""
        place = min(max((stamp - self._first) / self._step, 0.0), len(self._rows) - 1.0)
        i = min(int(place), len(self._rows) - 2)
        (p, q), (p_next, q_next) = self._rows[i], self._rows[i + 1]
        share = place - i
        turned = q + share * (q_next - q)
        return p + share * (p_next - p), turned / np.linalg.norm(turned)


class LiveWorld:
    """A world, and the sensors on its vehicle, in the running loop's time; the same for the same ``seed``."""

    def __init__(self, config: Config, track: Track, seed: int) -> None:
        loop = asyncio.get_running_loop()
        exercise(config, track)
        world_seed, camera_seed, tracker_seed, _, link_seed = np.random.SeedSequence(seed).spawn(5)
        self._config = config
        self._link_seed = number(link_seed)
        self._fed = -math.inf
        self.world = World(config, track, world_seed, loop.time)
        self.px4 = self.world.px4
        self._camera = SimCamera(config, track, number(camera_seed), self.world)
        self._tracker = SimTracker(config, number(tracker_seed), self.world)

    def endpoint(self, links: Sequence[Link], parameters: Sequence[str] = ()) -> MavlinkEndpoint:
        """The vehicle's autopilot behind MAVLink on ``links``, with the configured faults; not yet started.

        ``parameters`` are "NAME=VALUE" over PX4's own. Raises `BadInputError`.
        """
        endpoint = MavlinkEndpoint(self.px4, asyncio.get_running_loop().time, links, self._link_seed)
        for text in parameters:
            set_parameter(self.px4.parameters, text)
        for stamp, name, value in self._config.sim.faults:
            endpoint.faults.schedule(stamp, name, value)
        return endpoint

    async def advance(self) -> None:
        """Keep the world in the present, for ever."""
        ticker = Ticker(ADVANCE_RATE)
        while True:
            await ticker.tick()
            self.world.advance()

    async def track(self, send: Callable[[PoseSample], None]) -> None:
        """Give each pose that the tracker measures to ``send`` when it would arrive, for ever."""
        async for sample in self._tracker.poses():
            send(sample)

    async def film(self, show: Callable[[Frame], None]) -> None:
        """Give each frame of the camera to ``show`` when it would arrive, for ever; what comes too late is skipped.

        Images are rendered in a thread of their own, so that the world need not wait.
        """
        loop, camera = asyncio.get_running_loop(), self._config.camera
        origin, sequence = loop.time() + camera.exposure + abs(self._camera.after), 0
        with ThreadPoolExecutor(1, thread_name_prefix="camera") as thread:
            while True:
                stamp = origin + sequence / camera.rate
                exposed = stamp + self._camera.after
                await _until(exposed + 0.5 * camera.exposure)
                self.world.advance()
                seen = Glimpse(self.world, exposed, camera.exposure)
                expose = partial(self._camera.expose, stamp, sequence, seen.pose_at)
                frame = await loop.run_in_executor(thread, expose)
                await _until(stamp + camera.latency)
                show(frame)
                sequence = max(sequence + 1, int((loop.time() - origin) * camera.rate))

    def feed(self, sample: PoseSample) -> None:
        """Give a pose of the tracker to the vehicle's own autopilot, as if it was wired to it, at its usual rate."""
        if sample.stamp - self._fed >= VISION_PERIOD - 1e-6:
            self._fed = sample.stamp
            self.px4.external_vision(sample.stamp, sample.position, sample.orientation, sample.velocity, 0)


def set_parameter(parameters: Parameters, text: str) -> None:
    """Set what ``text``, "NAME=VALUE", says; raises `BadInputError`."""
    name, separator, value = (part.strip() for part in text.partition("="))
    if not separator:
        raise BadInputError(f"parameter '{text}': expected NAME=VALUE")
    if name not in parameters:
        close = difflib.get_close_matches(name, parameters, n=1)
        raise BadInputError(f"there is no parameter {name}" + (f"; did you mean {close[0]}?" if close else ""))
    kind = type(parameters[name])
    try:
        if not math.isfinite(wanted := kind(value)):
            raise ValueError
        parameters.set(name, wanted)
    except ValueError:
        form = "a whole number" if kind is int else "a number"
        raise BadInputError(f"parameter {name} is {form}, not '{value}'") from None


async def run_until(stop: asyncio.Event, *work: Coroutine[Any, Any, None]) -> None:
    """Run ``work``, which never ends by itself, until ``stop`` is set; raises what one of them raises."""
    tasks = [asyncio.create_task(coroutine) for coroutine in (stop.wait(), *work)]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
    for task in done:
        task.result()


async def _until(stamp: float) -> None:
    """Sleep to the loop's time ``stamp``; at least let others run."""
    await asyncio.sleep(max(stamp - asyncio.get_running_loop().time(), 0.0))
