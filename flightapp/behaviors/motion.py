"""Flying along a line: hover, go to a point, follow waypoints, sway on the spot."""

import asyncio
import itertools

import numpy as np

from flightapp.behaviors.base import Behavior, Context, Result
from flightapp.channel import Reader
from flightapp.frames import Vector
from flightapp.messages import Outcome
from flightapp.planning.goal import Goal
from flightapp.planning.sway import Sway, sway, within

ARRIVED = 0.5
"""m from the end of the line within which a flight along it has arrived."""

SETTLING = 10.0
"""s, longest wait for rest before swaying."""
WATCH_INTERVAL = 0.02
"""s between looks at the line."""

_serials = itertools.count(1)


def new_serial() -> int:
    """A number that no other goal of this process has."""
    return next(_serials)


class Hover(Behavior):
    """Stay where the line ends."""

    name = "hover"

    def __init__(self, context: Context, seconds: float) -> None:
        super().__init__(context, seconds + 1.0)
        self._seconds = seconds

    async def run(self) -> Result:
        """Wait."""
        await asyncio.sleep(self._seconds)
        return Result(Outcome.GOAL_ACHIEVED, f"hovered for {self._seconds:g} s")


class Follow(Behavior):
    """Fly through waypoints to the last one."""

    name = "follow"

    def __init__(self, context: Context, waypoints: Vector, timeout: float) -> None:
        super().__init__(context, timeout)
        self._waypoints = np.asarray(waypoints, float).reshape(-1, 3)

    async def run(self) -> Result:
        """Publish the goal, and wait until the line's end is reached."""
        bus, line = self.context.bus, self.context.line
        end = self._waypoints[-1]
        before = line.latest
        refused = bus.plan.count
        bus.goal.publish(Goal(end, self.context.limits, waypoints=self._waypoints, serial=new_serial()))
        state = Reader(bus.state)
        while True:
            latest = await state.newest()
            if line.latest is before:
                if bus.plan.count > refused and (report := bus.plan.latest) is not None and not report.accepted:
                    return Result(Outcome.PROCESS_FAILURE, f"no plan: {report.reason}")
                continue
            if line.latest is not None and latest.stamp > line.latest.end_stamp:
                miss = float(np.linalg.norm(latest.position - end))
                if miss < ARRIVED:
                    return Result(Outcome.GOAL_ACHIEVED, f"arrived, {miss:.2f} m from the end")
                if latest.stamp > line.latest.end_stamp + 5.0:
                    return Result(Outcome.WRONG_PROGRESS, f"ended {miss:.2f} m from the end of the line")


class Goto(Follow):
    """Fly to a point and rest there."""

    name = "goto"

    def __init__(self, context: Context, point: Vector, timeout: float) -> None:
        super().__init__(context, np.asarray(point, float).reshape(1, 3), timeout)


class Swaying(Behavior):
    """Sway about where the line ends, no more than the vehicle's limits allow."""

    name = "sway"

    def __init__(self, context: Context, way: Sway) -> None:
        super().__init__(context, way.seconds + SETTLING)
        config = context.config
        share = config.planning.thrust_share * config.vehicle.thrust_max
        self._way = within(way, context.limits, share, config.planning.rate_share * config.vehicle.rate_max)

    async def run(self) -> Result:
        """Come to rest, then sway to the end."""
        context, line = self.context, self.context.line
        while not line.at_rest(context.now()):
            if line.latest is None:
                return Result(Outcome.PROCESS_FAILURE, "the line was given up")
            await asyncio.sleep(WATCH_INTERVAL)
        now = context.now()
        here = line.motion(now)
        swaying = sway(now, here.position, here.yaw, self._way)
        line.accept(swaying)
        context.bus.trajectory.publish(swaying)
        while not line.at_rest(context.now()):
            if line.latest is None:
                return Result(Outcome.PROCESS_FAILURE, "the line was given up")
            await asyncio.sleep(WATCH_INTERVAL)
        return Result(Outcome.GOAL_ACHIEVED, f"swayed for {self._way.seconds:g} s")
