"""Random tracks on which much is in the way: slaloms, halls full of obstacles, a frame around every gate."""

import math
from dataclasses import replace

import numpy as np
from planning_tracks import at_rest, gate

from flightapp.interfaces import Limits, PlanRequest
from flightapp.track import Box, Cylinder, GateShape

SURE = 1e-4 * np.eye(4)
SHAPE = GateShape()
SPEEDS, ACCELERATIONS = (0.5, 2.0, 5.0, 12.0, math.inf), (2.0, 8.0, 20.0, math.inf)


def _request(rng, start, gates, end, obstacles):
    limits = Limits(rng.choice(SPEEDS), rng.choice(ACCELERATIONS), 3.0)
    sure = tuple(replace(g, covariance=SURE) for g in gates)
    return PlanRequest(0.0, at_rest(start), sure, np.array(end, float), limits, shape=SHAPE, obstacles=obstacles)


def _pillar(name, x, y, radius, height):
    return Cylinder(name=name, base=(float(x), float(y), 0.0), radius=float(radius), height=float(height))


def slalom(seed, gates):
    """Gates in a row that are passed on alternate sides, with a pillar on the straight way between any two."""
    rng = np.random.default_rng(seed)
    apart, aside, x = rng.uniform(2.0, 6.0), rng.uniform(0.5, 4.0), 3.0
    placed, pillars, side = [], [], 1.0
    for number in range(gates):
        position = np.array([x, side * aside + rng.uniform(-0.3, 0.3), rng.uniform(1.2, 3.0)])
        placed.append(gate(number, *position, rng.uniform(-0.6, 0.6)))
        middle = x + 0.5 * apart
        pillars.append(_pillar(f"pillar {number}", middle, rng.uniform(-0.3, 0.3), rng.uniform(0.1, 0.3), 6.0))
        x, side = x + apart * rng.uniform(0.9, 1.2), -side
    return _request(rng, (0.0, 0.0, 1.5), placed, (x, 0.0, 1.5), tuple(pillars))


def _apart(rng, half, count, least):
    """(count, 3) places in a hall, so far from each other as it has room for."""
    spots = []
    while len(spots) < count:
        x, y = rng.uniform(-half, half)
        if all(math.hypot(x - a, y - b) >= least for a, b, _ in spots):
            spots.append((x, y, rng.uniform(1.2, 4.0)))
        else:
            least *= 0.995
    return np.array(spots)


def hall(seed, gates, obstacles):
    """Gates at random in a hall, and boxes and pillars that are some way from each of them."""
    rng = np.random.default_rng(seed)
    half = np.array([3.0, 2.0]) * math.sqrt(gates + 2) * rng.uniform(1.0, 1.5)
    spots = _apart(rng, half, gates + 2, 2.8)
    placed = [
        gate(k, *spots[k + 1], math.atan2(*(spots[k + 2] - spots[k])[1::-1]) + rng.uniform(-0.5, 0.5))
        for k in range(gates)
    ]
    solids, tries = [], 0
    while len(solids) < obstacles and tries < 50 * obstacles:
        tries += 1
        x, y = rng.uniform(-half, half)
        size = rng.uniform((0.2, 0.2, 1.0), (2.0, 2.0, 7.0))
        if np.hypot(spots[:, 0] - x, spots[:, 1] - y).min() < 1.6 + 0.5 * math.hypot(size[0], size[1]):
            continue
        name = f"solid {len(solids)}"
        if rng.uniform() < 0.5:
            solids.append(_pillar(name, x, y, 0.5 * size[0], size[2]))
        else:
            centre = (float(x), float(y), float(rng.uniform(0.5 * size[2], 4.0)))
            solids.append(Box(name=name, centre=centre, size=tuple(size.tolist())))
    return _request(rng, spots[0], placed, spots[-1], tuple(solids))


def framed(request):
    """The same track with a frame around every gate."""
    return replace(request, gates=tuple(replace(g, covariance=SURE) for g in request.gates), shape=SHAPE)
