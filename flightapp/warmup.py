"""Everything that is compiled on first use, used once on the ground: nothing compiles in flight."""

import contextlib
from dataclasses import replace

import numpy as np

from flightapp.config import Config
from flightapp.frames import GRAVITY, quat_from_yaw, quat_normalize, quat_rotate, quat_rotate_inverse
from flightapp.interfaces import Limits, Motion, PlanningError, PlanRequest
from flightapp.messages import GateEstimate, GateSighting, ImuSample, PoseSample, Sightings, VehicleState
from flightapp.perception.regions import expected_regions
from flightapp.planning.answer import Answerer
from flightapp.planning.below import Below
from flightapp.planning.braking import Brakes
from flightapp.planning.geofence import Geofence
from flightapp.planning.goal import Goal
from flightapp.planning.pacing import Pace, paced
from flightapp.sensors.intake import PoseIntake
from flightapp.tasks import Modules
from flightapp.track import Cylinder, Track
from flightapp.trajectory import Trajectory

AHEAD = np.array((6.0, 1.0, 1.5))
ASIDE = np.array((0.0, 1000.0, 1.5))
POST = Cylinder(name="post", base=(3.0, 0.5, -5.0), radius=0.5, height=20.0)
"""In the way there."""
SLOWED = 0.9


def warm_up(config: Config, track: Track, spare: Modules) -> None:
    """Call each module once. They remember it: ``spare`` must not fly."""
    rest, level = np.zeros(3), quat_normalize(quat_from_yaw(0.0))
    # What the link turns poses and odometry with.
    quat_rotate_inverse(level, quat_rotate(level, rest))
    PoseIntake.of_body(config)
    state, gate_id = _estimate(config, track, spare)
    gate = GateEstimate(gate_id, AHEAD, 0.0, 0.01 * np.eye(4), 9, 0.0)
    start = Motion(rest, rest, rest, rest, 0.0, 0.0)
    limits = Limits(config.race.v_max, config.race.a_max, config.vehicle.yaw_rate_max)
    request = PlanRequest(0.1, start, (gate,), 2.0 * AHEAD, limits)
    trajectory = spare.planner.plan(request)
    trajectory.limits()
    in_flight = trajectory.setpoint(0.2)
    moving = Motion(in_flight.position, in_flight.velocity, in_flight.acceleration, in_flight.jerk, 0.0, 0.0)
    with contextlib.suppress(PlanningError):
        spare.planner.plan(replace(request, stamp=0.2, start=moving, gates=(replace(gate, position=1.01 * AHEAD),)))
    spare.planner.through(np.array([AHEAD]), request)
    with contextlib.suppress(PlanningError):
        spare.planner.plan(replace(request, shape=track.gate, obstacles=(POST,)))
    _decide(config, track, spare, replace(request, shape=track.gate), trajectory)
    if state is not None:
        spare.controller.command(state.stamp, state, trajectory)
        expected_regions(
            (gate,), state.position, state.orientation, config.camera.model(), track.gate, config.detection
        )


def _estimate(config: Config, track: Track, spare: Modules) -> tuple[VehicleState | None, int]:
    """See a gate often enough at another place to have it placed anew, with and without inertial sensors and poses.

    The last state, and the id of the gate.
    """
    rest, level, upward = np.zeros(3), quat_from_yaw(0.0), np.array((0.0, 0.0, GRAVITY))
    gate_id = track.passage[0].id if track.passage else 0
    sighting = GateSighting(0.0, gate_id, AHEAD, level, 1e-4 * np.eye(6), (AHEAD, level), 1, 0.1)
    state = None
    for count in range(config.mapping.moved_after + 2):
        stamp = 0.02 * count
        state = spare.estimator.on_pose(PoseSample(stamp, rest, level, rest, rest, 3, epoch=count // 9)) or state
        spare.estimator.on_sightings(Sightings(stamp - 0.005, count, (), (sighting,)))
        for later in (0.005, 0.016):
            spare.estimator.on_imu(ImuSample(stamp + later, upward, rest))
    # So long after the last pose that it coasts.
    for later in (0.025, 0.05):
        spare.estimator.on_imu(ImuSample(stamp + later, upward, rest))
    spare.estimator.gate_map(stamp)
    return state, gate_id


def _decide(config: Config, track: Track, spare: Modules, request: PlanRequest, trajectory: Trajectory) -> None:
    """What is done with a plan between the planner and the line."""
    goal = Goal(request.end, request.limits, gate_ids=tuple(gate.gate_id for gate in request.gates))
    aside = replace(request.gates[0], position=ASIDE)
    pacer = spare.navigator.pacer
    with contextlib.suppress(PlanningError):
        Answerer(config, spare.planner, pacer).answer(goal, request, (aside,), 1.0, True)
    stamp, moving = trajectory.stamp, replace(request.start, velocity=AHEAD)
    next(pacer.offers(trajectory, replace(request, start=moving), SLOWED))
    paced(trajectory, 0.0, Pace(stamp, 1.0, SLOWED, trajectory.duration), stamp)
    Brakes(config).brake(trajectory, stamp, request.limits, Below(config, track, request.gates).free)
    fence = Geofence.of(config.geofence)
    fence.outside(AHEAD)
    fence.exit(trajectory)
