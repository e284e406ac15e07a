"""Everything that is compiled on first use, used once on the ground: nothing compiles in flight."""

import contextlib
from dataclasses import replace

import numpy as np

from flightapp.config import Config
from flightapp.estimation.history import PoseHistory
from flightapp.frames import quat_from_yaw, quat_normalize, quat_rotate, quat_rotate_inverse
from flightapp.interfaces import Limits, Motion, PlanningError, PlanRequest
from flightapp.messages import GateEstimate, GateSighting, PoseSample
from flightapp.perception.regions import expected_regions
from flightapp.planning.answer import Answerer
from flightapp.planning.goal import Goal
from flightapp.planning.pacing import Pace, paced
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
    history = PoseHistory()
    state = None
    for stamp in (0.0, 0.005, 0.010):
        pose = PoseSample(stamp, rest, level, rest, rest, 3)
        history.add(pose)
        state = spare.estimator.on_pose(pose) or state
    between, beyond = history.at(0.007), history.at(0.012)
    gate_id = track.gates[0].id if track.gates else 0
    sighting = GateSighting(0.007, gate_id, AHEAD, level, 0.01 * np.eye(6), (AHEAD, level), 1, 0.1)
    if track.gates and between is not None:
        spare.estimator.on_drift(spare.mapper.update((sighting,), between).drift)
    gate = GateEstimate(gate_id, AHEAD, 0.0, 0.01 * np.eye(4), 9, 0.0)
    start = Motion(rest, rest, rest, rest, 0.0, 0.0)
    limits = Limits(config.race.v_max, config.race.a_max, config.vehicle.yaw_rate_max)
    request = PlanRequest(0.1, start, (gate,), 2.0 * AHEAD, limits)
    trajectory = spare.planner.plan(request)
    trajectory.setpoint(0.2)
    spare.planner.through(np.array([AHEAD]), request)
    with contextlib.suppress(PlanningError):
        spare.planner.plan(replace(request, shape=track.gate, obstacles=(POST,)))
    _decide(config, spare, replace(request, shape=track.gate), trajectory)
    if state is not None and beyond is not None:
        spare.controller.command(0.015, state, trajectory)
        expected_regions(
            (gate,), state.position, state.orientation, config.camera.model(), track.gate, config.detection
        )


def _decide(config: Config, spare: Modules, request: PlanRequest, trajectory: Trajectory) -> None:
    """What is done with a plan between the planner and the line."""
    goal = Goal(request.end, request.limits, gate_ids=tuple(gate.gate_id for gate in request.gates))
    aside = replace(request.gates[0], position=ASIDE)
    pacer = spare.navigator.pacer
    with contextlib.suppress(PlanningError):
        Answerer(config, spare.planner, pacer).answer(goal, request, (aside,), 1.0, True)
    stamp, moving = trajectory.stamp, replace(request.start, velocity=AHEAD)
    next(pacer.offers(trajectory, replace(request, start=moving), SLOWED))
    paced(trajectory, 0.0, Pace(stamp, 1.0, SLOWED, trajectory.duration), stamp)
