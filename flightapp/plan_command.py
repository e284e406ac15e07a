"""Planning without flying: a track in, a trajectory, its tables and its drawing out."""

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flightapp.config import Config, load_config
from flightapp.evaluation.page import Heading, page_html
from flightapp.evaluation.plan_figures import plan_figures
from flightapp.evaluation.planned import Planned, bounds, plan_tables
from flightapp.evaluation.tables import number
from flightapp.frames import Vector
from flightapp.inputs import BadInputError
from flightapp.interfaces import Limits, Motion, Planner, PlanRequest
from flightapp.messages import GateEstimate
from flightapp.modules import find
from flightapp.planning.clearance import Touch, touched
from flightapp.planning.obstacles import Margins
from flightapp.track import Track, load_track
from flightapp.trajectory import Trajectory
from flightapp.trajectory_files import SUFFIXES, save_samples, save_trajectory

REPEATS, PATIENCE, SLOW = 20, 0.5, 60.0
"""How often a plan is made again to time it; s after which that ends; and s of a first plan that is not made again."""
RATE_MAX = 10000.0
"""Hz, of samples in a file."""


@dataclass(frozen=True, slots=True)
class PlanOptions:
    """What the command line asks for; None where it does not say."""

    track: Path
    planner: str | None = None
    v_max: float | None = None
    a_max: float | None = None
    laps: int | None = None
    vehicle: Path | None = None
    overrides: tuple[str, ...] = ()


def plan_track(options: PlanOptions) -> Planned:
    """Plan along a track whose gates are where its file says.

    A start on the ground is raised to `mission.takeoff_height`. Raises `BadInputError`, and `PlanningError` where
    there is no plan.
    """
    track = load_track(options.track)
    config = load_config(options.vehicle, None, options.overrides)
    name = options.planner or config.planning.planner
    limits = Limits(
        _limit("--v-max", options.v_max, config.race.v_max, "m/s"),
        _limit("--a-max", options.a_max, config.race.a_max, "m/s²"),
        config.vehicle.yaw_rate_max,
    )
    planner: Planner = find("planners", name)(config)
    request, waypoints = _request(track, config, limits, options.laps or config.mission.laps)
    trajectory, first = _timed(planner, request, waypoints)
    again = _best(planner, request, waypoints) if first < SLOW else None
    return Planned(trajectory, request, track, config, name, first, again)


def line_along(track: Track, config: Config) -> Trajectory:
    """The line that ``config`` plans along ``track``; raises `BadInputError` and `PlanningError`."""
    limits = Limits(config.race.v_max, config.race.a_max, config.vehicle.yaw_rate_max)
    request, waypoints = _request(track, config, limits, config.mission.laps)
    return _timed(find("planners", config.planning.planner)(config), request, waypoints)[0]


def touch_of(planned: Planned) -> Touch | None:
    """The first obstacle or frame that the plan comes too close to; None where there is none."""
    request = planned.request
    margins = Margins.of(planned.config)
    return touched(planned.trajectory, request.gates, request.shape, request.obstacles, margins)


def write_plan(planned: Planned, out: Sequence[Path], rate: float | None, default: Path) -> tuple[Path, ...]:
    """Write the plan to each of ``out`` by its suffix, and its page beside the first, or to ``default``; the files.

    With a ``rate`` a CSV file gets samples at so many hertz. Raises `BadInputError`.
    """
    check_outputs(out, rate)
    pages = [path for path in out if path.suffix == ".html"]
    pages = pages or [out[0].with_suffix(".html") if out else default]
    for path in (*out, *pages):
        _make_directory(path)
    for path in out:
        if path.suffix == ".csv" and rate is not None:
            save_samples(planned.trajectory, path, rate)
        elif path.suffix in SUFFIXES:
            header = {"track": planned.track.model_dump_json(), "planner": planned.planner}
            save_trajectory(planned.trajectory, path, header)
    text = plan_page(planned)
    for path in pages:
        try:
            path.write_text(text, encoding="utf-8")
        except OSError as error:
            raise BadInputError(f"{path}: cannot be written: {error.strerror or error}") from None
    return (*(path for path in out if path not in pages), *pages)


def check_outputs(out: Sequence[Path], rate: float | None) -> None:
    """Raise `BadInputError` unless every file of ``out`` can be written as its suffix says."""
    known = (*SUFFIXES, ".html")
    for path in out:
        if path.suffix not in known:
            raise BadInputError(f"--out {path}: the file must end in {', '.join(known[:-1])} or {known[-1]}")
        if path.is_dir():
            raise BadInputError(f"--out {path}: is a directory; name a file")
        if path.suffix == ".mcap" and path.exists():
            raise BadInputError(f"--out {path}: exists, and may be a flight's record; choose another name")
    if rate is not None and not 0.0 < rate <= RATE_MAX:
        raise BadInputError(f"--rate {rate:g}: must be more than 0 and at most {RATE_MAX:g} Hz")
    if rate is not None and not any(path.suffix == ".csv" for path in out):
        raise BadInputError(f"--rate {rate:g}: is for a file of samples; give --out FILE.csv too")


def _make_directory(path: Path) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInputError(f"--out {path}: its directory cannot be made: {error.strerror or error}") from None


def plan_page(planned: Planned) -> str:
    """The page of a plan as text."""
    touch = touch_of(planned)
    broken = [bound.name for bound in bounds(planned) if not bound.kept]
    outcome = str(touch) if touch else f"beyond the limit: {', '.join(broken)}" if broken else "within the limits"
    limits, duration = planned.request.limits, planned.trajectory.duration
    asked = [f"{name} {value:g}" for name, value in (("v_max", limits.v_max), ("a_max", limits.a_max))]
    heading = Heading(
        f"{planned.track.name}, {', '.join(asked)}", outcome, not (touch or broken), f"planner {planned.planner}"
    )
    peaks = planned.trajectory.limits()
    facts = (
        ("duration, s", number(duration, 2)),
        ("length, m", number(planned.length, 1)),
        ("mean speed, m/s", number(planned.length / duration, 2)),
        ("peak speed, m/s", number(peaks.speed, 2)),
        ("peak specific force, m/s²", number(peaks.specific_force, 1)),
        ("greatest tilt, °", number(math.degrees(peaks.tilt), 0)),
        ("planned in, ms", number(planned.again or planned.first, 2, 1e3)),
    )
    return page_html(heading, facts, plan_figures(planned), plan_tables(planned)[1:], wide=("line",))


def _timed(planner: Planner, request: PlanRequest, waypoints: Vector | None) -> tuple[Trajectory, float]:
    begin = time.perf_counter()
    trajectory = planner.plan(request) if waypoints is None else planner.through(waypoints, request)
    return trajectory, time.perf_counter() - begin


def _best(planner: Planner, request: PlanRequest, waypoints: Vector | None) -> float:
    best, begin = math.inf, time.perf_counter()
    for _ in range(REPEATS):
        best = min(best, _timed(planner, request, waypoints)[1])
        if time.perf_counter() - begin > PATIENCE:
            break
    return best


def _request(track: Track, config: Config, limits: Limits, laps: int) -> tuple[PlanRequest, Vector | None]:
    """What to plan along ``track``, and the waypoints where it has no gates."""
    if track.unplaced:
        raise BadInputError(f"track '{track.name}' does not say where its gates are; only a flight can find them")
    x, y, z = track.start.position
    origin = np.array((x, y, z if z > 0.0 else z + config.mission.takeoff_height))
    rest = np.zeros(3)
    start = Motion(origin, rest, rest, rest, track.start.yaw, 0.0)
    finish = origin if track.finish is None else np.array(track.finish)
    waypoints = None
    if not track.gates:
        lap = [*track.waypoints, *([track.finish] if track.finish else [])]
        rows = np.array(lap * laps, float)
        waypoints, finish = rows[:-1] if len(rows) > 1 else rows, rows[-1]
    known = [GateEstimate(g.id, np.array(g.position), g.yaw, np.zeros((4, 4)), 0, 0.0, True) for g in track.gates]
    gates = tuple(known) * laps
    return PlanRequest(0.0, start, gates, finish, limits, None, None, track.gate, track.obstacles), waypoints


def _limit(option: str, given: float | None, configured: float, unit: str) -> float:
    if given is None:
        return configured
    if not given > 0.0:
        raise BadInputError(f"{option} {given:g}: must be more than 0 {unit}, such as {configured:g}; inf for no limit")
    return given
