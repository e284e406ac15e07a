"""What is remembered of each gate besides its place: sightings, refusals, and what they mean."""

import math
from collections.abc import Sequence

import numpy as np

from flightapp.config import Config
from flightapp.frames import Vector
from flightapp.messages import GateSighting
from flightapp.track import Gate, MarkedGate, Track

SURVEY_POSITION = 0.02
"""m, least deviation of a surveyed gate."""
SURVEY_YAW = 0.02
"""rad, least deviation of a surveyed gate's heading."""
AGREEMENT = 0.5
"""m within which sightings agree with each other."""
PLACED_AFTER = 3
"""Sightings by which one place of a gate must lead where nothing was known of it."""
APART = 1.0
"""s without a sighting that fits, after which a refused one is no longer a contradiction."""
CONTRADICTIONS = 5
"""Refused sightings at one place amid good ones that mean that the same markers are at two places."""


class GateRegister:
    """The gates of a track, by their place in the order of passage, with what their sightings told.

    Sightings that the map refuses vote on one other place of the gate: one there counts for it, one elsewhere against
    it (R. Boyer and J. Moore, "MJRTY: A fast majority vote algorithm", 1991), and one that fits the map ends the vote.
    Where ``mapping.moved_after`` are left for it the gate has moved; where only few sightings, perhaps wrong ones, tell
    of the gate's place, these few have to be outvoted. Refusals at one place amid sightings that fit mean that a second
    gate carries the same markers.
    """

    def __init__(self, config: Config, track: Track) -> None:
        n = len(track.passage)
        self.ids = tuple(gate.id for gate in track.passage)
        self.index = {gate_id: i for i, gate_id in enumerate(self.ids)}
        self.placed = [isinstance(gate, Gate) for gate in track.passage]
        self.deviations = [prior_deviations(gate, track) for gate in track.passage]
        """(4,) of x, y, z (m) and yaw (rad) of each gate before the first sighting."""
        known = config.mapping.known_sigma
        self.surveyed = [p and d[0] <= known for p, d in zip(self.placed, self.deviations, strict=True)]
        self.sightings = [0] * n
        self.last_seen = [-math.inf] * n
        self._moved_after = config.mapping.moved_after
        self._correlation_time = config.mapping.correlation_time
        self._refused = [0] * n
        self._refused_at = np.zeros((n, 3))
        self._contradictions = [0] * n
        self.notices: list[str] = []
        """What is worth telling, oldest first."""

    def inflation(self, i: int, stamp: float) -> float:
        """How many frames of the present rate count as one: errors of mount and calibration do not average out."""
        return max(1.0, 2.0 * self._correlation_time / max(stamp - self.last_seen[i], 1e-3))

    def used(self, i: int, stamp: float) -> None:
        """A sighting of gate ``i`` was used."""
        self._refused[i] = 0
        self.sightings[i] += 1
        self.last_seen[i] = stamp

    def refused(self, i: int, stamp: float, place: Vector) -> bool:
        """Count a sighting of gate ``i`` at ``place`` (3,), which the map refused; True where the gate has moved."""
        agrees = self._vote(i, place)
        if agrees and stamp - self.last_seen[i] < APART:
            self._contradictions[i] += 1
            if self._contradictions[i] == CONTRADICTIONS:
                self.notices.append(f"gate {self.ids[i]} is seen at two places: are its markers there twice?")
        few = self._moved_after if self.surveyed[i] else PLACED_AFTER + self.sightings[i]
        return agrees and self._refused[i] >= min(few, self._moved_after)

    def found(self, i: int, place: Vector) -> bool:
        """Count a sighting at ``place`` (3,) of gate ``i``, which has no place yet; True where it can be believed."""
        return self._vote(i, place) and self._refused[i] >= PLACED_AFTER

    def _vote(self, i: int, place: Vector) -> bool:
        """Whether ``place`` is the one that is voted on."""
        agrees = math.dist(place.tolist(), self._refused_at[i].tolist()) < AGREEMENT
        if agrees or self._refused[i] == 0:
            self._refused[i] += 1
            self._refused_at[i] = place
        else:
            self._refused[i] -= 1
        return agrees

    def lost(self, i: int) -> None:
        """Gate ``i`` is not where it should be: it must be seen anew before it is known."""
        self.notices.append(f"gate {self.ids[i]} should be in sight, but is not")
        self.surveyed[i], self.sightings[i] = False, 0

    def placed_anew(self, i: int, stamp: float, place: Vector) -> None:
        """Gate ``i`` is now at ``place`` (3,), whatever was known of it."""
        what = "has moved to" if self.placed[i] else "was found at"
        self.notices.append(f"gate {self.ids[i]} {what} ({place[0]:.1f}, {place[1]:.1f}, {place[2]:.1f})")
        self.placed[i], self.surveyed[i] = True, False
        self._refused[i], self.sightings[i], self._contradictions[i] = 0, 1, 0
        self.last_seen[i] = stamp


def prior_state(gate: MarkedGate) -> Vector:
    """(4,) position and yaw of ``gate``; zeros where they are not known."""
    if not isinstance(gate, Gate):
        return np.zeros(4)
    return np.array((*gate.position, math.remainder(gate.yaw, 2.0 * math.pi)))


def prior_deviations(gate: MarkedGate, track: Track) -> tuple[float, float, float, float]:
    """Deviations of x, y (a uniform disc), z and yaw (uniform intervals) of ``gate`` before the first sighting."""
    u = gate.uncertainty if isinstance(gate, Gate) and gate.uncertainty is not None else track.uncertainty
    across = max(0.5 * u.horizontal, SURVEY_POSITION)
    up = max(u.vertical / math.sqrt(3.0), SURVEY_POSITION)
    return across, across, up, max(math.radians(u.yaw_deg) / math.sqrt(3.0), SURVEY_YAW)


def hypotheses(sighting: GateSighting) -> Vector:
    """The sighting's pose, and its alternative where it has one, each with the covariance: (1 or 2, 43)."""
    poses: Sequence[tuple[Vector, Vector]] = ((sighting.position, sighting.orientation),)
    if sighting.alternative is not None:
        poses = (*poses, sighting.alternative)
    rows = np.empty((len(poses), 43))
    for row, (position, orientation) in zip(rows, poses, strict=True):
        row[0:3] = position
        row[3:7] = orientation
        row[7:43] = np.ravel(sighting.covariance)
    return rows
