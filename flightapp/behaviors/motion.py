"""Flying along a line: hover, go to a point, follow waypoints."""

import asyncio
import itertools

import numpy as np

from flightapp.behaviors.base import Behavior, Context, Result
from flightapp.channel import Reader
from flightapp.frames import Vector
from flightapp.messages import Outcome
from flightapp.planning.goal import Goal

ARRIVED = 0.5
"""m from the end of the line within which a flight along it has arrived."""

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
