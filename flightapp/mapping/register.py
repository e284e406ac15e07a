"""What is remembered of each gate besides its place: sightings, refusals, and what they mean."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

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


@dataclass(slots=True)
class GateRecord:
    """What the sightings of one gate told, and the vote of those that the map refused."""

    gate_id: int
    deviations: tuple[float, float, float, float]
    """Of x, y, z (m) and yaw (rad) before the first sighting."""
    placed: bool
    surveyed: bool
    sightings: int = 0
    last_seen: float = -math.inf
    votes: int = 0
    voted: Vector = field(default_factory=lambda: np.zeros(3))
    """(3,) m, the place that is voted on."""
    voted_since: float = math.inf
    contradictions: int = 0

    def vote(self, stamp: float, place: Vector) -> bool:
        """Count a sighting at ``place`` (3,); whether that is the one that is voted on."""
        agrees = math.dist(place.tolist(), self.voted.tolist()) < AGREEMENT
        if self.votes == 0:
            self.voted_since = stamp
        if agrees or self.votes == 0:
            self.votes += 1
            self.voted = place
        else:
            self.votes -= 1
        return agrees

    def used(self, stamp: float) -> None:
        """A sighting of it was used."""
        self.votes = 0
        self.sightings += 1
        self.last_seen = stamp

    def doubted(self) -> None:
        """It must be seen anew before it is known."""
        self.surveyed, self.sightings, self.votes = False, 0, 0


class GateRegister:
    """The gates of a track, by their place in the order of passage, with what their sightings told.

    Sightings that the map refuses vote on one other place of the gate: one there counts for it, one elsewhere against
    it (R. Boyer and J. Moore, "MJRTY: A fast majority vote algorithm", 1991), and one that fits the map ends the vote.
    Where ``mapping.moved_after`` are left for it the gate has moved; where only few sightings, perhaps wrong ones, tell
    of the gate's place, these few have to be outvoted. Refusals at one place amid sightings that fit mean that a second
    gate carries the same markers.
    """

    def __init__(self, config: Config, track: Track) -> None:
        m = config.mapping
        self.gates = tuple(_record(gate, track, m.known_sigma) for gate in track.passage)
        self.index = {gate.gate_id: i for i, gate in enumerate(self.gates)}
        self._moved_after = m.moved_after
        self._correlation_time, self._same_view = m.correlation_time, m.same_view
        self._frame = track.gate.opening + 2.0 * track.gate.border
        self.notices: list[str] = []
        """What is worth telling, oldest first."""

    def repeats(self, i: int, stamp: float, view_rate: float) -> float:
        """How many frames of the present rate count as one for what the lens gets wrong with a gate.

        That averages out as the view changes alone, with ``view_rate`` (rad/s).
        """
        same = max(self._correlation_time, self._same_view / max(view_rate, 1e-3))
        return max(1.0, 2.0 * same / max(stamp - self.gates[i].last_seen, 1e-3))

    def refused(self, i: int, stamp: float, place: Vector) -> bool:
        """Count a sighting of gate ``i`` at ``place`` (3,), which the map refused; True where the gate has moved."""
        gate = self.gates[i]
        agrees = gate.vote(stamp, place)
        if agrees and stamp - gate.last_seen < APART:
            gate.contradictions += 1
            if gate.contradictions == CONTRADICTIONS:
                self.notices.append(f"gate {gate.gate_id} is seen at two places: are its markers there twice?")
        few = self._moved_after if gate.surveyed else PLACED_AFTER + gate.sightings
        return agrees and gate.votes >= min(few, self._moved_after)

    def found(self, i: int, stamp: float, place: Vector) -> bool:
        """Count a sighting at ``place`` (3,) of gate ``i``, which has no place yet; True where it can be believed."""
        return self.gates[i].vote(stamp, place) and self.gates[i].votes >= PLACED_AFTER

    def lost(self, i: int) -> None:
        """Gate ``i`` is not where it should be."""
        self.notices.append(f"gate {self.gates[i].gate_id} should be in sight, but is not")
        self.gates[i].doubted()

    def placed_anew(self, i: int, stamp: float, place: Vector, left: Vector) -> None:
        """Gate ``i`` is now at ``place`` (3,), whatever was known of it; it was at ``left`` (3,) if anywhere."""
        gate, way = self.gates[i], math.dist(place.tolist(), left.tolist())
        if gate.placed and way < AGREEMENT:
            what = f"is seen {way:.2f} m beside its place: is the camera calibrated well? It is taken to be at"
        else:
            what = "has moved to" if gate.placed else "was found at"
        self.notices.append(f"gate {gate.gate_id} {what} ({place[0]:.1f}, {place[1]:.1f}, {place[2]:.1f})")
        # Those that voted for the place are sightings of it: its frame is to be kept clear of at once.
        gate.placed, gate.surveyed, gate.contradictions = True, False, 0
        gate.sightings, gate.votes, gate.last_seen = max(gate.votes, 1), 0, stamp

    def ousted(self, i: int, found: Vector, places: Vector, deviations: Vector) -> int | None:
        """Which gate can no longer be where the map has it, as gate ``i`` was just ``found`` (3,) there; None for none.

        ``places`` (n, 3) are those of the gates before, and ``deviations`` (n,) say how well these are known. Two
        frames do not stand in one place, so a gate that is thought to be there, and was not seen there since gate ``i``
        is, has most likely changed places with it.
        """
        if not self.gates[i].placed:
            return None
        away = np.linalg.norm(places - found, axis=1)
        reach = np.minimum(np.maximum(self._frame, 2.0 * deviations), away[i])
        fit = [
            j
            for j, gate in enumerate(self.gates)
            if j != i and gate.placed and away[j] < reach[j] and gate.last_seen < self.gates[i].voted_since
        ]
        return min(fit, key=lambda j: float(away[j]), default=None)

    def swapped(self, i: int, j: int) -> None:
        """Gate ``j`` is taken to be where gate ``i`` was before it was placed anew."""
        a, b = self.gates[i].gate_id, self.gates[j].gate_id
        self.notices.append(f"gate {a} is where gate {b} was thought to be: they may have changed places")
        self.gates[j].doubted()


def _record(gate: MarkedGate, track: Track, known_sigma: float) -> GateRecord:
    deviations, placed = prior_deviations(gate, track), isinstance(gate, Gate)
    return GateRecord(gate.id, deviations, placed, placed and deviations[0] <= known_sigma)


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
