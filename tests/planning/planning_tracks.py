"""Tracks and requests that the planners' tests share."""

import math

import numpy as np

from flightapp.interfaces import Limits, Motion, PlanRequest
from flightapp.messages import GateEstimate
from flightapp.trajectory import Trajectory

ZERO = np.zeros(3)
FIVE_GATES = (
    (-12.5, -10.0, 1.0),
    [(-4, -8, 1.5, 17), (4, -5, 2.5, 35), (9, 1, 4.5, 100), (2, 6, 3, 149), (-6, 10, 1.5, 190)],
    (-10.0, 4.0, 1.0),
)
FIVE_GATES_LOOP = (
    (0.0, -10.0, 1.0),
    [(9.5, -7, 1.5, 46), (12.5, 3, 3.5, 111), (3, 10, 4.5, 168), (-8, 7.5, 2.5, 220), (-12.5, -3, 1.5, 295)],
    (0.0, -10.0, 1.0),
)
FOUR_GATES = (
    (-2.0, -2.8, 1.0),
    [(0, -2, 1, 22), (2.5, 0, 1.4, 90), (0, 2, 1.9, 180), (-2.5, 0, 1.2, 270)],
    (-2.0, -2.8, 1.0),
)
TRACKS = {"five_gates": FIVE_GATES, "five_gates_loop": FIVE_GATES_LOOP, "four_gates": FOUR_GATES}


def gate(number, x, y, z, yaw):
    return GateEstimate(number, np.array([x, y, z], float), yaw, np.eye(4), 1, 0.0)


def at_rest(position, yaw=0.0):
    return Motion(np.array(position, float), ZERO, ZERO, ZERO, yaw, 0.0)


def request_for(track, v_max=4.0, a_max=8.0, yaw_rate_max=3.0, shift=None, **others):
    """``shift``: a generator that moves the gates as far as a prior may be off."""
    start, rows, end = track
    gates = []
    for number, (x, y, z, degrees) in enumerate(rows):
        moved, turned = ZERO, 0.0
        if shift is not None:
            radius, angle = 3.0 * math.sqrt(shift.uniform()), shift.uniform(0.0, 2.0 * math.pi)
            moved = np.array([radius * math.cos(angle), radius * math.sin(angle), shift.uniform(-0.5, 0.5)])
            turned = shift.uniform(-10.0, 10.0)
        gates.append(gate(number, x + moved[0], y + moved[1], z + moved[2], math.radians(degrees + turned)))
    limits = Limits(v_max, a_max, yaw_rate_max)
    return PlanRequest(0.0, at_rest(start), tuple(gates), np.array(end, float), limits, **others)


def lemniscate(points):
    theta = np.linspace(0.0, 2.0 * np.pi, points + 1)
    return np.column_stack((5.5 * np.sin(theta), 2.75 * np.sin(2.0 * theta), np.full(theta.size, 1.5)))


def lap_request(waypoints, v_max, a_max):
    return PlanRequest(0.0, at_rest(waypoints[0]), (), waypoints[-1], Limits(v_max, a_max, 3.0))


def motion_at(trajectory: Trajectory, t):
    s = trajectory.sample(float(t))
    return Motion(s.position, s.velocity, s.acceleration, s.jerk, float(s.yaw), float(s.yaw_rate))


def replan_request(request, trajectory, t, shift=None):
    """From the plan's own motion at ``t``, through the gates still to come."""
    left = [g for g, passed in zip(request.gates, trajectory.gate_times, strict=True) if passed > t]
    if shift is not None:
        left = [
            GateEstimate(g.gate_id, g.position + shift.normal(0.0, 0.1, 3), g.yaw, g.covariance, 1, t) for g in left
        ]
    return PlanRequest(t, motion_at(trajectory, t), tuple(left), request.end, request.limits, request.look_at)


def crossing_angles(trajectory, request):
    """Degrees between the velocity and each gate's direction of passage."""
    angles = []
    for passed, g in zip(trajectory.gate_times, request.gates, strict=True):
        v = trajectory.sample(passed).velocity
        along = (v[0] * math.cos(g.yaw) + v[1] * math.sin(g.yaw)) / np.linalg.norm(v)
        angles.append(math.degrees(math.acos(min(1.0, along))))
    return np.array(angles)
