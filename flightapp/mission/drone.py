"""The facade that missions call."""

from collections.abc import Sequence

import numpy as np

from flightapp.behaviors.base import Behavior, Context, Coordinator, Result
from flightapp.behaviors.motion import Follow, Goto, Hover, Swaying
from flightapp.behaviors.race import Race
from flightapp.behaviors.vertical import Land, Takeoff
from flightapp.frames import Vector
from flightapp.planning.sway import Sway, Tones
from flightapp.track import Track


class BehaviorFailedError(Exception):
    """A behavior ended without achieving its goal; `result` says how. A mission may catch it and go on."""

    def __init__(self, name: str, result: Result) -> None:
        super().__init__(f"{name}: {result.outcome}: {result.reason}")
        self.result = result


class Drone:
    """What a mission can have the drone do. Each call returns when it is done, or raises `BehaviorFailedError`."""

    def __init__(self, context: Context, coordinator: Coordinator) -> None:
        self._context = context
        self._coordinator = coordinator

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

    async def takeoff(self, height: float | None = None) -> Result:
        """Arm and climb to ``height`` m (default: mission.takeoff_height), then hover under our command."""
        return await self._run(Takeoff(self._context, height or self._context.config.mission.takeoff_height))

    async def hover(self, seconds: float) -> Result:
        """Stay for ``seconds``."""
        return await self._run(Hover(self._context, seconds))

    async def goto(self, x: float, y: float, z: float) -> Result:
        """Fly to a point (m, world) and rest there."""
        return await self._run(Goto(self._context, np.array((x, y, z)), self._context.config.race.timeout))

    async def follow(self, waypoints: Sequence[Sequence[float]] | Vector | None = None) -> Result:
        """Fly through ``waypoints`` (n, 3) to the last; default: the track's own, then its finish."""
        if waypoints is None:
            waypoints = [*self.track.waypoints, *([self.track.finish] if self.track.finish else [])]
        points = np.array(waypoints, float)
        return await self._run(Follow(self._context, points, self._context.config.race.timeout))

    async def sway(
        self, seconds: float, ahead: Tones = (), left: Tones = (), up: Tones = (), turn: Tones = ()
    ) -> Result:
        """Sway on the spot: tones of (m, or rad of the heading; Hz), smaller where a limit asks for it."""
        return await self._run(Swaying(self._context, Sway(seconds, ahead, left, up, turn)))

    async def race(self, laps: int | None = None) -> Result:
        """Fly through the track's gates in order, then to the finish (default: where the race starts)."""
        finish = self.track.finish
        start = self.position
        if finish is not None:
            end = np.array(finish)
        elif start is not None:
            end = start
        else:
            end = np.array(self.track.start.position)
        return await self._run(Race(self._context, laps or self._context.config.mission.laps, end))

    async def land(self) -> Result:
        """Land here and disarm."""
        return await self._run(Land(self._context))

    async def _run(self, behavior: Behavior) -> Result:
        result = await self._coordinator.run(behavior)
        if not result.achieved:
            raise BehaviorFailedError(behavior.name, result)
        return result
