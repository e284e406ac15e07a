"""One message of every kind, and streams of them, for the recording tests."""

import math

import numpy as np

from flightapp.frames import quat_from_yaw
from flightapp.messages import (
    AutopilotStatus,
    Collision,
    Drift,
    Event,
    FlightMode,
    GateEstimate,
    GateMap,
    GatePassage,
    GateSighting,
    GroundTruth,
    MarkerDetection,
    PlanReport,
    PoseSample,
    RateCommand,
    Setpoint,
    Sightings,
    Stage,
    StageTime,
    VehicleState,
)
from flightapp.trajectory import Trajectory


def pose(rng, stamp):
    return PoseSample(stamp, *_motion(rng), confidence=3, acceleration=rng.normal(size=3), epoch=2)


def state(rng, stamp):
    return VehicleState(stamp, *_motion(rng), covariance=rng.normal(size=(9, 9)), doubt="blind")


def truth(rng, stamp):
    return GroundTruth(stamp, *_motion(rng))


def setpoint(rng, stamp):
    return Setpoint(stamp, *(rng.normal(size=3) for _ in range(4)), yaw=0.3, yaw_rate=-0.1)


def command(rng, stamp):
    return RateCommand(stamp, rng.normal(size=3), 9.81)


def stage(rng, stamp):
    return StageTime(stamp, Stage.COMMAND, stamp - rng.uniform(0.0, 0.1), stamp - 0.002)


def gate(rng, gate_id, last_seen=-math.inf):
    return GateEstimate(gate_id, rng.normal(size=3), 0.4, np.eye(4) * 0.1, 3, last_seen)


def gate_map(rng, stamp):
    drift = Drift(stamp, rng.normal(size=3), 0.01, np.eye(4))
    return GateMap(stamp, 7, (gate(rng, 0), gate(rng, 1, stamp)), drift)


def sightings(rng, stamp):
    marker = MarkerDetection(4, rng.normal(size=(4, 2)), 0.9, 0.12)
    motion = rng.normal(size=3), quat_from_yaw(0.3)
    clear = GateSighting(stamp, 0, *motion, np.eye(6), None, 4, 0.4)
    ambiguous = GateSighting(stamp, 1, *motion, np.eye(6), motion, 1, 0.9)
    return Sightings(stamp, 12, (marker,), (clear, ambiguous))


def trajectory(rng, stamp):
    knots, yaw_knots = np.array([0.0, 1.0, 2.5]), np.array([0.0, 2.5])
    return Trajectory(stamp, knots, rng.normal(size=(2, 3, 8)), yaw_knots, rng.normal(size=(1, 4)), (0, 1), (1.0, 2.0))


def irregular(rng, stamp):
    return {
        "gate_map": gate_map(rng, stamp),
        "sightings": sightings(rng, stamp),
        "trajectory": trajectory(rng, stamp),
        "status": AutopilotStatus(stamp, FlightMode.OFFBOARD, True, False, True, 15.2, 0.75),
        "event": Event(stamp, "phase", "flying — los geht’s"),
        "plan": PlanReport(stamp, 0.002, False, "too fast"),
        "passage": GatePassage(stamp, 1, 0.12),
        "collision": Collision(stamp, "gate 1", 2.5),
    }


FAST = {"pose": pose, "state": state, "truth": truth, "setpoint": setpoint, "command": command, "stage": stage}


def write_stream(log, seconds, rate=200):
    """``seconds`` of everything at ``rate`` Hz, irregular messages ten times a second."""
    rng = np.random.default_rng(1)
    for i in range(int(seconds * rate)):
        stamp = i / rate
        for name, make in FAST.items():
            log.write(name, make(rng, stamp))
        if i % (rate // 10) == 0:
            for name, message in irregular(rng, stamp).items():
                log.write(name, message)


def _motion(rng):
    return rng.normal(size=3), quat_from_yaw(rng.uniform(-3, 3)), rng.normal(size=3), rng.normal(size=3)
