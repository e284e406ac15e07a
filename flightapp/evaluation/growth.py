"""How the time to plan grows with the number of points: the polynomial planner's and the race planner's, drawn."""

import math
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import plotly.graph_objects as go

from flightapp.config import Config
from flightapp.evaluation.figures import blank
from flightapp.evaluation.page import Heading, page_html
from flightapp.evaluation.tables import TextTable, number
from flightapp.frames import Vector
from flightapp.interfaces import Limits, Motion, Planner, PlanRequest
from flightapp.modules import find

COUNTS: Mapping[str, tuple[int, ...]] = {
    "polynomial": (6, 14, 26, 50, 100, 200, 400, 700, 1000),
    "race": (3, 6, 10, 14, 20, 26, 33, 40),
}
"""Points of the courses that each planner is timed on."""
REPEATS, PATIENCE = 20, 0.5
"""How often a plan is made, and s after which that ends."""
SPACING = 8.0
"""m of way between points."""
COLOURS = {"polynomial": "#1d4ed8", "race": "#d1495b"}


@dataclass(frozen=True, slots=True)
class Growth:
    """The times of one planner."""

    planner: str
    points: tuple[int, ...]
    seconds: tuple[float, ...]
    """Median of each."""

    @property
    def exponent(self) -> float:
        """Of the power of the number of points that fits the times best: 1 is linear growth."""
        slope, _ = np.polyfit(np.log(self.points), np.log(self.seconds), 1)
        return float(slope)


def wavy_course(points: int) -> tuple[PlanRequest, Vector]:
    """A closed course up and down through so many waypoints, and these without the last (points - 1, 3) m."""
    angle = np.linspace(0.0, 2.0 * math.pi, points + 1)[1:]
    radius = SPACING * points / (2.0 * math.pi)
    x, y, z = radius * np.sin(angle), radius * (1.0 - np.cos(angle)), 2.0 + np.sin(5.0 * angle)
    waypoints = np.column_stack((x, y, z))
    rest = np.zeros(3)
    start = Motion(np.array((0.0, 0.0, 2.0)), rest, rest, rest, 0.0, 0.0)
    return PlanRequest(0.0, start, (), waypoints[-1], Limits(5.0, 8.0, 3.0)), waypoints[:-1]


def measure_growth(counts: Mapping[str, tuple[int, ...]] = COUNTS) -> Iterator[Growth]:
    """Time each planner of ``counts`` on courses of so many points, from scratch."""
    for name, points in counts.items():
        planner: Planner = find("planners", name)(Config())
        _median(planner, points[0])
        yield Growth(name, points, tuple(_median(planner, count) for count in points))


def growth_page(measured: tuple[Growth, ...]) -> str:
    """A page with a figure and a table for each planner."""
    facts = [(f"exponent of the growth, {growth.planner}", number(growth.exponent, 2)) for growth in measured]
    heading = Heading("Planning time by number of points", "1 is linear growth", True, "medians, from scratch")
    figures = {growth.planner: _figure(growth) for growth in measured}
    return page_html(heading, facts, figures, growth_tables(measured))


def growth_tables(measured: tuple[Growth, ...]) -> tuple[TextTable, ...]:
    """The times and the times per point."""
    columns = ("points", "ms", "µs per point")
    tables = []
    for growth in measured:
        rows = [
            [str(count), number(taken, 3, 1e3), number(taken / count, 1, 1e6)]
            for count, taken in zip(growth.points, growth.seconds, strict=True)
        ]
        tables.append(TextTable(f"{growth.planner}: grows with power {growth.exponent:.2f}", columns, rows))
    return tuple(tables)


def _median(planner: Planner, points: int) -> float:
    request, waypoints = wavy_course(points)
    taken: list[float] = []
    while len(taken) < REPEATS and sum(taken) < PATIENCE:
        begin = time.perf_counter()
        planner.through(waypoints, request)
        taken.append(time.perf_counter() - begin)
    return float(np.median(taken))


def _figure(growth: Growth) -> go.Figure:
    """Times over points, and the straight line through zero with their mean time per point."""
    figure = blank(f"{growth.planner}: time from scratch", "points", "ms")
    points, taken = np.array(growth.points), 1e3 * np.array(growth.seconds)
    rate = float(points @ taken / (points @ points))
    colour = COLOURS.get(growth.planner, "#5a9e4b")
    figure.add_scatter(x=points, y=taken, mode="markers", name="measured", marker={"color": colour, "size": 9})
    ends = np.array((0, points[-1]))
    figure.add_scatter(
        x=ends, y=rate * ends, mode="lines", name=f"{1e3 * rate:.1f} µs a point", line={"color": "#6b7280"}
    )
    return figure
