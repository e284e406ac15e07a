"""The facade that missions call."""

import asyncio
import contextlib
from collections.abc import AsyncIterator, Coroutine, Mapping, Sequence
from contextlib import AbstractAsyncContextManager
from typing import Any, Protocol

from flightapp.behaviors.base import Behavior, Context, Result
from flightapp.frames import Vector
from flightapp.messages import Frame, GateMap
from flightapp.modules import find
from flightapp.planning.sway import Tones
from flightapp.track import Track

Setting = bool | int | float | str


class BehaviorFailedError(Exception):
    """A behavior ended without achieving its goal; `result` says how. A mission may catch it and go on."""

    def __init__(self, name: str, result: Result) -> None:
        super().__init__(f"{name}: {result.outcome}: {result.reason}")
        self.result = result


class Activated(Protocol):
    """A behavior at work."""

    @property
    def done(self) -> bool:
        """Whether it has ended."""
        ...

    @property
    def progress(self) -> float:
        """How much of it is done, 0 to 1."""
        ...

    async def result(self) -> Result:
        """How it ended; waits for that."""
        ...

    async def stop(self, why: str) -> Result:
        """End it."""
        ...


class Activator(Protocol):
    """Who has behaviors do their work."""

    def activate(self, behavior: Behavior[Any]) -> AbstractAsyncContextManager[Activated | Result]:
        """``behavior`` at work within an ``async with``; a `Result` where it is refused."""
        ...


class Drone:
    """What a mission can have the drone do.

    Each call returns a `Result` when it is done. One that did not achieve its goal is raised as
    `BehaviorFailedError`, unless ``check`` is False: then the mission branches on it. Every call takes a ``timeout``
    in s. Cancelling one (as `asyncio.timeout` does) stops the vehicle along its line.
    """

    def __init__(self, context: Context, coordinator: Activator, parameters: Mapping[str, Setting]) -> None:
        self._context = context
        self._coordinator = coordinator
        self.parameters = parameters
        """The mission's own parameters: its PARAMETERS, as ``--set mission.parameters.NAME=VALUE`` changed them."""

    @property
    def track(self) -> Track:
        """The track as it is known before the flight."""
        return self._context.track

    @property
    def laps(self) -> int:
        """How many laps the configuration asks for (mission.laps)."""
        return self._context.config.mission.laps

    @property
    def position(self) -> Vector | None:
        """Estimated position (3,) m, world; None before the first estimate."""
        state = self._context.bus.state.latest
        return None if state is None else state.position.copy()

    @property
    def gate_map(self) -> GateMap | None:
        """What is known of the gates; None before the first estimate."""
        return self._context.bus.gate_map.latest

    @property
    def battery(self) -> float | None:
        """0..1, charge left; None before the autopilot has said so."""
        status = self._context.autopilot.status.latest
        return None if status is None else status.battery

    async def next_frame(self) -> Frame:
        """The next image of the camera."""
        return await self._context.bus.frame.next()

    async def takeoff(self, height: float | None = None, **options: Any) -> Result:
        """Arm and climb to ``height`` m (default: mission.takeoff_height), then hover under our command."""
        return await self.run("takeoff", height=height, **options)

    async def hover(self, seconds: float, **options: Any) -> Result:
        """Stay for ``seconds``."""
        return await self.run("hover", seconds=seconds, **options)

    async def goto(self, x: float, y: float, z: float, **options: Any) -> Result:
        """Fly to a point (m, world) and rest there."""
        return await self.run("goto", point=(x, y, z), **options)

    async def follow(self, waypoints: Sequence[Sequence[float]] | Vector | None = None, **options: Any) -> Result:
        """Fly through ``waypoints`` (n, 3) to the last; default: the track's own, then its finish."""
        if waypoints is None:
            waypoints = [*self.track.waypoints, *([self.track.finish] if self.track.finish else [])]
        points = tuple(tuple(float(value) for value in point) for point in waypoints)
        return await self.run("follow", waypoints=points, **options)

    async def sway(
        self, seconds: float, ahead: Tones = (), left: Tones = (), up: Tones = (), turn: Tones = (), **options: Any
    ) -> Result:
        """Sway on the spot: tones of (m, or rad of the heading; Hz), smaller where a limit asks for it."""
        tones = {"ahead": tuple(ahead), "left": tuple(left), "up": tuple(up), "turn": tuple(turn)}
        options |= {"seconds": seconds, **tones}
        return await self.run("sway", **options)

    async def search(self, gate_id: int, **options: Any) -> Result:
        """Look for a gate that is not known, all round and from further and further away."""
        return await self.run("search", gate_id=gate_id, **options)

    async def race(self, laps: int | None = None, **options: Any) -> Result:
        """Fly through the track's gates in order, then to the finish (default: where the race starts)."""
        return await self.run("race", laps=laps, **options)

    async def land(self, **options: Any) -> Result:
        """Land here and disarm."""
        return await self.run("land", **options)

    async def run(self, name: str, check: bool = True, **parameters: Any) -> Result:
        """Have the behavior ``name`` do its work: one of ours, or of another package's entry point."""
        async with self.activate(name, **parameters) as activation:
            result = activation if isinstance(activation, Result) else await activation.result()
        if check and not result.achieved:
            raise BehaviorFailedError(name, result)
        return result

    @contextlib.asynccontextmanager
    async def activate(self, name: str, **parameters: Any) -> AsyncIterator[Activated | Result]:
        """The behavior ``name`` at work within an ``async with``; it is stopped at the end, if it still is then.

        A `Result` instead says why it could not begin.
        """
        behavior: Behavior[Any] = find("behaviors", name)(self._context, **parameters)
        async with self._coordinator.activate(behavior) as activation:
            yield activation

    @contextlib.asynccontextmanager
    async def beside(self, check: Coroutine[Any, Any, None]) -> AsyncIterator[None]:
        """Run ``check`` beside what is in the ``async with``, which it ends by raising; it is cancelled at the end."""
        body = asyncio.current_task()
        assert body is not None
        failures: list[BaseException] = []

        def ended(task: "asyncio.Task[None]") -> None:
            if not task.cancelled() and (error := task.exception()) is not None:
                failures.append(error)
                body.cancel()

        checking = asyncio.create_task(check, name="check")
        checking.add_done_callback(ended)
        try:
            yield
        except asyncio.CancelledError:
            if not failures:
                raise
            body.uncancel()
            raise failures[0] from None
        finally:
            checking.remove_done_callback(ended)
            checking.cancel()
            await asyncio.gather(checking, return_exceptions=True)
