"""Which gates may be flown through now, and where to stop before the first one that may not.

A gate that is known only to within metres is never flown through blindly: the course ends, at rest, a
standoff before it, from where the camera can see it. It is usually seen long before the drone would brake.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flightapp.frames import Vector
from flightapp.messages import GateEstimate

KNOWN_YAW = 0.35
"""rad, greatest standard deviation of the direction of passage of a gate that may be flown through."""
EXIT_RUN = 2.5
"""m straight out of a passed gate before which a course may not end: turning earlier would end in its frame."""


@dataclass(frozen=True, slots=True)
class Course:
    """The part of the track that can be planned now."""

    gates: tuple[GateEstimate, ...]
    end: Vector
    """(3,) m, world: where to come to rest."""
    waiting_for: GateEstimate | None
    """The gate that has to be seen before going on; None when there is none."""
    beyond: GateEstimate | None = None
    """The known gate behind the planner's horizon, towards which the course goes on; None when there is none."""
    blind: bool = False
    """Whether nothing at all is known of the gate that comes next."""

    @property
    def following(self) -> GateEstimate | None:
        """The gate after the last of `gates`; None when the course reaches the goal."""
        return self.waiting_for or self.beyond


def horizontal_sigma(gate: GateEstimate) -> float:
    """Largest standard deviation of a gate's horizontal position, m."""
    P = gate.covariance[:2, :2]
    spread = math.hypot(0.5 * (P[0, 0] - P[1, 1]), P[0, 1])
    return math.sqrt(max(0.5 * (P[0, 0] + P[1, 1]) + spread, 0.0))


def is_known(gate: GateEstimate, known_sigma: float, least_sightings: int = 3) -> bool:
    """Whether a gate is known well enough to be flown through."""
    if not gate.surveyed and (gate.sightings < least_sightings or gate.covariance[3, 3] > KNOWN_YAW**2):
        return False
    return horizontal_sigma(gate) <= known_sigma


def course(
    gates: Sequence[GateEstimate | None],
    origin: Vector,
    end: Vector,
    known_sigma: float,
    standoff: float,
    horizon: int,
) -> Course:
    """The course from ``origin`` (3,) through the leading known ones of ``gates`` towards ``end`` (3,).

    ``standoff`` is the distance in metres to keep from a gate that is not known yet; ``horizon`` the number of gates
    after which a course ends, at rest there too: it is planned on as gates are passed, long before it would brake.
    A gate of which nothing is known is None: the course ends straight out of the one before it, looking ahead.
    """
    known: list[GateEstimate] = []
    for gate in gates:
        if gate is None:
            return Course(tuple(known), _straight_out(known[-1]) if known else origin, None, blind=True)
        if not is_known(gate, known_sigma):
            return Course(tuple(known), _wait_before(gate, known, origin, standoff), gate)
        if len(known) == horizon:
            return Course(tuple(known), _wait_before(gate, known, origin, standoff), None, gate)
        known.append(gate)
    return Course(tuple(known), end, None)


def _straight_out(gate: GateEstimate) -> Vector:
    """Behind ``gate``, clear of its frame."""
    out: Vector = gate.position + EXIT_RUN * np.array((math.cos(gate.yaw), math.sin(gate.yaw), 0.0))
    return out


def _wait_before(gate: GateEstimate, known: list[GateEstimate], origin: Vector, standoff: float) -> Vector:
    """Where to wait for ``gate``: on the straight way to it, a standoff away, but clear of the gate before."""
    last = known[-1] if known else None
    before = last.position if last else origin
    way = gate.position - before
    distance = math.hypot(way[0], way[1])
    share = max(1.0 - standoff / distance, 0.0) if distance > 0.0 else 0.0
    point: Vector = before + share * way
    if last is not None:
        out = np.array((math.cos(last.yaw), math.sin(last.yaw), 0.0))
        point += max(EXIT_RUN - float(out @ (point - before)), 0.0) * out
    return point
