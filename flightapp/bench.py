"""Computation times on this computer, beside the paper's profiling table."""

import itertools
import os
import platform
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from rich.table import Table

from flightapp import app
from flightapp.autopilot.guard import CommandGuard
from flightapp.channel import Topic
from flightapp.config import Config
from flightapp.control.flatness import FlatnessController
from flightapp.control.mpc import MpcController
from flightapp.control.mpcc import MpccController
from flightapp.control_speed import BATCH, compiled_commands, compiled_laws, packed_commands, python_commands
from flightapp.estimation.fusion import FusionEstimator
from flightapp.evaluation.growth import wavy_course
from flightapp.evaluation.paper import profiling_times
from flightapp.evaluation.plan_table import yardsticks
from flightapp.frames import GRAVITY, quat_from_yaw, quat_to_matrix
from flightapp.inputs import BadInputError
from flightapp.interfaces import Limits, Motion, PlanRequest
from flightapp.messages import (
    AutopilotStatus,
    FlightMode,
    Frame,
    GateEstimate,
    GateMap,
    GateSighting,
    ImuSample,
    PoseSample,
    Sightings,
    VehicleState,
)
from flightapp.perception.aruco import ArucoDetector
from flightapp.perception.opencv import OpencvDetector
from flightapp.perception.regions import expected_regions
from flightapp.planning.polynomial import PolynomialPlanner
from flightapp.planning.race import RacePlanner
from flightapp.recording.recorder import Recorder
from flightapp.recording.writer import FlightLog
from flightapp.track import Gate, GateShape, Start, Track
from flightapp.trajectory import Trajectory

MISSION = Path(__file__).parents[1] / "missions" / "five_gates.py"
UNMEASURED = 3
"""Runs before those that are timed."""
GATE_DISTANCE = 4.0
"""m from the camera to the gate of the perception rows."""


PROFILED = {
    "controller": "controller",
    "plan_6": "trajectory_6_points",
    "plan_14": "trajectory_14_points",
    "plan_26": "trajectory_26_points",
    "aruco_full": "aruco",
}
"""Rows that are in the paper's profiling table, with their keys there."""


@dataclass(frozen=True, slots=True)
class Row:
    """One line of the table: seconds, or times faster than real time."""

    name: str
    count: int
    p50: float
    p99: float


def run_bench(mission: Path = MISSION) -> dict[str, Any]:
    """Measure everything; the machine-readable result of `flightapp bench`."""
    rows = [
        *_control(),
        *_planning(),
        *_perception(),
        *_estimation(),
        *_recording(),
        *_simulation(),
        *_flights(mission),
    ]
    return {
        "machine": f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}",
        "rows": [_beside_paper(row) for row in rows],
    }


def profile() -> list[dict[str, Any]]:
    """Only the rows that the paper's profiling table has, and our plans in flight; as in `run_bench`."""
    rows = itertools.chain(itertools.islice(_control(), 1), _planning(), itertools.islice(_perception(), 2))
    return [_beside_paper(row) for row in rows if row.name in (*PROFILED, "race_plan", "race_replan", "replan_26")]


def _beside_paper(row: Row) -> dict[str, Any]:
    paper = profiling_times().get(PROFILED.get(row.name, ""), {})
    measured = {"name": row.name, "count": row.count, "p50": row.p50, "p99": row.p99}
    return measured | {"paper_i7": paper.get("i7_10870H"), "paper_jetson": paper.get("jetson_xavier_nx")}


def bench_table(result: dict[str, Any]) -> Table:
    """``result`` of `run_bench` for a terminal."""
    table = Table("", "count", "p50", "p99", "paper, i7", "paper, Jetson", title=result["machine"])
    for row in result["rows"]:
        show = _times_real if row["name"].startswith("sim_") else _duration
        values = [show(row[key]) for key in ("p50", "p99", "paper_i7", "paper_jetson")]
        table.add_row(row["name"], str(row["count"]), *values)
    return table


def measure(name: str, function: Callable[[], object], count: int, calls: int = 1) -> Row:
    """Time ``function``, which does its work ``calls`` times, ``count`` times after `UNMEASURED` others."""
    for _ in range(UNMEASURED):
        function()
    taken = np.empty(count)
    for i in range(count):
        begin = time.perf_counter()
        function()
        taken[i] = time.perf_counter() - begin
    p50, p99 = np.percentile(taken / calls, (50.0, 99.0))
    return Row(name, count * calls, float(p50), float(p99))


def _control() -> Iterator[Row]:
    config = Config()
    line = _plan(config, 6)
    yield measure("controller", compiled_laws(config, line), 200, BATCH)
    yield measure("controller_predicting", compiled_commands(config, line), 200, BATCH)
    command, guard = python_commands(FlatnessController(config), line), CommandGuard(config)
    yield measure("controller_from_python", packed_commands(config, line), 20000)
    yield measure("controller_task", command, 20000)
    yield measure("mpc", python_commands(MpcController(config), line), 5000)
    yield measure("mpcc", python_commands(MpccController(config), line), 5000)
    status = AutopilotStatus(0.0, FlightMode.OFFBOARD, True, False, True, 16.0, 1.0)
    topics: tuple[Topic[Any], Topic[Any]] = (Topic("setpoint"), Topic("command"))

    def tick() -> None:
        nonlocal status
        wanted = command()
        if wanted.stamp - status.stamp > 0.1:
            status = replace(status, stamp=wanted.stamp)
        safe = guard.check(wanted, wanted.stamp, status)
        topics[0].publish(line.setpoint(safe.stamp))
        topics[1].publish(safe)

    yield measure("command_tick", tick, 20000)


def _planning() -> Iterator[Row]:
    config = Config()
    planner = PolynomialPlanner(config)
    for points, count in ((6, 300), (14, 200), (26, 100), (1000, 3)):
        request, waypoints = wavy_course(points)
        yield measure(f"plan_{points}", lambda r=request, w=waypoints: planner.through(w, r), count)  # type: ignore[misc]
    yield measure("replan_26", _replans(planner, 26), 300)
    racer, race = RacePlanner(config), _race(config)
    yield measure("race_plan", lambda: racer.plan(race), 50)
    yield measure("race_replan", _race_replans(config, race, 50 + UNMEASURED), 50)


def _replans(planner: PolynomialPlanner, points: int) -> Callable[[], Trajectory]:
    """Plans anew along the first leg, each time from further on and with points that moved by centimetres."""
    request, waypoints = wavy_course(points)
    plan = planner.through(waypoints, request)
    generator, first_leg, asked = np.random.default_rng(0), float(plan.knots[2]), []
    for share in np.linspace(0.1, 0.6, 20):
        s = plan.setpoint(plan.stamp + share * first_leg)
        motion = Motion(s.position, s.velocity, s.acceleration, s.jerk, s.yaw, s.yaw_rate)
        moved = waypoints + generator.normal(0.0, 0.02, waypoints.shape)
        asked.append((moved, PlanRequest(s.stamp, motion, (), request.end, request.limits)))
    turns = itertools.cycle(asked)
    return lambda: planner.through(*next(turns))


def _race(config: Config) -> PlanRequest:
    """Five gates, flown as a race is by default."""
    course = next(course for course in yardsticks().courses if course.name == "five_gates")
    ways = np.diff(np.vstack((course.start, course.points, course.finish)), axis=0)
    yaws = np.arctan2(*(ways[:-1] + ways[1:])[:, 1::-1].T)
    sure = np.diag((0.01, 0.01, 0.01, 0.001)) ** 2
    gates = (
        GateEstimate(i, p, float(yaw), sure, 9, 0.0) for i, (p, yaw) in enumerate(zip(course.points, yaws, strict=True))
    )
    rest = np.zeros(3)
    limits = Limits(config.race.v_max, config.race.a_max, config.vehicle.yaw_rate_max)
    start = Motion(course.start, rest, rest, rest, 0.0, 0.0)
    return PlanRequest(0.0, start, tuple(gates), course.finish, limits, None, None, GateShape())


def _race_replans(config: Config, race: PlanRequest, count: int) -> Callable[[], Trajectory]:
    """Plans anew before the first gate, each on another plan in flight, with gates that moved by centimetres."""
    generator, asked = np.random.default_rng(0), []
    for share in generator.uniform(0.1, 0.8, count):
        planner = RacePlanner(config)
        plan = planner.plan(race)
        s = plan.setpoint(plan.stamp + share * plan.gate_times[0])
        motion = Motion(s.position, s.velocity, s.acceleration, s.jerk, s.yaw, s.yaw_rate)
        gates = tuple(replace(gate, position=gate.position + generator.normal(0.0, 0.02, 3)) for gate in race.gates)
        asked.append((planner, replace(race, stamp=s.stamp, start=motion, gates=gates)))
    turns = iter(asked)

    def replan() -> Trajectory:
        planner, request = next(turns)
        return planner.plan(request)

    return replan


def _perception() -> Iterator[Row]:
    config, track = Config(), _one_gate()
    image = draw_gate(config, track)
    frame = Frame(0.0, 0, image)
    ours = ArucoDetector(config, track)
    gate = GateEstimate(1, np.array((GATE_DISTANCE, 0.0, 0.0)), 0.0, np.diag((0.01, 0.01, 0.01, 0.001)), 9, 0.0)
    state = _state(0.0)
    camera = config.camera.model()
    regions = expected_regions((gate,), np.zeros(3), state.orientation, camera, track.gate, config.detection)
    yield measure("aruco_tracking", lambda: ours.detect(frame, regions), 300)
    yield measure("aruco_full", lambda: ours.detect(frame, None), 100)
    opencv = OpencvDetector(config, track)
    yield measure("opencv_full", lambda: opencv.detect(frame, None), 100)


def _estimation() -> Iterator[Row]:
    config, track = Config(), _one_gate()
    estimator = FusionEstimator(config, track)
    clock, upward, rest = _clock(0.005), np.array((0.0, 0.0, GRAVITY)), np.zeros(3)

    def step() -> VehicleState | None:
        stamp = next(clock)
        estimator.on_imu(ImuSample(stamp, upward, rest))
        return estimator.on_pose(_pose(stamp))

    yield measure("estimator_step", step, 5000)

    def update() -> GateMap:
        stamp = max(state.stamp for _ in range(6) if (state := step()) is not None)
        sighting = GateSighting(
            stamp, 1, np.array((GATE_DISTANCE, 0.0, 0.0)), quat_from_yaw(0.0), 1e-4 * np.eye(6), None, 4, 0.2
        )
        estimator.on_sightings(Sightings(stamp - 0.03, 0, (), (sighting,)))
        return estimator.gate_map(stamp)

    yield measure("map_update", update, 2000)


def _recording() -> Iterator[Row]:
    with tempfile.TemporaryDirectory() as scratch:
        log = FlightLog(Path(scratch) / "flight.mcap", header={})
        recorder = Recorder(log, threaded=False)
        topic: Topic[VehicleState] = Topic("state")
        recorder.tap(topic)
        clock = _clock(0.005)
        yield measure("recorder_write", lambda: topic.publish(_state(next(clock))), 20000)
        recorder.close()


def _simulation() -> Iterator[Row]:
    for entry in entry_points(group="flightapp.benchmarks"):
        for name, simulated, function in entry.load()():
            row = measure(name, function, 20)
            yield Row(name, row.count, simulated / row.p50, simulated / row.p99)


def _flights(mission: Path) -> Iterator[Row]:
    if not mission.exists():
        raise BadInputError(f"{mission}: there is no such mission to measure the whole application with")
    for kind, flights in (("corners", 5), ("rendered", 3)):
        speeds = []
        for seed in range(flights + 1):
            with tempfile.TemporaryDirectory() as scratch:
                plan = app.FlightPlan(mission, Path(scratch), overrides=(f"sim.camera={kind}",), seed=seed)
                flown = app.fly(plan)
                speeds.append(flown.duration / flown.wall)
        slow, middle = np.percentile(speeds[1:], (1.0, 50.0))
        yield Row(f"sim_app_{kind}", flights, float(middle), float(slow))


def draw_gate(config: Config, track: Track) -> "np.typing.NDArray[np.uint8]":
    """What the configured camera sees of the track's first gate, straight ahead of a level body, with noise."""
    camera, shape = config.camera.model(), track.gate
    image = np.full((camera.height, camera.width), 110, np.uint8)
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{shape.dictionary}"))
    cells = 8
    for marker_id, corners in zip(track.gates[0].markers, shape.marker_corners(), strict=True):
        texture = np.full((10 * cells, 10 * cells), 255, np.uint8)
        texture[10:-10, 10:-10] = cv2.aruco.generateImageMarker(dictionary, marker_id, 10 * (cells - 2))
        centre = corners.mean(axis=0)
        quiet = centre + (corners - centre) * cells / (cells - 2)
        in_body = quiet @ quat_to_matrix(quat_from_yaw(track.gates[0].yaw)).T + np.array((GATE_DISTANCE, 0.0, 0.0))
        pixels = camera.project((in_body - camera.p_bc) @ camera.R_bc).astype(np.float32)
        side = 10.0 * cells - 0.5
        source = np.array([[-0.5, -0.5], [side, -0.5], [side, side], [-0.5, side]], np.float32)
        warp = cv2.getPerspectiveTransform(source, pixels)
        size = (camera.width, camera.height)
        drawn = cv2.warpPerspective(texture, warp, size, flags=cv2.INTER_AREA)
        mask = cv2.warpPerspective(np.full_like(texture, 255), warp, size) > 127
        image[mask] = drawn[mask]
    noise = np.random.default_rng(0).normal(0.0, 2.0, image.shape)
    blurred = cv2.GaussianBlur(image, (0, 0), 0.7)
    noisy: np.typing.NDArray[np.uint8] = np.clip(blurred + noise, 0.0, 255.0).astype(np.uint8)
    return noisy


def _plan(config: Config, points: int) -> Trajectory:
    request, waypoints = wavy_course(points)
    return PolynomialPlanner(config).through(waypoints, request)


def _one_gate() -> Track:
    gate = Gate(id=1, position=(GATE_DISTANCE, 0.0, 1.5), yaw_deg=0.0, markers=(1, 2, 3, 4))
    return Track(name="bench", start=Start(position=(0.0, 0.0, 0.0)), gate=GateShape(), gates=(gate,))


def _state(stamp: float) -> VehicleState:
    rest = np.zeros(3)
    return VehicleState(stamp, np.array((0.0, 0.0, 1.5)), quat_from_yaw(0.0), rest, rest, 1e-4 * np.eye(9))


def _pose(stamp: float) -> PoseSample:
    rest = np.zeros(3)
    return PoseSample(stamp, np.array((0.0, 0.0, 1.5)), quat_from_yaw(0.0), rest, rest, 3)


def _clock(step: float) -> Iterator[float]:
    count = 0
    while True:
        count += 1
        yield count * step


def _duration(seconds: float | None) -> str:
    if seconds is None:
        return ""
    for unit, scale in (("s", 1.0), ("ms", 1e3), ("µs", 1e6)):
        if seconds * scale >= 1.0:
            return f"{seconds * scale:.3g} {unit}"
    return f"{seconds * 1e9:.3g} ns"


def _times_real(factor: float | None) -> str:
    return "" if factor is None else f"{factor:.4g} ×"
