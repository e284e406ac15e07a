"""Plans beside the least times that are possible: every yardstick course at each of its speeds, by each planner."""

import math
import time
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from importlib.resources import files
from typing import Any

import numpy as np

from flightapp.config import Config, load_config
from flightapp.evaluation.tables import NONE, TextTable, number
from flightapp.frames import Vector
from flightapp.interfaces import Limits, Motion, Planner, PlanningError, PlanRequest
from flightapp.modules import find
from flightapp.trajectory import Trajectory

REPEATS, PATIENCE = 20, 2.0
"""How often a plan is made again to time it, and s after which that ends."""
STEP = 2e-3
"""s between the points that are looked at for how near a plan passes."""


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """Points to be passed from rest to rest, and in how little time that can be done."""

    name: str
    start: Vector
    points: Vector
    """(n, 3) m, each to be passed within `radius`."""
    finish: Vector
    optimum: tuple[tuple[float, float, float], ...]
    """Greatest speed (m/s), least time (s), and the time (s) of the plan of full model that is stored for it."""


@dataclass(frozen=True, slots=True)
class Yardsticks:
    """The courses, and the vehicle that their times are for."""

    thrust_to_weight: float
    rate_max: float
    radius: float
    courses: tuple[Course, ...]

    def config(self) -> Config:
        """The configuration under which planners are compared: all thrust and rates, no drag."""
        return load_config(
            None,
            {
                "vehicle.thrust_to_weight": self.thrust_to_weight,
                "vehicle.rate_max": self.rate_max,
                "vehicle.drag": [0.0, 0.0, 0.0],
                "guard.thrust_min": 0.0,
                "planning.thrust_share": 1.0,
                "planning.rate_share": 1.0,
                "planning.tilt_max_deg": 180.0,
                "planning.waypoint_radius": self.radius,
            },
        )


@dataclass(frozen=True, slots=True)
class PlanRow:
    """One plan; times in s, None where there is no plan."""

    course: str
    v_max: float
    planner: str
    optimum: float
    stored: float
    """s, of the plan of the full model, single rotors included, in missions/tracks/optimal."""
    duration: float | None = None
    ratio: float | None = None
    """Of the duration to the optimum."""
    plan_time: float | None = None
    """s, median of some from scratch."""
    excess: float | None = None
    """The greatest of the next four; negative where all limits are kept."""
    speed_excess: float | None = None
    """Relative excess over v_max, by a dense check as the others."""
    thrust_excess: float | None = None
    """Relative excess over the greatest collective thrust."""
    least_thrust_excess: float | None = None
    """By how much the least collective thrust is undercut, as a share of the greatest."""
    rate_excess: float | None = None
    """Relative excess over the greatest body rate."""
    offset: float | None = None
    """m, greatest distance at which a point is passed."""
    why: str = ""
    """Why there is no plan."""


def yardsticks() -> Yardsticks:
    """The courses of this package."""
    data = tomllib.loads(files("flightapp.evaluation").joinpath("data/yardsticks.toml").read_text(encoding="utf-8"))
    courses = tuple(
        Course(
            course["name"],
            np.array(course["start"]),
            np.array(course["points"]),
            np.array(course["finish"]),
            tuple((float(v_max), float(least), float(full)) for v_max, least, full in course["optimum"]),
        )
        for course in data["courses"]
    )
    return Yardsticks(data["thrust_to_weight"], data["rate_max"], data["radius"], courses)


def plan_rows(planners: Sequence[str]) -> Iterator[PlanRow]:
    """Each course at each speed by each of ``planners``, as they are made; raises `BadInputError` for unknown ones."""
    sticks = yardsticks()
    config = sticks.config()
    made = [(name, find("planners", name)(config)) for name in planners]
    for course in sticks.courses:
        for v_max, *times in course.optimum:
            for name, planner in made:
                yield _row(config, course, v_max, (times[0], times[1]), name, planner)


def rows_json(rows: Sequence[PlanRow]) -> dict[str, Any]:
    """The rows for a file; a speed without limit is null."""
    return {"rows": [{**asdict(row), "v_max": row.v_max if math.isfinite(row.v_max) else None} for row in rows]}


def rows_table(rows: Sequence[PlanRow]) -> TextTable:
    """The rows as text."""
    columns = ("course", "v_max", "planner", "s", "optimum", "ratio", "full", "plan ms", "excess %", "offset m")
    cells = []
    for row in rows:
        speed = f"{row.v_max:g}" if math.isfinite(row.v_max) else NONE
        times = [number(row.duration, 3), number(row.optimum, 2), number(row.ratio, 4), number(row.stored, 2)]
        taken, excess = number(row.plan_time, 2, 1e3), number(row.excess, 3, 1e2)
        cells.append([row.course, speed, row.planner, *times, taken, excess, number(row.offset, 3)])
    return TextTable("Plans from rest to rest beside the least times possible", columns, cells)


def _row(
    config: Config, course: Course, v_max: float, times: tuple[float, float], name: str, planner: Planner
) -> PlanRow:
    rest = np.zeros(3)
    limits = Limits(v_max, math.inf, config.vehicle.yaw_rate_max)
    request = PlanRequest(0.0, Motion(course.start, rest, rest, rest, 0.0, 0.0), (), course.finish, limits)
    try:
        plan = planner.through(course.points, request)
    except PlanningError as error:
        return PlanRow(course.name, v_max, name, *times, why=str(error))
    taken = _timed(planner, course.points, request)
    excess, offset = _excess(plan, config, v_max), _offset(plan, course.points)
    ratio = plan.duration / times[0]
    return PlanRow(course.name, v_max, name, *times, plan.duration, ratio, taken, max(excess), *excess, offset)


def _timed(planner: Planner, points: Vector, request: PlanRequest) -> float:
    taken: list[float] = []
    while len(taken) < REPEATS and sum(taken) < PATIENCE:
        begin = time.perf_counter()
        planner.through(points, request)
        taken.append(time.perf_counter() - begin)
    return float(np.median(taken))


def _excess(plan: Trajectory, config: Config, v_max: float) -> tuple[float, float, float, float]:
    """Relative excess over speed, greatest thrust, least thrust and body rate."""
    peaks = plan.limits()
    thrust, rate, least = config.vehicle.thrust_max, config.vehicle.rate_max, config.guard.thrust_min
    undercut = (least - peaks.specific_force_min) / thrust
    return peaks.speed / v_max - 1.0, peaks.specific_force / thrust - 1.0, undercut, peaks.body_rate / rate - 1.0


def _offset(plan: Trajectory, points: Vector) -> float:
    path = plan.sample(np.arange(0.0, plan.duration, STEP)).position
    return float(max(np.linalg.norm(path - point, axis=1).min() for point in points))
