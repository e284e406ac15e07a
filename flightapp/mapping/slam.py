"""The gate map: a joint filter over the tracker's drift and all gates."""

import math
from collections.abc import Sequence

import numpy as np

from flightapp.config import Config
from flightapp.frames import Vector
from flightapp.mapping.filter import predict, sight
from flightapp.messages import Drift, GateEstimate, GateMap, GateSighting, PoseSample
from flightapp.track import Gate, Track

START_POSITION = 0.01
"""m, how well the tracker's frame lies on the world at the start, which defines the world."""
START_YAW = 0.005
"""rad, the same for the heading."""
SURVEY_POSITION = 0.02
"""m, least deviation of a surveyed gate."""
SURVEY_YAW = 0.02
"""rad, least deviation of a surveyed gate's heading."""
GATE_FLOORS = np.array((0.01, 0.005))
"""m and rad, below which no gate is believed to be known: calibration errors do not average out."""
LEAST_POSITION_ERROR = 0.005
"""m, systematic error of a sighting at no distance."""
LEAST_YAW_ERROR = 0.01
"""rad, systematic error of a sighting's yaw."""
AMBIGUITY = 4.0
"""χ² by which one of two poses must fit better for its yaw to be used."""
MOVED_RADIUS = 0.5
"""m within which refused sightings agree with each other."""
REOPENED_POSITION = 1.0
"""m, least deviation of a gate that has moved."""
REOPENED_YAW = 0.5
"""rad, deviation of its heading."""


class SlamMapper:
    """Gates and drift estimated together, so that each sighting improves both as their covariance says.

    A new map starts from the survey ``track`` with its `Uncertainty`, at ``stamp``, with no drift. The
    drift walks with time and speed. Consecutive frames share most of their error (mount, attitude,
    timing), so within ``mapping.correlation_time`` they count as one. A gate that is refused
    ``mapping.moved_after`` times in a row at one other place has moved and is learnt anew.
    """

    def __init__(self, config: Config, track: Track, stamp: float) -> None:
        m = self._config = config.mapping
        self._max_jump = config.estimation.max_jump
        self._ids = tuple(gate.id for gate in track.gates)
        self._index = {gate_id: i for i, gate_id in enumerate(self._ids)}
        n = len(self._ids)
        self._x = np.zeros(4 + 4 * n)
        self._P = np.zeros((4 + 4 * n, 4 + 4 * n))
        self._prior = _prior_deviations(track)
        deviations = [START_POSITION] * 3 + [START_YAW] + list(self._prior) * n
        self._P[np.diag_indices_from(self._P)] = np.square(deviations)
        for i, gate in enumerate(track.gates):
            self._x[4 + 4 * i : 8 + 4 * i] = _gate_state(gate)
        self._errors = np.array((m.attitude_error, m.range_error, m.sync_error, LEAST_POSITION_ERROR, LEAST_YAW_ERROR))
        self._stamp = stamp
        self._version = 0
        self._last_pose: PoseSample | None = None
        self._surveyed = [self._prior[0] <= m.known_sigma] * n
        self._sightings = [0] * n
        self._last_seen = [-math.inf] * n
        self._refused = [0] * n
        self._refused_at = np.zeros((n, 3))
        self._z = np.empty(4)

    def update(self, sightings: Sequence[GateSighting], pose: PoseSample) -> GateMap:
        """The map after ``sightings``, which were all seen from the tracker's ``pose``.

        It is meant to be called for every frame, also where nothing was seen: so it notices when the
        tracker relocalises.
        What is not finite, has an impossible covariance or is of a gate not on the track is ignored.
        """
        row = np.concatenate((pose.position, pose.orientation, pose.velocity, pose.angular_velocity), dtype=float)
        if math.isfinite(pose.stamp) and all(map(math.isfinite, row.tolist())):
            self._predict(pose, row)
            changed = [self._use(sighting, row, pose.stamp) for sighting in sightings]
            self._version += any(changed)
        return self.snapshot(self._stamp)

    def snapshot(self, stamp: float) -> GateMap:
        """The map as it stands, without new sightings, stamped ``stamp``."""
        x = self._x.copy()
        yaws = x[3::4].tolist()
        blocks = np.arange(len(yaws))
        covariances = self._P.reshape(len(yaws), 4, len(yaws), 4)[blocks, :, blocks]
        gates = tuple(
            GateEstimate(gate_id, x[4 * i : 4 * i + 3], yaws[i], covariances[i], count, last, surveyed)
            for i, (gate_id, count, last, surveyed) in enumerate(
                zip(self._ids, self._sightings, self._last_seen, self._surveyed, strict=True), start=1
            )
        )
        return GateMap(stamp, self._version, gates, Drift(self._stamp, x[0:3], yaws[0], covariances[0]))

    def _predict(self, pose: PoseSample, row: Vector) -> None:
        dt = pose.stamp - self._stamp
        if dt <= 0.0:
            return
        m = self._config
        speed = math.hypot(*row[7:10].tolist())
        across = math.hypot(m.drift_rate, m.drift_speed * speed)
        up = math.hypot(m.drift_rate, m.drift_speed_vertical * speed)
        rates = np.array((across, across, up, m.drift_yaw_rate))
        predict(self._x, self._P, row[0:3], dt, rates, self._unexplained(pose, row, speed))
        self._stamp = pose.stamp
        self._last_pose = pose

    def _unexplained(self, pose: PoseSample, row: Vector, speed: float) -> float:
        """Metres of the way since the last pose that the speed doesn't explain: the tracker relocalised."""
        last = self._last_pose
        if last is None:
            return 0.0
        speed = max(speed, math.hypot(*last.velocity.tolist()))
        way = math.dist(row[0:3].tolist(), last.position.tolist())
        return way if way > self._max_jump + speed * (pose.stamp - last.stamp) else 0.0

    def _use(self, sighting: GateSighting, pose: Vector, stamp: float) -> bool:
        """Correct the state with one sighting; whether anything changed."""
        i = self._index.get(sighting.gate_id)
        hypotheses = _hypotheses(sighting)
        if i is None or not all(map(math.isfinite, hypotheses.flat)):
            return False
        m = self._config
        since = max(stamp - self._last_seen[i], 1e-3)
        inflation = max(1.0, 2.0 * m.correlation_time / since)
        verdict = sight(
            self._x,
            self._P,
            4 + 4 * i,
            pose,
            hypotheses,
            self._errors,
            inflation,
            m.gate,
            AMBIGUITY,
            GATE_FLOORS,
            self._z,
        )
        if verdict <= 0:
            return verdict == 0 and self._refuse(i)
        self._refused[i] = 0
        self._sightings[i] += 1
        self._last_seen[i] = stamp
        return True

    def _refuse(self, i: int) -> bool:
        """Count a refused sighting of gate ``i``; True where it makes the gate a moved one."""
        c, s = math.cos(self._x[3]), math.sin(self._x[3])
        zx, zy, zz = self._z[:3]
        seen = self._x[0:3] + np.array((c * zx - s * zy, s * zx + c * zy, zz))
        agrees = math.dist(seen.tolist(), self._refused_at[i].tolist()) < MOVED_RADIUS
        self._refused[i] = self._refused[i] + 1 if agrees else 1
        self._refused_at[i] = seen
        if self._refused[i] < self._config.moved_after:
            return False
        self._reopen(i, seen)
        return True

    def _reopen(self, i: int, seen: Vector) -> None:
        """Forget where gate ``i`` was: it is somewhere about where it was ``seen``."""
        a = 4 + 4 * i
        self._P[a : a + 4, :] = 0.0
        self._P[:, a : a + 4] = 0.0
        position = max(self._prior[0], REOPENED_POSITION)
        self._P[range(a, a + 4), range(a, a + 4)] = np.square((position, position, position, REOPENED_YAW))
        self._x[a : a + 3] = seen
        self._refused[i] = 0
        self._surveyed[i] = False
        self._sightings[i] = 0
        self._last_seen[i] = -math.inf


def _gate_state(gate: Gate) -> Vector:
    return np.array((*gate.position, math.remainder(gate.yaw, 2.0 * math.pi)))


def _prior_deviations(track: Track) -> tuple[float, float, float, float]:
    """Deviations of x, y (a uniform disc), z and yaw (uniform intervals) before the first sighting."""
    u = track.uncertainty
    across = max(0.5 * u.horizontal, SURVEY_POSITION)
    up = max(u.vertical / math.sqrt(3.0), SURVEY_POSITION)
    return across, across, up, max(math.radians(u.yaw_deg) / math.sqrt(3.0), SURVEY_YAW)


def _hypotheses(sighting: GateSighting) -> Vector:
    """The sighting's pose, and its alternative where it has one, each with the covariance: (1 or 2, 43)."""
    poses = [(sighting.position, sighting.orientation)]
    if sighting.alternative is not None:
        poses.append(sighting.alternative)
    rows = np.empty((len(poses), 43))
    for row, (position, orientation) in zip(rows, poses, strict=True):
        row[0:3] = position
        row[3:7] = orientation
        row[7:43] = np.ravel(sighting.covariance)
    return rows
