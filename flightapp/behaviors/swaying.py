"""Swaying on the spot, which shows how the vehicle answers."""

import asyncio

from pydantic import Field

from flightapp.behaviors.base import Context, Parameters, Result
from flightapp.behaviors.motion import Flying
from flightapp.config.fields import Finite
from flightapp.messages import Outcome
from flightapp.planning.geofence import Geofence
from flightapp.planning.sway import RAMP_LEAST, Sway, sway, within
from flightapp.trajectory import Trajectory

SETTLING = 10.0
"""s, longest wait for rest before swaying."""
WATCH_INTERVAL = 0.02
"""s between looks at the line."""

Tones = tuple[tuple[Finite, Finite], ...]


class SwayingParameters(Parameters):
    """Tones of (m, or rad of the heading; Hz), smaller in flight where a limit asks for it."""

    seconds: Finite = Field(ge=2.0 * RAMP_LEAST, le=600.0, description="s")
    ahead: Tones = Field((), description="m and Hz, along the heading")
    left: Tones = Field((), description="m and Hz, to its left")
    up: Tones = Field((), description="m and Hz, upwards")
    turn: Tones = Field((), description="rad and Hz, of the heading")


class Swaying(Flying[SwayingParameters]):
    """Sway about where the line ends, no more than the vehicle's limits allow."""

    name = "sway"
    accepts = SwayingParameters

    def __init__(self, context: Context, **parameters: object) -> None:
        super().__init__(context, **parameters)
        asked, config = self.parameters, context.config
        way = Sway(asked.seconds, asked.ahead, asked.left, asked.up, asked.turn)
        share = config.planning.thrust_share * config.vehicle.thrust_max
        self._way = within(way, context.limits, share, config.planning.rate_share * config.vehicle.rate_max)
        self._flown: Trajectory | None = None

    @property
    def timeout(self) -> float:
        """What it takes, with the time to come to rest before."""
        return self._way.seconds + SETTLING if self.parameters.timeout is None else self.parameters.timeout

    @property
    def progress(self) -> float:
        """Of the time."""
        return 0.0 if self._flown is None else (self.context.now() - self._flown.stamp) / self._way.seconds

    async def run(self) -> Result:
        """Come to rest, then sway to the end."""
        context, line = self.context, self.context.line
        if not await self._rest():
            return Result(Outcome.PROCESS_FAILURE, "the line was given up")
        now = context.now()
        here = line.motion(now)
        swaying = sway(now, here.position, here.yaw, self._way)
        if out := Geofence.of(context.config.geofence).exit(swaying):
            return Result(Outcome.PROCESS_FAILURE, f"no room to sway: {out}")
        self._flown = swaying
        line.accept(self._flown)
        context.bus.trajectory.publish(self._flown)
        if not await self._rest():
            return Result(Outcome.PROCESS_FAILURE, "the line was given up")
        return Result(Outcome.GOAL_ACHIEVED, f"swayed for {self._way.seconds:g} s")

    async def _rest(self) -> bool:
        """Until the line is over; False where there is none any more."""
        context = self.context
        while not context.line.at_rest(context.now()):
            if context.line.latest is None:
                return False
            await asyncio.sleep(WATCH_INTERVAL)
        return True
