"""Flying along a line: hover, go to a point, follow waypoints."""

import asyncio
import itertools
from abc import abstractmethod
from typing import TypeVar

import numpy as np
from pydantic import Field

from flightapp.behaviors.base import Behavior, Context, Parameters, Result
from flightapp.channel import Reader
from flightapp.config.fields import Finite, Triple
from flightapp.frames import Vector
from flightapp.messages import Outcome
from flightapp.planning.goal import Goal
from flightapp.trajectory import Trajectory

ARRIVED = 0.5
"""m from the end of the line within which a flight along it has arrived."""
PATIENCE = 5.0
"""s after the line's end in which the vehicle may still get there."""
STRAYED = 0.75
"""Of `safety.tracking_error`: further off its line a behavior is off its course."""
SETPOINT_AGE = 0.1
"""s, a setpoint older than this is not being followed."""

_serials = itertools.count(1)


def new_serial() -> int:
    """A number that no other goal of this process has."""
    return next(_serials)


P = TypeVar("P", bound=Parameters)


class Flying(Behavior[P]):
    """What all behaviors share that fly along a line of ours."""

    def off_course(self) -> str:
        """That the vehicle is too far off the line."""
        context = self.context
        state, setpoint = context.bus.state.latest, context.bus.setpoint.latest
        if state is None or setpoint is None or context.now() - setpoint.stamp > SETPOINT_AGE:
            return ""
        off = float(np.linalg.norm(setpoint.position - state.position))
        most = STRAYED * context.config.safety.tracking_error
        return f"{off:.2f} m off the line, at most {most:g} m" if off > most else ""


class HoverParameters(Parameters):
    """For how long."""

    seconds: Finite = Field(gt=0.0, le=3600.0, description="s")


class Hover(Flying[HoverParameters]):
    """Stay where the line ends."""

    name = "hover"
    accepts = HoverParameters
    priority = 40

    def __init__(self, context: Context, **parameters: object) -> None:
        super().__init__(context, **parameters)
        self._left = self.parameters.seconds

    @property
    def timeout(self) -> float:
        """A second more than it takes."""
        return self.parameters.seconds + 1.0 if self.parameters.timeout is None else self.parameters.timeout

    @property
    def progress(self) -> float:
        """Of the time."""
        return 1.0 - self._left / self.parameters.seconds

    async def run(self) -> Result:
        """Wait."""
        end = self.context.now() + self._left
        while (left := end - self.context.now()) > 0.0:
            self._left = left
            await asyncio.sleep(min(left, 0.1))
        return Result(Outcome.GOAL_ACHIEVED, f"hovered for {self.parameters.seconds:g} s")


class Along(Flying[P]):
    """Fly through points to the last one and rest there."""

    def __init__(self, context: Context, **parameters: object) -> None:
        super().__init__(context, **parameters)
        self._begun = False
        self._flown: Trajectory | None = None

    @abstractmethod
    def points(self) -> Vector:
        """(n, 3) m, world, what is to be flown through."""

    @property
    def destination(self) -> Vector:
        """The last point."""
        end: Vector = self.points()[-1]
        return end

    @property
    def progress(self) -> float:
        """Of the line's time."""
        if self._flown is None:
            return 0.0
        return (self.context.now() - self._flown.stamp) / max(self._flown.duration, 1e-3)

    async def run(self) -> Result:
        """Publish the goal, and wait until the line's end is reached."""
        bus, line = self.context.bus, self.context.line
        waypoints = self._ahead() if self._begun else self.points()
        self._begun = True
        end, before, refused = waypoints[-1], line.latest, bus.plan.count
        bus.goal.publish(Goal(end, self.context.limits, waypoints=waypoints, serial=new_serial()))
        state = Reader(bus.state)
        while True:
            latest = await state.newest()
            if line.latest is before:
                if bus.plan.count > refused and (report := bus.plan.latest) is not None and not report.accepted:
                    return Result(Outcome.PROCESS_FAILURE, f"no plan: {report.reason}")
                continue
            self._flown = line.latest
            if line.latest is not None and latest.stamp > line.latest.end_stamp:
                miss = float(np.linalg.norm(latest.position - end))
                if miss < ARRIVED:
                    return Result(Outcome.GOAL_ACHIEVED, f"arrived, {miss:.2f} m from the end")
                if latest.stamp > line.latest.end_stamp + PATIENCE:
                    return Result(Outcome.WRONG_PROGRESS, f"ended {miss:.2f} m from the end of the line")

    def _ahead(self) -> Vector:
        """The waypoints after the leg that the vehicle is nearest to, where the work begins again."""
        points, state = self.points(), self.context.bus.state.latest
        if len(points) < 2 or state is None:
            return points
        legs = np.diff(points, axis=0)
        along = np.einsum("ij,ij->i", state.position - points[:-1], legs) / np.maximum((legs * legs).sum(axis=1), 1e-9)
        feet = points[:-1] + np.clip(along, 0.0, 1.0)[:, None] * legs
        nearest = int(np.linalg.norm(feet - state.position, axis=1).argmin())
        return points if nearest == 0 and along[0] <= 0.0 else points[nearest + 1 :]


class FollowParameters(Parameters):
    """Through what."""

    waypoints: tuple[Triple, ...] = Field(min_length=1, max_length=10_000, description="m, world")


class Follow(Along[FollowParameters]):
    """Fly through waypoints to the last one and rest there."""

    name = "follow"
    accepts = FollowParameters

    def points(self) -> Vector:
        """(n, 3) m, the waypoints."""
        return np.array(self.parameters.waypoints, float)


class GotoParameters(Parameters):
    """Where to."""

    point: Triple = Field(description="m, world")


class Goto(Along[GotoParameters]):
    """Fly to a point and rest there."""

    name = "goto"
    accepts = GotoParameters

    def points(self) -> Vector:
        """(1, 3) m, the point."""
        return np.array([self.parameters.point], float)
