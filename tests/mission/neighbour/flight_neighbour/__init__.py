"""A planner that takes its time, and a behavior that flies a circle."""

from dataclasses import replace

import numpy as np
from pydantic import Field

from flightapp.behaviors.base import Parameters
from flightapp.behaviors.motion import Along
from flightapp.planning.polynomial import PolynomialPlanner


class GentlePlanner(PolynomialPlanner):
    """Half as fast as it may."""

    def through(self, waypoints, request):
        limits = replace(request.limits, v_max=0.5 * request.limits.v_max)
        return super().through(waypoints, replace(request, limits=limits))


class CircleParameters(Parameters):
    """How wide."""

    radius: float = Field(1.0, gt=0.1, le=10.0, description="m")


class Circle(Along[CircleParameters]):
    """Fly a circle about the place where it begins, and come to rest there again."""

    name = "circle"
    accepts = CircleParameters

    def points(self):
        state = self.context.bus.state.latest
        middle = np.zeros(3) if state is None else state.position
        angles = np.linspace(0.0, 2.0 * np.pi, 9)[1:]
        around = np.stack([np.cos(angles), np.sin(angles), np.zeros(8)], axis=1)
        return np.vstack([middle + self.parameters.radius * around, middle])
