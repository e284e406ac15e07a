"""A flight made up from formulas: a slalom through five gates, with known errors."""

import numpy as np

from flightapp.evaluation.flight import Commands, Flight, Motions, Setpoints, States
from flightapp.messages import Collision, Drift, Event, GateEstimate, GateMap, GatePassage, PlanReport
from flightapp.track import Gate, Track

GATES = ((-4.0, -8.0, 1.5, 17.0), (4.0, -5.0, 2.5, 35.0), (9.0, 1.0, 4.5, 100.0), (2.0, 6.0, 3.0, 149.0))
FLYING, LANDING, END = 2.0, 12.0, 14.0


def track():
    gates = [
        Gate(id=i, position=(x, y, z), yaw_deg=yaw, markers=tuple(range(4 * i, 4 * i + 4)))
        for i, (x, y, z, yaw) in enumerate(GATES)
    ]
    return Track(name="five_gates", start={"position": (-12.5, -10.0, 1.0)}, gates=tuple(gates))


def flight(seed=0, *, truth=True, mission="five_gates", v_max=4.0):
    rng = np.random.default_rng(seed)
    setpoints = _setpoints(250.0, FLYING, LANDING)
    motion = _setpoints(200.0, 0.0, END)
    wobble = np.stack([0.08 * np.sin(2.0 * motion.stamp + k) for k in range(3)], axis=1)
    actual = motion.position + wobble
    level = np.tile([1.0, 0.0, 0.0, 0.0], (motion.stamp.size, 1))
    still = np.zeros((motion.stamp.size, 3))
    estimate = actual + rng.normal(0.0, 0.01, actual.shape)
    variance = np.full((motion.stamp.size, 9), 1e-4)
    none, cross = np.zeros(motion.stamp.size, np.uint32), np.zeros((motion.stamp.size, 3))
    n = setpoints.stamp.size
    stamps = setpoints.stamp + rng.normal(0.0, 1e-4, n)
    commands = Commands(np.sort(stamps), rng.normal(0.0, 0.5, (n, 3)), 9.81 + rng.normal(0.0, 0.4, n))
    header = {
        "mission": mission,
        "seed": "3",
        "outcome": "GOAL_ACHIEVED",
        "track": track().model_dump_json(),
        "config": f"[race]\nv_max = {v_max}\n[control]\nrate = 250.0\n[mission]\nlaps = 1\n",
    }
    return Flight(
        header,
        states=States(motion.stamp, estimate, level, motion.velocity, still, variance, none, cross),
        setpoints=setpoints,
        commands=commands,
        truth=Motions(motion.stamp, actual, level, motion.velocity, still) if truth else Motions(),
        maps=tuple(_map(rng, stamp, error) for stamp, error in ((0.0, 0.9), (5.0, 0.3), (9.0, 0.1))),
        true_gates=(tuple(_gate(i, np.zeros(3)) for i in range(len(GATES))),) if truth else (),
        events=(
            Event(0.5, "phase", "takeoff: asked for"),
            Event(FLYING, "phase", "flying: race"),
            Event(6.2, "fault", "state lost: 0.30 s old"),
            Event(LANDING, "phase", "landing: race done"),
            Event(LANDING, "behavior", "race: GOAL_ACHIEVED: <all> gates passed"),
        ),
        plans=tuple(PlanReport(FLYING + 0.5 * i, 0.002 + 1e-4 * i, i != 3, "") for i in range(12)),
        passages=tuple(GatePassage(3.0 + 2.0 * i, i, 0.05 * i) for i in range(3)) if truth else (),
        collisions=(Collision(11.0, "gate 3", 1.5),) if truth else (),
    )


def _setpoints(rate, start, end):
    stamp = np.arange(start, end, 1.0 / rate)
    time = np.clip(stamp, FLYING, LANDING)
    phase = (time - FLYING) / (LANDING - FLYING)
    knots = np.linspace(0.0, 1.0, len(GATES) + 2)
    points = np.array([(-12.5, -10.0, 1.0), *(gate[:3] for gate in GATES), (-6.0, 10.0, 1.5)])
    coefficients = [np.polyfit(knots, points[:, axis], 5) for axis in range(3)]
    position = np.stack([np.polyval(c, phase) for c in coefficients], axis=1)
    moving = (stamp > FLYING) & (stamp < LANDING)
    slope = np.stack([np.polyval(np.polyder(c), phase) for c in coefficients], axis=1)
    velocity = np.where(moving[:, None], slope / (LANDING - FLYING), 0.0)
    still = np.zeros_like(position)
    return Setpoints(stamp, position, velocity, still, still, np.zeros(stamp.size), np.zeros(stamp.size))


def _gate(i, error):
    x, y, z, yaw = GATES[i]
    return GateEstimate(i, np.array([x, y, z]) + error, np.radians(yaw), np.eye(4) * 0.01, 5, 1.0)


def _map(rng, stamp, error):
    gates = tuple(_gate(i, rng.normal(0.0, error, 3)) for i in range(len(GATES)))
    return GateMap(stamp, 1, gates, Drift(stamp, np.zeros(3), 0.0, np.eye(4)))
